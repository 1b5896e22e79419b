//! The signals that a robot uses, and the checks that the pins of a board can have their functions.

use super::{BoardDescription, BoardKind, RobotDescription, Sensors, Signal};

/// Number of GPIO pins of the RP2040.
const RP2040_PINS: usize = 30;
/// The first GPIO pin of the RP2040 with a channel of the analog-to-digital converter.
pub const FIRST_ANALOG_PIN: u8 = 26;
/// The PWM slice of the RP2040 that makes the ticks of the step interrupt. Heater and fan cannot use its pins.
pub const STEP_SLICE: u8 = 7;

/// Reason why a board's pins are not valid, with the signals, the pin, and the remedy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    /// A pin is given for a signal whose pin is fixed.
    #[error(
        "board.pins.{signal} is set, but this signal has a fixed pin on {kind}: remove board.pins.{signal}, and wire \
         the signal as in WIRING.md"
    )]
    Fixed {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Kind of the board.
        kind: BoardKind,
    },
    /// The board has no default pin for a signal that the robot uses, and the description gives none.
    #[error(
        "{kind} has no default pin for {signal}: set board.pins.{signal}, or remove the sensor from the robot file"
    )]
    Missing {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Kind of the board.
        kind: BoardKind,
    },
    /// The pin does not exist.
    #[error("board.pins.{signal} is {pin}, but the GPIO pins of the board are 0 to 29: give one of them")]
    Unknown {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Number of the pin.
        pin: u8,
    },
    /// The board uses the pin itself.
    #[error("board.pins.{signal} is {pin}, which is {what} on {kind}: use another pin")]
    Reserved {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Number of the pin.
        pin: u8,
        /// Kind of the board.
        kind: BoardKind,
        /// Purpose for which the board itself uses the pin.
        what: &'static str,
    },
    /// Two signals have the same pin.
    #[error("{first} and {second} both use pin {pin}: give one of them another pin in board.pins")]
    Conflict {
        /// Number of the pin.
        pin: u8,
        /// One of the two signals that have this pin.
        first: Signal,
        /// The other one of the two signals that have this pin.
        second: Signal,
    },
    /// The pin has no channel of the analog-to-digital converter.
    #[error("board.pins.{signal} is {pin}, but the ADC measures only at pins 26 to 29: use one of these")]
    NotAnalog {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Number of the pin.
        pin: u8,
    },
    /// The PWM slice of the pin makes the ticks of the step interrupt.
    #[error(
        "board.pins.{signal} is {pin}, but the step interrupt uses the PWM slice of pins 14 and 15: use another pin"
    )]
    UsesStepSlice {
        /// Signal whose pin is not valid.
        signal: Signal,
        /// Number of the pin.
        pin: u8,
    },
    /// Heater and fan share a PWM slice.
    #[error(
        "the heater at pin {heater} and the fan at pin {fan} share a PWM slice (pins 0 and 1 share one, as do 2 and 3 \
         and so on, and as do pins 16 apart): use another pin for the heater or the fan"
    )]
    SharedSlice {
        /// Pin of the heater.
        heater: u8,
        /// Pin of the fan.
        fan: u8,
    },
}

impl Signal {
    /// Reports whether the robot uses the signal. Every robot needs the signals that do not belong to an optional
    /// sensor.
    pub fn is_used(self, robot: &RobotDescription) -> bool {
        let Sensors { filament_presence, filament_motion, driver_fault, emergency_stop, supply, orientation } =
            &robot.sensors;
        match self {
            Self::DriverFault => driver_fault.is_some(),
            Self::FilamentPresence => filament_presence.is_some(),
            Self::FilamentMotion => filament_motion.is_some(),
            Self::EmergencyStop => emergency_stop.is_some(),
            Self::OrientationData | Self::OrientationClock => *orientation,
            Self::Supply => *supply,
            _ => true,
        }
    }
}

impl BoardDescription {
    /// Returns the GPIO pin of a signal: the pin that the description gives, or else the default pin of the board's
    /// kind. `None` if there is neither.
    pub fn pin(&self, signal: Signal) -> Option<u8> {
        self.pins.get(signal).or(self.kind.pin(signal))
    }

    /// Checks the pins of all signals that a robot uses. Each pin must exist, be able to have its function, and belong
    /// to only one signal.
    pub(super) fn check(&self, robot: &RobotDescription) -> Result<(), PinError> {
        let kind = self.kind;
        let mut owners: [Option<Signal>; RP2040_PINS] = [None; RP2040_PINS];
        for signal in Signal::ALL {
            if kind.has_fixed_pin(signal) && self.pins.get(signal).is_some() {
                return Err(PinError::Fixed { signal, kind });
            }
            if kind == BoardKind::Stm32f405 {
                continue;
            }
            // A pin in the description is checked even if the robot does not have the sensor.
            if !signal.is_used(robot) && self.pins.get(signal).is_none() {
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
                return Err(PinError::Conflict { pin, first: other, second: signal });
            }
            *owner = Some(signal);
            if signal.is_analog() && pin < FIRST_ANALOG_PIN {
                return Err(PinError::NotAnalog { signal, pin });
            }
        }
        self.check_slices()
    }

    /// Checks that heater and fan have different PWM slices, and that neither has the slice of the step interrupt. Pins
    /// 0 and 1 share a slice, and so do 2 and 3. Pins from 16 on share the slices of the pins from 0 on.
    fn check_slices(&self) -> Result<(), PinError> {
        let slice = |signal| self.pin(signal).map(pwm_slice);
        for signal in [Signal::Heater, Signal::Fan] {
            if let (Some(pin), Some(STEP_SLICE)) = (self.pin(signal), slice(signal)) {
                return Err(PinError::UsesStepSlice { signal, pin });
            }
        }
        match (self.pin(Signal::Heater), self.pin(Signal::Fan)) {
            (Some(heater), Some(fan)) if pwm_slice(heater) == pwm_slice(fan) => {
                Err(PinError::SharedSlice { heater, fan })
            }
            _ => Ok(()),
        }
    }
}

/// Returns the PWM slice of a pin (RP2040 data sheet, table 525).
pub fn pwm_slice(pin: u8) -> u8 {
    pin / 2 % 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{DriverSettings, PinOverrides, Robot, RobotError};
    use crate::testing::description_a;

    fn with(kind: BoardKind, pins: PinOverrides) -> Result<Robot, RobotError> {
        let mut robot = description_a();
        if kind.has_onboard_drivers() {
            (robot.sensors.supply, robot.sensors.driver_fault) = (false, None);
            robot.head.driver = Some(DriverSettings::with_current(0.8));
            robot.feed.driver = robot.head.driver;
        }
        robot.board = Some(BoardDescription { kind, pins });
        Robot::new(robot)
    }

    fn refused(kind: BoardKind, pins: PinOverrides) -> std::string::String {
        std::format!("{}", with(kind, pins).unwrap_err())
    }

    #[test]
    fn every_board_kind_has_all_signals_without_conflicts() {
        for kind in [BoardKind::Stm32f405, BoardKind::Pico, BoardKind::SkrPico] {
            with(kind, PinOverrides::default()).unwrap();
        }
    }

    #[test]
    fn invalid_pins_are_refused_with_the_reason() {
        let none = PinOverrides::default();
        for (kind, pins, why) in [
            (BoardKind::Stm32f405, PinOverrides { fan: Some(3), ..none }, "fixed"),
            (BoardKind::SkrPico, PinOverrides { head_step: Some(6), ..none }, "fixed"),
            (BoardKind::SkrPico, PinOverrides { feed_enable: Some(7), ..none }, "fixed"),
            (BoardKind::Pico, PinOverrides { fan: Some(30), ..none }, "0 to 29"),
            (BoardKind::Pico, PinOverrides { fan: Some(25), ..none }, "the board's lamp"),
            (BoardKind::Pico, PinOverrides { index: Some(1), ..none }, "the link's UART"),
            (BoardKind::SkrPico, PinOverrides { driver_fault: Some(7), ..none }, "held off"),
            (BoardKind::SkrPico, PinOverrides { index: Some(9), ..none }, "the line to the stepper drivers"),
            (BoardKind::Pico, PinOverrides { index: Some(15), ..none }, "index and emergency_stop"),
            (BoardKind::Pico, PinOverrides { thermistor: Some(18), ..none }, "26 to 29"),
            (BoardKind::Pico, PinOverrides { fan: Some(23), ..none }, "the board's converter"),
            (BoardKind::Pico, PinOverrides { fan: Some(15), emergency_stop: Some(20), ..none }, "step interrupt"),
            (BoardKind::SkrPico, PinOverrides { fan: Some(22), orientation_clock: Some(17), ..none }, "share"),
        ] {
            let message = refused(kind, pins);
            assert!(message.contains(why), "{message}");
        }
    }

    #[test]
    fn signals_without_a_default_pin_need_an_override() {
        let mut robot = with(BoardKind::SkrPico, PinOverrides::default()).unwrap().description().clone();
        robot.sensors.supply = true;
        let message = std::format!("{}", Robot::new(robot.clone()).unwrap_err());
        assert!(message.contains("supply") && message.contains("skr-pico"), "{message}");
        robot.board = Some(BoardDescription {
            kind: BoardKind::SkrPico,
            pins: PinOverrides { supply: Some(26), ..PinOverrides::default() },
        });
        Robot::new(robot).unwrap();
    }
}
