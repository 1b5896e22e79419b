//! What a layer asks of the step interrupt, which makes a step every two ticks at most.

use core::f64::consts::{FRAC_PI_4, TAU};

use super::{FeedStrategy, RobotDescription};
use crate::layer::SECTORS;

/// Bounds on the busiest sector of a layer: no sector has fewer ticks or more steps.
pub(super) struct BusiestSector {
    pub ticks: f64,
    pub head: f64,
    pub feed: f64,
}

impl BusiestSector {
    /// The bounds for a layer of this mean height (mm) and tilt (radians).
    pub fn of(robot: &RobotDescription, height: f64, tilt: f64) -> Self {
        let sectors = SECTORS as f64;
        let lean = (robot.geometry.tip_radius_mm * tilt / height).min(1.0);
        let diameter = robot.feed.filament_diameter_mm;
        let wall_area = TAU * robot.geometry.tip_radius_mm * robot.wall.width_mm;
        let filament = height * wall_area / (FRAC_PI_4 * diameter * diameter);
        let ticks = robot.layer.period_s * f64::from(robot.motion.tick_hz) / sectors;
        let head = f64::from(robot.head.steps_per_turn) / sectors;
        let feed = filament * robot.feed.steps_per_mm / sectors;
        // Rounding at both edges of a sector gives up to one step more and one tick less than the even share.
        match robot.motion.strategy {
            // Even ticks; the most material lies on the outer side.
            FeedStrategy::Feed => Self {
                ticks: libm::floor(ticks),
                head: libm::floor(head) + 1.0,
                feed: libm::floor(feed * (1.0 + lean)) + 1.0,
            },
            // The shortest sector lies on the inner side, with the same feed a tick as everywhere.
            FeedStrategy::Speed => Self {
                ticks: libm::floor(ticks * (1.0 - lean)),
                head: libm::floor(head) + 1.0,
                feed: libm::floor(feed * (1.0 - lean)) + 1.0,
            },
        }
    }

    /// Whether the step interrupt can carry it.
    pub fn can_be_carried(&self) -> bool {
        2.0 * self.head.max(self.feed) <= self.ticks
    }
}
