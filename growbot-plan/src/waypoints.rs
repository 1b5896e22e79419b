//! Planning from a start through waypoints to a goal, with a joint optimization of the directions at the waypoints, for
//! the shortest path through all of them.
//!
//! If the legs are planned one after the other, each leg arrives at its position in the direction that makes this leg
//! shortest, and the next leg has to start in that direction. This module minimises the total length of all legs over
//! the directions at all positions but the last. The direction at the last position has a closed form
//! ([`growbot_core::to_position`]). The total length is a smooth function of the directions as long as the path types
//! of the legs do not change.
//!
//! The method is that of Hooke and Jeeves 1961 ("Direct search" solution of numerical and statistical problems, J. ACM
//! 8), on spheres. A sweep turns the direction at one position after the other by a step to each of four sides, and
//! keeps the turn that makes the two adjacent legs shortest. If no turn makes them shorter, the step of this position
//! is halved. After a sweep, its total change of all directions is tried a second time, which speeds up the search
//! where several directions have to change together. The search ends when all steps are below 1e-4. The search is run
//! from three initial guesses: the directions of the plan leg by leg, those of a plan leg by leg from the goal back to
//! the start, and the bisectors of the polygon through the positions.
//!
//! In the search, legs are arcs and lines, or the two-plane path. Helicoidal arcs take hundreds of times as long to
//! find and are shorter only within 4 radii. The best of the three results is then planned again with helicoidal arcs,
//! and taken if it is shorter than the plan leg by leg. The result is therefore never longer than that plan.
//!
//! The length of a leg takes some 10 us to compute. For 8 positions, the search from one initial guess computes some
//! 2,500 legs (docs/measurements.md).

use growbot_core::path;
use growbot_core::plan::{PlanError, Planner};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_core::shortest::{Candidates, PathProblem, candidates};
use growbot_core::to_position::planar;
use growbot_core::trigonometry::hypot;
use growbot_core::two_plane::two_plane;
use nalgebra::Vector3;

use crate::plan::{Goal, Plan, PlanOptions};
use crate::warning::SELF_COLLISION;

/// Initial angle by which a direction is turned in a step, radians.
const FIRST_STEP: f64 = 0.3;
/// Angle of a step at which the search ends, radians. Near the shortest path, the length changes with the square of the
/// step: by 1e-8 radii for this step.
const MIN_STEP: f64 = 1e-4;
/// Minimum reduction of the length that counts as an improvement, in radii.
const NO_GAIN: f64 = 1e-9;
/// Maximum number of sweeps from one initial guess. Of 200 chains of 3 to 8 positions, half took 30 sweeps or fewer,
/// and none took more than 139.
const MAX_SWEEPS: usize = 200;

impl Plan {
    /// Plans the shortest path that the planner finds from a start to a goal. `radius` is the radius of the arcs, mm.
    ///
    /// ```
    /// use growbot_plan::{plan::Plan, pose_text::parse_pose, robot_file};
    /// use growbot_core::plan::Planner;
    /// let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    /// let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,0,77.4,0,90").unwrap());
    /// let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap();
    /// assert_eq!(plan.requirements.layers, 100);
    /// assert_eq!(plan.path_type(), "S");
    /// ```
    ///
    /// # Errors
    /// Like [`growbot_core::plan::plan`], mainly a radius to which the robot cannot bend.
    pub fn new(robot: &Robot, start: &Pose, goal: &Pose, radius: f64, planner: Planner) -> Result<Self, PlanError> {
        Self::through_waypoints(
            robot,
            start,
            &[],
            goal,
            &PlanOptions { radius, planner, avoid_self_collision: false, existing: None },
        )
    }

    /// Plans from the start through these poses or positions, in order, to the goal. Each leg starts where the previous
    /// leg ended.
    ///
    /// The directions at positions are chosen so that the whole path becomes as short as possible
    /// ([`crate::waypoints`]).
    ///
    /// With [`PlanOptions::avoid_self_collision`], each leg is the shortest candidate that collides neither with itself
    /// nor with the earlier legs. If all candidates collide, the leg is the shortest candidate, and the plan gets a
    /// warning.
    ///
    /// # Errors
    /// Like [`Plan::new`].
    pub fn through_waypoints<G: Copy + Into<Goal>>(
        robot: &Robot,
        start: &Pose,
        via: &[G],
        goal: &G,
        search: &PlanOptions,
    ) -> Result<Self, PlanError> {
        Self::through_waypoints_while(robot, start, via, goal, search, &|| Ok(()))
    }

    /// Like [`Plan::through_waypoints`], but calls `check` before each leg and each step of the search for directions.
    /// An error that `check` returns ends the planning.
    ///
    /// # Errors
    /// Like [`Plan::new`], and the error of `check`.
    pub fn through_waypoints_while<G: Copy + Into<Goal>, E: From<PlanError>>(
        robot: &Robot,
        start: &Pose,
        via: &[G],
        goal: &G,
        search: &PlanOptions,
        check: &dyn Fn() -> Result<(), E>,
    ) -> Result<Self, E> {
        let goals: Vec<Goal> = via.iter().chain([goal]).map(|goal| (*goal).into()).collect();
        let plan = Self::leg_by_leg(robot, start, &goals, search, check)?;
        let shorter = optimize_directions(&plan, robot, &goals, search, check)?;
        Ok(shorter.unwrap_or(plan))
    }
}

/// Returns a plan with the same goals that is shorter than `plan`, which was planned leg by leg. `None` if no shorter
/// plan is found. `check` is called regularly, and an error that it returns ends the search.
fn optimize_directions<E: From<PlanError>>(
    plan: &Plan,
    robot: &Robot,
    goals: &[Goal],
    search: &PlanOptions,
    check: &dyn Fn() -> Result<(), E>,
) -> Result<Option<Plan>, E> {
    if !goals.split_last().is_some_and(|(_, on_the_way)| on_the_way.iter().any(Goal::is_free)) {
        return Ok(None);
    }
    let chain = WaypointChain { start: plan.start, goals, search };
    let mut best: Option<(f64, Vec<Pose>)> = None;
    for poses in [plan.via(), chain.reversed(robot, check)?, chain.bisectors()] {
        let found = chain.refined(poses, check)?;
        if best.as_ref().is_none_or(|(length, _)| found.0 < *length) {
            best = Some(found);
        }
    }
    let poses = best.map(|(_, poses)| poses).unwrap_or_default();
    let directed: Vec<Goal> = poses.into_iter().map(Goal::Pose).chain(goals.last().copied()).collect();
    let planned = Plan::leg_by_leg(robot, &plan.start, &directed, search, check);
    check()?;
    let Ok(mut shorter) = planned else { return Ok(None) };
    shorter.free_directions.clone_from(&plan.free_directions);
    let runs_into_itself = |plan: &Plan| plan.warnings.iter().any(|warning| warning.code == SELF_COLLISION);
    let worse = search.avoid_self_collision && runs_into_itself(&shorter) && !runs_into_itself(plan);
    let is_shorter = shorter.requirements.length < plan.requirements.length - NO_GAIN * search.radius;
    Ok((!worse && is_shorter).then_some(shorter))
}

/// A start and a chain of goals, some of which are positions without a direction.
struct WaypointChain<'a> {
    start: Pose,
    goals: &'a [Goal],
    search: &'a PlanOptions<'a>,
}

impl WaypointChain<'_> {
    /// Returns the poses at the waypoints of a path that is planned leg by leg from the goal back to the start. If no
    /// path is found, returns the bisectors.
    fn reversed<E: From<PlanError>>(&self, robot: &Robot, check: &dyn Fn() -> Result<(), E>) -> Result<Vec<Pose>, E> {
        let Some((last, on_the_way)) = self.goals.split_last() else { return Ok(Vec::new()) };
        let before = on_the_way.last().map_or(self.start.position(), Goal::position);
        let end = match last {
            Goal::Pose(pose) => *pose,
            Goal::Position(_) => directed(last, &(last.position() - before)),
        };
        let goals: Vec<Goal> = on_the_way.iter().rev().map(turned_back_goal).collect();
        let search = PlanOptions { avoid_self_collision: false, existing: None, ..*self.search };
        let planned = Plan::leg_by_leg(robot, &turned_back(&end), &goals, &search, check);
        check()?;
        Ok(match planned {
            Ok(plan) => plan.legs.iter().rev().map(|leg| turned_back(&leg.goal)).collect(),
            // The bisectors are one of the three initial guesses anyway.
            Err(_) => self.bisectors(),
        })
    }

    /// Returns the poses at the waypoints. The direction at a position bisects the directions of the lines from the
    /// previous position and to the next.
    fn bisectors(&self) -> Vec<Pose> {
        let positions: Vec<Vector3<f64>> =
            [self.start.position()].into_iter().chain(self.goals.iter().map(Goal::position)).collect();
        let unit = |from: &Vector3<f64>, to: &Vector3<f64>| (to - from).try_normalize(0.0).unwrap_or_default();
        let bisector = |(goal, three): (&Goal, &[Vector3<f64>])| match three {
            [before, here, after] => directed(goal, &(unit(before, here) + unit(here, after))),
            _ => directed(goal, &Vector3::zeros()),
        };
        self.goals.iter().zip(positions.windows(3)).map(bisector).collect()
    }

    /// Optimizes the directions of these poses by repeated sweeps. Returns the total length of the path (mm) and the
    /// poses.
    fn refined<E>(&self, mut poses: Vec<Pose>, check: &dyn Fn() -> Result<(), E>) -> Result<(f64, Vec<Pose>), E> {
        let mut steps: Vec<f64> =
            self.goals.iter().zip(&poses).map(|(goal, _)| if goal.is_free() { FIRST_STEP } else { 0.0 }).collect();
        let mut length = self.length(&poses);
        for _ in 0..MAX_SWEEPS {
            if steps.iter().all(|step| *step < MIN_STEP) {
                break;
            }
            let before = poses.clone();
            for (index, step) in steps.iter_mut().enumerate().filter(|(_, step)| **step >= MIN_STEP) {
                check()?;
                if !self.step(&mut poses, index, *step) {
                    *step *= 0.5;
                }
            }
            let further: Vec<Pose> = before.iter().zip(&poses).map(|(before, after)| beyond(before, after)).collect();
            let (swept, beyond) = (self.length(&poses), self.length(&further));
            (length, poses) = if beyond < swept { (beyond, further) } else { (swept, poses) };
        }
        Ok((length, poses))
    }

    /// Turns the direction at the waypoint of this index by `step` radians to the best of four sides, if this makes the
    /// path shorter. Returns true if the direction was turned.
    fn step(&self, poses: &mut [Pose], index: usize, step: f64) -> bool {
        let Some(pose) = poses.get(index).copied() else { return false };
        let frame = pose.frame().rotation;
        let here = self.legs_at(poses, index);
        let mut best = (here - NO_GAIN * self.search.radius, pose);
        for (x, y) in [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)] {
            let turned = pointing(&pose, &(frame * Vector3::new(x, y, 1.0)));
            set(poses, index, turned);
            let length = self.legs_at(poses, index);
            if length < best.0 {
                best = (length, turned);
            }
        }
        set(poses, index, best.1);
        best.1 != pose
    }

    /// Returns the total length of the two legs that meet at the waypoint of this index, mm.
    fn legs_at(&self, poses: &[Pose], index: usize) -> f64 {
        self.leg(poses, index) + self.leg(poses, index + 1)
    }

    fn length(&self, poses: &[Pose]) -> f64 {
        (0..self.goals.len()).map(|index| self.leg(poses, index)).sum()
    }

    /// Returns the length of the leg to the goal of this index, mm.
    fn leg(&self, poses: &[Pose], index: usize) -> f64 {
        let from = index.checked_sub(1).map_or(&self.start, |before| poses.get(before).unwrap_or(&self.start));
        match (poses.get(index), self.goals.get(index)) {
            (Some(pose), _) | (None, Some(Goal::Pose(pose))) => leg_to_pose(from, pose, self.search),
            (None, Some(Goal::Position(position))) => leg_to_position(from, &position.vector(), self.search.radius),
            (None, None) => 0.0,
        }
    }
}

/// Returns the length of the shortest leg between two poses without helicoidal arcs, mm. Infinite if no path is found.
fn leg_to_pose(from: &Pose, to: &Pose, &PlanOptions { radius, planner, .. }: &PlanOptions) -> f64 {
    let by_two_planes = two_plane(from, to, radius).map_or(f64::INFINITY, |path| path::length(&path));
    if planner == Planner::TwoPlane {
        return by_two_planes;
    }
    let mut found = Candidates::new();
    candidates(&PathProblem::from_poses(from, to, radius), 0.0, &mut found, &mut || ());
    found.first().map_or(by_two_planes, |shortest| by_two_planes.min(shortest.length() * radius))
}

/// Returns the length of the shortest leg from a pose to a position, mm. Infinite if no path is found.
fn leg_to_position(from: &Pose, to: &Vector3<f64>, radius: f64) -> f64 {
    let goal = from.frame().rotation.inverse() * ((to - from.position()) / radius);
    planar(goal.z, hypot(goal.x, goal.y)).first().map_or(f64::INFINITY, |path| path.length() * radius)
}

fn set(poses: &mut [Pose], index: usize, pose: Pose) {
    if let Some(place) = poses.get_mut(index) {
        *place = pose;
    }
}

/// Returns the pose of a goal. A goal that is only a position gets this direction.
fn directed(goal: &Goal, direction: &Vector3<f64>) -> Pose {
    match goal {
        Goal::Pose(pose) => *pose,
        Goal::Position(position) => pointing(&Pose::from_frame(&Default::default()).at(position), direction),
    }
}

/// Returns a pose at the position of `pose` that points in this direction. If the direction is zero, returns `pose`.
fn pointing(pose: &Pose, direction: &Vector3<f64>) -> Pose {
    let heading = libm::atan2(direction.y, direction.x);
    let pitch = libm::atan2(direction.z, hypot(direction.x, direction.y));
    if *direction == Vector3::zeros() {
        return *pose;
    }
    Pose::new(pose.position(), heading, pitch).unwrap_or(*pose)
}

/// Returns the pose `after`, whose direction is turned further by the angle between the directions of `before` and
/// `after`.
fn beyond(before: &Pose, after: &Pose) -> Pose {
    if before == after {
        return *after;
    }
    let (from, to) = (before.direction(), after.direction());
    pointing(after, &(to * (2.0 * from.dot(&to)) - from))
}

/// Returns the pose at the same position with the opposite direction.
fn turned_back(pose: &Pose) -> Pose {
    pointing(pose, &-pose.direction())
}

fn turned_back_goal(goal: &Goal) -> Goal {
    match goal {
        Goal::Pose(pose) => Goal::Pose(turned_back(pose)),
        Goal::Position(_) => *goal,
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::time::Instant;

    use growbot_core::pose::Position;
    use growbot_core::random::Rng;

    use super::*;
    use crate::robot_file;

    const RADIUS: f64 = 100.0;
    const CHAINS: u64 = 200;

    fn robot() -> Robot {
        robot_file::load(robot_file::DEFAULT.as_ref()).unwrap()
    }

    fn search(planner: Planner) -> PlanOptions<'static> {
        PlanOptions { radius: RADIUS, planner, avoid_self_collision: false, existing: None }
    }

    fn up() -> Pose {
        Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap()
    }

    /// Returns `count` random positions, each 2 to 10 radii from the previous one in a random direction.
    fn chain(seed: u64, count: usize) -> Vec<Goal> {
        let mut random = Rng::new(&[2026, seed]);
        let mut at = Vector3::zeros();
        let mut next = || {
            at += random.direction() * (RADIUS * random.uniform_between(2.0, 10.0));
            Goal::Position(Position::new(at).unwrap())
        };
        (0..count).map(|_| next()).collect()
    }

    /// Returns two plans: one whose legs are planned one after the other, and one whose legs are planned jointly.
    fn plans(goals: &[Goal], planner: Planner) -> (Plan, Plan) {
        let (robot, search) = (robot(), search(planner));
        let (last, via) = goals.split_last().unwrap();
        let plan = |via: &[Goal], last: &Goal| Plan::through_waypoints(&robot, &up(), via, last, &search).unwrap();
        let by_legs = Plan::leg_by_leg::<PlanError>(&robot, &up(), goals, &search, &|| Ok(()));
        (by_legs.unwrap(), plan(via, last))
    }

    #[test]
    fn planning_ends_at_the_first_error_of_its_check() {
        let goals = chain(1, 4);
        let (last, via) = goals.split_last().unwrap();
        let calls = Cell::new(0_u32);
        let plan = |allowed: u32| {
            calls.set(0);
            let check = || {
                calls.set(calls.get() + 1);
                if calls.get() > allowed { Err(PlanError::NoPath) } else { Ok(()) }
            };
            Plan::through_waypoints_while(&robot(), &up(), via, last, &search(Planner::Shortest), &check)
        };
        assert!(plan(u32::MAX).is_ok());
        let all = calls.get();
        assert!(all > 100, "{all}: each leg and each step of the three searches");
        for allowed in 0..all {
            assert_eq!(plan(allowed), Err(PlanError::NoPath));
            // The check may be called once more after its first error, where a failed plan does not end the search.
            assert!(calls.get() <= allowed + 2, "{} {allowed}", calls.get());
        }
    }

    /// Compares the lengths of plans that are optimized jointly and leg by leg, and prints them as in
    /// docs/measurements.md.
    #[test]
    fn joint_optimization_is_never_worse_than_leg_by_leg() {
        let mut all: Vec<f64> = Vec::new();
        let mut slowest = 0.0_f64;
        for count in 3..=8 {
            let (mut gains, begun) = (Vec::new(), Instant::now());
            for seed in (0..CHAINS).filter(|seed| 3 + (seed % 6) as usize == count) {
                let goals = chain(seed, count);
                let since = Instant::now();
                let (separate, joint) = plans(&goals, Planner::Shortest);
                slowest = slowest.max(since.elapsed().as_secs_f64());
                assert!(joint.requirements.length <= separate.requirements.length, "chain {seed}");
                assert!(joint.legs.iter().zip(&goals).all(|(leg, goal)| leg.goal.position() == goal.position()));
                assert!(joint.free_directions.iter().all(|free| *free));
                gains.push(100.0 * (1.0 - joint.requirements.length / separate.requirements.length));
            }
            let time = begun.elapsed().as_secs_f64() / gains.len() as f64;
            println!("| {count} | {} | {:.0} ms |", row(&mut gains), 1e3 * time);
            all.append(&mut gains);
        }
        println!("| 3 to 8 | {} | max {:.0} ms |", row(&mut all), 1e3 * slowest);
        assert_eq!(all.len() as u64, CHAINS);
        // The mean was 7.6 %, so the choice of directions is worthwhile.
        assert!(all.iter().sum::<f64>() / all.len() as f64 > 5.0);
    }

    fn row(gains: &mut [f64]) -> String {
        gains.sort_by(f64::total_cmp);
        let mean = gains.iter().sum::<f64>() / gains.len() as f64;
        let (median, max) = (gains[gains.len() / 2], gains[gains.len() - 1]);
        format!("{} | {mean:.2} % | {median:.2} % | {max:.2} %", gains.len())
    }

    #[test]
    fn chosen_directions_beat_a_fine_grid() {
        let (robot, search) = (robot(), search(Planner::Shortest));
        for seed in 1000..1008 {
            let goals = chain(seed, 2);
            let (_, joint) = plans(&goals, Planner::Shortest);
            let mut random = Rng::new(&[seed]);
            for _ in 0..400 {
                let via = Goal::Pose(directed(&goals[0], &random.direction()));
                let other = Plan::through_waypoints(&robot, &up(), &[via], &goals[1], &search).unwrap();
                assert!(joint.requirements.length <= other.requirements.length + 1e-6, "chain {seed}: {via:?}");
            }
        }
    }

    #[test]
    fn given_directions_are_kept_and_others_are_chosen() {
        for planner in [Planner::Shortest, Planner::TwoPlane] {
            let mut goals = chain(7, 4);
            let kept = directed(&goals[1], &Vector3::new(1.0, 2.0, -3.0));
            goals[1] = Goal::Pose(kept);
            let end = directed(&goals[3], &Vector3::new(-1.0, 0.0, 1.0));
            goals[3] = Goal::Pose(end);
            let (separate, joint) = plans(&goals, planner);
            assert!(joint.requirements.length < separate.requirements.length);
            assert_eq!((joint.legs[1].goal, joint.goal), (kept, end));
            assert_eq!(joint.free_directions, [true, false, true, false]);
        }
    }

    #[test]
    fn collinear_and_coincident_positions_are_planned() {
        let at = |x: f64, z: f64| Goal::Position(Position::new(Vector3::new(x, 0.0, z)).unwrap());
        let (separate, joint) = plans(&[at(0.0, 300.0), at(0.0, 600.0), at(0.0, 900.0)], Planner::Shortest);
        assert_eq!((separate.requirements.length, joint.requirements.length), (900.0, 900.0));
        let (separate, joint) = plans(&[at(0.0, 0.0), at(0.0, 0.0), at(300.0, 0.0)], Planner::Shortest);
        assert!(joint.requirements.length <= separate.requirements.length);
    }
}
