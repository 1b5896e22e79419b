//! The analog inputs of thermistor and supply. ADC1 converts one of them at a time, alternately, and no code waits for
//! it.
//!
//! The first call of `sample` switches the ADC on, so that the link responds first after start-up.

use core::sync::atomic::{AtomicU32, Ordering};

use growbot_firmware::hal::Adc;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use crate::pins::{SupplyInput, ThermistorInput};

/// Channel number of ADC1's input at PC0 (data sheet, table 7).
const THERMISTOR: u8 = 10;
/// Channel number of ADC1's input at PC1.
const SUPPLY: u8 = 11;

/// Latest unread conversion of the supply. [`NONE`] if the latest one was read.
static SUPPLY_READING: AtomicU32 = AtomicU32::new(NONE);
const NONE: u32 = u32::MAX;

/// Input of the thermistor. It owns the ADC, which converts both inputs.
pub struct ThermistorAdc {
    adc: pac::ADC1,
    common: pac::ADC_COMMON,
    state: Stm32AdcState,
    _pin: ThermistorInput,
}

/// Input of the supply. It is converted when the thermistor is sampled.
pub struct SupplyAdc {
    _pin: SupplyInput,
}

enum Stm32AdcState {
    /// The ADC has not been started.
    Off,
    /// The ADC has just been switched on. It needs 3 us to settle (data sheet, table 67), which the time until the next
    /// call exceeds.
    Settling,
    /// A conversion of the thermistor is running or done.
    ConvertingThermistor,
    /// A conversion of the supply is running or done.
    ConvertingSupply,
}

/// Creates the inputs of thermistor and supply. Enables the clock of the ADC, but does not start it.
pub fn new(
    adc: pac::ADC1,
    common: pac::ADC_COMMON,
    thermistor: ThermistorInput,
    supply: SupplyInput,
    rcc: &mut Rcc,
) -> (ThermistorAdc, SupplyAdc) {
    pac::ADC1::enable(rcc);
    (ThermistorAdc { adc, common, state: Stm32AdcState::Off, _pin: thermistor }, SupplyAdc { _pin: supply })
}

impl ThermistorAdc {
    fn switch_on(&mut self) {
        // 84 MHz / 4: the data sheet allows up to 36 MHz.
        self.common.ccr().modify(|_, w| w.adcpre().div4());
        // The sampling time is the longest one, 480 clocks, because dividers are weak sources.
        self.adc.smpr1().modify(|_, w| w.smp10().cycles480().smp11().cycles480());
        self.adc.cr2().write(|w| w.adon().set_bit());
    }

    fn begin(&mut self, channel: u8) {
        // SAFETY: called with 10 and 11, which exist.
        self.adc.sqr3().write(|w| unsafe { w.sq1().bits(channel) });
        self.adc.cr2().modify(|_, w| w.swstart().set_bit());
    }

    /// Returns the result of the running conversion. `None` while it is not done.
    fn read_converted(&mut self) -> Option<u16> {
        // Reading the data clears the flag.
        self.adc.sr().read().eoc().is_complete().then(|| self.adc.dr().read().data().bits() & 0xFFF)
    }
}

impl Adc for ThermistorAdc {
    /// Returns the result of the thermistor's conversion if it has ended since the last call, and starts the next
    /// conversion. Returns `None` in every other call, in which the supply's conversion is read, and in a call within
    /// 25 us of the last one.
    fn sample(&mut self) -> Option<u16> {
        match self.state {
            Stm32AdcState::Off => {
                self.switch_on();
                self.state = Stm32AdcState::Settling;
                None
            }
            Stm32AdcState::Settling => {
                self.begin(THERMISTOR);
                self.state = Stm32AdcState::ConvertingThermistor;
                None
            }
            Stm32AdcState::ConvertingThermistor => {
                let reading = self.read_converted()?;
                self.begin(SUPPLY);
                self.state = Stm32AdcState::ConvertingSupply;
                Some(reading)
            }
            Stm32AdcState::ConvertingSupply => {
                let reading = self.read_converted()?;
                self.begin(THERMISTOR);
                self.state = Stm32AdcState::ConvertingThermistor;
                SUPPLY_READING.store(u32::from(reading), Ordering::Relaxed);
                None
            }
        }
    }
}

impl Adc for SupplyAdc {
    fn sample(&mut self) -> Option<u16> {
        u16::try_from(SUPPLY_READING.swap(NONE, Ordering::Relaxed)).ok()
    }
}
