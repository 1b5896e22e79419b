//! Pins whose wiring may be inverted. The robot's description states the wiring, and the rest of the firmware uses
//! logical levels only.

use embedded_hal::digital::{ErrorType, InputPin, OutputPin, PinState};

/// A pin whose electrical level may be the inverse of its logical level.
pub struct InvertiblePin<P> {
    pin: P,
    high: PinState,
}

impl<P> InvertiblePin<P> {
    /// Wraps a pin. `high` is the electrical level that is logical high.
    pub fn new(pin: P, high: PinState) -> Self {
        Self { pin, high }
    }
}

impl<P: ErrorType> ErrorType for InvertiblePin<P> {
    type Error = P::Error;
}

impl<P: OutputPin> OutputPin for InvertiblePin<P> {
    fn set_low(&mut self) -> Result<(), P::Error> {
        if self.high == PinState::High { self.pin.set_low() } else { self.pin.set_high() }
    }

    fn set_high(&mut self) -> Result<(), P::Error> {
        if self.high == PinState::High { self.pin.set_high() } else { self.pin.set_low() }
    }
}

impl<P: InputPin> InputPin for InvertiblePin<P> {
    fn is_high(&mut self) -> Result<bool, P::Error> {
        if self.high == PinState::High { self.pin.is_high() } else { self.pin.is_low() }
    }

    fn is_low(&mut self) -> Result<bool, P::Error> {
        if self.high == PinState::High { self.pin.is_low() } else { self.pin.is_high() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::FakePins;

    #[test]
    fn levels_are_inverted_for_reads_and_writes() {
        let pins = FakePins::default();
        let mut plain = InvertiblePin::new(pins.pin(0), PinState::High);
        let mut inverted = InvertiblePin::new(pins.pin(1), PinState::Low);
        plain.set_high().unwrap();
        inverted.set_high().unwrap();
        assert!(pins.level(0) && !pins.level(1));
        assert!(plain.is_high().unwrap() && inverted.is_high().unwrap());
        inverted.set_low().unwrap();
        assert!(pins.level(1) && inverted.is_low().unwrap());
    }
}
