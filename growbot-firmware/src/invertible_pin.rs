//! Pins whose wiring may be inverted. The robot's description states the wiring, and the rest of the firmware uses
//! logical levels only.

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};

/// A pin whose electrical level may be the inverse of its logical level.
pub struct InvertiblePin<P> {
    pin: P,
    inverted: bool,
}

impl<P> InvertiblePin<P> {
    /// Wraps a pin. `inverted` means that logical high is electrical low.
    pub fn new(pin: P, inverted: bool) -> Self {
        Self { pin, inverted }
    }
}

impl<P: ErrorType> ErrorType for InvertiblePin<P> {
    type Error = P::Error;
}

impl<P: OutputPin> OutputPin for InvertiblePin<P> {
    fn set_low(&mut self) -> Result<(), P::Error> {
        if self.inverted { self.pin.set_high() } else { self.pin.set_low() }
    }

    fn set_high(&mut self) -> Result<(), P::Error> {
        if self.inverted { self.pin.set_low() } else { self.pin.set_high() }
    }
}

impl<P: InputPin> InputPin for InvertiblePin<P> {
    fn is_high(&mut self) -> Result<bool, P::Error> {
        if self.inverted { self.pin.is_low() } else { self.pin.is_high() }
    }

    fn is_low(&mut self) -> Result<bool, P::Error> {
        if self.inverted { self.pin.is_high() } else { self.pin.is_low() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::FakePins;

    #[test]
    fn levels_are_inverted_for_reads_and_writes() {
        let pins = FakePins::default();
        let mut plain = InvertiblePin::new(pins.pin(0), false);
        let mut inverted = InvertiblePin::new(pins.pin(1), true);
        plain.set_high().unwrap();
        inverted.set_high().unwrap();
        assert!(pins.level(0) && !pins.level(1));
        assert!(plain.is_high().unwrap() && inverted.is_high().unwrap());
        inverted.set_low().unwrap();
        assert!(pins.level(1) && inverted.is_low().unwrap());
    }
}
