//! The watchdog, which resets the board 2 s after it was last fed.

use growbot_firmware::hal::Watchdog;
use rp2040_pac as pac;

/// Timeout of the watchdog, 2 s, in its counts: two a microsecond (erratum RP2040-E1).
const COUNTS: u32 = 4_000_000;
/// Bits of the parts of the chip that the watchdog resets: all except the two oscillators.
const ALL_BUT_OSCILLATORS: u32 = 0x1_FFFC;
/// Bit that enables the watchdog. Without the bits that pause it for a debug probe, it continues in a halt.
const ON: u32 = 1 << 30;

/// The running watchdog.
pub struct Rp2040Watchdog(());

/// Starts the watchdog. It begins to count once the clocks run.
pub fn start(device: &pac::Peripherals) -> Rp2040Watchdog {
    // SAFETY: the bits of all parts that the reset must reach.
    device.PSM.wdsel().write(|w| unsafe { w.bits(ALL_BUT_OSCILLATORS) });
    feed();
    // SAFETY: a whole register, which only the start and the end of the watchdog write.
    device.WATCHDOG.ctrl().write(|w| unsafe { w.bits(ON) });
    Rp2040Watchdog(())
}

/// Feeds the watchdog, from any context.
pub fn feed() {
    // SAFETY: a write of the load value only feeds the watchdog.
    unsafe { (*pac::WATCHDOG::ptr()).load().write(|w| w.bits(COUNTS)) };
}

impl Watchdog for Rp2040Watchdog {
    fn feed(&mut self) {
        feed();
    }
}
