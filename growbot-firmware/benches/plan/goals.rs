//! The goals with which the cost of planners is measured, the same on every board.

use core::f64::consts::{PI, TAU};

use growbot_core::pose::Pose;

/// Radius of the planned curves, mm. It is near the smallest radius of the built-in robot.
pub const RADIUS: f64 = 100.0;

/// Returns a number in [0, 1) for each `n`: Weyl's sequence with this factor, which is evenly spread.
pub fn spread(n: u32, factor: f64) -> f64 {
    let value = f64::from(n + 1) * factor;
    value - libm::floor(value)
}

/// Returns the goal with the number `n`. Goals are evenly spread over direction, heading, pitch and distance, which is
/// between `nearest` and `farthest` radii.
pub fn goal(n: u32, nearest: f64, farthest: f64) -> Option<Pose> {
    let distance = RADIUS * (nearest + (farthest - nearest) * spread(n, 0.754_877_666_246_692_7));
    let (y, x) = libm::sincos(TAU * spread(n, 0.569_840_290_998_053_2));
    let z = 2.0 * spread(n, 0.430_159_709_001_946_7) - 1.0;
    let across = libm::sqrt(1.0 - z * z);
    let position = [across * x, across * y, z].map(|part| distance * part);
    let heading = TAU * spread(n, 0.618_033_988_749_894_9) - PI;
    let pitch = PI * (spread(n, 0.819_172_513_396_164_4) - 0.5);
    Pose::new(position.into(), heading, pitch).ok()
}
