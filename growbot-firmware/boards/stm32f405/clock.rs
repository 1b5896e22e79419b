//! The board's clocks and time. SysTick counts milliseconds, and its counter gives the microseconds between them.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use stm32f4xx_hal::pac;

/// Frequency of the processor's clock, Hz.
pub const PROCESSOR_HZ: u32 = 168_000_000;
/// Frequency of the clock of the peripherals on the first bus (APB1), Hz.
pub const APB1_HZ: u32 = PROCESSOR_HZ / 4;
/// Frequency of the clock of the timers on the first bus (APB1), which is twice that of its peripherals, Hz.
pub const APB1_TIMER_HZ: u32 = PROCESSOR_HZ / 2;

/// Number of SysTick interrupts a second.
const TICK_HZ: u32 = 1_000;

static MILLISECONDS_LO: AtomicU32 = AtomicU32::new(0);
static MILLISECONDS_HI: AtomicU32 = AtomicU32::new(0);

/// Frequency of the internal oscillator, from which the processor starts, Hz.
const INTERNAL_HZ: u32 = 16_000_000;
/// Time for which the start waits for the crystal, ms. A crystal takes some 2 ms (data sheet, table "HSE oscillator
/// characteristics"), and the watchdog's timeout is at least 700 ms.
const CRYSTAL_WAIT_MS: u32 = 100;
/// Number of clocks that one check of the crystal takes. It is 7 to 10: a count, a load, a shift, and two branches, of
/// which the taken one has 2 to 4.
const LOOK_CLOCKS: u32 = 8;
/// Max number of checks of a crystal that does not start: 200,000, which take 88 to 125 ms.
const MAX_LOOKS: u32 = INTERNAL_HZ / 1000 * CRYSTAL_WAIT_MS / LOOK_CLOCKS;

/// Source of the board's clocks.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum ClockSource {
    /// The crystal, monitored by the clock security system.
    Crystal,
    /// The oscillator in the processor, because the crystal did not start. It is exact to 1 % at 25 C, and to 8 % over
    /// all temperatures. The link usually works with it, so that the board can report the fault. Nothing heats.
    Internal,
}

/// Starts the 168 MHz clock from the crystal's 8 MHz, or from the internal oscillator's 16 MHz if the crystal does not
/// start. (The set-up of `stm32f4xx-hal`, for clocks of any rate, leaves panics in the firmware. The clock rates that
/// this crate returns afterwards are those from before.)
///
/// The watchdog must have been started: if a part never gets ready, the watchdog resets the board, with every pin
/// floating.
pub fn speed_up(rcc: &pac::RCC, flash: &pac::FLASH) -> ClockSource {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let starts = (0..MAX_LOOKS).any(|_| rcc.cr().read().hserdy().bit_is_set());
    if starts {
        // From now on a crystal that stops causes a non-maskable interrupt, and the processor runs on by the internal
        // oscillator.
        rcc.cr().modify(|_, w| w.csson().set_bit());
    } else {
        rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }
    // The PLL computes 8 MHz / 4, or 16 MHz / 8, times 168 / 2. The divider 7 makes the 48 MHz of parts that are not
    // used.
    // SAFETY: factors within the ranges of the reference manual: 2 to 63, 50 to 432, 2 to 15.
    rcc.pllcfgr().write(|w| unsafe {
        let w = if starts { w.pllsrc().hse().pllm().bits(4) } else { w.pllsrc().hsi().pllm().bits(8) };
        w.plln().bits(168).pllp().div2().pllq().bits(7)
    });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    while rcc.cr().read().pllrdy().bit_is_clear() {}
    // Flash is slower than the processor by 5 clocks at 168 MHz and 3.3 V.
    flash.acr().write(|w| w.latency().ws5().prften().set_bit().icen().set_bit().dcen().set_bit());
    rcc.cfgr().modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2());
    // The new ratios take effect after up to 16 clocks.
    cortex_m::asm::delay(16);
    rcc.cfgr().modify(|_, w| w.sw().pll());
    while !rcc.cfgr().read().sws().is_pll() {}
    if starts { ClockSource::Crystal } else { ClockSource::Internal }
}

/// Non-maskable interrupt of the clock security system: the crystal has stopped. The processor now runs on its internal
/// oscillator, ten times slower, so every task would miss its deadline.
#[exception]
unsafe fn NonMaskableInt() {
    crate::reset::reset_on_clock_failure();
}

/// Starts SysTick on the processor's clock, with an interrupt each millisecond.
pub fn start(syst: &mut SYST) {
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(PROCESSOR_HZ / TICK_HZ - 1);
    syst.clear_current();
    syst.enable_interrupt();
    syst.enable_counter();
}

/// Handles the SysTick interrupt: counts a millisecond.
pub fn on_tick() {
    let low = MILLISECONDS_LO.load(Ordering::Relaxed).wrapping_add(1);
    let high = MILLISECONDS_HI.load(Ordering::Relaxed).wrapping_add(u32::from(low == 0));
    // The high word is stored before the low one. `milliseconds` reads both in the reverse order and so detects a
    // carry.
    MILLISECONDS_HI.store(high, Ordering::Release);
    MILLISECONDS_LO.store(low, Ordering::Release);
}

/// Returns the time since the board started, ms.
pub fn milliseconds() -> u64 {
    loop {
        let high = MILLISECONDS_HI.load(Ordering::Acquire);
        let low = MILLISECONDS_LO.load(Ordering::Acquire);
        if high == MILLISECONDS_HI.load(Ordering::Acquire) {
            return u64::from(high) << 32 | u64::from(low);
        }
    }
}

/// Returns the time since the board started, us. Only code that the SysTick interrupt can interrupt may call this.
/// Other code would see up to a millisecond twice.
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
