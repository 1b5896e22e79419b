//! The motion that a layer requires of the motors: the number of steps, the speeds, and their changes. The step
//! interrupt makes at most one step in two ticks.
//!
//! A motor can change its speed by its *jump* instantly, and beyond that only by its acceleration: over any time `t` by
//! `jump + acceleration t`. Three kinds of change share these limits. The profile of a layer, whose speed changes from
//! sector to sector, may use [`PROFILE_ACCELERATION`] and [`PROFILE_JUMP`]. The ramps between rest and full speed use
//! the rest of the acceleration, [`RAMP_ACCELERATION`]. The change from one layer to the next uses the rest of the
//! jump, [`PASSING_JUMP`]. An axis that is never faster than its jump needs no ramp and has no such limit.

use core::f64::consts::{FRAC_PI_4, TAU};

use super::{FeedStrategy, HeadRotation, RobotDescription};
use crate::layer::{Layer, LayerError, SECTORS};
use crate::trigonometry;

/// Fraction of an axis's max acceleration that the changes of speed within a layer may use.
const PROFILE_ACCELERATION: f64 = 0.5;
/// Fraction of an axis's jump (max instantaneous change of speed) that the change from one sector to the next may use.
/// The change from one layer to the next may contain two such changes.
const PROFILE_JUMP: f64 = 0.25;
/// Fraction of an axis's max acceleration that the ramps between rest and full speed use.
const RAMP_ACCELERATION: f64 = 1.0 - PROFILE_ACCELERATION;
/// Fraction of an axis's jump (max instantaneous change of speed) that remains for the change from one layer to the
/// next.
const PASSING_JUMP: f64 = 1.0 - 2.0 * PROFILE_JUMP;
/// Max time of a ramp from rest to full speed, s.
pub(super) const MAX_RAMP_S: f64 = 10.0;

/// Returns the difference between the height of a layer's outer side and its mean height, as a fraction of the mean
/// height. It is 0 for a layer without tilt, and 1 for a layer without material on its inner side.
fn lean(robot: &RobotDescription, height: f64, tilt: f64) -> f64 {
    (robot.geometry.tip_radius_mm * tilt / height).min(1.0)
}

/// Returns the length of filament (mm) in a layer of this mean height (mm).
fn filament(robot: &RobotDescription, height: f64) -> f64 {
    let diameter = robot.feed.filament_diameter_mm;
    let wall_area = TAU * robot.geometry.tip_radius_mm * robot.wall.width_mm;
    height * wall_area / (FRAC_PI_4 * diameter * diameter)
}

/// Bounds on the busiest sector of a layer, the one with the most steps per tick: the min number of ticks, and the max
/// numbers of head steps and feed steps.
pub(super) struct BusiestSector {
    pub ticks: f64,
    pub head: f64,
    pub feed: f64,
}

impl BusiestSector {
    /// Returns the bounds for a layer of this mean height (mm) and tilt (radians).
    pub fn of(robot: &RobotDescription, height: f64, tilt: f64) -> Self {
        let sectors = SECTORS as f64;
        let lean = lean(robot, height, tilt);
        let ticks = robot.layer.period_s * f64::from(robot.motion.tick_hz) / sectors;
        let head = f64::from(robot.head.steps_per_turn) / sectors;
        let feed = filament(robot, height) * robot.feed.steps_per_mm / sectors;
        // Rounding at both edges of a sector gives up to one step more and one tick less than an equal part.
        match robot.motion.strategy {
            // All sectors have the same number of ticks, and the outer side has most of the material.
            FeedStrategy::Feed => Self {
                ticks: libm::floor(ticks),
                head: libm::floor(head) + 1.0,
                feed: libm::floor(feed * (1.0 + lean)) + 1.0,
            },
            // The shortest sector is on the inner side, and its feed per tick is the same as everywhere.
            FeedStrategy::Speed => Self {
                ticks: libm::floor(ticks * (1.0 - lean)),
                head: libm::floor(head) + 1.0,
                feed: libm::floor(feed * (1.0 - lean)) + 1.0,
            },
        }
    }

    /// Reports whether the step interrupt, which makes at most one step in two ticks, can make the steps of this
    /// sector.
    pub fn is_feasible(&self) -> bool {
        2.0 * self.head.max(self.feed) <= self.ticks
    }
}

/// The speeds and accelerations of an axis (head or feed) while a layer is laid at full speed, and the axis's limits.
/// Lengths are in turns for the head, and in mm of filament for the feed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisMotion {
    /// Max speed within the layer, turns/s or mm/s.
    pub speed: f64,
    /// Speed at the tip's x axis, where a layer begins and ends, turns/s or mm/s.
    pub speed_at_ends: f64,
    /// Limit of an instantaneous change of speed from rest or to rest, turns/s or mm/s.
    pub jump: f64,
    /// Limit of the change of speed from one layer to the next, turns/s or mm/s.
    pub layer_change_jump: f64,
    /// Limit of the acceleration in a ramp between rest and full speed, turns/s^2 or mm/s^2.
    pub ramp_acceleration: f64,
    /// Upper bound of the acceleration within the layer, turns/s^2 or mm/s^2.
    pub(super) acceleration: f64,
    /// Limit of [`Self::acceleration`], turns/s^2 or mm/s^2.
    pub(super) acceleration_limit: f64,
}

/// The motion of head and feed while a layer is laid at full speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayerMotion {
    /// Motion of the head, in turns.
    pub head: AxisMotion,
    /// Motion of the feed, in mm of filament.
    pub feed: AxisMotion,
}

impl LayerMotion {
    /// Returns the motion of head and feed for a layer, which must have material on its inner side.
    pub(super) fn of(robot: &RobotDescription, layer: &Layer) -> Self {
        let period = robot.layer.period_s;
        let lean = lean(robot, layer.height, layer.tilt);
        let at_ends = 1.0 + lean * trigonometry::cos(layer.alpha);
        let (head, feed) = (1.0 / period, filament(robot, layer.height) / period);
        let sector = period / SECTORS as f64;
        // If the head reverses its direction with the next layer, it may start instantly after it has stopped, so each
        // change may use half of the jump.
        let at_once = match robot.motion.turning {
            HeadRotation::Continuous => 1.0,
            HeadRotation::Alternate => 0.5,
        };
        let head_limits = (at_once, robot.head.speed_jump_turns_per_s, robot.head.acceleration_turns_per_s2);
        let feed_limits = (1.0, robot.feed.speed_jump_mm_per_s, robot.feed.acceleration_mm_per_s2);
        match robot.motion.strategy {
            // The speed is proportional to the height: `v (1 + lean cos)`.
            FeedStrategy::Feed => Self {
                head: AxisMotion::new(head_limits, [head, head], 0.0, sector),
                feed: AxisMotion::new(
                    feed_limits,
                    [feed * (1.0 + lean), feed * at_ends],
                    TAU * feed * lean / period,
                    sector,
                ),
            },
            // The speed is proportional to the inverse of the height. Its rate of change has the height to the third
            // power in the denominator.
            FeedStrategy::Speed => {
                let inner = 1.0 - lean;
                let acceleration = TAU * head * head * lean / (inner * inner * inner);
                Self {
                    head: AxisMotion::new(head_limits, [head / inner, head / at_ends], acceleration, sector * inner),
                    feed: AxisMotion::new(feed_limits, [feed, feed], 0.0, sector),
                }
            }
        }
    }

    /// Checks that the motors can follow the changes of speed within the layer.
    pub(super) fn check(&self) -> Result<(), LayerError> {
        for (axis, motion) in [("head, in turns/s^2", &self.head), ("feed, in mm/s^2", &self.feed)] {
            if !motion.follows_its_profile() {
                let (value, limit) = (motion.acceleration, motion.acceleration_limit);
                return Err(LayerError::Acceleration { axis, value, limit });
            }
        }
        Ok(())
    }
}

impl AxisMotion {
    fn new(
        (at_once, jump, acceleration): (f64, f64, f64),
        [speed, speed_at_ends]: [f64; 2],
        profile: f64,
        shortest_sector: f64,
    ) -> Self {
        Self {
            speed,
            speed_at_ends,
            jump: at_once * jump,
            layer_change_jump: PASSING_JUMP * jump,
            ramp_acceleration: RAMP_ACCELERATION * acceleration,
            acceleration: profile,
            acceleration_limit: (PROFILE_ACCELERATION * acceleration).min(PROFILE_JUMP * jump / shortest_sector),
        }
    }

    /// Reports whether the axis is never faster than its jump (max instantaneous change of speed), so that it needs no
    /// ramps.
    pub fn is_within_jump(&self) -> bool {
        self.speed <= self.jump
    }

    pub(super) fn follows_its_profile(&self) -> bool {
        self.is_within_jump() || self.acceleration <= self.acceleration_limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Robot;
    use crate::testing::robot_a;

    /// Returns robot A with a layer time of 3 s and a planning radius of 150 mm, so that its motors need ramps.
    fn quick(strategy: FeedStrategy) -> RobotDescription {
        let mut description = robot_a().description().clone();
        description.planning_radius_mm = 150.0;
        description.layer.period_s = 3.0;
        description.motion.strategy = strategy;
        description.head.speed_jump_turns_per_s = 0.1;
        description.feed.steps_per_mm = 25.0;
        description
    }

    #[test]
    fn step_rate_bounds_hold_for_the_whole_profile() {
        for strategy in [FeedStrategy::Feed, FeedStrategy::Speed] {
            let description = quick(strategy);
            for (height, tilt) in [(0.774, 0.0077), (0.5, 0.01), (0.3, 0.0136 * 0.9), (0.774, 0.0)] {
                let layer = Layer { alpha: 2.0, height, tilt };
                let motion = LayerMotion::of(&description, &layer);
                let r = description.geometry.tip_radius_mm;
                let filament = filament(&description, height);
                // Time, turns and filament by angle, in fine steps.
                let at = |psi: f64| {
                    let share = layer.material_fraction(psi, r);
                    let time = match strategy {
                        FeedStrategy::Feed => psi / TAU,
                        FeedStrategy::Speed => share,
                    };
                    [time * description.layer.period_s, psi / TAU, share * filament]
                };
                let n = 4096;
                let speeds: std::vec::Vec<[f64; 3]> = (0..n)
                    .map(|i| {
                        let (a, b) = (at(TAU * f64::from(i) / f64::from(n)), at(TAU * f64::from(i + 1) / f64::from(n)));
                        let dt = b[0] - a[0];
                        [dt, (b[1] - a[1]) / dt, (b[2] - a[2]) / dt]
                    })
                    .collect();
                for (axis, motion) in [(1, &motion.head), (2, &motion.feed)] {
                    let fastest = speeds.iter().map(|speed| speed[axis]).fold(0.0, f64::max);
                    assert!(fastest <= motion.speed * (1.0 + 1e-9) && fastest > motion.speed * 0.999);
                    assert!((speeds[0][axis] / motion.speed_at_ends - 1.0).abs() < 2e-3);
                    let steepest = speeds
                        .windows(2)
                        .map(|pair| (pair[1][axis] - pair[0][axis]).abs() / (0.5 * (pair[0][0] + pair[1][0])))
                        .fold(0.0, f64::max);
                    assert!(steepest <= motion.acceleration * 1.001 + 1e-4, "{steepest} of {}", motion.acceleration);
                }
            }
        }
    }

    #[test]
    fn layers_that_the_motors_cannot_follow_are_refused() {
        for strategy in [FeedStrategy::Feed, FeedStrategy::Speed] {
            let mut description = quick(strategy);
            let steep = Layer { alpha: 0.0, height: 0.774, tilt: 0.0077 };
            let robot = Robot::new(description.clone()).unwrap();
            robot.check_layer(&steep, 0.0).unwrap();
            let motion = robot.layer_motion(&steep);
            let profile = motion.head.acceleration.max(motion.feed.acceleration);
            // The limit is just sufficient for the planning radius, whose layers need less acceleration.
            match strategy {
                FeedStrategy::Feed => description.feed.acceleration_mm_per_s2 = 1.98 * profile,
                FeedStrategy::Speed => description.head.acceleration_turns_per_s2 = 1.98 * profile,
            }
            let robot = Robot::new(description).unwrap();
            let Err(LayerError::Acceleration { value, limit, .. }) = robot.check_layer(&steep, 0.0) else { panic!() };
            assert!(value > limit && value < 1.02 * limit, "{value} {limit}");
            robot.check_layer(&Layer { tilt: 0.004, ..steep }, 0.0).unwrap();
        }
    }
}
