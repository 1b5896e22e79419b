//! One layer as one turn of the head: the steps of head and feed, and the ticks, in each sector.
//!
//! The material between angle 0 and `psi` has a closed form ([`Layer::material_fraction`]). At the edges of the sectors
//! head and feed stand at the positions of this form, to the step. Within a sector both run at constant speed. This
//! flattens the first harmonic of the profile, which *is* the tilt, by `sinc^2` of half the sector's angle (0.08 % for
//! 64 sectors). The turn is computed with a tilt that is larger by this factor, so that the layer as laid has the
//! planned tilt.
//!
//! Two strategies lay the same steps in the same sectors. `feed` gives every sector the same time and varies the feed.
//! `speed` gives every sector time in proportion to its material, so that the feed is steady and the head is slower
//! where more material is needed.
//!
//! [`TurnPlanner::next_turn`](super::TurnPlanner::next_turn) computes the turns. It adds to each layer the lean that
//! the previous layers lack because of rounding.

use core::f64::consts::{PI, TAU};

use growbot_core::angle::wrap_positive;
use growbot_core::layer::{Layer, SECTORS};
use growbot_core::robot::{FeedStrategy, LayerMotion, Robot};
use growbot_core::trigonometry;

use super::direction::MotorDirection;
use super::ramp::{EndSpeeds, FULL_RATE, RampLimits};

/// Steps and ticks of one sector of a turn. Neither head nor feed makes more than one step in two ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sector {
    /// Duration of the sector, ticks of the step interrupt.
    pub ticks: u32,
    /// Number of steps of the head in the sector.
    pub head_steps: u32,
    /// Number of steps of the feed in the sector.
    pub feed_steps: u32,
}

/// Plan of one layer: the steps and ticks of one turn of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The sectors in the order of increasing angles, starting at the tip's x axis.
    pub sectors: [Sector; SECTORS],
    /// Direction of the head. Backward is from the last sector to the first.
    pub direction: MotorDirection,
    /// Total number of ticks of all sectors.
    pub ticks: u32,
    /// Limits of the speed at the beginning and the end of the turn, and of its change.
    pub pace: RampLimits,
}

/// Error: the motors cannot lay a layer. It needs more than one step in two ticks, feed in reverse, or more
/// acceleration than the motors have, or it has no height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepRateError;

/// Returns the factor by which constant speed within each sector flattens the first harmonic of a profile.
fn flattening() -> f64 {
    let half_sector = PI / SECTORS as f64;
    let sinc = trigonometry::sin(half_sector) / half_sector;
    sinc * sinc
}

impl Turn {
    /// Computes the turn that lays a layer with this profile. Also returns the speeds at the end of the turn.
    /// `feed_steps` returns the position of the feed, in steps and not rounded, after a share of the layer. `before`
    /// contains the speeds at the end of the previous turn, and is `None` at rest.
    ///
    /// # Errors
    /// Returns [`StepRateError`] if a sector needs more than one step in two ticks, feed in reverse, or more
    /// acceleration than the motors have.
    pub(super) fn new(
        profile: &Layer,
        feed_steps: impl Fn(f64) -> f64,
        robot: &Robot,
        direction: MotorDirection,
        before: Option<&EndSpeeds>,
    ) -> Result<(Self, EndSpeeds), StepRateError> {
        let steeper = Layer { tilt: profile.tilt / flattening(), ..*profile };
        // The check of a layer does not include the steeper profile. A layer close to its limits is therefore laid
        // without the factor.
        let (sectors, motion) = Self::of_profile(&steeper, &feed_steps, robot)
            .or_else(|StepRateError| Self::of_profile(profile, &feed_steps, robot))?;
        let ticks = sectors.iter().map(|sector| sector.ticks).sum();
        let ends = EndSpeeds::of(&motion, direction);
        let pace = RampLimits::of(&motion, &ends, before, robot.description().motion.tick_hz, ticks);
        Ok((Self { sectors, direction, ticks, pace }, ends))
    }

    fn of_profile(
        profile: &Layer,
        feed_steps: &impl Fn(f64) -> f64,
        robot: &Robot,
    ) -> Result<([Sector; SECTORS], LayerMotion), StepRateError> {
        robot.check_motion(profile).map_err(|_| StepRateError)?;
        let description = robot.description();
        let ticks = description.layer.period_s * f64::from(description.motion.tick_hz);
        let head_steps = f64::from(description.head.steps_per_turn);

        // Positions at the edge between two sectors: ticks, head steps, feed steps.
        let edge = |index: usize| {
            let even = index as f64 / SECTORS as f64;
            let share = if index == SECTORS { 1.0 } else { profile.material_fraction(even * TAU, robot.tip_radius()) };
            let time = match description.motion.strategy {
                FeedStrategy::Feed => even,
                FeedStrategy::Speed => share,
            };
            [libm::rint(ticks * time), libm::rint(head_steps * even), libm::rint(feed_steps(share))]
        };
        let mut sectors = [Sector::default(); SECTORS];
        let mut from = edge(0);
        for (index, sector) in sectors.iter_mut().enumerate() {
            let to = edge(index + 1);
            let [ticks, head, feed] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
            // A lean of more than the whole height would need feed steps in reverse. No checked layer has such a lean.
            if ticks < 1.0 || head < 0.0 || feed < 0.0 || 2.0 * head.max(feed) > ticks {
                return Err(StepRateError);
            }
            *sector = Sector { ticks: ticks as u32, head_steps: head as u32, feed_steps: feed as u32 };
            from = to;
        }
        Ok((sectors, robot.layer_motion(profile)))
    }

    /// Returns whether the turn is laid at full speed from its first tick to its last, because it needs no ramps.
    pub fn needs_no_ramp(&self) -> bool {
        self.pace.start_rate == FULL_RATE
    }

    /// Returns the max number of ticks that the turn can take if it starts and ends at rest and the next move arrives
    /// late. A turn that takes longer counts as stuck.
    pub fn longest_ticks(&self) -> u32 {
        self.ticks.saturating_add(self.pace.ramps_ticks())
    }

    /// Returns the layer that this turn lays.
    pub fn layer(&self, robot: &Robot) -> Layer {
        as_built(&self.sectors.map(|sector| sector.feed_steps), robot)
    }
}

/// Returns the layer that results from the number of feed steps made in each sector.
///
/// The mean height follows from the sum of the steps, tilt and alpha from their first harmonic: `h(psi) = h + r_t phi
/// cos(psi - alpha)`.
pub fn as_built(feed: &[u32; SECTORS], robot: &Robot) -> Layer {
    let half_sector = PI / SECTORS as f64;
    let (mut sum, mut cosine, mut sine) = (0.0, 0.0, 0.0);
    for (index, steps) in feed.iter().enumerate() {
        let (sin, cos) = trigonometry::sin_cos((2 * index + 1) as f64 * half_sector);
        let steps = f64::from(*steps);
        sum += steps;
        cosine += steps * cos;
        sine += steps * sin;
    }
    let even = trigonometry::sin(half_sector) / half_sector;
    let length_per_step = 1.0 / robot.feed_steps_per_length();
    let harmonic = 2.0 * even * length_per_step * trigonometry::hypot(cosine, sine);
    Layer {
        alpha: wrap_positive(libm::atan2(sine, cosine)),
        height: sum * length_per_step,
        tilt: harmonic / robot.tip_radius(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{robot_a, robot_a_by};
    use proptest::prelude::*;

    fn layer() -> impl Strategy<Value = Layer> {
        (0.0..TAU, 0.1..0.774, 98.2..1e5).prop_map(|(alpha, height, radius)| Layer {
            alpha,
            height,
            tilt: height / radius,
        })
    }

    fn lay(layer: &Layer, robot: &Robot) -> Result<Turn, StepRateError> {
        let feed_steps = |share| share * layer.height * robot.feed_steps_per_length();
        Turn::new(layer, feed_steps, robot, MotorDirection::Forward, None).map(|(turn, _)| turn)
    }

    proptest! {
        #[test]
        fn every_sector_is_within_a_step_of_the_closed_form(layer in layer()) {
            let robot = robot_a();
            let turn = lay(&layer, &robot).unwrap();
            let steps = layer.height * robot.feed_steps_per_length();
            for (index, sector) in turn.sectors.iter().enumerate() {
                let angle = |edge: usize| TAU * edge as f64 / SECTORS as f64;
                let share = |edge: usize| layer.material_fraction(angle(edge), robot.tip_radius());
                let closed_form = steps * (share(index + 1) - share(index));
                let feed = f64::from(sector.feed_steps);
                prop_assert!((feed - closed_form).abs() <= 1.1, "{index}: {feed} for {closed_form}");
            }
        }

        #[test]
        fn both_feed_strategies_lay_the_same_steps_per_sector(layer in layer()) {
            let (by_feed, by_speed) = (robot_a_by(FeedStrategy::Feed), robot_a_by(FeedStrategy::Speed));
            let [feed, speed] = [&by_feed, &by_speed].map(|robot| lay(&layer, robot).unwrap());
            for (a, b) in feed.sectors.iter().zip(&speed.sectors) {
                prop_assert_eq!((a.head_steps, a.feed_steps), (b.head_steps, b.feed_steps));
            }
            let total = |turn: &Turn| turn.sectors.iter().map(|sector| sector.ticks).sum::<u32>();
            prop_assert_eq!((total(&feed), total(&speed)), (72_000, 72_000));
        }

        #[test]
        fn the_built_layer_matches_the_requested_one(layer in layer()) {
            let robot = robot_a();
            let turn = lay(&layer, &robot).unwrap();
            let built = turn.layer(&robot);
            let step = 1.0 / robot.feed_steps_per_length();
            prop_assert!((built.height - layer.height).abs() <= 0.5 * step + 1e-6);
            let tilt = |layer: &Layer| {
                let (sin, cos) = libm::sincos(layer.alpha);
                nalgebra::Vector2::new(cos, sin) * layer.tilt * robot.tip_radius()
            };
            // Rounding shifts each edge by half a step at most. In the first harmonic the error is far less than the
            // sum of all these shifts.
            prop_assert!((tilt(&built) - tilt(&layer)).norm() < 4.0 * step, "{built:?} for {layer:?}");
        }
    }

    #[test]
    fn every_valid_layer_has_a_turn() {
        for strategy in [FeedStrategy::Feed, FeedStrategy::Speed] {
            let robot = robot_a_by(strategy);
            for height in 1..200 {
                for tilt in 0..50 {
                    let layer = Layer { alpha: 1.0, height: f64::from(height) * 0.005, tilt: f64::from(tilt) * 0.0002 };
                    if robot.check_layer(&layer, 0.0).is_ok() {
                        lay(&layer, &robot).unwrap();
                    }
                }
            }
        }
    }

    #[test]
    fn the_speed_strategy_has_a_constant_feed_rate() {
        let robot = robot_a_by(FeedStrategy::Speed);
        let layer = Layer { alpha: 0.3, height: 0.77, tilt: 0.0077 };
        let turn = lay(&layer, &robot).unwrap();
        let rate = |sector: &Sector| f64::from(sector.feed_steps) / f64::from(sector.ticks);
        let mean = turn.sectors.iter().map(rate).sum::<f64>() / SECTORS as f64;
        assert!(turn.sectors.iter().all(|sector| (rate(sector) / mean - 1.0).abs() < 0.02));
    }
}
