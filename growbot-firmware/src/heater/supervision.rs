//! Supervision: what the reading does against what the nozzle can do.
//!
//! Three nozzles are reckoned along with the real one, by the power that they are given: one that takes heat as badly as a
//! sound one may (*sure*), one as the description says, mended by what the regulation has learned (*likely*), and one that takes
//! it as well as a sound one may (*most*). Each is reckoned for a reading that follows at once and for one that follows by
//! [`LAG_S`]; where a rise is missed the lesser counts, where there is too much of one the greater. The reading's change over each of
//! the last seconds, up to [`MARKS`], is compared with theirs.
//!
//! The limits hold for a capacity, loss and power of 10 % more or less than described and a reading that follows within 4 s.

#[cfg(test)]
mod tests;

use growbot_core::link::message::Fault;
use heapless::Deque;

use super::model::Nozzle;
use super::regulation::{WIGGLE_PERIOD_S, wiggle_at};

/// How late a sound reading may follow the nozzle, s.
const LAG_S: f32 = 4.0;
/// Seconds that are looked back, a mark each.
const MARKS: usize = 25;
const MARK_S: f32 = 1.0;

/// The nozzle that takes heat worst and best: shares of power, need and heat capacity.
const SURE: [f32; 3] = [0.88, 1.15, 1.12];
const MOST: [f32; 3] = [1.12, 0.85, 0.88];
/// A supply that is not measured may be 10 % off: shares of power.
const UNMEASURED: (f32, f32) = (0.81, 1.21);

/// The reading must follow a change that is sure of so much, degrees, by this share.
const SURE_C: f32 = 12.0;
const SURE_SHARE: f32 = 0.7;
/// And one that is likely.
const LIKELY_C: f32 = 26.0;
const LIKELY_SHARE: f32 = 0.4;
/// A reading that stands still through a likely change of so much, degrees, or for so long while the power is wiggled, is frozen.
const FROZEN_C: f32 = 12.0;
const FROZEN_S: f32 = 45.0;
/// One that does not follow, and has not changed at all for so long, s, is frozen too. A living one of half a degree a count stands for
/// nearly 3 s where a draught turns a rise into a fall.
const STILL_S: f32 = 4.0;
/// A reading that has never moved so far, degrees, may as well be that of a heater without effect.
const MOVED_C: f32 = 3.0;
/// A rise beyond what is possible at most, degrees, over windows of so many seconds: at any duty, and at none.
const RISE_C: (f32, f32) = (6.0, 2.0);
const RISE_S: (f32, f32) = (3.0, 6.0);
/// A fall beyond this many times what the nozzle does without any power, and so many degrees, over windows of so many seconds.
const FALL: (f32, f32) = (1.6, 4.0);
const FALL_S: (f32, f32) = (1.0, 5.0);
/// Once hot: so far below the target for so long, degrees and s; and out of the band for so long, s.
const DROP: (f32, f32) = (8.0, 3.0);
const OUT_OF_BAND_S: f32 = 30.0;
/// Mean power over about so long, s, beyond so many times the need.
const ENERGY_S: f32 = 60.0;
const ENERGY: f32 = 1.6;
/// Over so long the regulation's trim is learned, s, while the reading is so near the target, degrees.
const LEARNING_S: f32 = 30.0;
const LEARNING_C: f32 = 2.0;
/// The reading's part in the wiggle, as a share of it, below which it is missed; so often in a row means a fault.
const WIGGLE_SHARE: f32 = 0.15;
const WIGGLES: u32 = 2;
/// Power that is saturated for more than this share of so many periods in a row is more than a hot nozzle can need.
const SATURATED_SHARE: f32 = 0.6;
const SATURATED: u32 = 3;
/// The nozzle's own temperature is that of a reading that goes on for so long, s, at its rate beyond this, degrees a second.
const AHEAD_S: f32 = 4.0;
const AHEAD_C_PER_S: f32 = 0.5;
const AHEAD_WINDOW_S: f32 = 3.0;

/// A change that is reckoned: of the nozzle, and of a reading that follows it late, degrees.
#[derive(Debug, Clone, Copy, Default)]
struct Reckoned {
    prompt: f32,
    late: f32,
    late_rate: f32,
}

impl Reckoned {
    fn add(&mut self, rate: f32, seconds: f32) {
        self.prompt += rate * seconds;
        self.late += self.late_rate * seconds;
        self.late_rate += (rate - self.late_rate) * (seconds / LAG_S).min(1.0);
    }

    /// The same from another beginning on: over hours the sums would grow until what is added is lost in rounding.
    fn begin_at(&mut self, beginning: &Self) {
        self.prompt -= beginning.prompt;
        self.late -= beginning.late;
    }

    /// Changes since an earlier moment: the lesser and the greater.
    fn since(&self, earlier: &Self) -> (f32, f32) {
        let (prompt, late) = (self.prompt - earlier.prompt, self.late - earlier.late);
        (prompt.min(late), prompt.max(late))
    }
}

/// A moment that is looked back at.
#[derive(Debug, Clone, Copy)]
struct Mark {
    age_s: f32,
    reading_c: f32,
    sure: Reckoned,
    likely: Reckoned,
    most: Reckoned,
    /// The most that the reading may have fallen without any power, degrees.
    fall_c: f32,
}

/// What there is to look at after each period.
pub struct Look<'a> {
    pub reading_c: f32,
    pub target_c: f32,
    /// The duty over the time that has passed.
    pub duty: f32,
    /// That time, s.
    pub seconds: f32,
    /// Whether the target has been reached.
    pub hot: bool,
    /// The regulation as it was; none where it is not regulated but driven round the target.
    pub regulated: Option<Regulated>,
    pub nozzle: &'a Nozzle<'a>,
}

/// What supervision takes from the regulation.
#[derive(Debug, Clone, Copy)]
pub struct Regulated {
    pub trim: f32,
    pub saturated: bool,
    /// Phase (0 to 1) and amplitude (degrees) of the wiggle, none where there is none.
    pub wiggle: Option<(f32, f32)>,
}

/// The supervision of a heater that is on.
#[derive(Debug, Clone, Default)]
pub struct Supervision {
    marks: Deque<Mark, MARKS>,
    since_mark_s: f32,
    sure: Reckoned,
    likely: Reckoned,
    most: Reckoned,
    fall_c: f32,
    /// The trim, learned slowly.
    learned: f32,
    /// The reading when the heater was switched on, degrees Celsius, and whether it has left it since.
    first_c: Option<f32>,
    moved: bool,
    /// Since when the reading has not changed at all.
    still: Option<Still>,
    /// How long there has been no power, s.
    zero_s: f32,
    /// How long it has been far below the target, and out of the band, since it was hot, s.
    low_s: f32,
    out_s: f32,
    /// Mean power and mean need, W.
    energy: (f32, f32),
    wiggle: Wiggle,
}

#[derive(Debug, Clone, Copy)]
struct Still {
    reading_c: f32,
    /// For how long, s, and for how long of it the power has been wiggled.
    seconds: f32,
    wiggled_s: f32,
    likely: Reckoned,
}

/// The reading's part in the wiggle, over one period.
#[derive(Debug, Clone, Copy, Default)]
struct Wiggle {
    sine: f32,
    cosine: f32,
    seconds: f32,
    /// Saturated meanwhile, s.
    saturated_s: f32,
    /// Periods in a row in which it was missed, and in which there was too little room for it.
    missed: u32,
    saturated: u32,
}

impl Supervision {
    /// Another target: what refers to the one before is forgotten.
    pub fn retarget(&mut self) {
        (self.low_s, self.out_s) = (0.0, 0.0);
        self.wiggle = Wiggle::default();
    }

    /// Looks at a reading.
    ///
    /// # Errors
    /// What is wrong.
    #[inline(never)]
    pub fn look(&mut self, look: &Look) -> Result<(), Fault> {
        self.reckon(look);
        let fault =
            self.rises_or_falls(look).or_else(|| self.stands_still(look)).or_else(|| self.does_not_follow(look));
        let fault =
            fault.or_else(|| self.drops(look)).or_else(|| self.takes_energy(look)).or_else(|| self.wiggles(look));
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
        let Self { sure, likely, most, fall_c, .. } = *self;
        // There is room now.
        let _ = self.marks.push_back(Mark { age_s: 0.0, reading_c, sure, likely, most, fall_c });
        // All is reckoned from this mark on.
        for mark in &mut self.marks {
            mark.sure.begin_at(&sure);
            mark.likely.begin_at(&likely);
            mark.most.begin_at(&most);
            mark.fall_c -= fall_c;
        }
        self.sure.begin_at(&sure);
        self.likely.begin_at(&likely);
        self.most.begin_at(&most);
        self.fall_c = 0.0;
        if let Some(still) = &mut self.still {
            still.likely.begin_at(&likely);
        }
    }

    /// Reckons the three nozzles on.
    fn reckon(&mut self, look: &Look) {
        let (seconds, capacity) = (look.seconds, look.nozzle.heat_capacity_j_per_k);
        let (least, greatest) = if look.nozzle.measured { (1.0, 1.0) } else { UNMEASURED };
        let need = look.nozzle.needed_w(look.reading_c);
        let power = look.duty * look.nozzle.available_w;
        let rate = |[of_power, of_need, of_capacity]: [f32; 3], supply: f32| {
            (power * supply * of_power - need * of_need) / (capacity * of_capacity)
        };
        self.sure.add(rate(SURE, least), seconds);
        self.most.add(rate(MOST, greatest), seconds);
        self.likely.add(rate([1.0 / (1.0 + self.learned), 1.0, 1.0], least), seconds);
        self.fall_c += FALL.0 * need.max(0.0) / capacity * seconds;
        let near = (look.reading_c - look.target_c).abs() < LEARNING_C;
        if let Some(regulated) = look.regulated.filter(|regulated| near && !regulated.saturated) {
            self.learned += (regulated.trim - self.learned) * (seconds / LEARNING_S).min(1.0);
        }
        self.zero_s = if look.duty > 0.0 { 0.0 } else { self.zero_s + seconds };
        self.since_mark_s += seconds;
        for mark in &mut self.marks {
            mark.age_s += seconds;
        }
        if look.hot {
            let share = (seconds / ENERGY_S).min(1.0);
            self.energy.0 += (power * least - self.energy.0) * share;
            self.energy.1 += (need - self.energy.1) * share;
        } else {
            // What heats the nozzle up is judged by its rise.
            self.energy = (need, need);
        }
    }

    /// Faster up than with all the power that was given, hotter than it may be, or faster down than with none.
    fn rises_or_falls(&self, look: &Look) -> Option<Fault> {
        for mark in &self.marks {
            let (age, change) = (mark.age_s, look.reading_c - mark.reading_c);
            if within(age, FALL_S) && -change > self.fall_c - mark.fall_c + FALL.1 {
                return Some(Fault::ThermistorDetached);
            }
            let most = self.most.since(&mark.most).1.max(0.0);
            let margin = if self.zero_s >= age { RISE_C.1 } else { RISE_C.0 };
            if within(age, RISE_S) && change > most + margin {
                return Some(Fault::HeaterStuckOn);
            }
            if within(age, (AHEAD_WINDOW_S - 0.5, AHEAD_WINDOW_S + 0.5)) {
                let ahead = AHEAD_S * (change / age - AHEAD_C_PER_S).max(0.0);
                if look.reading_c + ahead > look.nozzle.max_c {
                    return Some(Fault::OverTemperature);
                }
            }
        }
        None
    }

    /// Not the least change where there must be one.
    fn stands_still(&mut self, look: &Look) -> Option<Fault> {
        let first = *self.first_c.get_or_insert(look.reading_c);
        self.moved |= (look.reading_c - first).abs() > MOVED_C;
        let fresh = Still { reading_c: look.reading_c, seconds: 0.0, wiggled_s: 0.0, likely: self.likely };
        let still = self.still.get_or_insert(fresh);
        // A mean of whole counts that does not change comes out the same to the last bit.
        if (still.reading_c - look.reading_c).abs() > 1e-6 {
            *still = fresh;
            return None;
        }
        still.seconds += look.seconds;
        if look.regulated.is_some_and(|regulated| regulated.wiggle.is_some() && !regulated.saturated) {
            still.wiggled_s += look.seconds;
        }
        let (least, greatest) = self.likely.since(&still.likely);
        // With a supply that is not measured, a fall is known only where there is no power.
        let falls = look.nozzle.measured || self.zero_s > LAG_S;
        if least > FROZEN_C {
            let dead_heater = !self.moved && !look.hot;
            return Some(if dead_heater || has_all_the_power(look) { lacks(look) } else { Fault::ThermistorFrozen });
        }
        let frozen = falls && greatest < -FROZEN_C || still.wiggled_s > FROZEN_S;
        frozen.then_some(Fault::ThermistorFrozen)
    }

    /// The reading does not go where the power takes the nozzle.
    fn does_not_follow(&self, look: &Look) -> Option<Fault> {
        for mark in &self.marks {
            let change = look.reading_c - mark.reading_c;
            let sure = self.sure.since(&mark.sure).0;
            let (likely, fall) = self.likely.since(&mark.likely);
            if sure > SURE_C && change < SURE_SHARE * sure || likely > LIKELY_C && change < LIKELY_SHARE * likely {
                let still = self.moved && self.still.is_some_and(|still| still.seconds > STILL_S);
                return Some(if still && !has_all_the_power(look) { Fault::ThermistorFrozen } else { lacks(look) });
            }
            let above = look.reading_c - look.target_c > look.nozzle.band_c && look.nozzle.measured;
            let reckoned = above || self.zero_s >= mark.age_s;
            if reckoned && fall < -LIKELY_C && change > LIKELY_SHARE * fall {
                return Some(if look.hot || change > RISE_C.1 {
                    Fault::HeaterStuckOn
                } else {
                    Fault::ThermistorFrozen
                });
            }
        }
        None
    }

    /// It was hot and is so no more.
    fn drops(&mut self, look: &Look) -> Option<Fault> {
        let below = if look.hot && look.regulated.is_some() { look.target_c - look.reading_c } else { 0.0 };
        self.low_s = if below > DROP.0 { self.low_s + look.seconds } else { 0.0 };
        self.out_s = if below > look.nozzle.band_c { self.out_s + look.seconds } else { 0.0 };
        (self.low_s > DROP.1 || self.out_s > OUT_OF_BAND_S).then_some(Fault::TemperatureDrop)
    }

    /// More energy than the nozzle can need.
    fn takes_energy(&self, look: &Look) -> Option<Fault> {
        let (mean, need) = self.energy;
        (look.hot && mean > ENERGY * need).then_some(Fault::HeaterEnergy)
    }

    /// The wiggle of the power does not show.
    fn wiggles(&mut self, look: &Look) -> Option<Fault> {
        let Some((phase, amplitude)) = look.regulated.and_then(|regulated| regulated.wiggle) else {
            self.wiggle = Wiggle::default();
            return None;
        };
        let wiggle = &mut self.wiggle;
        if wiggle.seconds > WIGGLE_PERIOD_S - 0.5 * look.seconds {
            let Wiggle { sine, cosine, seconds, saturated_s, missed, saturated } = *wiggle;
            let shown = 2.0 * libm::sqrtf(sine * sine + cosine * cosine) / seconds.max(1e-3);
            let missed = if shown < WIGGLE_SHARE * amplitude { missed + 1 } else { 0 };
            let saturated = if saturated_s > SATURATED_SHARE * seconds { saturated + 1 } else { 0 };
            *wiggle = Wiggle { missed, saturated, ..Wiggle::default() };
        }
        if look.regulated.is_some_and(|regulated| regulated.saturated) {
            wiggle.saturated_s += look.seconds;
        }
        let (sin, cos) = wiggle_at(phase);
        let error = look.reading_c - look.target_c;
        wiggle.sine += error * sin * look.seconds;
        wiggle.cosine += error * cos * look.seconds;
        wiggle.seconds += look.seconds;
        if wiggle.missed >= WIGGLES {
            // With all the power there is no wiggle; but a reading that stands meanwhile is not that of a hot nozzle either.
            return Some(if wiggle.saturated > 0 { Fault::HeaterEnergy } else { Fault::ThermistorFrozen });
        }
        (wiggle.saturated >= SATURATED).then_some(Fault::HeaterEnergy)
    }
}

/// Whether it gets all the power. A reading that stands then may be that of a nozzle that comes no further, as in a draught.
fn has_all_the_power(look: &Look) -> bool {
    look.duty >= 1.0
}

/// What a nozzle has that does not get as warm as its power makes it.
fn lacks(look: &Look) -> Fault {
    if !look.hot {
        Fault::HeatingTooSlow
    } else if look.reading_c < look.target_c - look.nozzle.band_c {
        Fault::TemperatureDrop
    } else {
        Fault::HeaterEnergy
    }
}

fn within(value: f32, (least, greatest): (f32, f32)) -> bool {
    (least..=greatest).contains(&value)
}
