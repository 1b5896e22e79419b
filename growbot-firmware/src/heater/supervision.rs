//! Supervision of the heater: compares the reading with the behaviour of the nozzle that three models predict.
//!
//! Three models run along with the real nozzle and use the power that it is given ([`models`]). The change of the
//! reading over each of the last seconds, up to [`MARKS`] of them, is compared with the changes of the models. The
//! change of each model is computed twice: for a reading that follows the nozzle at once, and for a reading that lags.
//! The change that is nearer to the reading counts, so that the comparison favours a healthy nozzle.
//!
//! The limits (docs/decisions/0023-heater-supervision.md) are for a nozzle whose heat capacity, loss and power differ
//! from its description by up to 10 % and whose reading follows within 4 s. Two trials bound each limit from opposite
//! sides. No limit may raise a fault on a healthy nozzle (`heater::tests::sound`, 1,000 h, and
//! `tests/no_false_alarms.rs`). Every fault must be found in its time (`heater::tests::faults`, 200 nozzles, and `cargo
//! fault-campaign`). The module's own tests check the values.
//!
//! The limits are:
//!
//! | fault | what is compared | limit | why |
//! |---|---|---|---|
//! | `thermistor-open`, `-short` | the conversions | most of a period's at an end of the scale | no working sensor is there |
//! | `thermistor-silent` | age of the reading | 0.4 s | its conversions may be 0.1 s older |
//! | `over-temperature` | reading; and reading ahead by 4 s of its rate over 3 s, beyond 0.5 C/s | `max_c` | the nozzle is ahead of its thermistor |
//! | `thermistor-detached` | fall over 1 to 5 s | 1.6 times the fall without power, and 4 C | nothing cools a nozzle so fast |
//! | `heater-stuck-on` | rise over 3 to 6 s | 6 C above *upper*, 2 C at no duty | the power is not the commanded power |
//! | | fall at no duty | below 40 % of *nominal*, from 26 C on | the same, where it holds the temperature; at a lowered setpoint this is `thermistor-frozen` |
//! | `heating-too-slow` | rise, until hot | below 70 % of *lower*, from 12 C on; or 40 % of *nominal*, from 26 C on | known within 10 s, not minutes |
//! | | time to hot | `heating_timeout_s` | any other reason |
//! | `thermistor-frozen` | a reading that is the same to the bit | through 12 C of *nominal*, or for 45 s of dither | noise or the dither changes every working reading |
//! | | the dither's part in the reading over 16 s | below 15 % of its amplitude, twice in a row | a constant voltage, with noise on it |
//! | `temperature-drop` | reading below setpoint, once hot | 8 C for 3 s; `band_c` for 30 s | draught, a heater's wire |
//! | | rise, once hot and below the band | as `heating-too-slow` | |
//! | `heater-energy` | rise, once hot and in the band | as `heating-too-slow` | power goes somewhere else |
//! | | mean power over 60 s, once hot | 1.6 times the need | |
//! | | saturated power, once hot | over 60 % of three dithers in a row | no working nozzle needs that |
//!
//! A reading that has not left its first value by 3 C is `heating-too-slow` even if it stands still, because a dead
//! heater looks the same. At full power, a nozzle in a draught that warms no further looks the same too: without noise,
//! and with half a degree a count, its reading does not change by a bit. Then the fault is `heating-too-slow`,
//! `temperature-drop` or `heater-energy`, depending on the reading. Heating up has no energy budget, because a rise
//! that *lower* does not allow is detected sooner than any sum.

mod models;
#[cfg(test)]
mod tests;

use core::ops::RangeInclusive;

use growbot_core::link::message::Fault;
use heapless::Deque;

use self::models::{
    Change, CheckBounds, Checkpoint, Factors, LAG_S, LOWER, MARK_S, MARKS, UNMEASURED_MAX, UNMEASURED_MIN, UPPER,
};
use super::model::NozzleModel;
use super::temperature_control::{DITHER_PERIOD_S, Dither, dither_at};

/// Rise that the lower model must predict, degrees, before a reading that has risen by less than [`LOWER_SHARE`] of it
/// is a fault (decision 0023). A smaller value raises false alarms in the trial `heater::tests::sound`; with a larger
/// one the trial `heater::tests::faults` finds a heater's open wire too late.
const LOWER_C: f32 = 12.0;
/// Share of the rise predicted by the lower model that the reading must show (decision 0023). A larger share raises
/// false alarms in the trial `heater::tests::sound`; with a smaller one the trial `heater::tests::faults` finds faults
/// too late.
const LOWER_SHARE: f32 = 0.7;
/// Change that the nominal model must predict, degrees, before a reading that has changed by less than
/// [`NOMINAL_SHARE`] of it is a fault. The value was raised from 22 until the trial `heater::tests::sound` raised no
/// alarm.
const NOMINAL_C: f32 = 26.0;
/// Share of the change predicted by the nominal model that the reading must show (decision 0023). With a smaller share
/// the trial `heater::tests::faults` fails, because in that trial a detached thermistor still gets up to 40 % of the
/// nozzle's warmth.
const NOMINAL_SHARE: f32 = 0.4;
/// Change predicted by the nominal model, degrees, after which a reading that has not changed at all counts as frozen
/// (decision 0023). With a larger value the trial `heater::tests::faults` fails: a frozen reading must be detected
/// within 15 s after the heater is switched on.
const FROZEN_C: f32 = 12.0;
/// Duration of the dither, s, after which a reading that has not changed at all counts as frozen (decision 0023). With
/// a longer time the trial `heater::tests::faults` fails: a frozen reading must be detected within 60 s.
const FROZEN_S: f32 = 45.0;
/// Time, s, after which a reading that does not follow the models and has not changed at all counts as frozen. In the
/// trial `heater::tests::sound`, the reading of a working sensor with half a degree a count does not change for nearly
/// 3 s when a draught turns a rise into a fall.
const STILL_S: f32 = 4.0;
/// Distance from the first reading after the heater was switched on, degrees, up to which the reading counts as never
/// having changed. Such a reading may also be caused by a heater without effect (decision 0023). The distance is well
/// above the noise in the trial `heater::tests::sound`, which is 1.5 counts of half a degree.
const MOVED_C: f32 = 3.0;
/// Degrees by which the reading may rise more than the upper model predicts (decision 0023). A smaller value raises
/// false alarms in the trial `heater::tests::sound`; with a larger one the trial `heater::tests::faults` finds a power
/// stage that is stuck on too late.
const RISE_C: f32 = 6.0;
/// Degrees by which the reading may rise more than the upper model predicts, if the heater had no power in the whole
/// time (decision 0023). The same trials bound it as [`RISE_C`].
const RISE_UNPOWERED_C: f32 = 2.0;
/// Ages of the checkpoints with which the reading is compared to find a rise, s (decision 0023). The same trials bound
/// them as [`RISE_C`].
const RISE_WINDOW_S: RangeInclusive<f32> = 3.0..=6.0;
/// Max fall of the reading, as a multiple of the fall of a nozzle without any power. [`FALL_C`] is added to this limit.
/// A faster fall cannot be that of the nozzle (decision 0023). A smaller value raises false alarms in the trial
/// `heater::tests::sound`; with a larger one the trial `heater::tests::faults` finds a detached thermistor too late.
const FALL_TIMES: f32 = 1.6;
/// Degrees that are added to the limit [`FALL_TIMES`] of a fall of the reading (decision 0023). The same trials bound
/// them as [`FALL_TIMES`].
const FALL_C: f32 = 4.0;
/// Ages of the checkpoints with which the reading is compared to find a fall, s (decision 0023). The same trials bound
/// them as [`FALL_TIMES`].
const FALL_WINDOW_S: RangeInclusive<f32> = 1.0..=5.0;
/// Distance of a hot nozzle below its target, degrees, which is a temperature drop if it lasts for [`DROP_S`] (decision
/// 0023). A smaller distance raises false alarms in the trial `heater::tests::sound`, in which the flow varies by 35 %.
const DROP_C: f32 = 8.0;
/// Time for which a hot nozzle must be [`DROP_C`] below its target to count as a temperature drop, s (decision 0023).
/// With a longer time the trial `heater::tests::faults` fails: a heater's open wire must be detected within 20 s.
const DROP_S: f32 = 3.0;
/// Max time for which a hot nozzle may be below its temperature band, s. The time was lengthened from 20 s until the
/// trial `heater::tests::sound` raised no alarm.
const OUT_OF_BAND_S: f32 = 30.0;
/// Time over which the heater's actual power and the power that the model expects are averaged, s (decision 0023). A
/// shorter time raises false alarms in the trial `heater::tests::sound`; a longer one finds faults too late in the
/// trial `heater::tests::faults`.
const ENERGY_S: f32 = 60.0;
/// Max mean power of the heater, as a multiple of the mean power that the model expects (decision 0023). A smaller
/// value raises false alarms in the trial `heater::tests::sound`: 10 % more loss and 10 % less power than described
/// already give 1.22.
const ENERGY_TIMES: f32 = 1.6;
/// Time over which the supervision learns the integral term (trim) of the temperature control, s. A longer time raises
/// false alarms in the trial `heater::tests::sound`, because the nominal model is wrong until the term is learned. A
/// shorter time hides faults in the trial `heater::tests::faults`, because a fault is learned too.
const LEARNING_S: f32 = 30.0;
/// Distance from the target within which the integral term (trim) of the temperature control is learned, degrees. The
/// same trials bound it as [`LEARNING_S`].
const LEARNING_C: f32 = 2.0;
/// Share of the dither's amplitude below which the dither counts as missing in the reading (decision 0023). A larger
/// share raises false alarms in the trial `heater::tests::sound`; with a smaller one the trial `heater::tests::faults`
/// does not find a constant voltage with noise.
const DITHER_SHARE: f32 = 0.15;
/// Number of consecutive dither periods without the dither in the reading after which a fault is raised (decision
/// 0023). The trial `heater::tests::faults` allows 120 s for the detection.
const DITHERS_MISSED: u32 = 2;
/// Share of a dither period for which the power must be saturated so that the period counts as saturated. The share was
/// raised from 0.3 until the trial `heater::tests::sound` raised no alarm.
const SATURATED_SHARE: f32 = 0.6;
/// Number of consecutive saturated dither periods after which a fault is raised, because no hot nozzle needs that much
/// power (decision 0023). The same trials bound it as [`SATURATED_SHARE`].
const PERIODS_SATURATED: u32 = 3;
/// Time by which the reading is extrapolated to predict the temperature, s, because the nozzle is ahead of its
/// thermistor. The time equals the lag of the slowest healthy thermistor, [`LAG_S`].
const AHEAD_S: f32 = 4.0;
/// Rate of the reading, degrees a second, above which the reading is extrapolated (decision 0023). With a higher rate
/// the trial `heater::tests::faults` fails: the nozzle must stay below 5 C above `max_c`.
const AHEAD_C_PER_S: f32 = 0.5;
/// Ages of the checkpoints from which the rate of the reading is measured to predict the temperature, s. They are about
/// 3 s (decision 0023).
const AHEAD_WINDOW_S: RangeInclusive<f32> = 2.5..=3.5;

/// Inputs of the supervision in one control period.
pub struct SupervisionInput<'a> {
    pub reading_c: f32,
    pub target_c: f32,
    /// Duty of the heater in the control period, 0 to 1.
    pub duty: f32,
    /// Length of the control period, s.
    pub seconds: f32,
    /// True if the nozzle has reached its target since the target was set.
    pub hot: bool,
    /// State of the temperature control. `None` while the PID gains are tuned.
    pub regulated: Option<ControlState>,
    pub nozzle: &'a NozzleModel<'a>,
}

/// The part of the temperature control's state that the supervision of the heater needs.
#[derive(Debug, Clone, Copy)]
pub struct ControlState {
    pub trim: f32,
    pub saturated: bool,
    /// Phase and amplitude of the dither. `None` while the power is not dithered.
    pub dither: Option<Dither>,
}

/// State of the supervision of a heater that is on.
#[derive(Debug, Clone, Default)]
pub struct Supervision {
    marks: Deque<Checkpoint, MARKS>,
    since_mark_s: f32,
    lower: Change,
    nominal: Change,
    upper: Change,
    fall_c: f32,
    /// Integral term (trim) of the temperature control, averaged over [`LEARNING_S`].
    learned: f32,
    /// First reading after the heater was switched on, degrees Celsius. `None` before that reading.
    first_c: Option<f32>,
    /// True once the reading has differed from `first_c` by more than [`MOVED_C`].
    moved: bool,
    /// Latest reading, and the time for which it has not changed. `None` before the first reading.
    still: Option<FrozenReading>,
    /// Time for which the heater has had no power, s.
    unpowered_s: f32,
    /// Time for which a hot nozzle has been more than [`DROP_C`] below its target, s.
    low_s: f32,
    /// Time for which a hot nozzle has been below its temperature band, s.
    out_s: f32,
    /// Power of the heater and the power that the model expects, each a mean over [`ENERGY_S`].
    mean: MeanHeat,
    dither: DitherPeriod,
}

/// A reading, and the time for which it has not changed.
#[derive(Debug, Clone, Copy)]
struct FrozenReading {
    reading_c: f32,
    /// Time since the latest change of the reading, s.
    seconds: f32,
    /// Time since the latest change of the reading in which the power was dithered, s.
    dithered_s: f32,
    /// Running change of the nominal model at the latest change of the reading.
    nominal: Change,
}

/// Mean power of the heater and mean power that the model expects, W.
#[derive(Debug, Clone, Copy, Default)]
struct MeanHeat {
    power_w: f32,
    need_w: f32,
}

/// Sums over one period of the dither, from which the dither's amplitude in the reading is computed.
#[derive(Debug, Clone, Copy, Default)]
struct DitherPeriod {
    sine: f32,
    cosine: f32,
    seconds: f32,
    /// Time in the current dither period in which the power was saturated, s.
    saturated_s: f32,
    /// Number of consecutive dither periods in which the dither was missing in the reading.
    missed: u32,
    /// Number of consecutive dither periods in which the power was saturated.
    saturated: u32,
}

impl Supervision {
    /// Resets the state of the supervision that refers to the previous target.
    pub fn retarget(&mut self) {
        (self.low_s, self.out_s) = (0.0, 0.0);
        self.dither = DitherPeriod::default();
    }

    /// Advances the models by a control period, and compares the reading with them.
    ///
    /// # Errors
    /// Returns the fault that the reading shows.
    #[inline(never)]
    pub fn look(&mut self, look: &SupervisionInput) -> Result<(), Fault> {
        self.advance_models(look);
        let fault = self.check_rate(look).or_else(|| self.check_frozen(look)).or_else(|| self.check_response(look));
        let fault = fault
            .or_else(|| self.check_drop(look))
            .or_else(|| self.check_energy(look))
            .or_else(|| self.check_dither(look));
        if self.since_mark_s >= MARK_S {
            self.mark(look.reading_c);
        }
        fault.map_or(Ok(()), Err)
    }

    fn mark(&mut self, reading_c: f32) {
        self.since_mark_s = 0.0;
        if self.marks.is_full() {
            self.marks.pop_front();
        }
        let Self { lower, nominal, upper, fall_c, .. } = *self;
        // The queue is not full: its oldest element was removed above.
        let _ = self.marks.push_back(Checkpoint { age_s: 0.0, reading_c, lower, nominal, upper, fall_c });
        // All changes count from this checkpoint on.
        for mark in &mut self.marks {
            mark.lower.rebase(&lower);
            mark.nominal.rebase(&nominal);
            mark.upper.rebase(&upper);
            mark.fall_c -= fall_c;
        }
        self.lower.rebase(&lower);
        self.nominal.rebase(&nominal);
        self.upper.rebase(&upper);
        self.fall_c = 0.0;
        if let Some(still) = &mut self.still {
            still.nominal.rebase(&nominal);
        }
    }

    /// Advances the three models, and the mean powers, by a control period.
    fn advance_models(&mut self, look: &SupervisionInput) {
        let (seconds, capacity) = (look.seconds, look.nozzle.heat_capacity_j_per_k);
        let (min, max) = if look.nozzle.measured { (1.0, 1.0) } else { (UNMEASURED_MIN, UNMEASURED_MAX) };
        let need = look.nozzle.needed_w(look.reading_c);
        let power = look.duty * look.nozzle.available_w;
        let rate = |of: Factors, supply: f32| (power * supply * of.power - need * of.need) / (capacity * of.capacity);
        self.lower.add(rate(LOWER, min), seconds);
        self.upper.add(rate(UPPER, max), seconds);
        let learned = Factors { power: 1.0 / (1.0 + self.learned), need: 1.0, capacity: 1.0 };
        self.nominal.add(rate(learned, min), seconds);
        self.fall_c += FALL_TIMES * need.max(0.0) / capacity * seconds;
        let near = (look.reading_c - look.target_c).abs() < LEARNING_C;
        if let Some(regulated) = look.regulated.filter(|regulated| near && !regulated.saturated) {
            self.learned += (regulated.trim - self.learned) * (seconds / LEARNING_S).min(1.0);
        }
        self.unpowered_s = if look.duty > 0.0 { 0.0 } else { self.unpowered_s + seconds };
        self.since_mark_s += seconds;
        for mark in &mut self.marks {
            mark.age_s += seconds;
        }
        if look.hot {
            let share = (seconds / ENERGY_S).min(1.0);
            self.mean.power_w += (power * min - self.mean.power_w) * share;
            self.mean.need_w += (need - self.mean.need_w) * share;
        } else {
            // While the nozzle heats up, its rise is judged instead of its mean power.
            self.mean = MeanHeat { power_w: need, need_w: need };
        }
    }

    /// Checks for a reading that rises faster than the heater's power allows, is about to exceed `max_c`, or falls
    /// faster than that of a nozzle without power.
    fn check_rate(&self, look: &SupervisionInput) -> Option<Fault> {
        for mark in &self.marks {
            let (age, change) = (mark.age_s, look.reading_c - mark.reading_c);
            if FALL_WINDOW_S.contains(&age) && -change > self.fall_c - mark.fall_c + FALL_C {
                return Some(Fault::ThermistorDetached);
            }
            let upper = self.upper.since(&mark.upper).max.max(0.0);
            let margin = if self.unpowered_s >= age { RISE_UNPOWERED_C } else { RISE_C };
            if RISE_WINDOW_S.contains(&age) && change > upper + margin {
                return Some(Fault::HeaterStuckOn);
            }
            if AHEAD_WINDOW_S.contains(&age) {
                let ahead = AHEAD_S * (change / age - AHEAD_C_PER_S).max(0.0);
                if look.reading_c + ahead > look.nozzle.max_c {
                    return Some(Fault::OverTemperature);
                }
            }
        }
        None
    }

    /// Checks for a reading that does not change at all, although the models or the dither require a change.
    fn check_frozen(&mut self, look: &SupervisionInput) -> Option<Fault> {
        let first = *self.first_c.get_or_insert(look.reading_c);
        self.moved |= (look.reading_c - first).abs() > MOVED_C;
        let fresh = FrozenReading { reading_c: look.reading_c, seconds: 0.0, dithered_s: 0.0, nominal: self.nominal };
        let still = self.still.get_or_insert(fresh);
        // A mean of whole counts that does not change is equal to the last bit.
        if (still.reading_c - look.reading_c).abs() > 1e-6 {
            *still = fresh;
            return None;
        }
        still.seconds += look.seconds;
        if look.regulated.is_some_and(|regulated| regulated.dither.is_some() && !regulated.saturated) {
            still.dithered_s += look.seconds;
        }
        let nominal = self.nominal.since(&still.nominal);
        // If the supply is not measured, a fall is certain only without power.
        let falls = look.nozzle.measured || self.unpowered_s > LAG_S;
        if nominal.min > FROZEN_C {
            let dead_heater = !self.moved && !look.hot;
            return Some(if dead_heater || has_all_the_power(look) { lacks(look) } else { Fault::ThermistorFrozen });
        }
        let frozen = falls && nominal.max < -FROZEN_C || still.dithered_s > FROZEN_S;
        frozen.then_some(Fault::ThermistorFrozen)
    }

    /// Checks for a reading that changes less than the heater's power requires.
    fn check_response(&self, look: &SupervisionInput) -> Option<Fault> {
        for mark in &self.marks {
            let change = look.reading_c - mark.reading_c;
            let lower = self.lower.since(&mark.lower).min;
            let CheckBounds { min: rise, max: fall } = self.nominal.since(&mark.nominal);
            if lower > LOWER_C && change < LOWER_SHARE * lower || rise > NOMINAL_C && change < NOMINAL_SHARE * rise {
                let still = self.moved && self.still.is_some_and(|still| still.seconds > STILL_S);
                return Some(if still && !has_all_the_power(look) { Fault::ThermistorFrozen } else { lacks(look) });
            }
            let above = look.reading_c - look.target_c > look.nozzle.band_c && look.nozzle.measured;
            let is_known = above || self.unpowered_s >= mark.age_s;
            if is_known && fall < -NOMINAL_C && change > NOMINAL_SHARE * fall {
                return Some(if look.hot || change > RISE_UNPOWERED_C {
                    Fault::HeaterStuckOn
                } else {
                    Fault::ThermistorFrozen
                });
            }
        }
        None
    }

    /// Checks for a nozzle that was hot and is too cold.
    fn check_drop(&mut self, look: &SupervisionInput) -> Option<Fault> {
        let below = if look.hot && look.regulated.is_some() { look.target_c - look.reading_c } else { 0.0 };
        self.low_s = if below > DROP_C { self.low_s + look.seconds } else { 0.0 };
        self.out_s = if below > look.nozzle.band_c { self.out_s + look.seconds } else { 0.0 };
        (self.low_s > DROP_S || self.out_s > OUT_OF_BAND_S).then_some(Fault::TemperatureDrop)
    }

    /// Checks for a nozzle that takes more power than it can need.
    fn check_energy(&self, look: &SupervisionInput) -> Option<Fault> {
        let MeanHeat { power_w, need_w } = self.mean;
        (look.hot && power_w > ENERGY_TIMES * need_w).then_some(Fault::HeaterEnergy)
    }

    /// Checks for a dither that is missing in the reading, and for power that is saturated for too many dither periods.
    fn check_dither(&mut self, look: &SupervisionInput) -> Option<Fault> {
        let Some(Dither { phase, amplitude_c }) = look.regulated.and_then(|regulated| regulated.dither) else {
            self.dither = DitherPeriod::default();
            return None;
        };
        let period = &mut self.dither;
        if period.seconds > DITHER_PERIOD_S - 0.5 * look.seconds {
            let DitherPeriod { sine, cosine, seconds, saturated_s, missed, saturated } = *period;
            let shown = 2.0 * libm::sqrtf(sine * sine + cosine * cosine) / seconds.max(1e-3);
            let missed = if shown < DITHER_SHARE * amplitude_c { missed + 1 } else { 0 };
            let saturated = if saturated_s > SATURATED_SHARE * seconds { saturated + 1 } else { 0 };
            *period = DitherPeriod { missed, saturated, ..DitherPeriod::default() };
        }
        if look.regulated.is_some_and(|regulated| regulated.saturated) {
            period.saturated_s += look.seconds;
        }
        let (sin, cos) = dither_at(phase);
        let error = look.reading_c - look.target_c;
        period.sine += error * sin * look.seconds;
        period.cosine += error * cos * look.seconds;
        period.seconds += look.seconds;
        if period.missed >= DITHERS_MISSED {
            // Full power leaves no room for the dither. If the reading does not change at full power, the nozzle is not
            // hot either.
            return Some(if period.saturated > 0 { Fault::HeaterEnergy } else { Fault::ThermistorFrozen });
        }
        (period.saturated >= PERIODS_SATURATED).then_some(Fault::HeaterEnergy)
    }
}

/// Returns whether the heater gets full power. A reading that does not change at full power may be that of a nozzle in
/// a draught, which gets no warmer.
fn has_all_the_power(look: &SupervisionInput) -> bool {
    look.duty >= 1.0
}

/// Returns the fault to report for a nozzle that is less warm than its power should make it. The fault depends on the
/// reading, and on whether the nozzle was hot.
fn lacks(look: &SupervisionInput) -> Fault {
    if !look.hot {
        Fault::HeatingTooSlow
    } else if look.reading_c < look.target_c - look.nozzle.band_c {
        Fault::TemperatureDrop
    } else {
        Fault::HeaterEnergy
    }
}
