//! Kinematics of a growing tip: one step (Eq 4), a chain of steps (Eq 5), and the configuration-space rates (Eq 6).
//!
//! The model is that of Del Dottore et al. 2019, Front. Robot. AI 6:45, in a corrected form. The printed Eq 4 has four
//! errors: the group is SE(3), not SO(4); the first row has `C_phi`; the y translation is `s sin(b) (1 - cos phi) /
//! phi`; and the matrix bends **towards** its angle. The angle is therefore the bend direction `b = alpha + pi`,
//! opposite to the point of max deposition `alpha`.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use crate::pose::{Frame, Pose};
use crate::trigonometry;

/// Returns `tip_from_next_tip` of one step of growth (Eq 4, corrected).
///
/// - `alpha`: angle of max deposition from the tip's x axis, radians. The tip bends away from it.
/// - `bend`: rotation within this step, radians. The radius of curvature is `length / bend`.
/// - `length`: arc length of this step, mm.
///
/// The result is continuous in `bend` through 0, where it is a pure translation along z.
///
/// ```
/// use growbot_core::kinematics::step;
/// // A quarter circle of radius 100 mm with the material at alpha = 0 bends towards -x.
/// let quarter = std::f64::consts::FRAC_PI_2;
/// let tip_from_end = step(0.0, quarter, 100.0 * quarter);
/// let end = tip_from_end.translation.vector;
/// assert!((end - nalgebra::Vector3::new(-100.0, 0.0, 100.0)).norm() < 1e-12);
/// ```
pub fn step(alpha: f64, bend: f64, length: f64) -> Frame {
    let (sin_alpha, cos_alpha) = trigonometry::sin_cos(alpha);
    // The bend direction is alpha + pi.
    let (sin_b, cos_b) = (-sin_alpha, -cos_alpha);
    let sin_bend = trigonometry::sin(bend);
    let half = trigonometry::sin(0.5 * bend);
    let versine = 2.0 * half * half; // 1 - cos(bend), without cancellation
    let sideways = length * versine_ratio(bend);
    #[rustfmt::skip]
    let rotation = Matrix3::new(
        1.0 - cos_b * cos_b * versine, -cos_b * sin_b * versine,      cos_b * sin_bend,
        -cos_b * sin_b * versine,      1.0 - sin_b * sin_b * versine, sin_b * sin_bend,
        -cos_b * sin_bend,             -sin_b * sin_bend,             1.0 - versine,
    );
    Frame::from_parts(
        Translation3::new(cos_b * sideways, sin_b * sideways, length * sine_ratio(bend)),
        Rotation3::from_matrix_unchecked(rotation),
    )
}

/// Angle below which [`sine_ratio`] and [`versine_ratio`] are computed from their series, radians. There, the first
/// term omitted is under 1e-20.
const SERIES_BELOW: f64 = 0.01;

/// Returns `sin(x) / x`.
fn sine_ratio(x: f64) -> f64 {
    if x.abs() > SERIES_BELOW {
        return trigonometry::sin(x) / x;
    }
    let x2 = x * x;
    1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0))
}

/// Returns `(1 - cos(x)) / x`.
fn versine_ratio(x: f64) -> f64 {
    if x.abs() > SERIES_BELOW {
        let half = trigonometry::sin(0.5 * x);
        return 2.0 * half * half / x;
    }
    let x2 = x * x;
    0.5 * x * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0)))
}

/// Returns `base_from_tip * tip_from_next_tip`, with the rotation matrix made orthogonal again, so that it stays a
/// rotation over any number of steps. Without this correction, the rounding errors of 100,000 equal steps add up to
/// 1e-11. The correction is a Newton-Schulz step towards the nearest rotation (Higham 2008, chapter 8).
pub fn advance(base_from_tip: &Frame, tip_from_next_tip: &Frame) -> Frame {
    let next = base_from_tip * tip_from_next_tip;
    let rotation = next.rotation.matrix();
    let mended = rotation * (Matrix3::identity() * 1.5 - rotation.transpose() * rotation * 0.5);
    Frame::from_parts(next.translation, Rotation3::from_matrix_unchecked(mended))
}

/// Returns `base_from_tip` at the end of a chain of steps of growth (Eq 5) that begins at `base_from_start`.
///
/// Each step is a tuple `(alpha, bend, length)` of the arguments of [`step`].
pub fn chain(base_from_start: &Frame, steps: impl IntoIterator<Item = (f64, f64, f64)>) -> Frame {
    steps.into_iter().fold(*base_from_start, |base_from_tip, (alpha, bend, length)| {
        advance(&base_from_tip, &step(alpha, bend, length))
    })
}

/// The rates of change of the pose of a growing tip (Eq 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Velocity of the tip, mm/s.
    pub velocity: Vector3<f64>,
    /// Rate of change of the heading, rad/s.
    pub heading: f64,
    /// Rate of change of the pitch, rad/s.
    pub pitch: f64,
}

/// The inputs of the configuration-space model (Eq 6): growth velocity and the two steering rates, all signed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inputs {
    /// Growth velocity `g`, mm/s.
    pub growth: f64,
    /// `u1`, rate of change of the heading, rad/s.
    pub heading_rate: f64,
    /// `u2`, rate of change of the pitch, rad/s.
    pub pitch_rate: f64,
}

impl Inputs {
    /// Returns the rates of change of a pose under these inputs (Eq 6).
    pub fn rates(&self, pose: &Pose) -> Rates {
        Rates { velocity: pose.direction() * self.growth, heading: self.heading_rate, pitch: self.pitch_rate }
    }

    /// Returns the angular speed of the tip at a given pitch (radians), rad/s: `sqrt(u1^2 cos^2 gamma + u2^2)`.
    pub fn turning_rate(&self, pitch: f64) -> f64 {
        trigonometry::hypot(self.heading_rate * trigonometry::cos(pitch), self.pitch_rate)
    }

    /// Reports whether a robot whose min radius of curvature is `min_radius` (mm) can follow these inputs at this
    /// pitch, radians (Eq 8, corrected).
    ///
    /// The printed bound `|u_i| <= g / R_min` lets the curvature reach `sqrt(2) / R_min`. The correct bound couples the
    /// inputs: `u1^2 cos^2 gamma + u2^2 <= (g / R_min)^2`.
    pub fn within_curvature(&self, pitch: f64, min_radius: f64) -> bool {
        self.turning_rate(pitch) * min_radius <= self.growth.abs()
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI, TAU};

    use proptest::prelude::*;

    use super::*;

    /// Computes Eq 4 by composition: a turn to the bend direction, a rotation about the centre of curvature, and a turn
    /// back.
    fn step_by_composition(alpha: f64, bend: f64, length: f64) -> Frame {
        let radius = length / bend;
        let turn = Frame::rotation(Vector3::z() * (alpha + PI));
        let to_centre = Frame::translation(radius, 0.0, 0.0);
        let round = Frame::rotation(Vector3::y() * bend);
        turn * to_centre * round * to_centre.inverse() * turn.inverse()
    }

    fn distance(a: &Frame, b: &Frame) -> f64 {
        (a.to_homogeneous() - b.to_homogeneous()).norm()
    }

    proptest! {
        #[test]
        fn closed_form_matches_the_composition(alpha in 0.0..TAU, bend in 1e-3..6.0, length in 0.01..500.0) {
            prop_assert!(distance(&step(alpha, bend, length), &step_by_composition(alpha, bend, length)) < 1e-9);
        }

        #[test]
        fn two_half_steps_equal_one_step(alpha in 0.0..TAU, bend in -6.0..6.0, length in 0.01..500.0) {
            let half = step(alpha, 0.5 * bend, 0.5 * length);
            prop_assert!(distance(&(half * half), &step(alpha, bend, length)) < 1e-10);
        }

        #[test]
        fn steps_are_continuous_at_the_series_threshold(alpha in 0.0..TAU, sign in prop_oneof![Just(1.0), Just(-1.0)]) {
            let below = step(alpha, sign * SERIES_BELOW * (1.0 - 1e-12), 1.0);
            let above = step(alpha, sign * SERIES_BELOW * (1.0 + 1e-12), 1.0);
            prop_assert!(distance(&below, &above) < 1e-13);
        }

        #[test]
        fn growth_never_rolls_the_tip(alpha in 0.0..TAU, bend in 0.0..3.0) {
            // The rotation axis lies in the deposition plane, so the rotation has no component about z.
            let rotation = step(alpha, bend, 1.0).rotation;
            prop_assert!((rotation.matrix()[(0, 1)] - rotation.matrix()[(1, 0)]).abs() < 1e-15);
        }
    }

    #[test]
    fn zero_bend_is_a_translation_along_z() {
        let straight = step(1.0, 0.0, 3.0);
        assert_eq!(straight.translation.vector, Vector3::new(0.0, 0.0, 3.0));
        assert_eq!(straight.rotation.matrix(), &Matrix3::identity());
    }

    #[test]
    fn rotations_stay_orthonormal_over_100_000_layers() {
        // Identical layers are the worst case, because each adds the same rounding error.
        for (alpha, bend) in [(0.3, 0.00774), (1.0, 0.00258), (2.2, 1e-5), (3.7, 0.0921), (5.9, 0.5)] {
            let end = chain(&Frame::identity(), (0..100_000).map(|_| (alpha, bend, 0.774)));
            let rotation = end.rotation.matrix();
            let drift = (rotation.transpose() * rotation - Matrix3::identity()).norm();
            assert!(drift < 1e-12, "alpha {alpha}, bend {bend}: {drift:e}");
        }
    }

    #[test]
    fn steering_is_bounded_by_curvature() {
        let growth = 0.043;
        let max_rate = growth / 98.2;
        let corner = Inputs { growth, heading_rate: max_rate, pitch_rate: max_rate };
        assert!(!corner.within_curvature(0.0, 98.2));
        assert!(!corner.within_curvature(1.0, 98.2));
        assert!(Inputs { pitch_rate: 0.0, ..corner }.within_curvature(0.0, 98.2));
        // Near the vertical a change of heading needs no curvature.
        assert!(Inputs { heading_rate: 100.0 * max_rate, pitch_rate: 0.0, growth }.within_curvature(FRAC_PI_2, 98.2));
    }

    #[test]
    fn rates_match_a_small_step_to_first_order() {
        let pose = Pose::from_degrees([10.0, 20.0, 30.0, 40.0, 50.0]).unwrap();
        let inputs = Inputs { growth: 0.043, heading_rate: 2e-4, pitch_rate: -3e-4 };
        let dt = 1e-3;
        let rates = inputs.rates(&pose);
        // In the tip frame a rising pitch turns towards -x and a rising heading towards +y.
        let (towards_x, towards_y) = (-rates.pitch * dt, rates.heading * libm::cos(pose.pitch()) * dt);
        let bend = libm::hypot(towards_x, towards_y);
        let alpha = libm::atan2(towards_y, towards_x) + PI;
        let next = Pose::from_frame(&(pose.frame() * step(alpha, bend, inputs.growth * dt)));
        assert!((next.heading() - pose.heading() - rates.heading * dt).abs() < 1e-12);
        assert!((next.pitch() - pose.pitch() - rates.pitch * dt).abs() < 1e-12);
        assert!((next.position() - pose.position() - rates.velocity * dt).norm() < 1e-10);
    }
}
