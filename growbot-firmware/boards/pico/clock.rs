//! The board's clocks, 125 MHz from the crystal's 12 MHz, and the board's time, which the timer counts in microseconds.

use rp2040_pac as pac;

/// Frequency of the processor's clock, Hz.
pub const PROCESSOR_HZ: u32 = 125_000_000;
/// Bits of the used peripherals in the reset register: ADC, both banks of pins and pads, both PLLs, PWM, timer, both
/// UARTs (data sheet, 2.14.3).
const USED: u32 = 1 | 1 << 5 | 1 << 8 | 1 << 12 | 1 << 13 | 1 << 14 | 1 << 21 | 1 << 22 | 1 << 23;
/// Frequency of the crystal, MHz.
const CRYSTAL_MHZ: u32 = 12;
/// Number of readings of the timer, one a step tick, after which an unchanged timer counts as stopped. Ticks are at
/// least 10 us apart and the timer counts microseconds, so one reading would be enough.
const STANDING: u32 = 4;
/// Value of the crystal oscillator's control register: on, at 1 to 15 MHz.
const CRYSTAL_ON: u32 = 0xFA_BAA0;
/// Start-up delay of the crystal, 1 ms: 47 times 256 clocks.
const CRYSTAL_DELAY: u32 = 47;
const STABLE: u32 = 1 << 31;
const LOCKED: u32 = 1 << 31;
/// Power-down bits of all parts of a PLL. `PLL_DIVIDERS_OFF` is the bit of its dividers alone.
const PLL_OFF: u32 = 0b101101;
const PLL_DIVIDERS_OFF: u32 = 1 << 3;

/// Starts a PLL: multiplies the crystal's 12 MHz by `factor` and divides the result by both dividers.
fn run_pll(pll: &pac::pll_sys::RegisterBlock, factor: u32, dividers: [u32; 2]) {
    let [first, second] = dividers;
    // SAFETY: oscillators of 750 to 1600 MHz and dividers of 1 to 7, as the data sheet allows (2.18.2).
    unsafe {
        pll.pwr().write(|w| w.bits(PLL_OFF));
        pll.cs().write(|w| w.bits(1));
        pll.fbdiv_int().write(|w| w.bits(factor));
        pll.pwr().write(|w| w.bits(PLL_DIVIDERS_OFF));
        while pll.cs().read().bits() & LOCKED == 0 {}
        pll.prim().write(|w| w.bits(first << 16 | second << 12));
        pll.pwr().write(|w| w.bits(0));
    }
}

/// Starts the crystal, the clocks of processor and peripherals, and the timer. If a part never gets ready, this waits
/// without end, with everything off. The watchdog counts only after the end of this function.
pub fn start(device: &pac::Peripherals) {
    let (clocks, crystal) = (&device.CLOCKS, &device.XOSC);
    // SAFETY: values of the data sheet (2.15 to 2.18), in its order. No part runs from a clock while it changes.
    unsafe {
        crystal.startup().write(|w| w.bits(CRYSTAL_DELAY));
        crystal.ctrl().write(|w| w.bits(CRYSTAL_ON));
        while crystal.status().read().bits() & STABLE == 0 {}
        // The reference runs from the crystal, and so does the processor while the PLLs start.
        clocks.clk_sys_ctrl().write(|w| w.bits(0));
        while clocks.clk_sys_selected().read().bits() != 1 {}
        clocks.clk_ref_ctrl().write(|w| w.bits(2));
        while clocks.clk_ref_selected().read().bits() != 1 << 2 {}
        device.RESETS.reset().modify(|r, w| w.bits(r.bits() & !USED));
        while device.RESETS.reset_done().read().bits() & USED != USED {}
        run_pll(&device.PLL_SYS, 125, [6, 2]);
        run_pll(&device.PLL_USB, 100, [5, 5]);
        // The processor runs from its PLL, peripherals from the processor's clock, USB and the ADC from 48 MHz.
        clocks.clk_sys_div().write(|w| w.bits(1 << 8));
        clocks.clk_sys_ctrl().write(|w| w.bits(0));
        clocks.clk_sys_ctrl().write(|w| w.bits(1));
        while clocks.clk_sys_selected().read().bits() != 1 << 1 {}
        clocks.clk_peri_ctrl().write(|w| w.bits(1 << 11));
        clocks.clk_usb_div().write(|w| w.bits(1 << 8));
        clocks.clk_usb_ctrl().write(|w| w.bits(1 << 11));
        clocks.clk_adc_div().write(|w| w.bits(1 << 8));
        clocks.clk_adc_ctrl().write(|w| w.bits(1 << 11));
        device.WATCHDOG.tick().write(|w| w.bits(1 << 9 | CRYSTAL_MHZ));
    }
}

/// Detector of a crystal that stops. The timer and the watchdog count by the crystal and stop with it. Supervision
/// would then see no time pass, and feed a watchdog that never expires. The processor's PLL may run on without the
/// crystal, and the step interrupt with it.
pub struct CrystalMonitor {
    /// Lower half of the timer's count at the latest check, us.
    latest: u32,
    /// Number of consecutive checks at which the timer had the count `latest`.
    same: u32,
}

impl CrystalMonitor {
    /// Creates the detector, before its first check.
    pub const fn new() -> Self {
        Self { latest: 0, same: 0 }
    }

    /// Checks the timer and returns whether it has stopped. Call it at each step tick.
    #[inline(always)] // The interrupt that calls it runs from memory.
    pub fn has_stopped(&mut self) -> bool {
        // SAFETY: reading this register has no effect.
        let now = unsafe { (*pac::TIMER::ptr()).timerawl().read().bits() };
        self.same = if now == self.latest { self.same.saturating_add(1) } else { 0 };
        self.latest = now;
        self.same >= STANDING
    }
}

/// Returns the time since the board started, us.
pub fn now_us() -> u64 {
    // SAFETY: reading these registers has no effect.
    let timer = unsafe { &*pac::TIMER::ptr() };
    loop {
        let high = timer.timerawh().read().bits();
        let low = timer.timerawl().read().bits();
        if high == timer.timerawh().read().bits() {
            return u64::from(high) << 32 | u64::from(low);
        }
    }
}
