//! The analog inputs of thermistor and supply. The ADC converts one of them at a time, alternately, and no code waits
//! for it.
//!
//! The first call of `sample` switches the ADC on, so that the link responds first after start-up. The ADC's
//! non-linearity at four codes (erratum RP2040-E11) is smaller than the noise that the mean of several conversions
//! removes.

use core::sync::atomic::{AtomicU32, Ordering};

use growbot_core::robot::FIRST_ANALOG_PIN;
use growbot_firmware::hal::Adc;
use rp2040_pac as pac;

/// Bit of the ADC's control and status register that switches the ADC on. `START` starts one conversion, `READY` shows
/// its end, and `CHANNEL` is the position of the channel number.
const ON: u32 = 1;
const START: u32 = 1 << 2;
const READY: u32 = 1 << 8;
const CHANNEL: u32 = 12;
/// Number of the last ADC channel that has a pin.
const LAST_CHANNEL: u32 = 3;

/// Latest unread conversion of the supply. [`NONE`] if the latest one was read.
static SUPPLY_READING: AtomicU32 = AtomicU32::new(NONE);
const NONE: u32 = u32::MAX;

/// Input of the thermistor. It owns the ADC, which converts both inputs.
pub struct ThermistorAdc {
    adc: pac::ADC,
    state: Rp2040AdcState,
    /// Numbers of the ADC channels of the thermistor and of the supply. If the supply is not measured, both are that of
    /// the thermistor.
    channels: [u32; 2],
}

/// Input of the supply. It is converted when the thermistor is sampled.
pub struct SupplyAdc(());

enum Rp2040AdcState {
    /// The ADC has not been started.
    Off,
    /// The ADC has just been switched on.
    Settling,
    /// A conversion of the thermistor is running or done.
    ConvertingThermistor,
    /// A conversion of the supply is running or done.
    ConvertingSupply,
}

/// Creates the inputs of thermistor and supply at these pins. The ADC is not started.
pub fn new(adc: pac::ADC, thermistor: Option<u8>, supply: Option<u8>) -> (ThermistorAdc, SupplyAdc) {
    let channel = |pin: u8| u32::from(pin.saturating_sub(FIRST_ANALOG_PIN)).min(LAST_CHANNEL);
    let thermistor = thermistor.map_or(0, channel);
    let channels = [thermistor, supply.map_or(thermistor, channel)];
    (ThermistorAdc { adc, state: Rp2040AdcState::Off, channels }, SupplyAdc(()))
}

impl ThermistorAdc {
    fn control(&self, bits: u32) {
        // SAFETY: the whole register, which only this value owns.
        self.adc.cs().write(|w| unsafe { w.bits(ON | bits) });
    }

    fn begin(&self, channel: u32) {
        self.control(channel << CHANNEL | START);
    }

    /// Returns the result of the running conversion. `None` while it is not done.
    fn read_converted(&self) -> Option<u16> {
        let done = self.adc.cs().read().bits() & READY != 0;
        done.then(|| (self.adc.result().read().bits() & 0xFFF) as u16)
    }
}

impl Adc for ThermistorAdc {
    /// Returns the result of the thermistor's conversion if it has ended since the last call, and starts the next
    /// conversion. Returns `None` in every other call, in which the supply's conversion is read, and in a call within 2
    /// us of the last one.
    fn sample(&mut self) -> Option<u16> {
        match self.state {
            Rp2040AdcState::Off => {
                self.control(0);
                self.state = Rp2040AdcState::Settling;
                None
            }
            Rp2040AdcState::Settling => {
                self.begin(self.channels[0]);
                self.state = Rp2040AdcState::ConvertingThermistor;
                None
            }
            Rp2040AdcState::ConvertingThermistor => {
                let reading = self.read_converted()?;
                self.begin(self.channels[1]);
                self.state = Rp2040AdcState::ConvertingSupply;
                Some(reading)
            }
            Rp2040AdcState::ConvertingSupply => {
                let reading = self.read_converted()?;
                self.begin(self.channels[0]);
                self.state = Rp2040AdcState::ConvertingThermistor;
                SUPPLY_READING.store(u32::from(reading), Ordering::Relaxed);
                None
            }
        }
    }
}

impl Adc for SupplyAdc {
    fn sample(&mut self) -> Option<u16> {
        let reading = SUPPLY_READING.load(Ordering::Relaxed);
        SUPPLY_READING.store(NONE, Ordering::Relaxed);
        u16::try_from(reading).ok()
    }
}
