//! Temperature control of the nozzle: feed-forward of the holding power from the model, and PID for the deviations from
//! the model.
//!
//! `duty = (need (1 + trim) + dither) / available + kp e - kd dT/dt`. `need` is the power that holds the target by the
//! model. The integral term is the *trim*, a share of the need. A trim that is learned at one temperature and flow
//! corrects loss and power at every other. The trim is bounded, so that a reading that does not follow the nozzle
//! cannot demand unlimited power. It is frozen while the power is saturated or the reading approaches the target by
//! itself, so that heating up builds up no integral that would cause overshoot.
//!
//! The *dither* varies target and power together by about a count of the ADC, so that the regulation does not
//! counteract it. A reading that does not show the dither is not that of the nozzle (see [`super::supervision`]).
//!
//! docs/decisions/0022-heater-regulation.md gives the reasons. `heater::tests::regulating` and
//! `tests/no_false_alarms.rs` bound the effect of these constants on the temperature: within 1.5 C of the target over
//! layers, and 4 C of overshoot.

#[cfg(test)]
mod tests;

use core::f32::consts::TAU;

use growbot_core::trigonometry;

use super::model::NozzleModel;

/// Period of the dither, s (decision 0022). With a longer period, `heater::tests::faults` fails: a reading without the
/// dither must be detected within 120 s.
pub const DITHER_PERIOD_S: f32 = 16.0;
/// Amplitude of the dither, counts of the ADC (decision 0022). Because it exceeds a count, the mean of a period changes
/// even if the reading has no noise.
const DITHER_COUNTS: f32 = 1.2;
/// Min amplitude of the dither, degrees (decision 0022). With a larger amplitude the nozzle leaves the 1.5 C of
/// `tests/no_false_alarms.rs`. A smaller amplitude is not detectable in the noise of `heater::tests::sound`, 1.5
/// counts.
const DITHER_MIN_C: f32 = 0.35;
/// Max amplitude of the dither, degrees. It is bounded like [`DITHER_MIN_C`].
const DITHER_MAX_C: f32 = 0.7;
/// Assumed lag of the reading behind the nozzle, s, with which the dither's part in the reading is computed. The
/// thermistors of the trials lag by 1 to 4 s (`heater::tests::plant`).
const DITHER_LAG_S: f32 = 2.0;
/// Time constant of the filter that smooths the reading for the derivative term, s (decision 0022).
const SMOOTHING_S: f32 = 1.0;
/// Rate, degrees a second, beyond which a reading counts as approaching the target by itself, so that the integral term
/// is frozen. The rate was lowered from 0.3 C/s when the slow change of the fan's speed and the early power for a first
/// layer were added. Over 100 h of growth the nozzle then stayed within 1.24 C of its target, instead of 1.81 C.
const APPROACH_C_PER_S: f32 = 0.15;
/// Bound of the integral term (trim), as a share of the power that holds the temperature, if the supply voltage is
/// measured (decision 0022). A smaller value raises false alarms in `heater::tests::sound`.
const TRIM_MAX: f32 = 0.35;
/// Bound of the integral term (trim), as a share of the power that holds the temperature, if the supply voltage is not
/// measured (decision 0022). It is greater than [`TRIM_MAX`], because 10 % less voltage is 19 % less power.
const TRIM_MAX_UNMEASURED: f32 = 0.55;
/// Lower bound of the holding power by which the integral term (trim) is scaled, as a share of the heater's power. Near
/// room temperature the holding power is zero, and the scale factor would be infinite.
const MIN_NEED: f32 = 0.02;

/// Phase and amplitude of the dither at a moment. The dither varies target and power together, so that the reading of a
/// working sensor shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dither {
    /// Phase of the dither: the elapsed share of its period, 0 to 1.
    pub phase: f32,
    pub amplitude_c: f32,
}

/// Temperature control of the nozzle at one target: feed-forward from the model, and PID.
#[derive(Debug, Clone, Copy, Default)]
pub struct TemperatureControl {
    /// Integral term (trim), as a share of the power that holds the target by the nozzle's model.
    trim: f32,
    /// Latest reading without the expected effect of the dither, degrees Celsius. `None` before the first reading.
    previous_c: Option<f32>,
    /// Smoothed slope of the reading without the expected effect of the dither, degrees a second.
    slope_c_per_s: f32,
    /// Phase of the dither: the elapsed share of its period, 0 to 1.
    phase: f32,
    /// Amplitude of the dither, degrees. It is computed when it is first needed at a target, and `None` before that.
    amplitude_c: Option<f32>,
    saturated: bool,
}

impl TemperatureControl {
    /// Resets the state of the temperature control for another target, except for the integral term (trim) and the
    /// slope of the reading.
    pub fn retarget(&mut self) {
        *self =
            Self { trim: self.trim, previous_c: self.previous_c, slope_c_per_s: self.slope_c_per_s, ..Self::default() };
    }

    /// Returns the integral term (trim): the difference between the actual holding power and that of the nozzle's
    /// model, as a share of the model's.
    pub fn trim(&self) -> f32 {
        self.trim
    }

    /// Returns whether the latest duty was limited to the range from zero to full power.
    pub fn saturated(&self) -> bool {
        self.saturated
    }

    /// Returns the present phase and amplitude of the dither.
    pub fn dither(&self) -> Dither {
        Dither { phase: self.phase, amplitude_c: self.amplitude_c.unwrap_or(DITHER_MIN_C) }
    }

    /// Returns the heater's duty, 0 to 1, until the next call. `seconds` is the time since the previous call, and
    /// `dithers` is true if the power is to be dithered.
    pub fn duty(&mut self, target_c: f32, reading_c: f32, dithers: bool, seconds: f32, nozzle: &NozzleModel) -> f32 {
        let (available, need) = (nozzle.available_w, nozzle.needed_w(target_c));
        let (dither_c, dither_w) = if dithers { self.advance_dither(target_c, seconds, nozzle) } else { (0.0, 0.0) };
        let steady_c = reading_c - dither_c;
        if let (Some(previous), true) = (self.previous_c, seconds > 0.0) {
            let slope = (steady_c - previous) / seconds;
            self.slope_c_per_s += (slope - self.slope_c_per_s) * seconds / (SMOOTHING_S + seconds);
        }
        self.previous_c = Some(steady_c);
        let error = target_c - steady_c;
        // The gains apply at the nominal supply voltage.
        let correction = (nozzle.kp * error - nozzle.kd * self.slope_c_per_s) * nozzle.power_w;
        let unlimited = (need * (1.0 + self.trim) + dither_w + correction) / available;
        self.saturated = !(0.0..=1.0).contains(&unlimited);
        // The integral term is frozen while the reading approaches the target by itself or the power is saturated.
        let approaches = error * self.slope_c_per_s > APPROACH_C_PER_S * error.abs();
        if !self.saturated && !approaches {
            let max = if nozzle.measured { TRIM_MAX } else { TRIM_MAX_UNMEASURED };
            let scale = nozzle.power_w / need.max(nozzle.power_w * MIN_NEED);
            self.trim = (self.trim + nozzle.ki * scale * error * seconds).max(-max).min(max);
        }
        unlimited.clamp(0.0, 1.0)
    }

    /// Advances the phase of the dither. Returns the dither's part in the reading, degrees, and in the power, W.
    fn advance_dither(&mut self, target_c: f32, seconds: f32, nozzle: &NozzleModel) -> (f32, f32) {
        let amplitude = *self
            .amplitude_c
            .get_or_insert_with(|| (DITHER_COUNTS * nozzle.count_c(target_c)).clamp(DITHER_MIN_C, DITHER_MAX_C));
        self.phase += seconds / DITHER_PERIOD_S;
        if self.phase >= 1.0 {
            self.phase -= 1.0;
        }
        let (sin, cos) = dither_at(self.phase);
        let lag = TAU * DITHER_LAG_S / DITHER_PERIOD_S;
        let in_reading = amplitude * (sin - lag * cos) / (1.0 + lag * lag);
        (in_reading, nozzle.heat_capacity_j_per_k * amplitude * TAU / DITHER_PERIOD_S * cos)
    }
}

/// Returns the sine and the cosine of a dither phase, 0 to 1, where 1 is a whole period.
pub fn dither_at(phase: f32) -> (f32, f32) {
    let (sin, cos) = trigonometry::sin_cos(f64::from(TAU * phase));
    (sin as f32, cos as f32)
}
