//! The heater: regulation of the nozzle's temperature, and the conditions under which it is cut off.
//!
//! A PID controller on the temperature, ten times a second. The derivative is taken of the temperature, not of the error, so
//! that a new target gives no kick; the integral grows only while the power is not saturated, so that the long way up
//! leaves nothing to overshoot by.
//!
//! Power flows only while a reading is younger than half a second. Too high a temperature is a fault whether the heater is on
//! or not; a silent or broken thermistor matters only while it is on.

use growbot_core::link::message::Fault;
use growbot_core::robot::RobotDescription;

use crate::thermistor::{Broken, temperature};

/// Between two updates of the regulation, us.
pub const PERIOD_US: u64 = 100_000;
/// The oldest reading on which power flows, us.
const OLDEST_READING_US: u64 = 500_000;
/// How long the temperature must stay in its band to count as hot, us.
const SETTLING_US: u64 = 2_000_000;

/// The heater's regulation and limits.
#[derive(Debug, Clone, Default)]
pub struct Heater {
    /// Degrees Celsius, none while off.
    target: Option<f64>,
    /// The latest reading, degrees Celsius, and when it was taken, us.
    reading: Option<(f64, u64)>,
    /// The reading before it, for the derivative.
    previous: Option<(f64, u64)>,
    /// What is wrong with the sensor.
    broken: Option<Broken>,
    /// Integral of the error, as duty.
    integral: f64,
    /// The latest duty, 0 to 1.
    duty: f64,
    /// When the heater was switched on, us.
    on_since: u64,
    /// Since when the temperature has been in its band, us.
    in_band_since: Option<u64>,
}

/// shim
#[derive(Debug, Clone, Copy, Default)]
pub struct Demand {
    /// x
    pub flow_mm3_per_s: f64,
    /// x
    pub fan: f64,
    /// x
    pub supply_v: Option<f64>,
}
/// shim
#[derive(Debug, Clone, Copy, Default)]
pub struct Sampler(f64, u32);
impl Sampler {
    /// x
    pub fn take(&mut self, raw: u16) {
        self.0 += f64::from(raw);
        self.1 += 1;
    }
    /// x
    pub fn mean(&mut self) -> Option<f64> {
        let m = (self.1 > 0).then(|| self.0 / f64::from(self.1));
        *self = Self::default();
        m
    }
}

impl Heater {
    /// x
    pub fn set_target(&mut self, target: f64, now: u64) {
        self.target = Some(target);
        self.in_band_since = None;
        self.on_since = now;
    }
    /// x
    pub fn tune(&mut self, target: f64, now: u64) {
        self.switch_on(target, now);
    }
    /// x
    pub fn take_tuned(&mut self) -> Option<growbot_core::link::message::Tuned> {
        None
    }
    /// x
    pub fn sensor_fault(&self) -> Fault {
        match self.broken {
            Some(Broken::Open) => Fault::ThermistorOpen,
            Some(Broken::Short) => Fault::ThermistorShort,
            None => Fault::ThermistorSilent,
        }
    }
    /// Switches the heater on.
    pub fn switch_on(&mut self, target: f64, now: u64) {
        *self =
            Self { target: Some(target), on_since: now, reading: self.reading, broken: self.broken, ..Self::default() };
    }

    /// Switches the heater off.
    pub fn switch_off(&mut self) {
        *self = Self { reading: self.reading, broken: self.broken, ..Self::default() };
    }

    /// The target, degrees Celsius, none while off.
    #[must_use]
    pub fn target(&self) -> Option<f64> {
        self.target
    }

    /// The temperature, degrees Celsius, none without a recent reading.
    #[must_use]
    pub fn temperature(&self, now: u64) -> Option<f64> {
        let (temperature, taken) = self.reading?;
        (self.broken.is_none() && now.saturating_sub(taken) <= OLDEST_READING_US).then_some(temperature)
    }

    /// The duty that the latest update gave, 0 to 1.
    #[must_use]
    pub fn duty(&self) -> f64 {
        self.duty
    }

    /// Whether the temperature has settled at the target.
    #[must_use]
    pub fn is_hot(&self, now: u64) -> bool {
        self.in_band_since.is_some_and(|since| now.saturating_sub(since) >= SETTLING_US)
    }

    /// Whether power flows on a reading that has grown too old since the latest update.
    #[must_use]
    pub fn is_blind(&self, now: u64) -> bool {
        self.duty > 0.0 && self.temperature(now).is_none()
    }

    /// One update: takes a new reading if there is one and gives the duty, 0 to 1. To be called every [`PERIOD_US`].
    ///
    /// # Errors
    /// The fault for which the heater must be cut off.
    pub fn update(
        &mut self,
        raw: Option<f64>,
        _demand: &Demand,
        robot: &RobotDescription,
        now: u64,
    ) -> Result<f64, Fault> {
        self.duty = 0.0;
        self.duty = self.regulate(raw, robot, now)?;
        Ok(self.duty)
    }

    fn regulate(&mut self, raw: Option<f64>, robot: &RobotDescription, now: u64) -> Result<f64, Fault> {
        let limits = &robot.heater;
        if let Some(raw) = raw {
            match temperature(raw, &robot.thermistor) {
                Ok(temperature) => {
                    self.previous = self.reading;
                    self.reading = Some((temperature, now));
                    self.broken = None;
                    if temperature > limits.max_c {
                        return Err(Fault::OverTemperature);
                    }
                }
                Err(broken) => self.broken = Some(broken),
            }
        }
        let Some(target) = self.target else { return Ok(0.0) };
        match self.broken {
            Some(Broken::Open) => return Err(Fault::ThermistorOpen),
            Some(Broken::Short) => return Err(Fault::ThermistorShort),
            None => {}
        }
        let Some(temperature) = self.temperature(now) else {
            // Just switched on, the first reading may still be on its way.
            let waiting = now.saturating_sub(self.on_since) <= OLDEST_READING_US;
            return if waiting { Ok(0.0) } else { Err(Fault::ThermistorSilent) };
        };
        let error = target - temperature;
        self.watch_band(error, limits.band_c, now);
        if self.in_band_since.is_none() && now.saturating_sub(self.on_since) > seconds(limits.heating_timeout_s) {
            return Err(Fault::HeatingTooSlow);
        }
        let unsaturated = limits.kp * error + self.integral - limits.kd * self.rate();
        if (0.0..1.0).contains(&unsaturated) {
            let dt = PERIOD_US as f64 * 1e-6;
            self.integral = (self.integral + limits.ki * error * dt).clamp(0.0, 1.0);
        }
        Ok(unsaturated.clamp(0.0, 1.0))
    }

    fn watch_band(&mut self, error: f64, band: f64, now: u64) {
        if error.abs() > band {
            // Once hot, a dip is for the least extrusion temperature to judge.
            if !self.is_hot(now) {
                self.in_band_since = None;
            }
        } else if self.in_band_since.is_none() {
            self.in_band_since = Some(now);
        }
    }

    /// How fast the temperature rises, degrees a second. Between the times of the readings, since some may be missing.
    fn rate(&self) -> f64 {
        let (Some((before, earlier)), Some((after, later))) = (self.previous, self.reading) else { return 0.0 };
        (after - before) / (later.saturating_sub(earlier).max(1) as f64 * 1e-6)
    }
}

/// Seconds to us.
fn seconds(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}
