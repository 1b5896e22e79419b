//! Poses in the plane, the six path types by the directions of their segments, and planar paths.

use core::f64::consts::TAU;

use crate::angle::wrap_positive;
use crate::trigonometry;

/// A pose in the plane: x, y in radii, heading in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Distance forwards from the start, radii.
    pub x: f64,
    /// Distance to the left of the start, radii.
    pub y: f64,
    /// Heading of the pose relative to the start's, counter-clockwise, radians.
    pub heading: f64,
}

/// Direction of a segment of a planar path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// An arc, counter-clockwise.
    Left,
    /// An arc, clockwise.
    Right,
    /// A straight line.
    Straight,
}

use Direction::{Left, Right, Straight};

/// Type of a planar path, by the directions of its three segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathType {
    /// Left, straight, left.
    Lsl,
    /// Right, straight, right.
    Rsr,
    /// Left, straight, right.
    Lsr,
    /// Right, straight, left.
    Rsl,
    /// Left, right, left.
    Lrl,
    /// Right, left, right.
    Rlr,
}

impl PathType {
    /// All path types, in the order in which ties are decided.
    pub const ALL: [Self; 6] = [Self::Lsl, Self::Rsr, Self::Lsr, Self::Rsl, Self::Lrl, Self::Rlr];

    /// Returns the directions of the three segments.
    pub fn directions(self) -> [Direction; 3] {
        match self {
            Self::Lsl => [Left, Straight, Left],
            Self::Rsr => [Right, Straight, Right],
            Self::Lsr => [Left, Straight, Right],
            Self::Rsl => [Right, Straight, Left],
            Self::Lrl => [Left, Right, Left],
            Self::Rlr => [Right, Left, Right],
        }
    }
}

/// A planar path of one of the six types. Segments may have a length of 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPath {
    /// Type of the path.
    pub path_type: PathType,
    /// Length of each segment, radii. The length of an arc is its angle.
    pub lengths: [f64; 3],
}

impl PlanarPath {
    /// Returns the length of the whole path, radii.
    pub fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }

    /// Returns the segments whose length is not 0, in order.
    pub fn pieces(&self) -> impl Iterator<Item = (Direction, f64)> + use<> {
        self.path_type.directions().into_iter().zip(self.lengths).filter(|(_, length)| *length > 0.0)
    }

    /// Returns the pose at the end of the path, by forward integration.
    pub fn end(&self) -> PlanarPose {
        let mut at = PlanarPose { x: 0.0, y: 0.0, heading: 0.0 };
        let (mut sin, mut cos) = (0.0, 1.0);
        for (direction, length) in self.pieces() {
            match direction {
                Straight => {
                    at.x += length * cos;
                    at.y += length * sin;
                }
                Left | Right => {
                    let side = if direction == Left { 1.0 } else { -1.0 };
                    at.heading += side * length;
                    let (sin_after, cos_after) = trigonometry::sin_cos(at.heading);
                    at.x += side * (sin_after - sin);
                    at.y -= side * (cos_after - cos);
                    (sin, cos) = (sin_after, cos_after);
                }
            }
        }
        at
    }

    /// Returns the error of the path's end at the goal: the distance (radii) or the angle (radians), whichever is
    /// larger.
    pub fn goal_error(&self, goal: &PlanarPose) -> f64 {
        let end = self.end();
        let turned = wrap_positive(end.heading - goal.heading);
        trigonometry::hypot(end.x - goal.x, end.y - goal.y).max(turned.min(TAU - turned))
    }
}
