//! The shortest path to a position, with any direction of arrival, of curvature at most 1.
//!
//! The path is planar. By Pontryagin's principle (Sussmann 1995, used as in [`crate::shortest`]) an arc turns about `m
//! = m0 + p x x`, which is perpendicular to its tip. If the direction of arrival is free, `m` vanishes at the end. So
//! `m . p`, which is constant, is 0, and with it the torsion, `-(m . p) / |m|^2`. The plane contains the start's
//! direction and the goal.
//!
//! In the plane it is the relaxed Dubins problem (Bui, Soueres, Boissonnat and Laumond 1994, "Shortest path synthesis
//! for Dubins non-holonomic robot", ICRA). The path is an arc and a line. If the position is inside a turning circle of
//! the start, the path is two arcs, first away from the position and then towards it. The code builds the paths on both
//! sides, and with both meetings of the two circles. It returns the shortest of those that end at the position.
//!
//! Lengths are in units of the turning radius.

use core::f64::consts::TAU;

use heapless::Vec;

use crate::angle::wrap_positive;
use crate::dubins2::{PathType, PlanarPath};
use crate::path::{self, Segment};
use crate::plan::{
    MIN_SEGMENT, PlanError, PlannedPath, Planner, check_radius, plan_with_filter, trim_and_check, two_plane_length,
};
use crate::pose::{Pose, Position};
use crate::robot::Robot;
use crate::shortest::PathCandidate;
use crate::trigonometry;

/// Max number of paths to a position: an arc and a line on two sides, and two arcs in two orders with two meetings.
pub const MAX_PATHS: usize = 6;
/// Max difference between an angle and a full turn, radians, at which the angle may be 0 with a rounding error.
const NEAR_FULL_TURN: f64 = 1e-5;
/// Max error of a path at the position, radii, for positions within 100 radii. At larger distances it grows in
/// proportion.
const MAX_POSITION_ERROR: f64 = 1e-12;

/// Returns all paths of an arc and a line, or of two arcs, from the origin and the x direction to a position (radii) in
/// the plane, shortest first. There is always one.
/// ```
/// use growbot_core::to_position::planar;
/// assert_eq!(planar(10.0, 0.0)[0].length(), 10.0);
/// // Inside the circle to the left: first right, then left.
/// let [near, ..] = &planar(0.0, 0.5)[..] else { panic!() };
/// assert!(near.pieces().count() == 2 && near.length() > 5.0);
/// ```
pub fn planar(x: f64, y: f64) -> Vec<PlanarPath, MAX_PATHS> {
    let mut found = Vec::new();
    if x == 0.0 && y == 0.0 {
        keep(&mut found, PlanarPath { path_type: PathType::Lsl, lengths: [0.0; 3] });
        return found;
    }
    for (line, arcs, side) in [(PathType::Lsl, PathType::Lsr, 1.0), (PathType::Rsr, PathType::Rsl, -1.0)] {
        // Paths that begin to the right are those that begin to the left, in the mirrored plane.
        let (x, y) = (x, side * y);
        let paths = [(line, arc_and_line(x, y)), (arcs, two_arcs(x, y, 1.0)), (arcs, two_arcs(x, y, -1.0))];
        for (path_type, lengths) in paths {
            let short = lengths.map(|length| if length > TAU - NEAR_FULL_TURN { 0.0 } else { length });
            let is_line = path_type == line;
            let short = PlanarPath { path_type, lengths: [short[0], lengths[1], if is_line { 0.0 } else { short[2] }] };
            let path = PlanarPath { path_type, lengths };
            let arrives = |path: &PlanarPath| arrives(path, x, side, y);
            if let Some(path) = [short, path].into_iter().find(arrives) {
                keep(&mut found, path);
            }
        }
    }
    found
}

/// Reports whether the path ends at a position. The position is given as `(x, y)` in a plane that is mirrored if `side`
/// is -1.
fn arrives(path: &PlanarPath, x: f64, side: f64, y: f64) -> bool {
    let end = path.end();
    let scale = (0.01 * trigonometry::hypot(x, y)).max(1.0);
    trigonometry::hypot(end.x - x, end.y - side * y) <= MAX_POSITION_ERROR * scale
}

/// Inserts a path into the list in order of length, after paths of the same length.
fn keep(found: &mut Vec<PlanarPath, MAX_PATHS>, path: PlanarPath) {
    // The list has space for each path.
    let _ = found.push(path);
    let mut index = found.len().saturating_sub(1);
    while index > 0 && found.get(index - 1).is_some_and(|before| before.length() > path.length()) {
        found.swap(index - 1, index);
        index -= 1;
    }
}

/// Returns the lengths of the segments of a path with a left arc, until the tip points to the position, and a straight
/// line. If the position is inside the circle of the arc, such a path does not exist, and the result does not reach the
/// position. If only rounding has moved the position inside, the result reaches it.
fn arc_and_line(x: f64, y: f64) -> [f64; 3] {
    // Length of the tangent from the position to the circle, whose centre is (0, 1).
    let line = root(x * x + y * (y - 2.0));
    let above = y - 1.0;
    let turn = wrap_positive(libm::atan2(x + above * line, x * line - above));
    [turn, line, 0.0]
}

/// Returns the lengths of the segments of a path with a left arc and a right arc. The circle of the right arc goes
/// through the position. `meeting`, 1 or -1, selects one of the two circles that do. If there is none, the result does
/// not reach the position.
fn two_arcs(x: f64, y: f64, meeting: f64) -> [f64; 3] {
    // Vector from the centre of the first circle to the position. The centre of the second circle is at distance 2 from
    // the first centre, and at distance 1 from the position.
    let (across, along) = (y - 1.0, x);
    let distance = trigonometry::hypot(across, along);
    let square = (distance - 1.0) * (3.0 - distance) * (distance + 1.0) * (distance + 3.0);
    let aside = meeting * libm::atan2(root(square), distance * distance + 3.0);
    // After an arc of angle `first`, the tip is at (sin, -cos) of that angle from the centre.
    let first = wrap_positive(libm::atan2(along, -across) + aside);
    let (sin, cos) = trigonometry::sin_cos(first);
    let (from_x, from_y) = (-sin, cos);
    let (to_x, to_y) = (along - 2.0 * sin, across + 2.0 * cos);
    // The clockwise angle from the beginning of the second arc to the position.
    let second = wrap_positive(libm::atan2(from_y * to_x - from_x * to_y, from_x * to_x + from_y * to_y));
    [first, 0.0, second]
}

/// Returns the square root, or 0 if the number is negative, which may result from rounding.
fn root(square: f64) -> f64 {
    libm::sqrt(square.max(0.0))
}

/// A path to a position, and the pose at its end.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionPlan {
    /// The pose at the end of the path: the position, with the direction in which the path arrives.
    pub goal: Pose,
    /// The path, with the number of candidates from which it was selected.
    pub planned: PlannedPath,
}

/// Plans a path with arcs of this radius (mm) to a position that may be reached in any direction, and checks that the
/// path ends there. Returns the shortest path that `accept` accepts. `None` if it accepts none.
///
/// With [`Planner::TwoPlane`] the direction of arrival is that of the shortest path, and the path returned is the
/// two-plane path to this pose.
///
/// # Errors
/// Returns the errors of [`crate::plan::plan`].
pub fn plan_to_position(
    robot: &Robot,
    start: &Pose,
    point: &Position,
    radius: f64,
    planner: Planner,
    mut accept: impl FnMut(&[Segment]) -> bool,
) -> Result<Option<PositionPlan>, PlanError> {
    check_radius(robot, radius)?;
    let base_from_tip = start.frame();
    let goal = base_from_tip.rotation.inverse() * ((point.vector() - start.position()) / radius);
    let across = trigonometry::hypot(goal.x, goal.y);
    // If the position is straight ahead or behind, any plane will do.
    let left = libm::atan2(goal.y, goal.x);
    let paths = planar(goal.z, across);
    for planar in &paths {
        let path = PathCandidate::Planar { path: *planar, left }.path(radius)?;
        // Segments that are only rounding errors would turn the direction of arrival by as much.
        let short = path.filtered(|segment| segment.length() >= MIN_SEGMENT * radius);
        for path in [short, path] {
            let goal = arrival(start, point, &path);
            // A path that does not reach the position is skipped.
            let Ok(path) = trim_and_check(path, start, &goal, radius) else { continue };
            if planner == Planner::TwoPlane {
                let chosen = plan_with_filter(robot, start, &goal, radius, planner, accept)?;
                return Ok(chosen.map(|chosen| PositionPlan { goal, planned: chosen }));
            }
            if accept(&path) {
                let two_plane_length = two_plane_length(start, &goal, radius)?;
                return Ok(Some(PositionPlan {
                    goal,
                    planned: PlannedPath { path, candidate_count: paths.len(), two_plane_length },
                }));
            }
            break;
        }
    }
    Ok(None)
}

/// Returns the pose at a position, with the direction in which a path arrives. A path without a bend arrives exactly in
/// the direction of the start.
fn arrival(start: &Pose, point: &Position, path: &[Segment]) -> Pose {
    let bends = path.iter().any(|segment| segment.bend() > 0.0);
    let end = if bends { Pose::from_frame(&path::end(path, &start.frame())) } else { *start };
    end.at(point)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI};

    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::dubins2::{self, PlanarPose};
    use crate::plan::goal_error;
    use crate::testing::robot_a;

    const ARCS: [PathType; 2] = [PathType::Lsr, PathType::Rsl];

    fn length_to(x: f64, y: f64) -> f64 {
        planar(x, y)[0].length()
    }

    /// Returns the length of the shortest path to a position (radii), by a search over the directions of arrival.
    fn by_search(x: f64, y: f64) -> f64 {
        let length = |heading: f64| dubins2::shortest(&PlanarPose { x, y, heading }).length();
        let mut best = (f64::INFINITY, 0.0);
        for step in 0..720 {
            let heading = f64::from(step) * TAU / 720.0;
            let found = length(heading);
            if found < best.0 {
                best = (found, heading);
            }
        }
        let mut step = TAU / 720.0;
        while step > 1e-9 {
            let near = [best.1 - step, best.1 + step].map(|heading| (length(heading), heading));
            match near.into_iter().find(|(found, _)| *found < best.0) {
                Some(better) => best = better,
                None => step *= 0.5,
            }
        }
        best.0
    }

    fn magnitude() -> impl Strategy<Value = f64> {
        (-15.0..1.5).prop_map(|exponent| libm::pow(10.0, exponent))
    }

    fn sign() -> impl Strategy<Value = f64> {
        prop::sample::select(&[-1.0, 0.0, 1.0])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        #[test]
        fn no_direction_gives_a_shorter_path(x in -5.0..5.0, y in -5.0..5.0, heading in 0.0..TAU) {
            let to_pose = dubins2::shortest(&PlanarPose { x, y, heading });
            prop_assert!(length_to(x, y) <= to_pose.length() + 1e-12);
        }

        #[test]
        fn paths_are_sorted_by_length_and_reach_the_goal(x in -5.0..5.0, y in -5.0..5.0) {
            let paths = planar(x, y);
            prop_assert!(!paths.is_empty());
            prop_assert!(paths.windows(2).all(|pair| pair[0].length() <= pair[1].length()));
            for path in &paths {
                let end = path.end();
                prop_assert!(libm::hypot(end.x - x, end.y - y) < 1e-12, "{path:?}");
            }
        }

        #[test]
        fn tiny_segments_do_not_cause_full_turns(first in magnitude(), line in magnitude(), side in sign()) {
            let path_type = if side < 0.0 { PathType::Rsr } else { PathType::Lsl };
            let laid = PlanarPath { path_type, lengths: [if side == 0.0 { 0.0 } else { first % PI }, line, 0.0] };
            let end = laid.end();
            prop_assert!(length_to(end.x, end.y) <= laid.length() + 1e-11, "{laid:?}");
        }

        #[test]
        fn two_arcs_are_found(first in magnitude(), second in 0.0..TAU, order in 0..2_usize) {
            let laid = PlanarPath { path_type: ARCS[order], lengths: [first % TAU, 0.0, second] };
            let end = laid.end();
            // Rounding changes a tiny first arc, and the second arc compensates for it.
            prop_assert!(length_to(end.x, end.y) <= laid.length() + 1e-7, "{laid:?}");
        }

        #[test]
        fn degenerate_positions_are_reached(x in magnitude(), y in magnitude(), sx in sign(), sy in sign(), at in 0..5_usize) {
            let (at_x, at_y) = [(0.0, 0.0), (1.0, 1.0), (0.0, 2.0), (-1.0, 1.0), (0.0, -3.0)][at];
            let (x, y) = (at_x + sx * x, at_y + sy * y);
            let paths = planar(x, y);
            prop_assert!(!paths.is_empty(), "{x:e}, {y:e}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn planar_path_is_the_shortest_over_all_directions(x in -4.0..4.0, y in -4.0..4.0) {
            let (found, searched) = (length_to(x, y), by_search(x, y));
            prop_assert!((found - searched).abs() < 1e-8, "{x}, {y}: {found}, {searched}");
        }
    }

    #[test]
    fn known_positions_have_the_expected_lengths() {
        for (x, y, length) in [(0.0, 0.0, 0.0), (3.0, 0.0, 3.0), (1.0, 1.0, FRAC_PI_2), (-1.0, 2.0, PI + 1.0)] {
            assert!((length_to(x, y) - length).abs() < 1e-15, "{x}, {y}: {}", length_to(x, y));
        }
        // The position is the centre of the circle to the left. The centres of the two circles and the position form a
        // triangle.
        let path = planar(0.0, 1.0)[0];
        let aside = libm::acos(7.0 / 8.0);
        let last = TAU - libm::acos(0.25);
        assert_eq!(path.path_type, PathType::Rsl);
        assert!((path.length() - aside - last).abs() < 1e-12, "{path:?}");
    }

    fn point(x: f64, y: f64, z: f64) -> Position {
        Position::new(Vector3::new(x, y, z)).unwrap()
    }

    fn to_point(start: &Pose, point: &Position, planner: Planner) -> PositionPlan {
        plan_to_position(&robot_a(), start, point, 100.0, planner, |_| true).unwrap().unwrap()
    }

    proptest! {
        #[test]
        fn the_path_ends_at_the_returned_pose(
            x in -2e3..2e3, y in -2e3..2e3, z in -2e3..2e3, heading in -180.0..180.0, pitch in -90.0..90.0,
        ) {
            let start = Pose::from_degrees([10.0, 20.0, 30.0, heading, pitch]).unwrap();
            for planner in [Planner::Shortest, Planner::TwoPlane] {
                let PositionPlan { goal, planned } = to_point(&start, &point(x, y, z), planner);
                prop_assert_eq!(goal.position(), Vector3::new(x, y, z));
                let miss = goal_error(&path::end(&planned.path, &start.frame()), &goal);
                prop_assert!(miss.distance < 1e-9 && miss.angle < 1e-11, "{miss:?}");
            }
        }
    }

    #[test]
    fn a_goal_straight_ahead_keeps_the_direction_exactly() {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 30.0, 90.0]).unwrap();
        let PositionPlan { goal, planned: chosen } = to_point(&start, &point(0.0, 0.0, 400.0), Planner::Shortest);
        assert_eq!((goal.heading(), goal.pitch()), (start.heading(), start.pitch()));
        assert_eq!(chosen.path.len(), 1);
        let there = to_point(&start, &point(0.0, 0.0, 0.0), Planner::Shortest);
        assert!(there.planned.path.is_empty() && there.goal == start);
    }

    #[test]
    fn the_next_path_is_offered_if_one_is_rejected() {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let (point, mut offered) = (point(50.0, 0.0, 0.0), std::vec::Vec::new());
        let refuse = |path: &[Segment]| {
            offered.push(path::length(path));
            false
        };
        let none = plan_to_position(&robot_a(), &start, &point, 100.0, Planner::Shortest, refuse).unwrap();
        assert!(none.is_none() && offered.len() > 1 && offered.is_sorted(), "{offered:?}");
    }

    #[test]
    fn invalid_positions_and_radii_are_refused() {
        assert!(Position::new(Vector3::new(0.0, f64::NAN, 0.0)).is_err());
        assert!(Position::new(Vector3::new(0.0, 0.0, 2e7)).is_err());
        let (start, point) = (Pose::from_degrees([0.0; 5]).unwrap(), point(1.0, 2.0, 3.0));
        let refused = plan_to_position(&robot_a(), &start, &point, 50.0, Planner::Shortest, |_| true);
        assert!(matches!(refused, Err(PlanError::RadiusTooSmall { .. })));
    }
}
