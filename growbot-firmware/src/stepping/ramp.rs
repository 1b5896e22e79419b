//! Ramps: acceleration at the beginning and deceleration at the end of a turn of the head.
//!
//! The sectors of a turn are laid out in *virtual ticks*. A real tick advances virtual time by the *rate*,
//! [`FULL_RATE`] at most: an accumulator adds it up, and each time it overflows a virtual tick is due. Both axes
//! therefore slow down together and lay the same plastic at any rate, to the step.
//!
//! From rest the rate begins at the speed that the motors can reach at an instant (the speed jump), and rises evenly.
//! Before the end of a turn it falls in time, to a rate that allows a stop, or to the entry rate of the next turn. The
//! limits come with each turn ([`RampLimits`]), so that the interrupt only multiplies and compares, without division.
//!
//! If a move arrives while a turn brakes, the turn speeds up again. A layer in which no speed exceeds the speed jump
//! has no ramp, and every tick is a virtual tick. Homing and moves of the filament run at constant speed, within the
//! speed jump.

use growbot_core::robot::{AxisMotion, LayerMotion};

use super::direction::MotorDirection;

/// Rate at full speed: one virtual tick in each tick.
pub const FULL_RATE: u32 = 1 << FRACTION;
/// Number of fractional bits of a rate.
const FRACTION: u32 = 24;

/// Limits of the rate at the beginning and the end of a turn, and of its change. Rates are in units of 2^-24.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RampLimits {
    /// Max rate at which a turn may begin from rest, and may end at rest.
    pub(super) start_rate: u32,
    /// Max change of the rate from one tick to the next.
    pub(super) rate_step: u32,
    /// Max rate at which the turn may follow the previous turn. The change of speed between the two turns is then
    /// within the speed jump of the motors, and the turn is long enough to brake.
    pub(super) entry_rate: u32,
    /// Number of virtual ticks within which the turn can brake from any rate.
    pub(super) braking_ticks: u32,
}

/// Signed speeds of head (turns/s) and feed (mm/s) at the beginning and the end of a turn at full rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EndSpeeds {
    head: f64,
    feed: f64,
}

impl EndSpeeds {
    pub fn of(motion: &LayerMotion, direction: MotorDirection) -> Self {
        let head = motion.head.speed_at_ends;
        Self { head: if direction == MotorDirection::Forward { head } else { -head }, feed: motion.feed.speed_at_ends }
    }
}

/// Converts a share of full speed to a rate in units of 2^-24, rounded down, but at least 1 unit.
fn units(share: f64) -> u32 {
    ((share.min(1.0) * f64::from(FULL_RATE)) as u32).max(1)
}

impl RampLimits {
    /// Limits of a turn without ramps: it runs at full rate from its first tick to its last.
    pub(super) const FULL: Self =
        Self { start_rate: FULL_RATE, rate_step: FULL_RATE, entry_rate: FULL_RATE, braking_ticks: 0 };

    /// Returns the limits for a turn of `ticks` virtual ticks. `before` contains the speeds of the previous turn, and
    /// is `None` if the turn begins at rest.
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
        // From that rate the turn can brake to `start`: see `VirtualClock::can_brake`, solved for the rate.
        let (from, by) = (f64::from(start), f64::from(slope));
        let room = 2.0 * by * f64::from(ticks) * f64::from(FULL_RATE);
        let brakable = libm::sqrt(by * by / 4.0 + from * from - by * from + room) - by / 2.0;
        Self {
            start_rate: start,
            rate_step: slope,
            entry_rate: units(passing.min(brakable / f64::from(FULL_RATE))),
            braking_ticks: (FULL_RATE / 2).checked_div(slope).unwrap_or(FULL_RATE) + 3,
        }
    }

    /// Returns the max number of ticks that ramps can add to a turn. It allows for two ramps up and two down, because a
    /// move that arrives while the turn brakes speeds it up again, and for some virtual ticks at the slowest rate.
    pub(super) fn ramps_ticks(&self) -> u32 {
        let slowest = FULL_RATE.div_ceil(self.start_rate.min(self.entry_rate).max(1));
        self.braking_ticks.saturating_mul(4).saturating_add(slowest.saturating_mul(4))
    }
}

/// Clock of virtual ticks, whose rate rises and falls with the ramps.
pub(super) struct VirtualClock {
    /// Present rate, virtual ticks a tick in units of 2^-24; 0 at rest.
    rate: u32,
    accumulator: u32,
}

impl VirtualClock {
    pub const AT_REST: Self = Self { rate: 0, accumulator: 0 };

    #[inline]
    pub fn is_at_rest(&self) -> bool {
        self.rate == 0
    }

    /// Begins a turn: from rest, or at the rate at which the previous turn has ended.
    pub fn enter(&mut self, pace: &RampLimits) {
        // A rate above the entry rate of the next turn is low enough to stop: the engine has braked to one of the two.
        self.rate = if self.rate <= pace.entry_rate { self.rate.max(pace.start_rate) } else { pace.start_rate };
    }

    /// Advances by a tick. Returns whether a virtual tick is due. `left` is the number of virtual ticks left in the
    /// turn. `passing` is the rate at which the next turn can be entered, 0 if there is none.
    #[inline]
    pub fn tick(&mut self, pace: &RampLimits, left: u32, passing: u32) -> bool {
        let goal = passing.max(pace.start_rate);
        if self.rate != FULL_RATE || (goal != FULL_RATE && left <= pace.braking_ticks) {
            self.change(pace, left, goal);
        }
        self.accumulator += self.rate;
        let due = self.accumulator >= FULL_RATE;
        if due {
            self.accumulator -= FULL_RATE;
        }
        due
    }

    /// Raises the rate if the turn can then still brake to the rate `goal` by its end, and reduces it if the turn must
    /// brake.
    fn change(&mut self, pace: &RampLimits, left: u32, goal: u32) {
        let faster = (self.rate + pace.rate_step).min(FULL_RATE);
        if left > pace.braking_ticks || self.can_brake(pace, left, goal, faster) {
            self.rate = faster;
        } else if !self.can_brake(pace, left, goal, self.rate) {
            self.rate = self.rate.saturating_sub(pace.rate_step).max(goal);
        }
    }

    /// Returns whether the turn can still brake to the rate `goal` in time if this tick runs at `rate`. Each tick after
    /// it reduces the rate by `rate_step`, until the goal is reached. From `r` to `g` by steps of `s`, that takes `(r +
    /// g)(r - g + s) / 2 s` of virtual time. The computation does not overflow, because `left` is within
    /// [`RampLimits::braking_ticks`].
    fn can_brake(&self, pace: &RampLimits, left: u32, goal: u32, rate: u32) -> bool {
        let Some(over) = rate.checked_sub(goal) else { return true };
        let room = (u64::from(left) << FRACTION) - u64::from(self.accumulator);
        over == 0 || u64::from(rate + goal) * u64::from(over + pace.rate_step) <= 2 * u64::from(pace.rate_step) * room
    }

    /// Returns the number of upcoming ticks each of which is certain to be a virtual tick; 0 while the rate changes.
    #[inline]
    pub fn steady_ticks(&self, pace: &RampLimits, left: u32, passing: u32) -> u32 {
        if self.rate != FULL_RATE {
            0
        } else if passing.max(pace.start_rate) == FULL_RATE {
            u32::MAX
        } else {
            left.saturating_sub(pace.braking_ticks)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a turn of this number of virtual ticks. Returns the rate in each tick.
    fn run(
        clock: &mut VirtualClock,
        pace: &RampLimits,
        ticks: u32,
        passing: impl Fn(u32) -> u32,
    ) -> std::vec::Vec<u32> {
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
        RampLimits { start_rate: start, rate_step: slope, entry_rate: entry, braking_ticks: FULL_RATE / 2 / slope + 3 }
    }

    #[test]
    fn a_turn_from_rest_to_rest_ramps_symmetrically() {
        for ticks in [1, 2, 7, 100, 1000, 30_000] {
            for slope in [1 << 8, 12_345, 1 << 14, 1 << 20, FULL_RATE] {
                for start in [1 << 18, FULL_RATE / 3, FULL_RATE - 1, FULL_RATE] {
                    let pace = pace(start, slope, FULL_RATE);
                    let rates = run(&mut { VirtualClock::AT_REST }, &pace, ticks, |_| 0);
                    assert!(rates.iter().all(|rate| (start..=FULL_RATE).contains(rate)));
                    assert!(rates.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= slope));
                    assert!(rates[0] <= (start + slope).min(FULL_RATE));
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
                        even * u64::from(start) <= 2 * u64::from(FULL_RATE) + 3 * u64::from(start)
                            || start == FULL_RATE
                            || ticks < 10
                    );
                }
            }
        }
    }

    #[test]
    fn a_turn_brakes_to_the_entry_rate_of_the_next() {
        let this = pace(FULL_RATE / 10, 2000, FULL_RATE);
        for entry in [FULL_RATE / 20, FULL_RATE / 10, FULL_RATE / 2, FULL_RATE] {
            let mut clock = VirtualClock::AT_REST;
            let rates = run(&mut clock, &this, 20_000, |_| entry);
            let last = *rates.last().unwrap();
            assert!(last <= entry.max(this.start_rate) && last + 4000 >= entry.max(this.start_rate).min(FULL_RATE));
            clock.enter(&pace(FULL_RATE / 10, 2000, entry));
            assert_eq!(clock.rate, if last <= entry { last } else { FULL_RATE / 10 });
        }
    }

    #[test]
    fn a_move_submitted_while_braking_speeds_up_again() {
        let pace = pace(FULL_RATE / 10, 2000, FULL_RATE);
        let mut clock = VirtualClock::AT_REST;
        let rates = run(&mut clock, &pace, 20_000, |left| if left < 1000 { FULL_RATE } else { 0 });
        assert!(rates.iter().rev().take(5000).min().unwrap() < &(FULL_RATE / 2));
        assert!(*rates.last().unwrap() > FULL_RATE / 2);
        assert!(rates.windows(2).all(|pair| pair[0].abs_diff(pair[1]) <= pace.rate_step));
    }
}
