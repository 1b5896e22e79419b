//! The heater: regulation of the nozzle's temperature, and the conditions under which the heater is switched off.
//!
//! Call [`HeaterController::update`] ten times a second with the mean of the period's conversions
//! ([`Oversampler`](crate::oversampler::Oversampler)) and the load of the nozzle ([`Demand`]). It returns the states of
//! the heater's switches (`switches`). `temperature_control` computes the duty while the nozzle approaches a target and
//! holds it. `autotune` computes the duty while the PID gains are measured. `supervision` compares the reading with the
//! behaviour that the `model` predicts for the nozzle.
//!
//! Before the heater heats, both of its switches are tested (`proof_test`). Power flows only while a reading is younger
//! than half a second. Too high a temperature is a fault whether the heater is on or off. All other checks apply only
//! while the heater is on.

mod autotune;
mod model;
mod proof_test;
mod supervision;
mod switches;
mod temperature_control;
#[cfg(test)]
mod tests;

use growbot_core::link::message::{Fault, Tuned};
use growbot_core::robot::RobotDescription;

use self::autotune::RelayTuner;
pub use self::model::Demand;
use self::model::NozzleModel;
use self::proof_test::{ProofTest, UnheatedTrend};
use self::supervision::{ControlState, Supervision, SupervisionInput};
pub use self::switches::HeaterOutput;
use self::temperature_control::TemperatureControl;
use crate::thermistor::{ThermistorError, celsius_from_raw};

/// Time between two updates of the regulation, us (docs/decisions/0022-heater-regulation.md).
pub const PERIOD_US: u64 = 100_000;
/// Max age of a temperature reading while the heater gets power, us. The ADC conversions of a reading may be one period
/// older, so the heater never gets power by a conversion that is older than 0.5 s (decision 0022).
const OLDEST_READING_US: u64 = 400_000;
/// Time for which the temperature must stay in the robot's temperature band around the target before the nozzle counts
/// as hot, us. The derivation of this value is not recorded. `heater::tests::times` checks it, and
/// `heater::tests::sound` bounds it from below: if a nozzle counts as hot too early, its temperature drops.
const SETTLING_US: u64 = 2_000_000;
/// Max distance from the target, as a share of the temperature band, at which the nozzle's temperature counts as
/// steady. The temperature must stay within this distance for [`STEADY_US`] before a layer is laid. The share and the
/// time together ensure that the overshoot has decayed. `tests/no_false_alarms.rs` allows 1.5 C while growing, which is
/// half of robot A's band.
const STEADY_BANDS: f32 = 0.45;
/// Time for which the temperature must stay within [`STEADY_BANDS`] of the target before a layer is laid, us.
/// `tests/no_false_alarms.rs` bounds this time and [`STEADY_BANDS`].
const STEADY_US: u64 = 10_000_000;
/// Time in the temperature band after which a layer is laid even if the temperature never was within [`STEADY_BANDS`]
/// of the target, us. So a robot still grows if its nozzle never comes nearer to the target. The derivation of this
/// value is not recorded. `heater::tests::times` checks it.
const STEADY_ENOUGH_US: u64 = 60_000_000;
/// Distance from the target, in multiples of the robot's temperature tolerance (its band), within which the heater's
/// power is dithered. The reading of a working sensor therefore shows the dither before the nozzle counts as hot. The
/// derivation of this value is not recorded. `heater::tests::sound` and `heater::tests::faults` bound it.
const DITHERED_BANDS: f32 = 2.0;
/// Max duration of tuning, as a multiple of the robot's heating timeout (docs/decisions/0022-heater-regulation.md).
const TUNING_TIMEOUTS: u64 = 2;
/// Max duration of a swing during tuning, s. If a swing lasts longer, the reading does not follow the heater's power
/// (decision 0022).
const MAX_SWING_S: f32 = 90.0;

/// Temperature reading of the thermistor.
#[derive(Debug, Clone, Copy)]
struct Reading {
    celsius: f64,
    /// Time at which the reading was taken, us.
    taken: u64,
}

/// Controller of the heater: regulates the nozzle's temperature and switches the heater off if a limit is exceeded.
#[derive(Debug, Clone, Default)]
pub struct HeaterController {
    /// Target of the nozzle's temperature, degrees Celsius. `None` while the heater is off.
    target: Option<f64>,
    reading: Option<Reading>,
    /// Reason why the latest ADC conversions gave no temperature reading. `None` if they gave one.
    broken: Option<ThermistorError>,
    /// Latest duty of the power stage, 0 to 1.
    duty: f64,
    /// Time of the latest update, us. `None` before the first update.
    updated: Option<u64>,
    /// Latest time at which the heater was switched on, its target was set, or it began to heat, us.
    on_since: u64,
    /// Time since which the temperature has been in its band, us. `None` while it is outside.
    in_band_since: Option<u64>,
    /// Time since which the temperature has been within [`STEADY_BANDS`] of the target, us. `None` while it is not.
    steady_since: Option<u64>,
    /// Trend of the readings while the heater is off.
    rest: UnheatedTrend,
    /// Proof test of the heater's two switches. `None` unless the test is running.
    proof: Option<ProofTest>,
    regulation: TemperatureControl,
    supervision: Supervision,
    tuning: Option<RelayTuner>,
    tuned: Option<Tuned>,
}

impl HeaterController {
    /// Switches the heater on. The proof test of its switches runs first.
    pub fn switch_on(&mut self, target_c: f64, now: u64) {
        self.switch_off();
        (self.target, self.on_since, self.proof) = (Some(target_c), now, Some(ProofTest::default()));
    }

    /// Sets a new target without switching the heater off in between. Does nothing while the heater is off or being
    /// tuned.
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

    /// Switches the heater on and lets the nozzle temperature oscillate around a target, to measure the PID gains. The
    /// heater switches off once the gains are found.
    pub fn tune(&mut self, target_c: f64, now: u64) {
        self.switch_on(target_c, now);
        (self.tuning, self.tuned) = (Some(RelayTuner::default()), None);
    }

    /// Removes and returns the PID gains that a tuning has found. `None` if no tuning has ended since the last call.
    pub fn take_tuning_result(&mut self) -> Option<Tuned> {
        self.tuned.take()
    }

    /// Returns the target of the nozzle's temperature, degrees Celsius. `None` while the heater is off.
    pub fn target(&self) -> Option<f64> {
        self.target
    }

    /// Returns the nozzle's temperature, degrees Celsius. `None` without a recent reading.
    pub fn temperature(&self, now: u64) -> Option<f64> {
        let Reading { celsius, taken } = self.reading?;
        (self.broken.is_none() && now.saturating_sub(taken) <= OLDEST_READING_US).then_some(celsius)
    }

    /// Returns the fault to report if the thermistor gives no temperature: open, shorted, or without readings.
    pub fn sensor_fault(&self) -> Fault {
        match self.broken {
            Some(ThermistorError::Open) => Fault::ThermistorOpen,
            Some(ThermistorError::Short) => Fault::ThermistorShort,
            None => Fault::ThermistorSilent,
        }
    }

    /// Returns the duty of the power stage after the latest update, 0 to 1. In the proof test the power stage has full
    /// duty while the second switch is open.
    pub fn duty(&self) -> f64 {
        self.duty
    }

    /// Returns whether the nozzle's temperature has been in its band around the target for long enough to count as hot.
    pub fn is_hot(&self, now: u64) -> bool {
        self.in_band_since.is_some_and(|since| now.saturating_sub(since) >= SETTLING_US)
    }

    /// Returns whether the temperature has been near enough to the target for long enough to lay a layer.
    pub fn is_steady(&self, now: u64) -> bool {
        let lasts = |since: Option<u64>, min| since.is_some_and(|since| now.saturating_sub(since) >= min);
        lasts(self.steady_since, STEADY_US) || lasts(self.in_band_since, STEADY_ENOUGH_US)
    }

    /// Returns whether the heater still gets power although the latest reading has become too old since the latest
    /// update.
    pub fn is_powered_without_reading(&self, now: u64) -> bool {
        self.duty > 0.0 && self.temperature(now).is_none()
    }

    /// Updates the heater with the mean ADC conversion of the period, if the ADC converted anything. Returns the states
    /// of the switches until the next update. Call it every [`PERIOD_US`].
    ///
    /// # Errors
    /// Returns the fault for which the heater must be switched off.
    #[inline(never)] // The controller's code is large, so this function is beyond the reach of short instructions.
    pub fn update(
        &mut self,
        raw: Option<f64>,
        demand: &Demand,
        robot: &RobotDescription,
        now: u64,
    ) -> Result<HeaterOutput, Fault> {
        // A fault leaves the duty unchanged, so that the record of the fault contains that duty.
        let output = self.next(raw, demand, robot, now)?;
        self.duty = output.duty;
        Ok(output)
    }

    /// Computes the states of the switches until the next update.
    fn next(
        &mut self,
        raw: Option<f64>,
        demand: &Demand,
        robot: &RobotDescription,
        now: u64,
    ) -> Result<HeaterOutput, Fault> {
        let before = self.updated.replace(now).unwrap_or(now);
        let seconds = now.saturating_sub(before).min(OLDEST_READING_US) as f32 * 1e-6;
        if let Some(raw) = raw {
            self.read(raw, robot, now)?;
        }
        let Some(target_c) = self.target else {
            match self.temperature(now) {
                Some(reading_c) => _ = self.rest.add(reading_c as f32, seconds),
                None => self.rest = UnheatedTrend::default(),
            }
            return Ok(HeaterOutput::OFF);
        };
        match self.broken {
            Some(ThermistorError::Open) => return Err(Fault::ThermistorOpen),
            Some(ThermistorError::Short) => return Err(Fault::ThermistorShort),
            None => {}
        }
        let Some(reading_c) = self.temperature(now) else {
            // The first reading after the heater is switched on may still be missing.
            let waiting = now.saturating_sub(self.on_since) <= OLDEST_READING_US;
            return if waiting { Ok(HeaterOutput::OFF) } else { Err(Fault::ThermistorSilent) };
        };
        let nozzle = NozzleModel::new(demand, robot);
        let (target_c, reading_c) = (target_c as f32, reading_c as f32);
        let mut given = self.duty as f32;
        if let Some(proof) = &mut self.proof {
            let timeout_s = robot.heater.heating_timeout_s as f32;
            if let Some(output) = proof.look(&mut self.rest, reading_c, seconds, timeout_s, &nozzle)? {
                return Ok(output);
            }
            (self.proof, self.rest, self.on_since) = (None, UnheatedTrend::default(), now);
            // The second switch was open.
            given = 0.0;
        }
        self.watch_band(target_c - reading_c, nozzle.band_c, seconds_us(robot.heater.heating_timeout_s), now)?;
        let dithers = (target_c - reading_c).abs() < DITHERED_BANDS * nozzle.band_c;
        let regulated = self.tuning.is_none().then(|| ControlState {
            trim: self.regulation.trim(),
            saturated: self.regulation.saturated(),
            dither: dithers.then(|| self.regulation.dither()),
        });
        let (hot, nozzle) = (self.is_hot(now), &nozzle);
        self.supervision.look(&SupervisionInput {
            reading_c,
            target_c,
            duty: given,
            seconds,
            hot,
            regulated,
            nozzle,
        })?;
        if self.tuning.and_then(|relay| relay.swing_s()).is_some_and(|swing| swing > MAX_SWING_S) {
            return Err(Fault::ThermistorFrozen);
        }
        let duty = match &mut self.tuning {
            None => self.regulation.duty(target_c, reading_c, dithers, seconds, nozzle),
            Some(relay) => {
                relay.update(target_c, reading_c, seconds, nozzle).unwrap_or_else(|tuned| self.finish(tuned))
            }
        };
        Ok(HeaterOutput { duty: f64::from(duty), enable: self.target.is_some() })
    }

    /// Converts the mean ADC conversion of a period to a temperature and stores it. Returns a fault if the temperature
    /// is above the robot's max.
    fn read(&mut self, raw: f64, robot: &RobotDescription, now: u64) -> Result<(), Fault> {
        match celsius_from_raw(raw, &robot.thermistor) {
            Ok(celsius) => {
                (self.reading, self.broken) = (Some(Reading { celsius, taken: now }), None);
                if celsius > robot.heater.max_c {
                    return Err(Fault::OverTemperature);
                }
            }
            Err(broken) => self.broken = Some(broken),
        }
        Ok(())
    }

    /// Ends the tuning with the gains that it has found. Returns a duty of zero.
    fn finish(&mut self, tuned: Tuned) -> f32 {
        self.switch_off();
        self.tuned = Some(tuned);
        0.0
    }

    /// Records whether the temperature is in its band, and returns a fault if the temperature does not reach the band
    /// in time.
    fn watch_band(&mut self, error: f32, band: f32, timeout: u64, now: u64) -> Result<(), Fault> {
        if error.abs() > STEADY_BANDS * band {
            self.steady_since = None;
        } else if self.steady_since.is_none() {
            self.steady_since = Some(now);
        }
        if error.abs() > band {
            // Once the nozzle is hot, the supervision checks for a temperature drop instead.
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

/// Converts seconds to us.
fn seconds_us(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}
