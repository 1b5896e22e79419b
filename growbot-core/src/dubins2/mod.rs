//! The shortest path in a plane between two poses, of curvature at most 1 (Dubins 1957).
//!
//! Lengths are in units of the turning radius; the start is at the origin with heading 0; left is counter-clockwise.
//! A shortest path has one of six types, LSL, RSR, LSR, RSL, LRL, RLR, or a part of one (S, C, SC, CS, CC): a part is a
//! path type with angles or lengths of 0.
//!
//! Each path type is built from the centres of its circles (Shkel and Lumelsky 2001 classify the same path types by
//! their angles); path types that begin to the right are those that begin to the left, in the mirrored plane
//! (`path_types.rs`).
//!
//! Two errors of classic implementations are handled explicitly: where rounding puts an arc a full turn too far, or two
//! circles coincide and the line between their centres has no direction, the line is turned back. How far from the goal
//! the path then ends follows from how far the line's end moves, so no path has to be integrated.
//!
//! Most of six path types would be built in vain. An arc, a line and an arc, neither arc longer than pi, are the
//! shortest path. Where there is no such path the search is a branch and bound: each path type first gets a lower bound
//! of its length, in single precision and with a short polynomial for the arc tangent (`bounds.rs`), and only path
//! types whose bound is below the best length found are built. What is not built is never what would be returned.

mod bounds;
mod path_types;
#[cfg(test)]
mod tests;

use core::f64::consts::TAU;

use crate::angle::wrap_positive;
use crate::trigonometry;
use path_types::{Goal, Tangent, lengths};

/// A pose in the plane: x, y in radii, heading in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Forwards from the start, radii.
    pub x: f64,
    /// To the left of the start, radii.
    pub y: f64,
    /// Counter-clockwise from the start's, radians.
    pub heading: f64,
}

/// Which way a piece of a planar path goes.
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

/// One of the six path types.
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

    /// The three pieces.
    #[must_use]
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

/// A path of one of the types. Pieces may have no length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPath {
    /// The path type.
    pub path_type: PathType,
    /// Length of each piece, radii; for an arc that is its angle.
    pub lengths: [f64; 3],
}

impl PlanarPath {
    /// Length of the whole path, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }

    /// The pieces that have a length, in order.
    pub fn pieces(&self) -> impl Iterator<Item = (Direction, f64)> + use<> {
        self.path_type.directions().into_iter().zip(self.lengths).filter(|(_, length)| *length > 0.0)
    }

    /// Where the path ends: by forward integration.
    #[must_use]
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

    /// How far from the goal the path ends: the larger of distance (radii) and angle (radians).
    #[must_use]
    pub fn miss(&self, goal: &PlanarPose) -> f64 {
        let end = self.end();
        let turned = wrap_positive(end.heading - goal.heading);
        trigonometry::hypot(end.x - goal.x, end.y - goal.y).max(turned.min(TAU - turned))
    }
}

/// Max difference in length (radii) of paths that count as equally long: the error by rounding, as [`path_types`]
/// accepts it. The first of them in the order of [`PathType::ALL`] is returned, so that ties fall the same way
/// everywhere.
const TIE: f64 = 1e-12;

/// The shortest path to a goal.
///
/// ```
/// use growbot_core::dubins2::{PlanarPose, PathType, shortest};
/// let path = shortest(&PlanarPose { x: 10.0, y: 0.0, heading: 0.0 });
/// assert_eq!(path.length(), 10.0);
/// let behind = shortest(&PlanarPose { x: -1.0, y: 0.0, heading: 0.0 });
/// assert!(matches!(behind.path_type, PathType::Lrl | PathType::Rlr | PathType::Lsl | PathType::Rsr));
/// ```
#[must_use]
pub fn shortest(goal: &PlanarPose) -> PlanarPath {
    let goal = Goal::new(goal);
    match goal.by_short_arcs() {
        Some(path) => path,
        None => {
            let tangents = goal.tangents();
            shortest_within(&tangents, bounds::lower_bounds(&tangents))
        }
    }
}

/// The shortest path, built only from path types whose lower bound leaves that possible. Whatever the bounds, the
/// result is the same.
#[inline(always)]
fn shortest_within(tangents: &[Tangent; 4], bounds: [f32; 6]) -> PlanarPath {
    let mut likeliest = PathType::Lsl;
    let mut min_bound = f32::INFINITY;
    for (path_type, bound) in PathType::ALL.into_iter().zip(bounds) {
        if bound < min_bound {
            (likeliest, min_bound) = (path_type, bound);
        }
    }
    // After the likeliest path type there is mostly no other left.
    let first = PlanarPath { path_type: likeliest, lengths: lengths(tangents, likeliest) };
    let length = first.length();
    if bounds.into_iter().filter(|bound| is_longer(*bound, length)).count() == bounds.len() - 1 {
        return first;
    }
    shortest_of_several(tangents, bounds, first)
}

/// Whether a path type of that bound is certainly longer than the shortest. A bound that is not a number rules nothing
/// out; the rounding to single precision is within the bounds' margins.
fn is_longer(bound: f32, shortest: f64) -> bool {
    bound > (shortest + TIE) as f32
}

/// [`shortest_within`], where more than one path type may be the shortest; one of them is built already.
#[cold]
fn shortest_of_several(tangents: &[Tangent; 4], bounds: [f32; 6], built: PlanarPath) -> PlanarPath {
    let mut found = [PlanarPath { path_type: PathType::Lsl, lengths: [f64::NAN; 3] }; 6];
    let mut shortest = built.length();
    for (path, (path_type, bound)) in found.iter_mut().zip(PathType::ALL.into_iter().zip(bounds)) {
        if path_type == built.path_type {
            *path = built;
        } else if !is_longer(bound, shortest) {
            *path = PlanarPath { path_type, lengths: lengths(tangents, path_type) };
            shortest = if path.length() < shortest { path.length() } else { shortest };
        }
    }
    // LSL always exists, so there is always a path, unless the goal is not in numbers.
    let [first, ..] = found;
    found.into_iter().find(|path| path.length() <= shortest + TIE).unwrap_or(first)
}
