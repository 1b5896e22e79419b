//! Robots and simulated pins for this crate's tests.

pub mod fake_i2c_bus;
/// The simulated flash of the simulated board.
#[path = "../../growbot-sim/src/tip/flash.rs"]
pub mod flash;
pub mod preemption;

use core::convert::Infallible;
use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use embedded_hal::digital::{ErrorKind, ErrorType, InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use growbot_core::robot::{FeedStrategy, Robot, RobotDescription};

use crate::hal::Outputs;

/// Returns the amount of work of a long test: the value of an environment variable, or `otherwise` if the variable is
/// not set.
pub fn number_from_environment(variable: &str, otherwise: u64) -> u64 {
    match std::env::var(variable) {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("{variable} is {text:?}: give a whole number")),
        Err(_) => otherwise,
    }
}

fn description_a() -> RobotDescription {
    toml::from_str(include_str!("../../robots/growbot-a.toml")).expect("robots/growbot-a.toml is readable")
}

/// Returns robot A of the paper, as described in `robots/growbot-a.toml`.
pub fn robot_a() -> Robot {
    Robot::new(description_a()).expect("robots/growbot-a.toml is valid")
}

/// Returns robot A with another feed strategy.
pub fn robot_a_by(strategy: FeedStrategy) -> Robot {
    let mut description = description_a();
    description.motion.strategy = strategy;
    Robot::new(description).expect("either strategy is valid")
}

/// Returns a robot that lays a layer in 0.18 s: the motion of robot A2 with the nozzle of robot A.
pub fn fast_robot() -> Robot {
    let text = include_str!("../../robots/growbot-a2.toml");
    let mut description: RobotDescription = toml::from_str(text).expect("robots/growbot-a2.toml is readable");
    let RobotDescription { heater, fan, pause, supply, sensors, .. } = description_a();
    description = RobotDescription { heater, fan, pause, supply, sensors, ..description };
    Robot::new(description).expect("robots/growbot-a2.toml is valid with any nozzle")
}

/// Returns a robot whose description states the kind of its board (SKR Pico) and the settings of its stepper drivers.
pub fn on_skr_pico() -> Robot {
    let text = include_str!("../../robots/examples/skr-pico.toml");
    Robot::new(toml::from_str(text).expect("the example is readable")).expect("the example is valid")
}

/// Simulated pins whose levels a test can read, set and break.
#[derive(Clone, Default)]
pub struct FakePins(Rc<RefCell<Levels>>);

#[derive(Default)]
struct Levels {
    high: Vec<bool>,
    failed: Vec<usize>,
}

impl FakePins {
    /// Returns the pin with this number.
    pub fn pin(&self, number: usize) -> FakePin {
        let mut levels = self.0.borrow_mut();
        if levels.high.len() <= number {
            levels.high.resize(number + 1, false);
        }
        FakePin { pins: self.clone(), number }
    }

    /// Returns the level of a pin.
    pub fn level(&self, number: usize) -> bool {
        self.0.borrow().high[number]
    }

    /// Sets the level of a pin from outside the board.
    pub fn set(&self, number: usize, high: bool) {
        self.0.borrow_mut().high[number] = high;
    }

    /// Makes every access to a pin fail from now on.
    pub fn fail(&self, number: usize) {
        self.0.borrow_mut().failed.push(number);
    }

    /// Makes a pin that was set to fail work again.
    pub fn repair(&self, number: usize) {
        self.0.borrow_mut().failed.retain(|failed| *failed != number);
    }

    /// Returns whether the pin works.
    pub fn works(&self, number: usize) -> bool {
        !self.0.borrow().failed.contains(&number)
    }
}

/// One of the simulated pins, as the firmware uses it.
pub struct FakePin {
    pins: FakePins,
    number: usize,
}

/// Error of a pin that was set to fail.
#[derive(Debug)]
pub struct PinFailed;

impl embedded_hal::digital::Error for PinFailed {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for FakePin {
    type Error = PinFailed;
}

impl FakePin {
    fn check(&self) -> Result<(), PinFailed> {
        if self.pins.works(self.number) { Ok(()) } else { Err(PinFailed) }
    }
}

impl OutputPin for FakePin {
    fn set_low(&mut self) -> Result<(), PinFailed> {
        self.check()?;
        self.pins.set(self.number, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), PinFailed> {
        self.check()?;
        self.pins.set(self.number, true);
        Ok(())
    }
}

impl InputPin for FakePin {
    fn is_high(&mut self) -> Result<bool, PinFailed> {
        self.check()?;
        Ok(self.pins.level(self.number))
    }

    fn is_low(&mut self) -> Result<bool, PinFailed> {
        self.is_high().map(|high| !high)
    }
}

/// Outputs that only count how often they were switched off.
#[derive(Clone, Default)]
pub struct FakeOutputs(pub Rc<RefCell<u32>>);

impl Outputs for FakeOutputs {
    fn make_safe(&mut self) {
        *self.0.borrow_mut() += 1;
    }
}

/// PWM output of the heater or the fan whose duty a test can read.
#[derive(Clone, Default)]
pub struct FakePower(Rc<RefCell<u16>>);

impl FakePower {
    /// Sets the duty, as an interrupt does that does not own the output.
    pub fn set(&self, duty: u16) {
        *self.0.borrow_mut() = duty;
    }

    /// Returns the duty as a share of full power, 0 to 1.
    pub fn share(&self) -> f64 {
        f64::from(*self.0.borrow()) / f64::from(self.max_duty_cycle())
    }
}

impl embedded_hal::pwm::ErrorType for FakePower {
    type Error = Infallible;
}

impl SetDutyCycle for FakePower {
    fn max_duty_cycle(&self) -> u16 {
        10_000
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        *self.0.borrow_mut() = duty;
        Ok(())
    }
}
