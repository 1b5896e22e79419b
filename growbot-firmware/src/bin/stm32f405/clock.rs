//! The board's clock: SysTick, a thousand times a second, and the microseconds between.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// SysTicks a second.
pub const TICK_HZ: u32 = 1_000;

static MILLISECONDS_LO: AtomicU32 = AtomicU32::new(0);
static MILLISECONDS_HI: AtomicU32 = AtomicU32::new(0);

/// Starts SysTick on the processor's clock.
pub fn start(syst: &mut SYST, processor_hz: u32) {
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload((processor_hz / TICK_HZ).saturating_sub(1));
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
}

/// The SysTick interrupt.
pub fn on_tick() {
    let low = MILLISECONDS_LO.load(Ordering::Relaxed).wrapping_add(1);
    let high = MILLISECONDS_HI.load(Ordering::Relaxed).wrapping_add(u32::from(low == 0));
    // High before low: `milliseconds` reads them the other way round and so notices a carry.
    MILLISECONDS_HI.store(high, Ordering::Release);
    MILLISECONDS_LO.store(low, Ordering::Release);
}

/// Milliseconds since the board started.
pub fn milliseconds() -> u64 {
    loop {
        let high = MILLISECONDS_HI.load(Ordering::Acquire);
        let low = MILLISECONDS_LO.load(Ordering::Acquire);
        if high == MILLISECONDS_HI.load(Ordering::Acquire) {
            return u64::from(high) << 32 | u64::from(low);
        }
    }
}

/// Microseconds since the board started. For code that the SysTick interrupt may interrupt; it would repeat up to a millisecond
/// otherwise.
pub fn now_us() -> u64 {
    loop {
        let before = milliseconds();
        let left = SYST::get_current();
        if milliseconds() == before {
            let whole = SYST::get_reload().saturating_add(1);
            let gone = whole.saturating_sub(left).min(whole.saturating_sub(1));
            return before * 1_000 + u64::from(gone) * 1_000 / u64::from(whole.max(1));
        }
    }
}
