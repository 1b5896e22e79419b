//! Whether the pins of a board can be what a robot needs.

use super::{Board, BoardKind, RobotDescription, Signal};

/// GPIO pins of the RP2040.
const RP2040_PINS: usize = 30;
/// The first GPIO pin of the RP2040 with a channel of the converter.
pub const FIRST_ANALOG_PIN: u8 = 26;
/// The PWM slice that makes the step interrupt's ticks: no pin of it can be the heater's or the fan's.
pub const STEP_SLICE: u8 = 7;

/// Why a board's pins were refused: the signals, the pin, and what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    /// A pin is given for a signal whose pin is fixed.
    #[error(
        "board.pins.{signal} is given, and on {kind} that pin is fixed: leave it out, and wire it as WIRING.md says"
    )]
    Fixed {
        /// The signal.
        signal: Signal,
        /// The board's kind.
        kind: BoardKind,
    },
    /// A signal that the robot has is nowhere on its board.
    #[error("{kind} has no place of its own for {signal}: give board.pins.{signal}, or leave its sensor out")]
    Missing {
        /// The signal.
        signal: Signal,
        /// The board's kind.
        kind: BoardKind,
    },
    /// There is no such pin.
    #[error("board.pins.{signal} is {pin}, and GPIO pins are 0 to 29")]
    Unknown {
        /// The signal.
        signal: Signal,
        /// The pin's number.
        pin: u8,
    },
    /// A pin that the board uses itself.
    #[error("board.pins.{signal} is {pin}, which is {what} on {kind}: take another pin")]
    Reserved {
        /// The signal.
        signal: Signal,
        /// The pin's number.
        pin: u8,
        /// The board's kind.
        kind: BoardKind,
        /// What is there.
        what: &'static str,
    },
    /// Two signals are at one pin.
    #[error("{first} and {second} are both at pin {pin}: give one of them another in board.pins")]
    Twice {
        /// The pin's number.
        pin: u8,
        /// A signal.
        first: Signal,
        /// Another.
        second: Signal,
    },
    /// A pin without a channel of the converter.
    #[error("board.pins.{signal} is {pin}, and the converter measures at pins 26 to 29: take one of these")]
    NotAnalog {
        /// The signal.
        signal: Signal,
        /// The pin's number.
        pin: u8,
    },
    /// A pin whose PWM slice makes the ticks of the step interrupt.
    #[error("board.pins.{signal} is {pin}, whose PWM slice is the step interrupt's: take another than 14 and 15")]
    OfStepSlice {
        /// The signal.
        signal: Signal,
        /// The pin's number.
        pin: u8,
    },
    /// Heater and fan share a PWM slice.
    #[error(
        "heater at pin {heater} and fan at pin {fan} share a PWM slice, as pins 0 and 1 do, 2 and 3, and so on, and 16 \
         as 0: take another for one of them"
    )]
    OfOneSlice {
        /// The heater's pin.
        heater: u8,
        /// The fan's pin.
        fan: u8,
    },
}

impl Board {
    /// The GPIO pin of a signal: the one that is given, else the kind's.
    #[must_use]
    pub fn pin(&self, signal: Signal) -> Option<u8> {
        self.pins.of(signal).or(self.kind.pin(signal))
    }

    /// Checks the pins of a robot's signals: each exists, can do what it is for, and is one signal's alone.
    pub(super) fn check(&self, robot: &RobotDescription) -> Result<(), PinError> {
        let kind = self.kind;
        let mut owners: [Option<Signal>; RP2040_PINS] = [None; RP2040_PINS];
        for signal in Signal::ALL {
            if kind.fixes(signal) && self.pins.of(signal).is_some() {
                return Err(PinError::Fixed { signal, kind });
            }
            if kind == BoardKind::Stm32f405 {
                continue;
            }
            // A pin that is given is checked, whether or not the robot has the sensor.
            if !signal.is_used(robot) && self.pins.of(signal).is_none() {
                continue;
            }
            let Some(pin) = self.pin(signal) else { return Err(PinError::Missing { signal, kind }) };
            let Some(owner) = owners.get_mut(usize::from(pin)) else {
                return Err(PinError::Unknown { signal, pin });
            };
            if let Some(what) = kind.reserved(pin) {
                return Err(PinError::Reserved { signal, pin, kind, what });
            }
            if let Some(other) = *owner {
                return Err(PinError::Twice { pin, first: other, second: signal });
            }
            *owner = Some(signal);
            if signal.is_analog() && pin < FIRST_ANALOG_PIN {
                return Err(PinError::NotAnalog { signal, pin });
            }
        }
        self.check_slices()
    }

    /// Heater and fan each have a PWM slice of their own: pins 0 and 1 share one, so do 2 and 3, and 16 begins again.
    fn check_slices(&self) -> Result<(), PinError> {
        let slice = |signal| self.pin(signal).map(pwm_slice);
        for signal in [Signal::Heater, Signal::Fan] {
            if let (Some(pin), Some(STEP_SLICE)) = (self.pin(signal), slice(signal)) {
                return Err(PinError::OfStepSlice { signal, pin });
            }
        }
        match (self.pin(Signal::Heater), self.pin(Signal::Fan)) {
            (Some(heater), Some(fan)) if pwm_slice(heater) == pwm_slice(fan) => {
                Err(PinError::OfOneSlice { heater, fan })
            }
            _ => Ok(()),
        }
    }
}

/// The PWM slice of a pin (RP2040 data sheet, table 525).
#[must_use]
pub fn pwm_slice(pin: u8) -> u8 {
    pin / 2 % 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Driver, PinNumbers, Robot, RobotError};
    use crate::testing::description_a;

    fn with(kind: BoardKind, pins: PinNumbers) -> Result<Robot, RobotError> {
        let mut robot = description_a();
        if kind.has_drivers() {
            (robot.sensors.supply, robot.sensors.driver_fault) = (false, None);
            robot.head.driver = Some(Driver::of_current(0.8));
            robot.feed.driver = robot.head.driver;
        }
        robot.board = Some(Board { kind, pins });
        Robot::new(robot)
    }

    fn refused(kind: BoardKind, pins: PinNumbers) -> std::string::String {
        std::format!("{}", with(kind, pins).unwrap_err())
    }

    #[test]
    fn every_kind_has_the_signals_of_a_robot_without_conflicts() {
        for kind in [BoardKind::Stm32f405, BoardKind::Pico, BoardKind::SkrPico] {
            with(kind, PinNumbers::default()).unwrap();
        }
    }

    #[test]
    fn what_a_pin_cannot_be_is_refused_with_the_reason() {
        let none = PinNumbers::default();
        for (kind, pins, why) in [
            (BoardKind::Stm32f405, PinNumbers { fan: Some(3), ..none }, "fixed"),
            (BoardKind::SkrPico, PinNumbers { head_step: Some(6), ..none }, "fixed"),
            (BoardKind::SkrPico, PinNumbers { feed_enable: Some(7), ..none }, "fixed"),
            (BoardKind::Pico, PinNumbers { fan: Some(30), ..none }, "0 to 29"),
            (BoardKind::Pico, PinNumbers { fan: Some(25), ..none }, "the board's lamp"),
            (BoardKind::Pico, PinNumbers { index: Some(1), ..none }, "the link's UART"),
            (BoardKind::SkrPico, PinNumbers { driver_fault: Some(7), ..none }, "held off"),
            (BoardKind::SkrPico, PinNumbers { index: Some(9), ..none }, "the line to the stepper drivers"),
            (BoardKind::Pico, PinNumbers { index: Some(15), ..none }, "index and emergency_stop"),
            (BoardKind::Pico, PinNumbers { thermistor: Some(18), ..none }, "26 to 29"),
            (BoardKind::Pico, PinNumbers { fan: Some(23), ..none }, "the board's converter"),
            (BoardKind::Pico, PinNumbers { fan: Some(15), emergency_stop: Some(20), ..none }, "step interrupt"),
            (BoardKind::SkrPico, PinNumbers { fan: Some(22), orientation_clock: Some(17), ..none }, "share"),
        ] {
            let said = refused(kind, pins);
            assert!(said.contains(why), "{said}");
        }
    }

    #[test]
    fn signals_that_a_board_has_no_place_for_need_a_pin() {
        let mut robot = with(BoardKind::SkrPico, PinNumbers::default()).unwrap().description().clone();
        robot.sensors.supply = true;
        let said = std::format!("{}", Robot::new(robot.clone()).unwrap_err());
        assert!(said.contains("supply") && said.contains("skr-pico"), "{said}");
        robot.board =
            Some(Board { kind: BoardKind::SkrPico, pins: PinNumbers { supply: Some(26), ..PinNumbers::default() } });
        Robot::new(robot).unwrap();
    }
}
