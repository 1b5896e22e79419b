//! The shortest path in a plane between two poses, of curvature at most 1 (Dubins 1957).
//!
//! Lengths are in units of the turning radius. The start is at the origin with heading 0. Left is counter-clockwise. A
//! shortest path has one of six types, LSL, RSR, LSR, RSL, LRL, RLR, or is a part of one (S, C, SC, CS, CC). A part is
//! a path type with angles or lengths of 0.
//!
//! Each path type is built from the centres of its circles (Shkel and Lumelsky 2001 classify the same path types by
//! their angles). Path types that begin to the right are those that begin to the left, in the mirrored plane
//! (`path_types.rs`). `planar_path.rs` holds the poses and the paths.
//!
//! The code handles two errors of classic implementations. Rounding may make an arc a full turn too long, or two
//! circles may coincide, so that the line between their centres has no direction. In both cases the code turns the line
//! back. The error at the goal then follows from how far the end of the line moves, so no path needs to be integrated.
//!
//! Building all six path types would mostly be a waste. If a path consists of an arc, a line and an arc, and neither
//! arc is longer than pi, it is the shortest path. If such a path does not exist, the search is a branch and bound.
//! Each path type first gets a lower bound of its length, in single precision and with a short polynomial for the arc
//! tangent (`bounds.rs`). Only path types whose bound is below the best length found are built. A path type that is not
//! built is never the one that would be returned.

mod bounds;
mod path_types;
mod planar_path;
#[cfg(test)]
mod tests;

use path_types::{PlanarGoal, Tangent, lengths};
pub use planar_path::{Direction, PathType, PlanarPath, PlanarPose};

/// Max difference in length (radii) of paths that count as equally long: the rounding error that [`path_types`]
/// accepts. Of such paths, the first in the order of [`PathType::ALL`] is returned, so that ties are decided in the
/// same way on every machine.
const TIE: f64 = 1e-12;

/// Returns the shortest planar path from the start to a goal.
///
/// ```
/// use growbot_core::dubins2::{PlanarPose, PathType, shortest};
/// let path = shortest(&PlanarPose { x: 10.0, y: 0.0, heading: 0.0 });
/// assert_eq!(path.length(), 10.0);
/// let behind = shortest(&PlanarPose { x: -1.0, y: 0.0, heading: 0.0 });
/// assert!(matches!(behind.path_type, PathType::Lrl | PathType::Rlr | PathType::Lsl | PathType::Rsr));
/// ```
pub fn shortest(goal: &PlanarPose) -> PlanarPath {
    let goal = PlanarGoal::new(goal);
    match goal.by_short_arcs() {
        Some(path) => path,
        None => {
            let tangents = goal.tangents();
            shortest_within(&tangents, bounds::lower_bounds(&tangents))
        }
    }
}

/// Returns the shortest path of all types. Only path types whose lower bound is small enough are built. The result does
/// not depend on the bounds.
#[inline(always)]
fn shortest_within(tangents: &[Tangent; 4], bounds: [f32; 6]) -> PlanarPath {
    let mut likeliest = PathType::Lsl;
    let mut min_bound = f32::INFINITY;
    for (path_type, bound) in PathType::ALL.into_iter().zip(bounds) {
        if bound < min_bound {
            (likeliest, min_bound) = (path_type, bound);
        }
    }
    // After the likeliest path type, mostly no other path type remains.
    let first = PlanarPath { path_type: likeliest, lengths: lengths(tangents, likeliest) };
    let length = first.length();
    if bounds.into_iter().filter(|bound| is_longer(*bound, length)).count() == bounds.len() - 1 {
        return first;
    }
    shortest_of_several(tangents, bounds, first)
}

/// Reports whether paths of a type with this lower bound (radii) are certainly longer than the length `shortest`
/// (radii). A bound that is NaN excludes nothing. The rounding to single precision is within the margins of the bounds.
fn is_longer(bound: f32, shortest: f64) -> bool {
    bound > (shortest + TIE) as f32
}

/// Like [`shortest_within`], for the case that more than one path type may be the shortest. `built` is the path that is
/// built already.
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
    // LSL always exists, so there is always a path, unless the goal contains NaN or infinity.
    let [first, ..] = found;
    found.into_iter().find(|path| path.length() <= shortest + TIE).unwrap_or(first)
}
