//! The analog inputs: the ADC converts thermistor and supply by turns, one at a time, and nothing waits for it.
//!
//! It is switched on by the first call of `sample`, not at start-up: the link answers first. Its non-linearity at four
//! codes (erratum RP2040-E11) is smaller than what the mean of a reading's conversions smooths.

use core::sync::atomic::{AtomicU32, Ordering};

use growbot_core::robot::FIRST_ANALOG_PIN;
use growbot_firmware::hal::Adc;
use rp2040_pac as pac;

/// Control and status: on, start one conversion, ready, error, and where the channel is.
const ON: u32 = 1;
const START: u32 = 1 << 2;
const READY: u32 = 1 << 8;
const CHANNEL: u32 = 12;
/// The last channel with a pin.
const LAST_CHANNEL: u32 = 3;

/// The latest reading of the supply that has not been read yet, else [`NONE`].
static SUPPLY_READING: AtomicU32 = AtomicU32::new(NONE);
const NONE: u32 = u32::MAX;

/// The thermistor's input, and the ADC, which converts both inputs.
pub struct Thermistor {
    adc: pac::ADC,
    state: State,
    /// Channels of the thermistor and of the supply; where the supply is not measured, the thermistor's twice.
    channels: [u32; 2],
}

/// The supply's input. It is converted while the thermistor is asked for.
pub struct Supply(());

enum State {
    /// Not touched yet.
    Off,
    /// Switched on.
    Settling,
    /// A conversion of the thermistor is running or done.
    ConvertingThermistor,
    /// One of the supply is.
    ConvertingSupply,
}

/// Both inputs, at these pins; the ADC is left alone.
pub fn new(adc: pac::ADC, thermistor: Option<u8>, supply: Option<u8>) -> (Thermistor, Supply) {
    let channel = |pin: u8| u32::from(pin.saturating_sub(FIRST_ANALOG_PIN)).min(LAST_CHANNEL);
    let thermistor = thermistor.map_or(0, channel);
    let channels = [thermistor, supply.map_or(thermistor, channel)];
    (Thermistor { adc, state: State::Off, channels }, Supply(()))
}

impl Thermistor {
    fn control(&self, bits: u32) {
        // SAFETY: the whole register, of which this has the only owner.
        self.adc.cs().write(|w| unsafe { w.bits(ON | bits) });
    }

    fn begin(&self, channel: u32) {
        self.control(channel << CHANNEL | START);
    }

    /// What has been converted, if that is done.
    fn read_converted(&self) -> Option<u16> {
        let done = self.adc.cs().read().bits() & READY != 0;
        done.then(|| (self.adc.result().read().bits() & 0xFFF) as u16)
    }
}

impl Adc for Thermistor {
    /// The conversion that has ended since the last call. Starts the next one. Every other call gives `None`, and so
    /// does a call within 2 us.
    fn sample(&mut self) -> Option<u16> {
        match self.state {
            State::Off => {
                self.control(0);
                self.state = State::Settling;
                None
            }
            State::Settling => {
                self.begin(self.channels[0]);
                self.state = State::ConvertingThermistor;
                None
            }
            State::ConvertingThermistor => {
                let reading = self.read_converted()?;
                self.begin(self.channels[1]);
                self.state = State::ConvertingSupply;
                Some(reading)
            }
            State::ConvertingSupply => {
                let reading = self.read_converted()?;
                self.begin(self.channels[0]);
                self.state = State::ConvertingThermistor;
                SUPPLY_READING.store(u32::from(reading), Ordering::Relaxed);
                None
            }
        }
    }
}

impl Adc for Supply {
    fn sample(&mut self) -> Option<u16> {
        let reading = SUPPLY_READING.load(Ordering::Relaxed);
        SUPPLY_READING.store(NONE, Ordering::Relaxed);
        u16::try_from(reading).ok()
    }
}
