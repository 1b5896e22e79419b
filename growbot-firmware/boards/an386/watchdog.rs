//! The watchdog of the board. The first expiry is a non-maskable interrupt, and the second one resets the board.

use growbot_firmware::hal::Watchdog;

use crate::registers::Register;
use crate::tip;

const BASE: usize = 0x4000_8000;
// SAFETY: the registers of the watchdog, which only this file uses.
const LOAD: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const CONTROL: Register = unsafe { Register::at(BASE + 0x08) };
// SAFETY: as above.
const INTERRUPT_CLEAR: Register = unsafe { Register::at(BASE + 0x0C) };
// SAFETY: as above.
const LOCK: Register = unsafe { Register::at(BASE + 0xC00) };

const UNLOCK: u32 = 0x1ACC_E551;
const CONTROL_INTERRUPT: u32 = 1 << 0;
const CONTROL_RESET: u32 = 1 << 1;

/// The running watchdog. It cannot be stopped.
pub struct CmsdkWatchdog(());

/// Timeout of the watchdog, s. Time on this board is that of the desktop, which may stop the emulator for a while when
/// it has other work. The timeout of the robot's board is 1 s.
const PATIENCE: u32 = 10;

/// Starts the watchdog. It makes the outputs safe after [`PATIENCE`] without a feed, and resets the board after twice
/// that time.
pub fn start(clock_hz: u32) -> CmsdkWatchdog {
    LOCK.write(UNLOCK);
    LOAD.write(clock_hz.saturating_mul(PATIENCE));
    CONTROL.write(CONTROL_INTERRUPT | CONTROL_RESET);
    LOCK.write(0);
    CmsdkWatchdog(())
}

impl Watchdog for CmsdkWatchdog {
    fn feed(&mut self) {
        feed();
        tip::count_feed();
    }
}

fn feed() {
    LOCK.write(UNLOCK);
    INTERRUPT_CLEAR.write(1);
    LOCK.write(0);
}

/// Feeds the watchdog and does nothing else while the host requests that the main loop hang. In this time only an
/// interrupt can switch anything off.
pub fn hang() {
    while tip::wants_hang() {
        feed();
    }
}
