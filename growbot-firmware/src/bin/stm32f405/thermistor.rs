//! The thermistor: ADC1 channel 10, one conversion at a time, never waited for.
//!
//! The converter is switched on by the first call of `sample`, not at start-up: the link answers first.

use growbot_firmware::hal::Thermistor;
use stm32f4xx_hal::gpio::{Analog, PC0};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc};

const CHANNEL: u8 = 10;

/// The converter, and what it is doing.
pub struct BoardThermistor {
    adc: pac::ADC1,
    common: pac::ADC_COMMON,
    state: State,
    _pin: PC0<Analog>,
}

enum State {
    /// Not touched yet.
    Off,
    /// Switched on; needs 3 us to settle, which the time until the next call is.
    Settling,
    /// A conversion is running or done.
    Converting,
}

impl BoardThermistor {
    /// Clocks the converter, and leaves it alone.
    pub fn new(adc: pac::ADC1, common: pac::ADC_COMMON, pin: PC0<Analog>, rcc: &mut Rcc) -> Self {
        pac::ADC1::enable(rcc);
        BoardThermistor { adc, common, state: State::Off, _pin: pin }
    }

    fn switch_on(&mut self) {
        // 84 MHz / 4: the data sheet allows up to 36 MHz.
        self.common.ccr().modify(|_, w| w.adcpre().div4());
        // The longest sampling time, 480 clocks, since a thermistor's divider is a weak source.
        self.adc.smpr1().modify(|_, w| w.smp10().cycles480());
        // SAFETY: channel 10 exists.
        self.adc.sqr3().write(|w| unsafe { w.sq1().bits(CHANNEL) });
        self.adc.cr2().write(|w| w.adon().set_bit());
    }

    fn begin(&mut self) {
        self.adc.cr2().modify(|_, w| w.swstart().set_bit());
    }
}

impl Thermistor for BoardThermistor {
    /// A conversion that has ended since the last call, and starts the next one. To be called from the control loop; a call more
    /// often than every 25 us gives `None`.
    fn sample(&mut self) -> Option<u16> {
        match self.state {
            State::Off => {
                self.switch_on();
                self.state = State::Settling;
                None
            }
            State::Settling => {
                self.begin();
                self.state = State::Converting;
                None
            }
            State::Converting => {
                if !self.adc.sr().read().eoc().is_complete() {
                    return None;
                }
                // Reading the data clears the flag.
                let raw = self.adc.dr().read().data().bits() & 0xFFF;
                self.begin();
                Some(raw)
            }
        }
    }
}
