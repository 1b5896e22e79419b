//! The heater: regulation of the nozzle's temperature, and the conditions under which it is cut off.
//!
//! [`Heater::update`] takes the mean of the period's conversions ([`Sampler`]) and what the nozzle is asked for ([`Demand`]), ten
//! times a second, and gives the duty: by `regulation` on the way to a target and at it, by `tuning` where the gains are to be
//! found. `supervision` compares the reading with what the nozzle can do by the `model`.
//!
//! Before it heats, both of its switches are tried (`proof_test`). Power flows only while a reading is younger than half a second. Too high a temperature is a fault whether the heater is on
//! or not; everything else matters only while it is on.

mod model;
mod proof_test;
mod regulation;
mod sampler;
mod supervision;
#[cfg(test)]
mod tests;
mod tuning;

use growbot_core::link::message::{Fault, Tuned};
use growbot_core::robot::RobotDescription;

use self::model::Nozzle;
use self::proof_test::{ProofTest, Rest};
use self::regulation::Regulation;
pub use self::sampler::Sampler;
use self::supervision::{Look, Regulated, Supervision};
use self::tuning::Relay;
use crate::thermistor::{Broken, temperature};

/// Between two updates of the regulation, us.
pub const PERIOD_US: u64 = 100_000;
/// The oldest reading on which power flows, us. Its conversions may be a period older.
const OLDEST_READING_US: u64 = 400_000;
/// How long the temperature must stay in its band to count as hot, us.
const SETTLING_US: u64 = 2_000_000;
/// To lay a layer, the temperature must have been within this share of its band for so long, us: the overshoot is over then.
const STEADY_BANDS: f32 = 0.45;
const STEADY_US: u64 = 10_000_000;
/// Or anywhere in its band for so long, us.
const STEADY_ENOUGH_US: u64 = 60_000_000;
/// Within this many bands of the target the power is wiggled.
const WIGGLED_BANDS: f32 = 2.0;
/// Tuning takes at most so many times the robot's longest heating.
const TUNING_TIMEOUTS: u64 = 2;
/// A reading that does not swing in so long, s, does not follow the power.
const LONGEST_SWING_S: f32 = 90.0;

/// What the nozzle is asked for, and what there is to do it with.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Demand {
    /// Plastic that flows through it, mm^3/s.
    pub flow_mm3_per_s: f64,
    /// Duty of the fan, 0 to 1.
    pub fan: f64,
    /// The supply as measured, V; none where it is not.
    pub supply_v: Option<f64>,
}

/// What the heater's two switches are to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// Duty of the power stage, 0 to 1.
    pub duty: f64,
    /// Whether the second switch is closed.
    pub closed: bool,
}

impl Output {
    /// Both are open.
    pub const OFF: Self = Self { duty: 0.0, closed: false };
    const SECOND_SWITCH_ALONE: Self = Self { duty: 0.0, closed: true };
    const POWER_STAGE_ALONE: Self = Self { duty: 1.0, closed: false };
}

/// The heater's regulation and limits.
#[derive(Debug, Clone, Default)]
pub struct Heater {
    /// Degrees Celsius, none while off.
    target: Option<f64>,
    /// The latest reading, degrees Celsius, and when it was taken, us.
    reading: Option<(f64, u64)>,
    /// What is wrong with the sensor.
    broken: Option<Broken>,
    /// The latest duty of the power stage, 0 to 1.
    duty: f64,
    /// When the latest update was, us.
    updated: Option<u64>,
    /// When it was switched on, got its target, or began to heat, us.
    on_since: u64,
    /// Since when the temperature has been in its band, us.
    in_band_since: Option<u64>,
    /// Since when it has been so near to the target that a layer can be laid, us.
    steady_since: Option<u64>,
    /// The reading while nothing heats.
    rest: Rest,
    /// Its switches are being tried.
    proof: Option<ProofTest>,
    regulation: Regulation,
    supervision: Supervision,
    tuning: Option<Relay>,
    tuned: Option<Tuned>,
}

impl Heater {
    /// Switches the heater on. It tries its switches first.
    pub fn switch_on(&mut self, target_c: f64, now: u64) {
        self.switch_off();
        (self.target, self.on_since, self.proof) = (Some(target_c), now, Some(ProofTest::default()));
    }

    /// Another target, without switching off in between. Nothing while it is off or being tuned.
    pub fn set_target(&mut self, target_c: f64, now: u64) {
        if self.tuning.is_some() || self.target.is_none_or(|target| target.to_bits() == target_c.to_bits()) {
            return;
        }
        (self.target, self.on_since) = (Some(target_c), now);
        (self.in_band_since, self.steady_since) = (None, None);
        self.regulation.retarget();
        self.supervision.retarget();
    }

    /// Switches the heater off.
    pub fn switch_off(&mut self) {
        let Self { reading, broken, .. } = *self;
        let rest = core::mem::take(&mut self.rest);
        *self = Self { reading, broken, rest, tuned: self.tuned.take(), ..Self::default() };
    }

    /// Switches the heater on to drive the nozzle round a target and find its gains. When they are found, it is off.
    pub fn tune(&mut self, target_c: f64, now: u64) {
        self.switch_on(target_c, now);
        (self.tuning, self.tuned) = (Some(Relay::default()), None);
    }

    /// What was found since it was last asked for.
    pub fn take_tuned(&mut self) -> Option<Tuned> {
        self.tuned.take()
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

    /// What a sensor that gives no temperature suffers from.
    #[must_use]
    pub fn sensor_fault(&self) -> Fault {
        match self.broken {
            Some(Broken::Open) => Fault::ThermistorOpen,
            Some(Broken::Short) => Fault::ThermistorShort,
            None => Fault::ThermistorSilent,
        }
    }

    /// The duty of the power stage, 0 to 1, as the latest update gave it. In the proof test it is full with the second
    /// switch open.
    #[must_use]
    pub fn duty(&self) -> f64 {
        self.duty
    }

    /// Whether the temperature has settled at the target.
    #[must_use]
    pub fn is_hot(&self, now: u64) -> bool {
        self.in_band_since.is_some_and(|since| now.saturating_sub(since) >= SETTLING_US)
    }

    /// Whether the temperature is steady enough to lay a layer.
    #[must_use]
    pub fn is_steady(&self, now: u64) -> bool {
        let lasts = |since: Option<u64>, least| since.is_some_and(|since| now.saturating_sub(since) >= least);
        lasts(self.steady_since, STEADY_US) || lasts(self.in_band_since, STEADY_ENOUGH_US)
    }

    /// Whether power flows on a reading that has grown too old since the latest update.
    #[must_use]
    pub fn is_blind(&self, now: u64) -> bool {
        self.duty > 0.0 && self.temperature(now).is_none()
    }

    /// One update: takes the mean reading of the period if there is one and gives what the switches are to do. To be called every
    /// [`PERIOD_US`].
    ///
    /// # Errors
    /// The fault for which the heater must be cut off.
    #[inline(never)] // It is far in the controller, which has it beyond the reach of short instructions.
    pub fn update(
        &mut self,
        raw: Option<f64>,
        demand: &Demand,
        robot: &RobotDescription,
        now: u64,
    ) -> Result<Output, Fault> {
        // A fault leaves the duty as it was: that is what its record says.
        let output = self.next(raw, demand, robot, now)?;
        self.duty = output.duty;
        Ok(output)
    }

    /// What the switches are to do next.
    fn next(&mut self, raw: Option<f64>, demand: &Demand, robot: &RobotDescription, now: u64) -> Result<Output, Fault> {
        let before = self.updated.replace(now).unwrap_or(now);
        let seconds = now.saturating_sub(before).min(OLDEST_READING_US) as f32 * 1e-6;
        if let Some(raw) = raw {
            match temperature(raw, &robot.thermistor) {
                Ok(temperature) => {
                    (self.reading, self.broken) = (Some((temperature, now)), None);
                    if temperature > robot.heater.max_c {
                        return Err(Fault::OverTemperature);
                    }
                }
                Err(broken) => self.broken = Some(broken),
            }
        }
        let Some(target_c) = self.target else {
            match self.temperature(now) {
                Some(reading_c) => _ = self.rest.take(reading_c as f32, seconds),
                None => self.rest = Rest::default(),
            }
            return Ok(Output::OFF);
        };
        match self.broken {
            Some(Broken::Open) => return Err(Fault::ThermistorOpen),
            Some(Broken::Short) => return Err(Fault::ThermistorShort),
            None => {}
        }
        let Some(reading_c) = self.temperature(now) else {
            // Just switched on, the first reading may still be on its way.
            let waiting = now.saturating_sub(self.on_since) <= OLDEST_READING_US;
            return if waiting { Ok(Output::OFF) } else { Err(Fault::ThermistorSilent) };
        };
        let nozzle = Nozzle::new(demand, robot);
        let (target_c, reading_c) = (target_c as f32, reading_c as f32);
        let mut given = self.duty as f32;
        if let Some(proof) = &mut self.proof {
            let timeout_s = robot.heater.heating_timeout_s as f32;
            if let Some(output) = proof.look(&mut self.rest, reading_c, seconds, timeout_s, &nozzle)? {
                return Ok(output);
            }
            (self.proof, self.rest, self.on_since) = (None, Rest::default(), now);
            // The second switch was open.
            given = 0.0;
        }
        self.watch_band(target_c - reading_c, nozzle.band_c, seconds_us(robot.heater.heating_timeout_s), now)?;
        let wiggles = (target_c - reading_c).abs() < WIGGLED_BANDS * nozzle.band_c;
        let wiggle = wiggles.then(|| (self.regulation.phase(), self.regulation.amplitude_c()));
        let regulated = Regulated { trim: self.regulation.trim(), saturated: self.regulation.saturated(), wiggle };
        self.supervision.look(&Look {
            reading_c,
            target_c,
            duty: given,
            seconds,
            hot: self.is_hot(now),
            regulated: self.tuning.is_none().then_some(regulated),
            nozzle: &nozzle,
        })?;
        if self.tuning.and_then(|relay| relay.swing_s()).is_some_and(|swing| swing > LONGEST_SWING_S) {
            return Err(Fault::ThermistorFrozen);
        }
        let duty = match &mut self.tuning {
            None => self.regulation.duty(target_c, reading_c, wiggles, seconds, &nozzle),
            Some(relay) => match relay.duty(target_c, reading_c, seconds, &nozzle) {
                Ok(duty) => duty,
                Err(tuned) => {
                    self.switch_off();
                    self.tuned = Some(tuned);
                    0.0
                }
            },
        };
        Ok(Output { duty: f64::from(duty), closed: self.target.is_some() })
    }

    /// Watches whether the target is reached, and in time.
    fn watch_band(&mut self, error: f32, band: f32, timeout: u64, now: u64) -> Result<(), Fault> {
        if error.abs() > STEADY_BANDS * band {
            self.steady_since = None;
        } else if self.steady_since.is_none() {
            self.steady_since = Some(now);
        }
        if error.abs() > band {
            // Once hot, a dip is for the supervision to judge.
            if !self.is_hot(now) {
                self.in_band_since = None;
            }
        } else if self.in_band_since.is_none() {
            self.in_band_since = Some(now);
        }
        let since = now.saturating_sub(self.on_since);
        let too_slow = match self.tuning {
            Some(_) => since > timeout.saturating_mul(TUNING_TIMEOUTS),
            None => self.in_band_since.is_none() && error > 0.0 && since > timeout,
        };
        if too_slow { Err(Fault::HeatingTooSlow) } else { Ok(()) }
    }
}

/// Seconds to us.
fn seconds_us(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}
