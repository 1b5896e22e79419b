//! Regulation: what the nozzle needs by the model, and PID for what the model does not know.
//!
//! `duty = (need (1 + trim) + wiggle) / available + kp e - kd dT/dt`. The integral is the *trim*, a share of the need: what is
//! learned about loss and power at one temperature and flow then holds at every other. It is bounded, so that a reading
//! that does not follow the nozzle cannot ask for everything, and stands while the power is saturated or the reading nears the
//! target by itself, so that the long way up leaves nothing to overshoot by.
//!
//! The *wiggle* swings target and power together by about a count of the converter, so that the regulation does not work
//! against it: a reading in which it does not show is not the nozzle's (see [`super::supervision`]).

#[cfg(test)]
mod tests;

use core::f32::consts::TAU;

use growbot_core::trigonometry;

use super::model::Nozzle;

/// Period of the wiggle, s.
pub const WIGGLE_PERIOD_S: f32 = 16.0;
/// How far the wiggle goes to either side: counts of the converter, and its bounds in degrees.
const WIGGLE_COUNTS: f32 = 1.2;
const WIGGLE_C: (f32, f32) = (0.35, 0.7);
/// How late the reading follows the nozzle, for the wiggle of the target, s.
const WIGGLE_LAG_S: f32 = 2.0;
/// The derivative is that of a reading smoothed by so much, s.
const SMOOTHING_S: f32 = 1.0;
/// A reading that nears the target faster than this, degrees a second, is on its way.
const APPROACH_C_PER_S: f32 = 0.15;
/// How far the trim goes, as a share of the need, where the supply is measured and where it is not.
const AUTHORITY: (f32, f32) = (0.35, 0.55);
/// The need is taken as at least this share of the heater's power where the trim is scaled by it.
const LEAST_NEED: f32 = 0.02;

/// The regulation of one target.
#[derive(Debug, Clone, Copy, Default)]
pub struct Regulation {
    /// Integral of the error, as a share of the need.
    trim: f32,
    /// The reading less the wiggle's part in it, and its smoothed slope.
    previous_c: Option<f32>,
    slope_c_per_s: f32,
    /// Where in its period the wiggle is, 0 to 1.
    phase: f32,
    /// How far the wiggle goes, degrees, found when first needed at a target.
    amplitude_c: Option<f32>,
    saturated: bool,
}

impl Regulation {
    /// Another target: the trim stays.
    pub fn retarget(&mut self) {
        *self =
            Self { trim: self.trim, previous_c: self.previous_c, slope_c_per_s: self.slope_c_per_s, ..Self::default() };
    }

    /// What the model lacks, as a share of what it says.
    pub fn trim(&self) -> f32 {
        self.trim
    }

    /// Whether the latest duty was cut to what there is.
    pub fn saturated(&self) -> bool {
        self.saturated
    }

    /// Where in its period the wiggle is, 0 to 1.
    pub fn phase(&self) -> f32 {
        self.phase
    }

    /// How far the wiggle goes to either side, degrees.
    pub fn amplitude_c(&self) -> f32 {
        self.amplitude_c.unwrap_or(WIGGLE_C.0)
    }

    /// The duty, 0 to 1, after `seconds` since the latest one.
    pub fn duty(&mut self, target_c: f32, reading_c: f32, wiggles: bool, seconds: f32, nozzle: &Nozzle) -> f32 {
        let (available, need) = (nozzle.available_w, nozzle.needed_w(target_c));
        let (wiggle_c, wiggle_w) = if wiggles { self.wiggle(target_c, seconds, nozzle) } else { (0.0, 0.0) };
        let steady_c = reading_c - wiggle_c;
        if let (Some(previous), true) = (self.previous_c, seconds > 0.0) {
            let slope = (steady_c - previous) / seconds;
            self.slope_c_per_s += (slope - self.slope_c_per_s) * seconds / (SMOOTHING_S + seconds);
        }
        self.previous_c = Some(steady_c);
        let error = target_c - steady_c;
        // The gains are those at the nominal supply.
        let correction = (nozzle.kp * error - nozzle.kd * self.slope_c_per_s) * nozzle.power_w;
        let wanted = (need * (1.0 + self.trim) + wiggle_w + correction) / available;
        self.saturated = !(0.0..=1.0).contains(&wanted);
        // On its way by itself, or asked for what there is not: nothing to learn.
        let approaches = error * self.slope_c_per_s > APPROACH_C_PER_S * error.abs();
        if !self.saturated && !approaches {
            let most = if nozzle.measured { AUTHORITY.0 } else { AUTHORITY.1 };
            let scale = nozzle.power_w / need.max(nozzle.power_w * LEAST_NEED);
            self.trim = (self.trim + nozzle.ki * scale * error * seconds).max(-most).min(most);
        }
        wanted.clamp(0.0, 1.0)
    }

    /// The wiggle: its part in the reading, degrees, and its power, W.
    fn wiggle(&mut self, target_c: f32, seconds: f32, nozzle: &Nozzle) -> (f32, f32) {
        let amplitude = *self
            .amplitude_c
            .get_or_insert_with(|| (WIGGLE_COUNTS * nozzle.count_c(target_c)).clamp(WIGGLE_C.0, WIGGLE_C.1));
        self.phase += seconds / WIGGLE_PERIOD_S;
        if self.phase >= 1.0 {
            self.phase -= 1.0;
        }
        let (sin, cos) = wiggle_at(self.phase);
        let lag = TAU * WIGGLE_LAG_S / WIGGLE_PERIOD_S;
        let in_reading = amplitude * (sin - lag * cos) / (1.0 + lag * lag);
        (in_reading, nozzle.heat_capacity_j_per_k * amplitude * TAU / WIGGLE_PERIOD_S * cos)
    }
}

/// Sine and cosine of the wiggle at a phase, 0 to 1.
pub fn wiggle_at(phase: f32) -> (f32, f32) {
    let (sin, cos) = trigonometry::sin_cos(f64::from(TAU * phase));
    (sin as f32, cos as f32)
}
