//! Poses and frames.
//!
//! A [`Pose`] is a point and a direction, in the form that users give. The direction of a tip with heading `theta` and
//! pitch `gamma` is `(cos gamma cos theta, cos gamma sin theta, sin gamma)`.
//!
//! A [`Frame`] is the robot's form, `base_from_tip`. Its z axis is the direction of growth, and its x and y axes span
//! the deposition plane. The frame of a pose is `Rz(heading) * Ry(90 deg - pitch) * Rz(roll)`. A pose that a user gives
//! has roll 0. Growth never rolls the tip about its own z, so from there on the frame is carried along the body without
//! twist. A body that begins at the tip of another one therefore has a start with roll.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Vector3};

use crate::angle::{degrees, radians, wrap_signed};
use crate::compact_number::CompactNumber;
use crate::trigonometry;

/// A rigid transform: a rotation and a translation in mm. A frame is named after the conversion that it makes:
/// `base_from_tip * point_in_tip` gives the point in the coordinates of the base.
pub type Frame = IsometryMatrix3<f64>;

/// The position of a tip and its direction of growth. Position in mm, angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    position: Vector3<f64>,
    heading: f64,
    pitch: f64,
    roll: f64,
}

/// A goal of the tip that prescribes the position (mm) but not the direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position(Vector3<f64>);

impl Position {
    /// Creates a position from its coordinates in mm.
    ///
    /// # Errors
    /// Returns an error if a coordinate is not finite or beyond [`Pose::MAX_COORDINATE_MM`].
    pub fn new(position: Vector3<f64>) -> Result<Self, PoseError> {
        Pose::new(position, 0.0, 0.0).map(|pose| Self(pose.position))
    }

    /// Returns the coordinates of the position, mm.
    pub fn vector(&self) -> Vector3<f64> {
        self.0
    }
}

/// Reason why a pose is not valid.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A field is NaN or infinite.
    #[error("{field} is {}: give a finite number", CompactNumber(.value))]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Value of the field.
        value: f64,
    },
    /// A coordinate is beyond [`Pose::MAX_COORDINATE_MM`].
    #[error("{field} is {} mm: keep coordinates within {limit} mm of the origin", CompactNumber(.value))]
    TooFar {
        /// Name of the coordinate.
        field: &'static str,
        /// Value of the coordinate, mm.
        value: f64,
        /// Max absolute value of a coordinate, mm.
        limit: f64,
    },
    /// The pitch lies beyond straight up or straight down.
    #[error("pitch is {} deg: it must lie between -90 (straight down) and 90 (straight up)", CompactNumber(.value))]
    Pitch {
        /// The pitch, degrees.
        value: f64,
    },
}

impl Pose {
    /// Max absolute value of a coordinate, mm (10 km). Larger coordinates are refused, because the rounding errors of
    /// an `f64` grow with them.
    pub const MAX_COORDINATE_MM: f64 = 1e7;

    /// Max angle from straight up or straight down at which a direction counts as vertical, radians (0.0006 degrees).
    /// The heading of a vertical direction has no meaning. Rounding alone turns the tip of a vertical body by a fifth
    /// of this angle.
    pub const VERTICAL_TOLERANCE_RAD: f64 = 1e-5;

    /// The pose at the origin that points straight up.
    ///
    /// ```
    /// use growbot_core::pose::Pose;
    /// assert_eq!(Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]), Ok(Pose::UPRIGHT));
    /// ```
    pub const UPRIGHT: Self =
        Self { position: Vector3::new(0.0, 0.0, 0.0), heading: 0.0, pitch: core::f64::consts::FRAC_PI_2, roll: 0.0 };

    /// Creates a pose without roll from a position in mm, and a heading and a pitch in radians. The heading is wrapped
    /// to `(-pi, pi]`.
    ///
    /// # Errors
    /// Returns an error if a number is not finite, a coordinate is beyond [`Self::MAX_COORDINATE_MM`], or the pitch is
    /// beyond `+-pi/2`.
    pub fn new(position: Vector3<f64>, heading: f64, pitch: f64) -> Result<Self, PoseError> {
        let named = [("x", position.x), ("y", position.y), ("z", position.z), ("heading", heading), ("pitch", pitch)];
        for (field, value) in named {
            if !value.is_finite() {
                return Err(PoseError::NotFinite { field, value });
            }
        }
        for (field, value) in &named[..3] {
            if value.abs() > Self::MAX_COORDINATE_MM {
                return Err(PoseError::TooFar { field, value: *value, limit: Self::MAX_COORDINATE_MM });
            }
        }
        if pitch.abs() > core::f64::consts::FRAC_PI_2 {
            return Err(PoseError::Pitch { value: degrees(pitch) });
        }
        Ok(Self { position, heading: wrap_signed(heading), pitch, roll: 0.0 })
    }

    /// Returns this pose with another roll, radians. The roll is wrapped to `(-pi, pi]`.
    ///
    /// # Errors
    /// Returns an error if the roll is not finite.
    pub fn with_roll(self, roll: f64) -> Result<Self, PoseError> {
        if !roll.is_finite() {
            return Err(PoseError::NotFinite { field: "roll", value: roll });
        }
        Ok(Self { roll: wrap_signed(roll), ..self })
    }

    /// Creates a pose without roll from x, y and z in mm, and heading and pitch in degrees.
    ///
    /// ```
    /// use growbot_core::pose::Pose;
    /// let up = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    /// assert!((up.direction() - nalgebra::Vector3::z()).norm() < 1e-15);
    /// assert!(Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 91.0]).is_err());
    /// ```
    ///
    /// # Errors
    /// Returns the errors of [`Pose::new`].
    pub fn from_degrees([x, y, z, heading, pitch]: [f64; 5]) -> Result<Self, PoseError> {
        if pitch.is_finite() && pitch.abs() > 90.0 {
            return Err(PoseError::Pitch { value: pitch });
        }
        Self::new(Vector3::new(x, y, z), radians(heading), radians(pitch))
    }

    /// Returns x, y and z in mm, and heading and pitch in degrees.
    pub fn to_degrees(&self) -> [f64; 5] {
        [self.position.x, self.position.y, self.position.z, degrees(self.heading), degrees(self.pitch)]
    }

    /// Returns the pose of a tip with this frame, without its roll. The heading is 0 if the tip points exactly straight
    /// up or down, because such a direction has no heading.
    pub fn from_frame(base_from_tip: &Frame) -> Self {
        let direction = tip_direction(base_from_tip);
        Self {
            position: base_from_tip.translation.vector,
            heading: wrap_signed(libm::atan2(direction.y, direction.x)),
            pitch: libm::atan2(direction.z, trigonometry::hypot(direction.x, direction.y)),
            roll: 0.0,
        }
    }

    /// Returns the pose of a tip with this frame, with its roll.
    pub fn from_frame_with_roll(base_from_tip: &Frame) -> Self {
        let pose = Self::from_frame(base_from_tip);
        Self { roll: pose.roll_to(base_from_tip), ..pose }
    }

    /// Returns the roll of a tip about its direction of growth, relative to the frame of this pose, radians. The tip
    /// must be at this pose.
    pub fn roll_to(&self, base_from_tip: &Frame) -> f64 {
        let pose_from_tip = self.frame().rotation.inverse() * base_from_tip.rotation;
        let matrix = pose_from_tip.matrix();
        libm::atan2(matrix[(1, 0)], matrix[(0, 0)])
    }

    /// Returns a pose without roll at the given position with the direction of this pose.
    pub fn at(&self, position: &Position) -> Self {
        Self { position: position.0, roll: 0.0, ..*self }
    }

    /// Returns the position of the tip, mm.
    pub fn position(&self) -> Vector3<f64> {
        self.position
    }

    /// Returns the heading in `(-pi, pi]`, radians: the direction's angle in the x-y plane.
    pub fn heading(&self) -> f64 {
        self.heading
    }

    /// Returns the pitch in `[-pi/2, pi/2]`, radians: the direction's angle above the x-y plane.
    pub fn pitch(&self) -> f64 {
        self.pitch
    }

    /// Returns the roll of the frame about the direction in `(-pi, pi]`, radians. 0 unless the pose is a tip of a body.
    pub fn roll(&self) -> f64 {
        self.roll
    }

    /// Reports whether the direction of the pose is straight up or down within [`Self::VERTICAL_TOLERANCE_RAD`]. If so,
    /// the direction does not depend on the heading.
    pub fn is_vertical(&self) -> bool {
        core::f64::consts::FRAC_PI_2 - self.pitch.abs() <= Self::VERTICAL_TOLERANCE_RAD
    }

    /// Returns the direction of growth, a unit vector.
    pub fn direction(&self) -> Vector3<f64> {
        tip_direction(&self.frame())
    }

    /// Returns the frame of a tip at this pose, `base_from_tip`: `Rz(heading) * Ry(90 deg - pitch) * Rz(roll)`.
    pub fn frame(&self) -> Frame {
        let (sin_heading, cos_heading) = trigonometry::sin_cos(self.heading);
        let (sin_pitch, cos_pitch) = trigonometry::sin_cos(self.pitch);
        #[rustfmt::skip]
        let rotation = Matrix3::new(
            cos_heading * sin_pitch, -sin_heading, cos_heading * cos_pitch,
            sin_heading * sin_pitch,  cos_heading, sin_heading * cos_pitch,
            -cos_pitch,               0.0,         sin_pitch,
        );
        let mut rotation = Rotation3::from_matrix_unchecked(rotation);
        if self.roll != 0.0 {
            let (sin_roll, cos_roll) = trigonometry::sin_cos(self.roll);
            #[rustfmt::skip]
            let roll = Matrix3::new(
                cos_roll, -sin_roll, 0.0,
                sin_roll,  cos_roll, 0.0,
                0.0,       0.0,      1.0,
            );
            rotation *= Rotation3::from_matrix_unchecked(roll);
        }
        Frame::from_parts(Translation3::from(self.position), rotation)
    }
}

/// Returns the direction of growth of a tip, which is the z axis of its frame.
pub fn tip_direction(base_from_tip: &Frame) -> Vector3<f64> {
    column::<2>(base_from_tip.rotation.matrix())
}

/// Returns a column of a matrix. (The function of nalgebra counts the elements while it copies them, and the compiler
/// cannot remove the panic of that count from the firmware.)
pub(crate) fn column<const INDEX: usize>(matrix: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::from(matrix.data.0[INDEX])
}

/// Returns the angle between two unit vectors, radians, exact near 0 and near pi.
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    libm::atan2(a.cross(b).norm(), a.dot(b))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn poses_round_trip_through_frames(x in -1e4..1e4, heading in -179.9..180.0, pitch in -89.9..89.9) {
            let pose = Pose::from_degrees([x, 2.0, 3.0, heading, pitch]).unwrap();
            let again = Pose::from_frame(&pose.frame());
            prop_assert!((again.heading() - pose.heading()).abs() < 1e-12);
            prop_assert!((again.pitch() - pose.pitch()).abs() < 1e-12);
            prop_assert_eq!(again.position(), pose.position());
        }

        #[test]
        fn frames_round_trip_through_poses_with_roll(
            heading in -179.9..180.0, pitch in -90.0..=90.0, roll in -180.0..180.0,
        ) {
            let pose = Pose::from_degrees([1.0, 2.0, 3.0, heading, pitch]).unwrap();
            let frame = pose.with_roll(radians(roll)).unwrap().frame();
            let again = Pose::from_frame_with_roll(&frame);
            prop_assert!((again.frame().to_homogeneous() - frame.to_homogeneous()).norm() < 1e-14);
            prop_assert!((again.direction() - pose.direction()).norm() < 1e-14);
            prop_assert_eq!(Pose::from_frame(&frame).roll(), 0.0);
        }

        #[test]
        fn the_frame_is_rz_times_ry(heading in -180.0..180.0, pitch in -90.0..90.0) {
            let pose = Pose::from_degrees([0.0, 0.0, 0.0, heading, pitch]).unwrap();
            let expected = Rotation3::from_axis_angle(&Vector3::z_axis(), pose.heading())
                * Rotation3::from_axis_angle(&Vector3::y_axis(), core::f64::consts::FRAC_PI_2 - pose.pitch());
            prop_assert!((pose.frame().rotation.matrix() - expected.matrix()).norm() < 1e-14);
        }
    }

    #[test]
    fn a_vertical_pose_keeps_its_heading_in_the_frame() {
        let pose = Pose::from_degrees([0.0, 0.0, 0.0, 90.0, 90.0]).unwrap();
        let x_axis = pose.frame().rotation * Vector3::x();
        assert!((x_axis - Vector3::y()).norm() < 1e-15);
    }

    #[test]
    fn vertical_directions_are_detected() {
        let is_vertical = |pitch| Pose::from_degrees([0.0, 0.0, 0.0, 30.0, pitch]).unwrap().is_vertical();
        assert!(is_vertical(90.0) && is_vertical(-90.0) && is_vertical(89.9995));
        assert!(!is_vertical(89.999) && !is_vertical(0.0));
    }

    #[test]
    fn invalid_poses_are_refused_with_the_value() {
        assert!(matches!(
            Pose::from_degrees([0.0, f64::NAN, 0.0, 0.0, 0.0]),
            Err(PoseError::NotFinite { field: "y", .. })
        ));
        assert!(matches!(Pose::from_degrees([0.0, 0.0, 2e7, 0.0, 0.0]), Err(PoseError::TooFar { field: "z", .. })));
        assert!(matches!(Pose::from_degrees([0.0, 0.0, 0.0, 0.0, -90.5]), Err(PoseError::Pitch { value: -90.5 })));
    }

    #[test]
    fn angle_between_directions_is_exact_near_0_and_180_degrees() {
        let tilted = Vector3::new(1e-9, 0.0, 1.0);
        assert!((angle_between(&Vector3::z(), &tilted) - 1e-9).abs() < 1e-20);
        assert_eq!(angle_between(&Vector3::z(), &-Vector3::z()), core::f64::consts::PI);
    }
}
