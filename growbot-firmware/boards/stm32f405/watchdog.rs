//! The independent watchdog, which resets the board about 1 s after it was last fed (0.7 to 2 s, over the tolerance of
//! its oscillator).

use growbot_firmware::hal::Watchdog;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::watchdog::IndependentWatchdog;

use crate::debug_port::DebugFreeze;

/// The running watchdog. It cannot be stopped.
pub struct Stm32Watchdog {
    watchdog: IndependentWatchdog,
    halts: DebugFreeze,
}

/// Starts the watchdog. It keeps counting while a debug probe halts the processor, as `halts` configures.
pub fn start(iwdg: pac::IWDG, halts: DebugFreeze) -> Stm32Watchdog {
    let mut watchdog = IndependentWatchdog::new(iwdg);
    watchdog.start(1.secs());
    Stm32Watchdog { watchdog, halts }
}

impl Watchdog for Stm32Watchdog {
    fn feed(&mut self) {
        self.halts.assert();
        self.watchdog.feed();
    }
}
