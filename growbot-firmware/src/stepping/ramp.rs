//! Ramps: acceleration and deceleration of a turn.
//!
//! The sectors of a turn are laid out in *virtual ticks*. A real tick advances virtual time by the *rate*, [`ONE`] at
//! most: an accumulator adds it up, and each time it overflows a virtual tick is due. Both axes therefore slow down
//! together and lay the same plastic at any rate, to the step.
//!
//! From rest the rate begins at the speed that the motors can reach at an instant, and rises evenly. Before the end of
//! a turn it falls in time, to a rate that allows a stop, or to the entry rate of the next turn. Slopes and rates come
//! with each turn ([`Pace`]), so that the interrupt only multiplies and compares, without division.
//!
//! If a move arrives while a turn brakes, the turn speeds up again. A layer in which no speed exceeds the jumps has no
//! ramp, and every tick counts. Homing and moves of the filament run evenly, at speeds within the jump.

use growbot_core::robot::{AxisMotion, LayerMotion};

/// Full speed: a virtual tick in each tick.
pub const ONE: u32 = 1 << FRACTION;
/// Bits of a rate below one.
const FRACTION: u32 = 24;

/// Limits of the rate at the beginning and the end of a turn, and of its change. Rates are in units of 2^-24.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RampLimits {
    /// Max rate from rest, and to rest.
    pub(super) start: u32,
    /// Max change of the rate in a tick.
    pub(super) slope: u32,
    /// Max rate at which the turn may follow the one before. The change of speed between the two is within the speed
    /// that the motors can reach at an instant, and the turn is long enough to brake.
    pub(super) entry: u32,
    /// Virtual ticks within which the turn can brake from any rate.
    pub(super) braking: u32,
}

/// Signed speeds of both axes at the beginning and the end of a turn at full rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EndSpeeds {
    head: f64,
    feed: f64,
}

impl EndSpeeds {
    pub fn of(motion: &LayerMotion, backwards: bool) -> Self {
        let head = motion.head.speed_at_ends;
        Self { head: if backwards { -head } else { head }, feed: motion.feed.speed_at_ends }
    }
}

/// Converts a share of full speed to a rate, rounded down, but at least 1 unit.
fn units(share: f64) -> u32 {
    ((share.min(1.0) * f64::from(ONE)) as u32).max(1)
}

impl RampLimits {
    /// The pace without ramps.
    pub(super) const FULL: Self = Self { start: ONE, slope: ONE, entry: ONE, braking: 0 };

    /// Returns the pace of a turn of this number of ticks that follows another.
    pub(super) fn of(
        motion: &LayerMotion,
        ends: &EndSpeeds,
        before: Option<&EndSpeeds>,
        tick_hz: u32,
        ticks: u32,
    ) -> Self {
        let axes = [&motion.head, &motion.feed];
        let min_share = |share: &dyn Fn(&AxisMotion) -> f64| axes.into_iter().map(share).fold(1.0, f64::min);
        let start = units(min_share(&|axis| axis.jump / axis.speed));
        let slope = units(min_share(&|axis| {
            if axis.is_within_jump() { 1.0 } else { axis.ramp_acceleration / axis.speed / f64::from(tick_hz) }
        }));
        let change = before.map_or([0.0; 2], |before| [ends.head - before.head, ends.feed - before.feed]);
        // A change of 0 gives infinity, which `units` limits to full speed.
        let passing = axes
            .into_iter()
            .zip(change)
            .map(|(axis, change)| axis.layer_change_jump / change.abs())
            .fold(1.0, f64::min);
        // From that rate the turn can brake to `start`: see `Clock::can_brake`, solved for the rate.
        let (from, by) = (f64::from(start), f64::from(slope));
        let room = 2.0 * by * f64::from(ticks) * f64::from(ONE);
        let brakable = libm::sqrt(by * by / 4.0 + from * from - by * from + room) - by / 2.0;
        Self {
            start,
            slope,
            entry: units(passing.min(brakable / f64::from(ONE))),
            braking: (ONE / 2).checked_div(slope).unwrap_or(ONE) + 3,
        }
    }

    /// Returns the max number of ticks that a turn can take beyond its own. They are two ramps up and two down, because
    /// a move that arrives while the turn brakes speeds it up again, and some virtual ticks at the slowest rate.
    pub(super) fn ramps_ticks(&self) -> u32 {
        let slowest = ONE.div_ceil(self.start.min(self.entry).max(1));
        self.braking.saturating_mul(4).saturating_add(slowest.saturating_mul(4))
    }
}

/// The virtual clock.
pub(super) struct Clock {
    /// Rate; 0 at rest.
    rate: u32,
    accumulator: u32,
}

impl Clock {
    pub const AT_REST: Self = Self { rate: 0, accumulator: 0 };

    #[inline]
    pub fn is_at_rest(&self) -> bool {
        self.rate == 0
    }

    /// Begins a turn: from rest, or at the rate at which the one before has ended.
    pub fn enter(&mut self, pace: &RampLimits) {
        // A rate above the entry rate of the next turn is low enough to stop: the engine has braked to one of the two.
        self.rate = if self.rate <= pace.entry { self.rate.max(pace.start) } else { pace.start };
    }

    /// Advances by a tick, with `left` virtual ticks of the turn left. Returns whether a virtual tick is due. `passing`
    /// is the rate at which the next turn can be entered, 0 without one.
    #[inline]
    pub fn tick(&mut self, pace: &RampLimits, left: u32, passing: u32) -> bool {
        let goal = passing.max(pace.start);
        if self.rate != ONE || (goal != ONE && left <= pace.braking) {
            self.change(pace, left, goal);
        }
        self.accumulator += self.rate;
        let due = self.accumulator >= ONE;
        if due {
            self.accumulator -= ONE;
        }
        due
    }

    /// Accelerates if the turn can still brake to the goal by its end, and decelerates if it must.
    fn change(&mut self, pace: &RampLimits, left: u32, goal: u32) {
        let faster = (self.rate + pace.slope).min(ONE);
        if left > pace.braking || self.can_brake(pace, left, goal, faster) {
            self.rate = faster;
        } else if !self.can_brake(pace, left, goal, self.rate) {
            self.rate = self.rate.saturating_sub(pace.slope).max(goal);
        }
    }

    /// Returns whether this tick can run at a rate. Each tick after it reduces the rate by a slope, until the goal is
    /// reached. From `r` to `g` by `s`, that takes `(r + g)(r - g + s) / 2 s` of virtual time. The computation does not
    /// overflow, because `left` is within [`Pace::braking`].
    fn can_brake(&self, pace: &RampLimits, left: u32, goal: u32, rate: u32) -> bool {
        let Some(over) = rate.checked_sub(goal) else { return true };
        let room = (u64::from(left) << FRACTION) - u64::from(self.accumulator);
        over == 0 || u64::from(rate + goal) * u64::from(over + pace.slope) <= 2 * u64::from(pace.slope) * room
    }

    /// Returns the number of next ticks that are all virtual ticks for certain; 0 while the rate changes.
    #[inline]
    pub fn steady_ticks(&self, pace: &RampLimits, left: u32, passing: u32) -> u32 {
        if self.rate != ONE {
            0
        } else if passing.max(pace.start) == ONE {
            u32::MAX
        } else {
            left.saturating_sub(pace.braking)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a turn of this number of ticks. Returns the rate in each real tick.
    fn run(clock: &mut Clock, pace: &RampLimits, ticks: u32, passing: impl Fn(u32) -> u32) -> std::vec::Vec<u32> {
        let (mut left, mut rates) = (ticks, std::vec::Vec::new());
        clock.enter(pace);
        while left > 0 {
            if clock.tick(pace, left, passing(left)) {
                left -= 1;
            }
            rates.push(clock.rate);
        }
        rates
    }

    fn pace(start: u32, slope: u32, entry: u32) -> RampLimits {
        RampLimits { start, slope, entry, braking: ONE / 2 / slope + 3 }
    }

    #[test]
    fn a_turn_from_rest_to_rest_goes_up_and_down_evenly() {
        for ticks in [1, 2, 7, 100, 1000, 30_000] {
            for slope in [1 << 8, 12_345, 1 << 14, 1 << 20, ONE] {
                for start in [1 << 18, ONE / 3, ONE - 1, ONE] {
                    let pace = pace(start, slope, ONE);
                    let rates = run(&mut { Clock::AT_REST }, &pace, ticks, |_| 0);
                    assert!(rates.iter().all(|rate| (start..=ONE).contains(rate)));
                    assert!(rates.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= slope));
                    assert!(rates[0] <= (start + slope).min(ONE));
                    assert_eq!(
                        *rates.last().unwrap(),
                        start.max(rates[0].saturating_sub(slope)),
                        "{ticks} {slope} {start}"
                    );
                    // The rate rises, then falls, and never rises again. It is only as low as necessary.
                    let top = rates.iter().max().unwrap();
                    let summit = rates.iter().position(|rate| rate == top).unwrap();
                    assert!(rates[..summit].is_sorted());
                    assert!(rates[summit..].is_sorted_by(|a, b| a >= b));
                    let even = rates.iter().filter(|rate| **rate == start).count() as u64;
                    assert!(
                        even * u64::from(start) <= 2 * u64::from(ONE) + 3 * u64::from(start)
                            || start == ONE
                            || ticks < 10
                    );
                }
            }
        }
    }

    #[test]
    fn it_brakes_to_what_the_next_turn_can_be_entered_at() {
        let this = pace(ONE / 10, 2000, ONE);
        for entry in [ONE / 20, ONE / 10, ONE / 2, ONE] {
            let mut clock = Clock::AT_REST;
            let rates = run(&mut clock, &this, 20_000, |_| entry);
            let last = *rates.last().unwrap();
            assert!(last <= entry.max(this.start) && last + 4000 >= entry.max(this.start).min(ONE));
            clock.enter(&pace(ONE / 10, 2000, entry));
            assert_eq!(clock.rate, if last <= entry { last } else { ONE / 10 });
        }
    }

    #[test]
    fn an_order_that_comes_while_it_brakes_speeds_it_up_again() {
        let pace = pace(ONE / 10, 2000, ONE);
        let mut clock = Clock::AT_REST;
        let rates = run(&mut clock, &pace, 20_000, |left| if left < 1000 { ONE } else { 0 });
        assert!(rates.iter().rev().take(5000).min().unwrap() < &(ONE / 2));
        assert!(*rates.last().unwrap() > ONE / 2);
        assert!(rates.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= pace.slope));
    }
}
