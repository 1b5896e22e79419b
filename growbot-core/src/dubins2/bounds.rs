//! Lower bounds for the length of each path type.
//!
//! The angles are in single precision, because some microcontrollers compute single precision in hardware and double
//! precision in software. The arc tangent is a short polynomial without branches, so that a desktop computes four path
//! types at once. The margins are several times the errors. `tests.rs` checks every bound against its path type.

use core::array;
use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::path_types::Tangent;

/// Max difference between an angle and a full turn, radians, at which the angle counts as 0 in a lower bound, because
/// its true value may be 0. The arc-tangent approximation errs by up to 0.004 rad, so the difference of two angles errs
/// by up to 0.008 rad. The test `no_path_type_is_shorter_than_its_bound` checks all margins of this module.
const ANGLE_MARGIN: f32 = 0.01;
/// Margin of the lower bound of a path's length, radii, for the errors of its angles. The arc-tangent approximation
/// errs by up to 0.004 rad. The length of the path type LRL (left, right, left) contains four such errors (0.016), so
/// the margin is about twice what LRL needs.
const LENGTH_MARGIN: f32 = 0.03;
/// Margin of the lower bound of a path's length, as a fraction of the length of the path's line. It is several times
/// the rounding error of single precision, 6e-8.
const RELATIVE_MARGIN: f32 = 1e-6;
/// Max distance between the centres of two circles, radii, at which the circles may coincide. The lower bound of their
/// path type is then 0.
const COINCIDING: f32 = 1e-4;
/// Max amount by which rounding may make a square negative, radii squared. It is larger than the rounding error of
/// single precision.
const EDGE: f32 = 1e-4;

/// Returns a lower bound of the length of each of [`super::PathType::ALL`], infinite if that path type does not exist.
/// Beyond the range of single precision the bounds are NaN and exclude no path type.
#[inline(always)]
pub(super) fn lower_bounds(tangents: &[Tangent; 4]) -> [f32; 6] {
    let tangents = tangents.each_ref();
    let x = tangents.map(|tangent| tangent.x as f32);
    let y = tangents.map(|tangent| tangent.y as f32);
    let square = tangents.map(|tangent| tangent.square as f32);
    let straight = tangents.map(|tangent| tangent.straight as f32);
    let heading = tangents.map(|tangent| tangent.heading as f32);
    let side = tangents.map(|tangent| if tangent.outer { 1.0 } else { -1.0 });
    let first = array::from_fn::<_, 4, _>(|path_type| direction(x[path_type], y[path_type]));
    let [lsl, rsr, lsr, rsl] = array::from_fn(|path_type| {
        let last = wrap(side[path_type] * (heading[path_type] - first[path_type]));
        let bound = straight[path_type] + turn(first[path_type]) + turn(last) - margin(straight[path_type]);
        let bound = if straight[path_type] < COINCIDING { 0.0 } else { bound };
        if square[path_type] < -EDGE { f32::INFINITY } else { bound }
    });
    let [lrl, rlr] = array::from_fn(|path_type| three_arcs(straight[path_type], first[path_type], heading[path_type]));
    [lsl, rsr, lsr, rsl, lrl, rlr]
}

/// Returns the lower bound of the length of LRL (left, right, left), from the distance and the direction between the
/// centres of its first and its last circle.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn three_arcs(distance: f32, along: f32, heading: f32) -> f32 {
    let square = (4.0 - distance) * (4.0 + distance);
    let base = direction(distance, libm::sqrtf(if square > 0.0 { square } else { 0.0 }));
    let first = wrap(along + (base + FRAC_PI_2) - TAU);
    let last = wrap(wrap(heading - first) + (2.0 * base - PI));
    let bound = PI + 2.0 * base + turn(first) + turn(last) - margin(distance);
    let bound = if distance < COINCIDING { 0.0 } else { bound };
    if square < -EDGE { f32::INFINITY } else { bound }
}

#[inline(always)]
fn margin(line: f32) -> f32 {
    LENGTH_MARGIN + RELATIVE_MARGIN * line
}

/// Returns the contribution of an arc's angle to the lower bound of a path's length.
#[inline(always)]
fn turn(angle: f32) -> f32 {
    if angle > TAU - ANGLE_MARGIN { 0.0 } else { angle }
}

/// Wraps an angle between -2 pi and 2 pi to [0, 2 pi].
#[inline(always)]
fn wrap(angle: f32) -> f32 {
    angle + (PI - PI.copysign(angle))
}

/// Returns the direction of a vector in [0, 2 pi], with an error of up to 0.004 rad (the arc tangent is that of Rajan
/// et al. 2006).
#[cfg_attr(not(target_os = "none"), inline(always))]
fn direction(x: f32, y: f32) -> f32 {
    let (along, across) = (x.abs(), y.abs());
    let (sum, difference) = (along + across, along - across);
    // The smaller of the two divided by the larger.
    let ratio = (sum - difference.abs()) / (sum + difference.abs());
    let octant = ratio * ((FRAC_PI_4 + 0.273) - 0.273 * ratio);
    // The angle in an octant counts from a multiple of pi/2, upwards or downwards.
    let (shallow, forwards, up) = (1.0_f32.copysign(difference), 1.0_f32.copysign(x), 1.0_f32.copysign(y));
    let from = PI - up * (FRAC_PI_2 + forwards * (FRAC_PI_4 + shallow * FRAC_PI_4));
    from + up * forwards * shallow * octant
}
