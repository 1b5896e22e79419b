//! The proof test of the heater's two switches, each time before it heats: each is closed alone, and the nozzle must not get warmer.
//!
//! Power stage and second switch lie in series. One that conducts for ever does no harm while the other one opens, and so would
//! stay unknown until that fails, too.
//!
//! | stage | power stage | second switch | a rise means |
//! |---|---|---|---|
//! | at rest | off | open | both conduct |
//! | second switch | off | closed | the power stage conducts: `heater-stuck-on` |
//! | power stage | full duty | open | the second switch conducts: `heater-switch-welded` |
//!
//! A nozzle that is still hot falls meanwhile, and one that was heated a moment ago may still rise: its thermistor lags, and its heater is
//! hotter than its block. So what counts is the deviation from the course that the reading had with both switches open
//! ([`Rest`]), and that must be straight first. A reading that leaves a falling course by standing still is `thermistor-frozen`.
//!
//! A switch that conducts gives the heater's whole power. Each stage lasts until that would have taken the nozzle up by [`RISE_C`],
//! and [`DELAY_S`] more, for the way from the heater to the reading: 6.9 s for robot A.

#[cfg(test)]
mod tests;

use growbot_core::link::message::Fault;
use heapless::Deque;

use super::Output;
use super::model::Nozzle;

/// Readings are taken as means of so long, s, and so many means make a course: two halves of [`HALF_S`] and a mean to begin with.
const MEAN_S: f32 = 1.0;
const MEANS: usize = 7;
const HALF_S: f32 = 3.0;
/// The means of a straight course lie this close to a line, degrees;
const BEND_C: f32 = 0.4;
/// it does not rise faster than this, degrees a second,
const RISING_C_PER_S: f32 = 0.3;
/// nor fall faster than this beyond so many times what the nozzle needs: a draught's fall levels off too soon.
const FALLING_C_PER_S: f32 = 0.3;
const FALL: f32 = 1.6;
/// Means of a reading that does not change differ by less than this, degrees.
const STILL_C: f32 = 1e-3;
/// A nozzle without power that still rises after so long, s, is heated.
const STILL_RISING_S: f32 = 30.0;
/// So much, degrees, would the whole power raise the nozzle in a stage, and so long, s, does the reading take to show it.
const RISE_C: f32 = 8.0;
const DELAY_S: f32 = 5.0;
/// A mean that lies further above the course than this, degrees, is a rise.
const LIMIT_C: f32 = 3.5;
/// The test begins so far below the greatest temperature, degrees, since a switch that conducts heats.
const HEADROOM_C: f32 = 35.0;

/// The course of the reading while nothing heats.
#[derive(Debug, Clone, Default)]
pub struct Rest {
    means: Deque<f32, MEANS>,
    /// Sum of the readings, and the time, of the mean under way.
    sum: f32,
    seconds: f32,
}

/// A straight course.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Course {
    /// The latest mean, degrees Celsius.
    at_c: f32,
    /// Degrees a second; never upwards, since nothing heats.
    slope_c_per_s: f32,
}

impl Rest {
    /// Takes a reading. Gives the mean that it completes.
    pub fn take(&mut self, reading_c: f32, seconds: f32) -> Option<f32> {
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

    /// The slope over its latter half, degrees a second, and the latest mean; none while it is too short.
    fn latter_half(&self) -> Option<(f32, f32)> {
        let at = |index: usize| self.means.iter().nth(index).copied();
        let (middle, last) = (at(MEANS / 2)?, at(MEANS - 1)?);
        Some(((last - middle) / HALF_S, last))
    }

    /// How far the mean that is furthest from it lies from the line through the first and the latest, degrees.
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

    fn course(&self, nozzle: &Nozzle) -> Option<Course> {
        let (slope, at_c) = self.latter_half()?;
        let fall = FALL * nozzle.needed_w(at_c).max(0.0) / nozzle.heat_capacity_j_per_k;
        let straight = self.bend_c() <= BEND_C && (-fall - FALLING_C_PER_S..=RISING_C_PER_S).contains(&slope);
        straight.then_some(Course { at_c, slope_c_per_s: slope.min(0.0) })
    }

    /// Whether the latest two means are the same: no nozzle that leaves its course gives them.
    fn stands_still(&self) -> bool {
        let mut latest = self.means.iter().rev();
        matches!((latest.next(), latest.next()), (Some(last), Some(before)) if (last - before).abs() < STILL_C)
    }

    fn rises(&self) -> bool {
        self.latter_half().is_some_and(|(slope, _)| slope > RISING_C_PER_S)
    }
}

/// A proof test under way.
#[derive(Debug, Clone, Default)]
pub struct ProofTest {
    stage: Stage,
    second_switch_is_proven: bool,
    /// At rest for so long, s.
    waited_s: f32,
}

#[derive(Debug, Clone, Copy, Default)]
enum Stage {
    #[default]
    AtRest,
    /// One switch is closed, for so long, s, and this was the course before.
    Closed { seconds: f32, course: Course },
}

impl ProofTest {
    /// Looks at a reading: what the switches are to do next, or nothing once both are proven.
    ///
    /// # Errors
    /// Which of them conducts.
    pub fn look(
        &mut self,
        rest: &mut Rest,
        reading_c: f32,
        seconds: f32,
        timeout_s: f32,
        nozzle: &Nozzle,
    ) -> Result<Option<Output>, Fault> {
        let mean = rest.take(reading_c, seconds);
        match &mut self.stage {
            Stage::AtRest => self.waited_s += seconds,
            Stage::Closed { seconds: closed_s, .. } => *closed_s += seconds,
        }
        // All begins and ends with a mean, so that the times between them are whole.
        if let Some(mean_c) = mean {
            if let Stage::Closed { seconds: closed_s, course } = self.stage {
                if mean_c - course.after(closed_s, nozzle) > LIMIT_C {
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
                if let Some(course) = rest.course(nozzle).filter(|_| mean_c + HEADROOM_C <= nozzle.max_c) {
                    self.stage = Stage::Closed { seconds: 0.0, course };
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

impl Course {
    /// Where it leads after so long, degrees Celsius: a fall levels off as the nozzle nears its surroundings.
    fn after(&self, seconds: f32, nozzle: &Nozzle) -> f32 {
        let levels_off = 0.5 * seconds * nozzle.need_w_per_k / nozzle.heat_capacity_j_per_k;
        self.at_c + self.slope_c_per_s * seconds * (1.0 - levels_off.min(0.5))
    }
}
