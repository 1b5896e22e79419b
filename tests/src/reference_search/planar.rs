//! The six path types of Dubins (1957), for a start, a goal and directions that lie in one plane.
//!
//! In the plane the start is the origin and its heading is along y (the third axis of space). Left and right circles
//! have radius 1.

use core::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Vector2, Vector3};

use super::{Curve, Piece, Problem, across};

/// Start, goal and directions lie in one plane if the volume they span is below this.
const FLAT: f64 = 1e-13;
/// An arc that is short of a full turn by less than this may be an empty arc. Both are tried.
const NEARLY_FULL: f64 = 1e-6;

const LEFT: f64 = 1.0;
const RIGHT: f64 = -1.0;

/// Returns the plane's first axis. Its second axis is z. `None` if not everything lies in one plane.
fn plane(problem: &Problem) -> Option<Vector3<f64>> {
    let z = Vector3::z();
    if (z.cross(&problem.tangent).dot(&problem.goal)).abs() > FLAT {
        return None;
    }
    let lateral = |vector: &Vector3<f64>| vector - z * vector.z;
    let (goal, tangent) = (lateral(&problem.goal), lateral(&problem.tangent));
    let widest = if goal.norm() > tangent.norm() { goal } else { tangent };
    Some(if widest.norm() > 1e-9 { widest.normalize() } else { across(&z).0 })
}

fn direction(heading: f64) -> Vector2<f64> {
    let (sin, cos) = libm::sincos(heading);
    Vector2::new(cos, sin)
}

fn heading(vector: &Vector2<f64>) -> f64 {
    libm::atan2(vector.y, vector.x)
}

/// Returns the centre of the circle that touches a point with a heading, on one side.
fn centre(at: &Vector2<f64>, heading: f64, side: f64) -> Vector2<f64> {
    at + direction(heading + side * FRAC_PI_2)
}

/// Returns the angle of an arc to this side between two headings, in [0, 2 pi).
fn turn(from: f64, to: f64, side: f64) -> f64 {
    let angle = (side * (to - from)) % TAU;
    if angle < 0.0 { angle + TAU } else { angle }
}

/// Returns the paths of all path types that exist: name, and for each segment the side and the angle of an arc, or 0
/// and the length of a line. Angles are not corrected for rounding.
fn words(goal: &Vector2<f64>, goal_heading: f64) -> Vec<(&'static str, [(f64, f64); 3])> {
    let mut words = Vec::new();
    for (name, first, last) in [("LSL", LEFT, LEFT), ("RSR", RIGHT, RIGHT), ("LSR", LEFT, RIGHT), ("RSL", RIGHT, LEFT)]
    {
        let between = centre(goal, goal_heading, last) - centre(&Vector2::zeros(), FRAC_PI_2, first);
        // The line is tangent to both circles. It is parallel to the line between the centres, or crosses it midway.
        let width: f64 = if first == last { 0.0 } else { 2.0 };
        let apart = between.norm();
        if apart < width - 1e-12 {
            continue;
        }
        let line = libm::sqrt((apart * apart - width * width).max(0.0));
        let along = heading(&between) + first * libm::atan2(width, line);
        let angles = (turn(FRAC_PI_2, along, first), turn(along, goal_heading, last));
        words.push((name, [(first, angles.0), (0.0, line), (last, angles.1)]));
    }
    for (name, side) in [("LRL", LEFT), ("RLR", RIGHT)] {
        let start_centre = centre(&Vector2::zeros(), FRAC_PI_2, side);
        let between = centre(goal, goal_heading, side) - start_centre;
        let apart = between.norm();
        if apart > 4.0 + 1e-12 {
            continue;
        }
        // The middle circle touches both others, on either side of the line between them.
        let open = libm::acos((apart / 4.0).min(1.0));
        for way in [-1.0, 1.0] {
            let to_middle = heading(&between) + way * open;
            let middle = start_centre + 2.0 * direction(to_middle);
            let from_middle = heading(&(start_centre + between - middle));
            let (enter, leave) = (to_middle + side * FRAC_PI_2, from_middle - side * FRAC_PI_2);
            let first = turn(FRAC_PI_2, enter, side);
            let second = turn(enter, leave, -side);
            let third = turn(leave, goal_heading, side);
            words.push((name, [(side, first), (-side, second), (side, third)]));
        }
    }
    words
}

/// Returns the shortest planar path and its path type. `None` if not everything lies in one plane.
pub fn shortest(problem: &Problem) -> Option<(Curve, &'static str)> {
    let sideways = plane(problem)?;
    let flat = |vector: &Vector3<f64>| Vector2::new(vector.dot(&sideways), vector.z);
    let to_the_left = sideways.cross(&Vector3::z());
    let mut best: Option<(Curve, &'static str)> = None;
    for (name, parts) in words(&flat(&problem.goal), heading(&flat(&problem.tangent))) {
        // All ways of leaving out arcs that may only be the result of rounding.
        for left_out in 0..8 {
            let mut pieces = Vec::new();
            let mut fits = true;
            for (index, (side, extent)) in parts.into_iter().enumerate() {
                let is_left_out = left_out & (1 << index) != 0;
                fits &= !is_left_out || (side != 0.0 && extent > TAU - NEARLY_FULL);
                match (is_left_out, side) {
                    (true, _) => {}
                    (false, 0.0) => pieces.push(Piece::Line { length: extent }),
                    (false, _) => pieces.push(Piece::Arc { axis: to_the_left * side, angle: extent }),
                }
            }
            let curve = Curve::Pieces(pieces);
            let is_shorter = best.as_ref().is_none_or(|(shortest, _)| curve.length() < shortest.length());
            if fits && is_shorter && problem.is_reached_by(&curve) {
                best = Some((curve, name));
            }
        }
    }
    best
}
