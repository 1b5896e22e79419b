//! A stepper driver and its pins.

use embedded_hal::digital::OutputPin;

use super::direction::MotorDirection;
use super::moves::EngineFault;

/// Step, direction and enable pins of a stepper driver. Levels are logical. A board with inverted wiring wraps its pins
/// in [`crate::invertible_pin::InvertiblePin`].
pub struct StepperPins<S, D, E> {
    /// Step pin. A rising edge is a step.
    pub step: S,
    /// Direction pin. High: the head turns counter-clockwise, the feed pushes filament out.
    pub direction: D,
    /// Enable pin. High: the motor is energised.
    pub enable: E,
}

/// A stepper driver, with the levels that its step and direction pins were set to.
pub(super) struct Stepper<S, D, E> {
    pins: StepperPins<S, D, E>,
    pub raised: bool,
    /// Direction to which the direction pin is set. `None` before the pin is first set.
    pub direction: Option<MotorDirection>,
}

impl<S: OutputPin, D: OutputPin, E: OutputPin> Stepper<S, D, E> {
    pub fn new(pins: StepperPins<S, D, E>) -> Self {
        Self { pins, raised: false, direction: None }
    }

    /// Energises the motor and sets its direction. Returns whether the direction has changed, so that a tick must pass
    /// before the next step.
    pub fn enable(&mut self, direction: MotorDirection) -> Result<bool, EngineFault> {
        let other = self.direction != Some(direction);
        if other {
            let pin = &mut self.pins.direction;
            let set = if direction == MotorDirection::Forward { pin.set_high() } else { pin.set_low() };
            set.map_err(|_| EngineFault::Hardware)?;
            self.direction = Some(direction);
        }
        self.pins.enable.set_high().map_err(|_| EngineFault::Hardware)?;
        Ok(other)
    }

    /// Switches the driver off. Each pin is set even if another one has failed.
    pub fn disable(&mut self) {
        self.raised = false;
        let _ = self.pins.step.set_low();
        let _ = self.pins.enable.set_low();
    }

    pub fn raise(&mut self) -> Result<(), EngineFault> {
        self.raised = true;
        self.pins.step.set_high().map_err(|_| EngineFault::Hardware)
    }

    pub fn lower(&mut self) -> Result<(), EngineFault> {
        if !self.raised {
            return Ok(());
        }
        self.raised = false;
        self.pins.step.set_low().map_err(|_| EngineFault::Hardware)
    }
}
