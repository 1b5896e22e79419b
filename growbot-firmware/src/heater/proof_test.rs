//! The proof test of the heater's two switches, each time before it heats. Each switch is closed alone, and the nozzle
//! must not get warmer.
//!
//! Power stage and second switch are in series. A switch that always conducts is harmless while the other one still
//! opens. Without the test it would therefore stay undetected until the other switch fails too.
//!
//! | stage | power stage | second switch | a rise means |
//! |---|---|---|---|
//! | at rest | off | open | both conduct |
//! | second switch | off | closed | the power stage conducts: `heater-stuck-on` |
//! | power stage | full duty | open | the second switch conducts: `heater-switch-welded` |
//!
//! A nozzle that is still hot cools during the test. A nozzle that was heated a moment ago may still get warmer,
//! because its thermistor lags and its heater is hotter than its block. The test therefore judges the deviation from a
//! reference line. This is the line that the reading followed with both switches open ([`UnheatedTrend`]), and it must
//! be straight before the test begins. If a reading leaves a falling line by standing still, the fault is
//! `thermistor-frozen`.
//!
//! A switch that conducts delivers the heater's whole power. Each stage lasts until that power would have raised the
//! nozzle by [`RISE_C`], plus [`DELAY_S`] for the delay from the heater to the reading. For robot A this is 6.9 s.
//!
//! The limits are those of docs/decisions/0021-heater-proof-test.md. `heater::tests::proof` bounds each limit from both
//! sides: on 300 nozzles, after any heating and pause, no healthy switch raises a fault and every broken one is found.

#[cfg(test)]
mod tests;

use growbot_core::link::message::Fault;
use heapless::Deque;

use super::model::NozzleModel;
use super::switches::HeaterOutput;

/// Time over which readings are averaged to one mean, s (decision 0021).
const MEAN_S: f32 = 1.0;
/// Number of one-second means from which the reference line is computed: two halves of [`HALF_S`], and one mean at the
/// beginning (decision 0021).
const MEANS: usize = 7;
/// Duration of the latter half of the one-second means, from which the slope of the reference line is computed, s
/// (decision 0021).
const HALF_S: f32 = 3.0;
/// Max distance of the one-second means from a straight line, degrees (decision 0021). Healthy nozzles whose noise is
/// 1.5 counts of half a degree must pass the test.
const BEND_C: f32 = 0.4;
/// Max slope of a rising reference line, degrees a second (decision 0021). After recent heating the test waits until
/// the nozzle rises no faster.
const RISING_C_PER_S: f32 = 0.3;
/// Degrees a second by which the fall of a reference line may exceed the limit of [`FALL_TIMES`] (decision 0021). A
/// faster fall, as in a draught, levels off too soon.
const FALLING_C_PER_S: f32 = 0.3;
/// Max rate at which a reference line may fall, as a multiple of the rate at which the nozzle's loss of heat cools it.
/// The supervision limits a fall by the same factor (decision 0023).
const FALL_TIMES: f32 = 1.6;
/// Max difference between two one-second means of a reading that does not change, degrees. This difference is far less
/// than a count of the ADC and more than the rounding of a mean.
const STILL_C: f32 = 1e-3;
/// Time at rest, s, after which the fault is `heater-stuck-on` if the temperature still rises although both switches
/// are open (decision 0021).
const STILL_RISING_S: f32 = 30.0;
/// Degrees by which the heater's full power would raise the nozzle in one stage of the test (decision 0021). The rise
/// must exceed [`LIMIT_C`] on a nozzle with 10 % less power and a lag of 4 s.
const RISE_C: f32 = 8.0;
/// Time that the reading takes to show a rise, s: the lag of 4 s of the slowest healthy thermistor, and a second for
/// the heater cartridge (decision 0021).
const DELAY_S: f32 = 5.0;
/// Distance above the reference line, degrees, beyond which a one-second mean counts as a rise (decision 0021).
const LIMIT_C: f32 = 3.5;
/// Min distance of the reading below `max_c` at which the test may begin, degrees, because a broken switch that
/// conducts heats the nozzle (decision 0021). In the trial `heater::tests::proof` no nozzle exceeded `max_c`.
const HEADROOM_C: f32 = 35.0;

/// Trend of the reading while the heater is off: one-second means of the last seconds.
#[derive(Debug, Clone, Default)]
pub struct UnheatedTrend {
    means: Deque<f32, MEANS>,
    /// Sum of the readings for the current one-second mean.
    sum: f32,
    /// Time covered so far by the readings of the current one-second mean, s.
    seconds: f32,
}

/// The reference line: the line that the reading would follow if nothing heated the nozzle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Baseline {
    /// Temperature at which the line begins: the latest one-second mean of the reading, degrees Celsius.
    at_c: f32,
    /// Slope of the line, degrees a second. It is never positive, because nothing heats.
    slope_c_per_s: f32,
}

impl UnheatedTrend {
    /// Adds a reading. Returns the one-second mean that this reading completes. `None` if the mean is not complete.
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
        // The queue is not full: its oldest element was removed above.
        let _ = self.means.push_back(mean);
        Some(mean)
    }

    /// Returns the line through the latter half of the one-second means. `None` while there are too few means.
    fn latter_half(&self) -> Option<Baseline> {
        let at = |index: usize| self.means.iter().nth(index).copied();
        let (middle, last) = (at(MEANS / 2)?, at(MEANS - 1)?);
        Some(Baseline { at_c: last, slope_c_per_s: (last - middle) / HALF_S })
    }

    /// Returns the largest distance of a one-second mean from the line through the first and the latest mean, degrees.
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

    /// Returns the reference line from the one-second means. `None` while there are too few means, they are not on a
    /// straight line, or the line is too steep.
    fn reference(&self, nozzle: &NozzleModel) -> Option<Baseline> {
        let Baseline { at_c, slope_c_per_s: slope } = self.latter_half()?;
        let fall = FALL_TIMES * nozzle.needed_w(at_c).max(0.0) / nozzle.heat_capacity_j_per_k;
        let straight = self.bend_c() <= BEND_C && (-fall - FALLING_C_PER_S..=RISING_C_PER_S).contains(&slope);
        straight.then_some(Baseline { at_c, slope_c_per_s: slope.min(0.0) })
    }

    /// Returns whether the latest two one-second means are equal. The means of a working sensor differ while the nozzle
    /// leaves its reference line.
    fn stands_still(&self) -> bool {
        let mut latest = self.means.iter().rev();
        matches!((latest.next(), latest.next()), (Some(last), Some(before)) if (last - before).abs() < STILL_C)
    }

    fn rises(&self) -> bool {
        self.latter_half().is_some_and(|line| line.slope_c_per_s > RISING_C_PER_S)
    }
}

/// A running proof test of the heater's two switches.
#[derive(Debug, Clone, Default)]
pub struct ProofTest {
    stage: Stage,
    second_switch_is_proven: bool,
    /// Time for which both switches have been open, s.
    waited_s: f32,
}

#[derive(Debug, Clone, Copy, Default)]
enum Stage {
    #[default]
    AtRest,
    /// One switch is closed. `seconds` is the time since it was closed, s, and `reference` is the reference line from
    /// that time on.
    Closed { seconds: f32, reference: Baseline },
}

impl ProofTest {
    /// Evaluates a reading of the thermistor. Returns the states of the switches until the next reading, or `None` once
    /// both switches are found to open.
    ///
    /// # Errors
    /// Returns the fault of a switch that conducts although it is open, or of a thermistor whose reading stands still.
    pub fn look(
        &mut self,
        rest: &mut UnheatedTrend,
        reading_c: f32,
        seconds: f32,
        timeout_s: f32,
        nozzle: &NozzleModel,
    ) -> Result<Option<HeaterOutput>, Fault> {
        let mean = rest.add(reading_c, seconds);
        match &mut self.stage {
            Stage::AtRest => self.waited_s += seconds,
            Stage::Closed { seconds: closed_s, .. } => *closed_s += seconds,
        }
        // Each stage begins and ends at the end of a one-second mean, so a stage lasts a whole number of means.
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
            (Stage::AtRest, _) => HeaterOutput::OFF,
            (Stage::Closed { .. }, false) => HeaterOutput::SECOND_SWITCH_ALONE,
            (Stage::Closed { .. }, true) => HeaterOutput::POWER_STAGE_ALONE,
        }))
    }
}

/// Returns the duration of one stage of the test, in which one switch is closed and the other is open, s.
fn stage_s(nozzle: &NozzleModel) -> f32 {
    DELAY_S + RISE_C * nozzle.heat_capacity_j_per_k / nozzle.available_w
}

impl Baseline {
    /// Returns the temperature on the reference line after a time, degrees Celsius. A fall levels off as the nozzle
    /// nears the temperature of its surroundings.
    fn after(&self, seconds: f32, nozzle: &NozzleModel) -> f32 {
        let levels_off = 0.5 * seconds * nozzle.loss_w_per_k / nozzle.heat_capacity_j_per_k;
        self.at_c + self.slope_c_per_s * seconds * (1.0 - levels_off.min(0.5))
    }
}
