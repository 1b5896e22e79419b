//! The independent watchdog: resets about 1 s after it was last fed (0.7 to 2 s, over the tolerance of its oscillator).

use growbot_firmware::hal::Watchdog;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::watchdog::IndependentWatchdog;

/// The running watchdog. It cannot be stopped again.
pub struct BoardWatchdog(IndependentWatchdog);

/// Starts the watchdog. It pauses while a debugger holds the processor.
pub fn start(iwdg: pac::IWDG, debug: &pac::DBGMCU) -> BoardWatchdog {
    let mut watchdog = IndependentWatchdog::new(iwdg);
    watchdog.stop_on_debug(debug, true);
    watchdog.start(1.secs());
    BoardWatchdog(watchdog)
}

impl Watchdog for BoardWatchdog {
    fn feed(&mut self) {
        self.0.feed();
    }
}
