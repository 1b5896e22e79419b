//! Supply of the processor: the detector that warns before the voltage is too low, and the reset that stops the
//! processor while the voltage is too low.
//!
//! The detector's interrupt switches all outputs of the tip off and restarts the board, which then reports "brown-out".
//! The interrupt occurs only when the voltage falls below the threshold. A board whose supply is still rising, or
//! always below the threshold, therefore starts nevertheless, and writes a warning to its log.

use growbot_firmware::guarded_flash::SupplyMonitor;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc};

/// Threshold of the detector (field PLS): 2.93 V falling (2.85 to 2.99), 3.03 V rising (data sheet, table "embedded
/// reset and power control block characteristics"). The processor may run at 168 MHz down to 2.7 V. The next level,
/// 3.03 V, is within the tolerance of 3.3 V.
const LEVEL: u8 = 0b110;
/// Number of the detector's line at the interrupt controller EXTI (reference manual, 12.2.5).
const LINE: u8 = 16;

/// Starts the detector of the processor's supply voltage. It starts fast, but its first output is not reliable.
pub fn start_detector(pwr: &pac::PWR, rcc: &mut Rcc) {
    pac::PWR::enable(rcc);
    // SAFETY: PLS has three bits, and every value is a level.
    pwr.cr().modify(|_, w| unsafe { w.pls().bits(LEVEL) }.pvde().set_bit());
}

/// The running detector of the processor's supply voltage. Its threshold is above the voltage at which flash can be
/// programmed by words (2.7 V, data sheet DS8626).
pub struct PvdMonitor;

impl SupplyMonitor for PvdMonitor {
    fn is_enough(&self) -> bool {
        // SAFETY: a read of this register has no effect.
        unsafe { &*pac::PWR::ptr() }.csr().read().pvdo().bit_is_clear()
    }
}

/// Enables the interrupt that occurs when the supply falls below the detector's threshold. Call it before the journal
/// is opened, but as late as possible in the start-up. The interrupt is served once the start-up is over.
pub fn arm(pwr: &pac::PWR, exti: &pac::EXTI) {
    // The detector's output rises when the supply falls.
    exti.rtsr().modify(|_, w| w.tr(LINE).set_bit());
    // Earlier events do not count. The flag is cleared by writing a one, and no other flag is changed.
    exti.pr().write(|w| w.pr(LINE).clear_bit_by_one());
    exti.imr().modify(|_, w| w.mr(LINE).set_bit());
    if pwr.csr().read().pvdo().bit_is_set() {
        defmt::warn!("the processor's supply is below 2.9 V");
    }
}

/// Writes a warning to the log if the option bytes disable the brown-out reset. In that case the processor runs on
/// while its supply sags to 1.7 V.
pub fn check_reset_level(flash: &pac::FLASH) {
    // BOR_LEV, bits 3:2 (reference manual, 3.9.10): 11 is off, as boards are delivered, and 00 is the highest level.
    if flash.optcr().read().bor_lev().bits() == 0b11 {
        defmt::warn!("the brown-out reset is off: set BOR_LEV to level 3 (WIRING.md)");
    }
}
