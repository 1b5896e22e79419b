//! Pins, ADC channels and sensors of a simulated board, which connect the controller and the step engine to the
//! simulated tip.
//!
//! Levels are logical (an active signal is high), so that no part needs
//! [`growbot_firmware::invertible_pin::InvertiblePin`].

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};
use growbot_firmware::hal;
use growbot_firmware::stepping::MotorDirection;

use super::{Motor, TipModel};

/// A simulated tip that is shared by the pins of a board.
pub type SharedTip = Rc<RefCell<TipModel>>;

/// STEP pin of a motor.
pub struct StepPin(pub Motor, pub SharedTip);

/// DIR pin of a motor: high turns the head counter-clockwise and pushes filament out.
pub struct DirectionPin(pub Motor, pub SharedTip);

/// ENABLE pin of a motor: high energises the motor.
pub struct EnablePin(pub Motor, pub SharedTip);

/// An input with two levels, which is read from the tip.
pub struct Input {
    tip: SharedTip,
    level: fn(&TipModel) -> bool,
}

/// The heater's power output.
pub struct HeaterPower(pub SharedTip);

/// The second switch in the heater's supply. High closes it.
pub struct HeaterEnable(pub SharedTip);

/// The output for the fan.
pub struct FanPwm(pub SharedTip);

/// A channel of the simulated ADC.
pub struct SimulatedAdc {
    tip: SharedTip,
    sample: fn(&mut TipModel) -> Option<u16>,
}

/// The orientation sensor.
pub struct Orientation(pub SharedTip);

impl Input {
    /// Returns the input of the index sensor, which is high while the sensor detects its mark.
    pub fn index(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), level: TipModel::on_index }
    }

    /// Returns the input of the encoder that the filament turns.
    pub fn filament_motion(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), level: TipModel::encoder }
    }

    /// Returns the input of the filament switch: high while there is filament.
    pub fn filament_presence(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), level: TipModel::has_filament }
    }

    /// Returns the input of the stepper drivers: high while one of them reports a fault.
    pub fn driver_fault(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), level: TipModel::driver_fault }
    }

    /// Returns the input of the emergency stop, which is high while the stop is pressed.
    pub fn emergency_stop(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), level: TipModel::is_emergency_stop_pressed }
    }
}

impl SimulatedAdc {
    /// Returns the channel of the thermistor's divider.
    pub fn thermistor(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), sample: TipModel::sample_thermistor }
    }

    /// Returns the channel of the supply's divider.
    pub fn supply(tip: &SharedTip) -> Self {
        Self { tip: Rc::clone(tip), sample: TipModel::sample_supply }
    }
}

/// The outputs that the step interrupt can switch off: heater, fan and both stepper drivers.
pub struct SimulatedOutputs(pub SharedTip);

impl hal::Outputs for SimulatedOutputs {
    fn make_safe(&mut self) {
        let mut tip = self.0.borrow_mut();
        tip.set_heater(0.0, false);
        tip.set_fan(0.0);
        tip.set_enabled(Motor::Head, false);
        tip.set_enabled(Motor::Feed, false);
    }
}

impl hal::Adc for SimulatedAdc {
    fn sample(&mut self) -> Option<u16> {
        (self.sample)(&mut self.tip.borrow_mut())
    }
}

impl hal::GravitySensor for Orientation {
    fn gravity(&mut self) -> Option<[i16; 3]> {
        self.0.borrow_mut().gravity()
    }
}

impl ErrorType for StepPin {
    type Error = Infallible;
}

impl OutputPin for StepPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    /// Applies a step pulse to the motor's driver. The engine raises a pin only after it has lowered it, so each call
    /// is an edge.
    fn set_high(&mut self) -> Result<(), Infallible> {
        self.1.borrow_mut().step(self.0);
        Ok(())
    }
}

impl ErrorType for DirectionPin {
    type Error = Infallible;
}

impl OutputPin for DirectionPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.1.borrow_mut().set_direction(self.0, MotorDirection::Backward);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.1.borrow_mut().set_direction(self.0, MotorDirection::Forward);
        Ok(())
    }
}

impl ErrorType for EnablePin {
    type Error = Infallible;
}

impl OutputPin for EnablePin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.1.borrow_mut().set_enabled(self.0, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.1.borrow_mut().set_enabled(self.0, true);
        Ok(())
    }
}

impl ErrorType for Input {
    type Error = Infallible;
}

impl InputPin for Input {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok((self.level)(&self.tip.borrow()))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

impl pwm::ErrorType for HeaterPower {
    type Error = Infallible;
}

impl SetDutyCycle for HeaterPower {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        let mut tip = self.0.borrow_mut();
        let closed = tip.heater_is_on();
        tip.set_heater(f64::from(duty) / f64::from(u16::MAX), closed);
        Ok(())
    }
}

impl ErrorType for HeaterEnable {
    type Error = Infallible;
}

impl HeaterEnable {
    fn set(&mut self, closed: bool) {
        let mut tip = self.0.borrow_mut();
        let duty = tip.heater_duty();
        tip.set_heater(duty, closed);
    }
}

impl OutputPin for HeaterEnable {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set(true);
        Ok(())
    }
}

impl pwm::ErrorType for FanPwm {
    type Error = Infallible;
}

impl SetDutyCycle for FanPwm {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.0.borrow_mut().set_fan(f64::from(duty) / f64::from(u16::MAX));
        Ok(())
    }
}
