//! The proof test of the heater's two switches, each time before it heats: each is closed alone, and the nozzle must
//! not get warmer.
//!
//! Power stage and second switch lie in series. A switch that always conducts does no harm while the other one opens,
//! and so would stay unknown until that one fails, too.
//!
//! | stage | power stage | second switch | a rise means |
//! |---|---|---|---|
//! | at rest | off | open | both conduct |
//! | second switch | off | closed | the power stage conducts: `heater-stuck-on` |
//! | power stage | full duty | open | the second switch conducts: `heater-switch-welded` |
//!
//! A nozzle that is still hot cools in the test, and one that was heated a moment ago may still rise: its thermistor
//! lags, and its heater is hotter than its block. So the test judges the deviation from a reference, the line that the
//! reading followed with both switches open ([`Rest`]). That line must be straight first. A reading that leaves a
//! falling line by standing still is `thermistor-frozen`.
//!
//! A switch that conducts gives the heater's whole power. Each stage lasts until that would have raised the nozzle by
//! [`RISE_C`], and [`DELAY_S`] more, for the way from the heater to the reading: 6.9 s for robot A.
//!
//! The limits are those of docs/decisions/0021-heater-proof-test.md. `heater::tests::proof` bounds each from both
//! sides: on 300 nozzles, after any heating and pause, no sound switch is accused and every broken one is found.

#[cfg(test)]
mod tests;

use growbot_core::link::message::Fault;
use heapless::Deque;

use super::Output;
use super::model::Nozzle;

/// Time over which readings are averaged, s (decision 0021).
const MEAN_S: f32 = 1.0;
/// Means that make a reference: two halves of [`HALF_S`], and a mean to begin with (decision 0021).
const MEANS: usize = 7;
/// Time of the half that gives the slope, s (decision 0021).
const HALF_S: f32 = 3.0;
/// Distance of the means from a straight line, degrees. Decision 0021; sound nozzles whose noise is 1.5 counts of half
/// a degree must pass it.
const BEND_C: f32 = 0.4;
/// The fastest rise of a reference, degrees a second. Decision 0021; a nozzle that was heated a moment ago is waited
/// for.
const RISING_C_PER_S: f32 = 0.3;
/// The fastest fall of a reference, degrees a second, beyond [`FALL_TIMES`]. Decision 0021: a faster fall, as in a
/// draught, levels off too soon.
const FALLING_C_PER_S: f32 = 0.3;
/// A fall of this many times the nozzle's loss is a reference. It is supervision's limit of a fall (decision 0023).
const FALL_TIMES: f32 = 1.6;
/// Means of a reading that does not change differ by less than this, degrees: far less than a count of the ADC, and
/// more than the rounding of a mean.
const STILL_C: f32 = 1e-3;
/// A nozzle without power that still rises after this time, s, is heated. Decision 0021.
const STILL_RISING_S: f32 = 30.0;
/// Degrees by which the whole power would raise the nozzle in a stage. Decision 0021; it must pass [`LIMIT_C`] on a
/// nozzle with 10 % less power and a lag of 4 s.
const RISE_C: f32 = 8.0;
/// Time that the reading takes to show a rise, s: the lag of 4 s of the slowest sound thermistor, and a second of
/// cartridge (decision 0021).
const DELAY_S: f32 = 5.0;
/// A mean that lies further above the reference than this, degrees, is a rise. Decision 0021.
const LIMIT_C: f32 = 3.5;
/// The test begins so far below `max_c`, degrees, since a switch that conducts heats. Decision 0021; in the trial no
/// nozzle passed `max_c`.
const HEADROOM_C: f32 = 35.0;

/// The reading while nothing heats.
#[derive(Debug, Clone, Default)]
pub struct Rest {
    means: Deque<f32, MEANS>,
    /// Sum of the readings of the mean under way.
    sum: f32,
    /// Time of the mean under way, s.
    seconds: f32,
}

/// The line that the reading would follow if nothing heated.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reference {
    /// The latest mean, degrees Celsius.
    at_c: f32,
    /// Degrees a second; never upwards, since nothing heats.
    slope_c_per_s: f32,
}

impl Rest {
    /// Adds a reading. Returns the mean that it completes.
    pub fn add(&mut self, reading_c: f32, seconds: f32) -> Option<f32> {
        self.sum += reading_c * seconds;
        self.seconds += seconds;
        if self.seconds < MEAN_S - 0.5 * seconds {
            return None;
        }
        let mean = self.sum / self.seconds.max(1e-3);
        (self.sum, self.seconds) = (0.0, 0.0);
        if self.means.is_full() {
            self.means.pop_front();
        }
        // There is room now.
        let _ = self.means.push_back(mean);
        Some(mean)
    }

    /// The line through the latter half of the means; none while there are too few.
    fn latter_half(&self) -> Option<Reference> {
        let at = |index: usize| self.means.iter().nth(index).copied();
        let (middle, last) = (at(MEANS / 2)?, at(MEANS - 1)?);
        Some(Reference { at_c: last, slope_c_per_s: (last - middle) / HALF_S })
    }

    /// The largest distance of a mean from the line through the first and the latest one, degrees.
    fn bend_c(&self) -> f32 {
        let (Some(first), Some(last)) = (self.means.front(), self.means.back()) else { return 0.0 };
        let step = (last - first) / (MEANS - 1) as f32;
        let (mut line, mut bend) = (*first, 0.0_f32);
        for mean in &self.means {
            bend = bend.max((mean - line).abs());
            line += step;
        }
        bend
    }

    /// The reference that the means make; none while they are not straight, or too steep.
    fn reference(&self, nozzle: &Nozzle) -> Option<Reference> {
        let Reference { at_c, slope_c_per_s: slope } = self.latter_half()?;
        let fall = FALL_TIMES * nozzle.needed_w(at_c).max(0.0) / nozzle.heat_capacity_j_per_k;
        let straight = self.bend_c() <= BEND_C && (-fall - FALLING_C_PER_S..=RISING_C_PER_S).contains(&slope);
        straight.then_some(Reference { at_c, slope_c_per_s: slope.min(0.0) })
    }

    /// Whether the latest two means are the same. A nozzle that leaves its reference does not give them.
    fn stands_still(&self) -> bool {
        let mut latest = self.means.iter().rev();
        matches!((latest.next(), latest.next()), (Some(last), Some(before)) if (last - before).abs() < STILL_C)
    }

    fn rises(&self) -> bool {
        self.latter_half().is_some_and(|line| line.slope_c_per_s > RISING_C_PER_S)
    }
}

/// A proof test under way.
#[derive(Debug, Clone, Default)]
pub struct ProofTest {
    stage: Stage,
    second_switch_is_proven: bool,
    /// Time at rest, s.
    waited_s: f32,
}

#[derive(Debug, Clone, Copy, Default)]
enum Stage {
    #[default]
    AtRest,
    /// One switch has been closed for this time, s.
    Closed { seconds: f32, reference: Reference },
}

impl ProofTest {
    /// Judges a reading: the states of the switches until the next one, or none once both are proven.
    ///
    /// # Errors
    /// The fault of the switch that conducts.
    pub fn look(
        &mut self,
        rest: &mut Rest,
        reading_c: f32,
        seconds: f32,
        timeout_s: f32,
        nozzle: &Nozzle,
    ) -> Result<Option<Output>, Fault> {
        let mean = rest.add(reading_c, seconds);
        match &mut self.stage {
            Stage::AtRest => self.waited_s += seconds,
            Stage::Closed { seconds: closed_s, .. } => *closed_s += seconds,
        }
        // Each stage begins and ends with a mean, so that the times between them are whole.
        if let Some(mean_c) = mean {
            if let Stage::Closed { seconds: closed_s, reference } = self.stage {
                if mean_c - reference.after(closed_s, nozzle) > LIMIT_C {
                    return Err(match self.second_switch_is_proven {
                        _ if rest.stands_still() => Fault::ThermistorFrozen,
                        true => Fault::HeaterSwitchWelded,
                        false => Fault::HeaterStuckOn,
                    });
                }
                if closed_s >= stage_s(nozzle) {
                    if self.second_switch_is_proven {
                        return Ok(None);
                    }
                    *self = Self { second_switch_is_proven: true, ..Self::default() };
                }
            }
            if let Stage::AtRest = self.stage {
                if self.waited_s > STILL_RISING_S && rest.rises() || self.waited_s > timeout_s {
                    return Err(Fault::HeaterStuckOn);
                }
                if let Some(reference) = rest.reference(nozzle).filter(|_| mean_c + HEADROOM_C <= nozzle.max_c) {
                    self.stage = Stage::Closed { seconds: 0.0, reference };
                }
            }
        }
        Ok(Some(match (self.stage, self.second_switch_is_proven) {
            (Stage::AtRest, _) => Output::OFF,
            (Stage::Closed { .. }, false) => Output::SECOND_SWITCH_ALONE,
            (Stage::Closed { .. }, true) => Output::POWER_STAGE_ALONE,
        }))
    }
}

/// How long one switch stays closed alone, s.
fn stage_s(nozzle: &Nozzle) -> f32 {
    DELAY_S + RISE_C * nozzle.heat_capacity_j_per_k / nozzle.available_w
}

impl Reference {
    /// The temperature after a time, degrees Celsius. A fall levels off as the nozzle nears its surroundings.
    fn after(&self, seconds: f32, nozzle: &Nozzle) -> f32 {
        let levels_off = 0.5 * seconds * nozzle.need_w_per_k / nozzle.heat_capacity_j_per_k;
        self.at_c + self.slope_c_per_s * seconds * (1.0 - levels_off.min(0.5))
    }
}
