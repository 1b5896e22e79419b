//! The watchdog: resets 2 s after it was last fed.

use growbot_firmware::hal::Watchdog;
use rp2040_pac as pac;

/// Counts of 2 s: two a microsecond (erratum RP2040-E1).
const COUNTS: u32 = 4_000_000;
/// It resets all but the two oscillators.
const ALL_BUT_OSCILLATORS: u32 = 0x1_FFFC;
/// On, and not paused by a debug probe.
const ON: u32 = 1 << 30;

/// The running watchdog.
pub struct BoardWatchdog(());

/// Starts the watchdog. It counts from when the clocks run.
pub fn start(device: &pac::Peripherals) -> BoardWatchdog {
    // SAFETY: the bits of all parts that a reset is to reach.
    device.PSM.wdsel().write(|w| unsafe { w.bits(ALL_BUT_OSCILLATORS) });
    feed();
    // SAFETY: a whole register; only the watchdog's start and end write it.
    device.WATCHDOG.ctrl().write(|w| unsafe { w.bits(ON) });
    BoardWatchdog(())
}

/// Feeds it, from any context.
pub fn feed() {
    // SAFETY: writing the load value has no other effect than to feed.
    unsafe { (*pac::WATCHDOG::ptr()).load().write(|w| w.bits(COUNTS)) };
}

impl Watchdog for BoardWatchdog {
    fn feed(&mut self) {
        feed();
    }
}
