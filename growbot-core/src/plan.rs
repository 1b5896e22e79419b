//! Planning of a path between two poses, with a check that the path ends at its goal.

use core::cmp::Ordering;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

use crate::compact_number::{CompactNumber, rounded_up};
use crate::path::{self, Path, PathFull, Segment};
use crate::pose::{Frame, Pose, angle_between, tip_direction};
use crate::robot::Robot;
use crate::shortest::{self, Candidates, PathCandidate, PathProblem};
use crate::two_plane::two_plane;

/// Method of finding a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, EnumString, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Planner {
    /// The paper's planner: two planar Dubins paths ([`crate::two_plane`]).
    TwoPlane,
    /// The search for the shortest path ([`crate::shortest`]).
    Shortest,
}

impl Planner {
    /// Returns the name of the planner in `--planner` and in files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// A planned path, and the number of candidates from which it was selected.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPath {
    /// Planned path.
    pub path: Path,
    /// Number of paths to the goal that the planner found.
    pub candidate_count: usize,
    /// Length of the two-plane path to the same goal, mm.
    pub two_plane_length: f64,
}

/// Reason why a plan could not be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The radius is below R_min.
    #[error("the radius of the bends is {} mm, below R_min = {} mm of this robot: give a radius of at least \
             R_min", CompactNumber(.radius), CompactNumber(&rounded_up(.limit)))]
    RadiusTooSmall {
        /// Requested radius, mm.
        radius: f64,
        /// R_min, the robot's min radius, mm.
        limit: f64,
    },
    /// The radius is not finite or above [`MAX_RADIUS_MM`].
    #[error("the radius of the bends is {} mm: give a radius of at most {limit} mm", CompactNumber(.radius))]
    RadiusTooLarge {
        /// Requested radius, mm.
        radius: f64,
        /// Max radius that is accepted, mm.
        limit: f64,
    },
    /// The path that the planner found does not end at the goal.
    #[error(
        "the path ends {distance} mm and {angle} rad from the goal (tolerance {limit} mm): this is a bug, please \
         report the poses"
    )]
    GoalNotReached {
        /// Distance from the goal, mm.
        distance: f64,
        /// Angle between the direction at the path's end and the goal's direction, radians.
        angle: f64,
        /// Max distance that is accepted, mm.
        limit: f64,
    },
    /// No path was found.
    #[error("no path was found: this is a bug, please report the poses")]
    NoPath,
    /// The path has more segments than a [`Path`] can hold.
    #[error(transparent)]
    TooManySegments(#[from] PathFull),
}

/// Max radius of a plan that is accepted, mm (1 km).
pub const MAX_RADIUS_MM: f64 = 1e6;
/// Max error of a planned path at the goal, radii and radians, for goals within 100 radii. At larger distances it grows
/// in proportion. It is a tenth of a nanometre for a radius of 100 mm.
const GOAL_TOLERANCE: f64 = 1e-9;
/// Min length of a segment, radii. A shorter segment is only a rounding error, and is removed if the end of the path
/// does not move by more than [`UNMOVED`].
pub(crate) const MIN_SEGMENT: f64 = 1e-9;
/// Max error at the goal of a path from which short segments have been removed, radii and radians: a tenth of
/// [`GOAL_TOLERANCE`].
const UNMOVED: f64 = 1e-10;

/// The difference between the pose of a tip and a goal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GoalError {
    /// Distance between the tip and the goal, mm.
    pub distance: f64,
    /// Angle between the direction of growth of the tip and that of the goal, radians.
    pub angle: f64,
}

/// Reports whether a goal is so close (for arcs of this radius, mm) that a helicoidal arc may be the shortest path. The
/// search for helicoidal arcs is not complete, so for such a goal a path may exist that is shorter than the planned
/// path. The search for all other paths is complete.
pub fn is_within_helicoid_range(start: &Pose, goal: &Pose, radius: f64) -> bool {
    (goal.position() - start.position()).norm() < shortest::HELICOIDS_WITHIN * radius
}

/// Returns the difference between the pose of a tip and a goal.
pub fn goal_error(base_from_tip: &Frame, goal: &Pose) -> GoalError {
    GoalError {
        distance: (base_from_tip.translation.vector - goal.position()).norm(),
        angle: angle_between(&tip_direction(base_from_tip), &goal.direction()),
    }
}

/// Plans a path with arcs of this radius (mm) from start to goal. Checks that the path ends at the goal, by multiplying
/// the transforms of its segments (Eq 4; a helicoidal arc is integrated).
///
/// # Errors
/// Returns an error if the radius is below R_min or above [`MAX_RADIUS_MM`], or if the path does not end at the goal.
/// The second error has never been observed.
pub fn plan(robot: &Robot, start: &Pose, goal: &Pose, radius: f64, planner: Planner) -> Result<PlannedPath, PlanError> {
    plan_with_keep_alive(robot, start, goal, radius, planner, &mut || ())
}

/// Like [`plan`], but calls `keep_alive` at least every few milliseconds on a microcontroller, so that a board can feed
/// its watchdog.
///
/// # Errors
/// Returns the errors of [`plan`].
pub fn plan_with_keep_alive(
    robot: &Robot,
    start: &Pose,
    goal: &Pose,
    radius: f64,
    planner: Planner,
    keep_alive: &mut dyn FnMut(),
) -> Result<PlannedPath, PlanError> {
    check_radius(robot, radius)?;
    // The first candidate is accepted, so there is always a result.
    search(start, goal, radius, planner, |_| true, keep_alive).and_then(|chosen| chosen.ok_or(PlanError::NoPath))
}

/// Returns the shortest of the planner's candidates that `accept` accepts. `None` if it accepts none. `accept` receives
/// the candidates in the order of their length, with the two-plane path among them.
///
/// # Errors
/// Returns the errors of [`plan`].
pub fn plan_with_filter(
    robot: &Robot,
    start: &Pose,
    goal: &Pose,
    radius: f64,
    planner: Planner,
    accept: impl FnMut(&[Segment]) -> bool,
) -> Result<Option<PlannedPath>, PlanError> {
    check_radius(robot, radius)?;
    search(start, goal, radius, planner, accept, &mut || ())
}

fn search(
    start: &Pose,
    goal: &Pose,
    radius: f64,
    planner: Planner,
    accept: impl FnMut(&[Segment]) -> bool,
    keep_alive: &mut dyn FnMut(),
) -> Result<Option<PlannedPath>, PlanError> {
    match planner {
        Planner::TwoPlane => two_plane_only(start, goal, radius, accept),
        Planner::Shortest => shortest_of_all(start, goal, radius, accept, keep_alive),
    }
}

/// Returns an error if the radius (mm) is below R_min or above [`MAX_RADIUS_MM`].
pub(crate) fn check_radius(robot: &Robot, radius: f64) -> Result<(), PlanError> {
    let limit = robot.min_radius();
    if radius < limit {
        return Err(PlanError::RadiusTooSmall { radius, limit });
    }
    if radius.is_nan() || radius > MAX_RADIUS_MM {
        return Err(PlanError::RadiusTooLarge { radius, limit: MAX_RADIUS_MM });
    }
    Ok(())
}

#[inline(never)] // Keeps its stack frame out of the caller's.
fn two_plane_only(
    start: &Pose,
    goal: &Pose,
    radius: f64,
    mut accept: impl FnMut(&[Segment]) -> bool,
) -> Result<Option<PlannedPath>, PlanError> {
    let path = checked_two_plane(start, goal, radius)?;
    let two_plane_length = path::length(&path);
    Ok(accept(&path).then_some(PlannedPath { path, candidate_count: 1, two_plane_length }))
}

#[inline(never)]
fn shortest_of_all(
    start: &Pose,
    goal: &Pose,
    radius: f64,
    mut accept: impl FnMut(&[Segment]) -> bool,
    keep_alive: &mut dyn FnMut(),
) -> Result<Option<PlannedPath>, PlanError> {
    let two_plane_length = two_plane_length(start, goal, radius)?;
    let problem = PathProblem::from_poses(start, goal, radius);
    let mut found = Candidates::new();
    shortest::candidates(&problem, two_plane_length / radius, &mut found, keep_alive);
    let count = found.len() + 1;
    // The two-plane path is tried at its place in the order of lengths.
    let shorter = found.partition_point(|candidate| candidate.length() * radius < two_plane_length);
    for index in 0..count {
        keep_alive();
        let path = match index.cmp(&shorter) {
            Ordering::Equal => checked_two_plane(start, goal, radius),
            Ordering::Less => checked_candidate(found.get(index), start, goal, radius),
            Ordering::Greater => checked_candidate(found.get(index - 1), start, goal, radius),
        };
        // A candidate that does not reach the goal is skipped.
        if let Ok(path) = path
            && accept(&path)
        {
            return Ok(Some(PlannedPath { path, candidate_count: count, two_plane_length }));
        }
    }
    Ok(None)
}

/// Returns the length of the two-plane path from start to goal, mm.
#[inline(never)] // Keeps its stack frame out of the caller's.
pub(crate) fn two_plane_length(start: &Pose, goal: &Pose, radius: f64) -> Result<f64, PlanError> {
    checked_two_plane(start, goal, radius).map(|path| path::length(&path))
}

#[inline(never)]
fn checked_two_plane(start: &Pose, goal: &Pose, radius: f64) -> Result<Path, PlanError> {
    trim_and_check(two_plane(start, goal, radius)?, start, goal, radius)
}

#[inline(never)]
fn checked_candidate(
    candidate: Option<&PathCandidate>,
    start: &Pose,
    goal: &Pose,
    radius: f64,
) -> Result<Path, PlanError> {
    trim_and_check(candidate.ok_or(PlanError::NoPath)?.path(radius)?, start, goal, radius)
}

/// Returns the path, without segments that are only rounding errors, after a check that it ends at the goal. Returns an
/// error if it does not.
pub(crate) fn trim_and_check(path: Path, start: &Pose, goal: &Pose, radius: f64) -> Result<Path, PlanError> {
    let scale = ((goal.position() - start.position()).norm() / (100.0 * radius)).max(1.0);
    let within = |path: &Path, share: f64| {
        let error = goal_error(&path::end(path, &start.frame()), goal);
        (error.distance <= share * scale * radius && error.angle <= share * scale, error)
    };
    let short = path.filtered(|segment| segment.length() >= MIN_SEGMENT * radius);
    if short.len() < path.len() && within(&short, UNMOVED).0 {
        return Ok(short);
    }
    match within(&path, GOAL_TOLERANCE) {
        (true, _) => Ok(path),
        (false, GoalError { distance, angle }) => {
            Err(PlanError::GoalNotReached { distance, angle, limit: GOAL_TOLERANCE * scale * radius })
        }
    }
}

/// Length, layers, time and filament that a path needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Requirements {
    /// Arc length, mm.
    pub length: f64,
    /// Number of layers, if the path is sliced with [`crate::slicing::Slicing::Exact`].
    pub layers: usize,
    /// Time in which the robot lays the layers, s.
    pub duration: f64,
    /// Length of filament, mm.
    pub filament: f64,
}

/// Returns the length, layers, time and filament that a path needs on this robot.
pub fn requirements(path: &[Segment], robot: &Robot) -> Requirements {
    let layers = crate::slicing::layers(path, robot, crate::slicing::Slicing::Exact).size_hint().0;
    let length = path::length(path);
    Requirements {
        length,
        layers,
        duration: layers as f64 * robot.description().layer.period_s,
        filament: length * robot.filament_per_length(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn assert_plans(start: &Pose, goal: &Pose, radius: f64) -> Path {
        assert_plans_by(Planner::TwoPlane, start, goal, radius)
    }

    fn assert_plans_by(planner: Planner, start: &Pose, goal: &Pose, radius: f64) -> Path {
        let PlannedPath { path, two_plane_length, .. } = plan(&robot_a(), start, goal, radius, planner)
            .unwrap_or_else(|error| panic!("{start:?} to {goal:?}: {error}"));
        assert!(path::length(&path) <= two_plane_length * (1.0 + 1e-12));
        let error = goal_error(&path::end(&path, &start.frame()), goal);
        assert!(error.distance < 1e-6 && error.angle < 1e-8, "{start:?} to {goal:?}: {error:?}");
        path
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (-2000.0..2000.0, -2000.0..2000.0, -2000.0..2000.0, -180.0..180.0, -90.0..90.0)
            .prop_map(|(x, y, z, heading, pitch)| Pose::from_degrees([x, y, z, heading, pitch]).unwrap())
    }

    /// Generates angles, degrees, for directions that make planes degenerate, exactly or approximately.
    fn special_angle() -> impl Strategy<Value = f64> {
        let exact = prop::sample::select(std::vec![-180.0, -90.0, 0.0, 45.0, 90.0, 180.0]);
        let off = prop_oneof![Just(0.0), -15.0..-5.0];
        (exact, off, any::<bool>()).prop_map(|(angle, exponent, up)| {
            let off = if exponent == 0.0 { 0.0 } else { libm::pow(10.0, exponent) };
            if up { angle + off } else { angle - off }
        })
    }

    fn special_pose() -> impl Strategy<Value = Pose> {
        let coordinate = || prop_oneof![Just(0.0), Just(100.0), Just(-200.0), Just(4000.0), -1e-9..1e-9, -1e-3..1e-3];
        (coordinate(), coordinate(), coordinate(), special_angle(), special_angle()).prop_map(
            |(x, y, z, heading, pitch)| Pose::from_degrees([x, y, z, heading, pitch.clamp(-90.0, 90.0)]).unwrap(),
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        #[test]
        fn random_poses_are_reached(start in pose(), goal in pose()) {
            assert_plans(&start, &goal, 100.0);
        }

        #[test]
        fn random_poses_are_reached_by_the_shortest_planner(start in pose(), goal in pose()) {
            // Close goals take long, so the tests below use fewer of them.
            if (goal.position() - start.position()).norm() > 400.0 {
                assert_plans_by(Planner::Shortest, &start, &goal, 100.0);
            }
        }

        #[test]
        fn degenerate_poses_are_reached(start in special_pose(), goal in special_pose()) {
            assert_plans(&start, &goal, 100.0);
        }

        #[test]
        fn one_point_is_reached_in_any_direction(start in pose(), heading in special_angle(), pitch in -90.0..90.0) {
            let goal = Pose::new(start.position(), heading, pitch / 57.3).unwrap();
            assert_plans(&start, &goal, 98.2);
        }

        #[test]
        fn goals_nearly_ahead_are_reached(start in pose(), distance in 0.0..4000.0, exponent in -16.0..0.0, side in -1.0..1.0) {
            let off = libm::pow(10.0, exponent);
            let across = start.frame().rotation * Vector3::new(side, 1.0, 0.0) * off;
            let position = start.position() + start.direction() * distance + across;
            let goal = Pose::new(position, start.heading() + off, start.pitch()).unwrap();
            assert_plans(&start, &goal, 100.0);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn degenerate_poses_are_reached_by_the_shortest_planner(start in special_pose(), goal in special_pose()) {
            assert_plans_by(Planner::Shortest, &start, &goal, 100.0);
        }

        #[test]
        fn one_point_is_reached_in_any_direction_by_the_shortest_planner(start in pose(), heading in special_angle(), pitch in -90.0..90.0) {
            let goal = Pose::new(start.position(), heading, pitch / 57.3).unwrap();
            assert_plans_by(Planner::Shortest, &start, &goal, 98.2);
        }

        #[test]
        fn goals_nearly_ahead_are_reached_by_the_shortest_planner(start in pose(), distance in 0.0..4000.0, exponent in -16.0..0.0, side in -1.0..1.0) {
            let off = libm::pow(10.0, exponent);
            let across = start.frame().rotation * Vector3::new(side, 1.0, 0.0) * off;
            let position = start.position() + start.direction() * distance + across;
            let goal = Pose::new(position, start.heading() + off, start.pitch()).unwrap();
            assert_plans_by(Planner::Shortest, &start, &goal, 100.0);
        }
    }

    #[test]
    fn start_equal_to_goal_gives_zero_length() {
        let pose = Pose::from_degrees([1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert!(assert_plans(&pose, &pose, 100.0).is_empty());
    }

    #[test]
    fn a_goal_straight_ahead_gives_a_straight_line() {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let goal = Pose::from_degrees([0.0, 0.0, 500.0, 0.0, 90.0]).unwrap();
        assert!((path::length(&assert_plans(&start, &goal, 100.0)) - 500.0).abs() < 1e-9);
    }

    #[test]
    fn invalid_radii_are_refused_with_the_limit() {
        let pose = Pose::from_degrees([0.0; 5]).unwrap();
        let refused = |radius| plan(&robot_a(), &pose, &pose, radius, Planner::TwoPlane).unwrap_err();
        assert!(matches!(refused(98.1), PlanError::RadiusTooSmall { limit, .. } if (limit - 98.2).abs() < 1e-9));
        assert!(matches!(refused(f64::NAN), PlanError::RadiusTooLarge { .. }));
        assert!(matches!(refused(f64::INFINITY), PlanError::RadiusTooLarge { .. }));
        assert!(matches!(refused(-1.0), PlanError::RadiusTooSmall { .. }));
    }
}
