//! Proof that obstacles separate start and goal for every body of the given width, however the body bends.
//!
//! Space is divided into cubes. A cube is blocked if its centre is so near to an obstacle that no point of the cube has
//! the required distance from this obstacle. If no sequence of free cubes with common faces joins start and goal, no
//! path exists. This is a proof, independent of the resolution. The opposite result proves nothing.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use nalgebra::Vector3;

use super::budget::BudgetTracker;
use super::problem::PlanningProblem;
use crate::bvh::Bounds;

/// Resolutions, tried one after another: the side of the cubes as a fraction of the required distance from obstacles,
/// and the maximum number of cubes that are examined. Half the diagonal of the largest cube is smaller than the
/// required distance, so that a layer of blocked cubes along a wall has no holes.
pub(super) const FINENESS: [(f64, usize); 3] = [(0.7, 1 << 18), (0.35, 1 << 20), (0.175, 1 << 21)];

/// Result of flooding the free cubes from start and goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Flood {
    /// No path exists.
    Separated,
    /// A path may exist.
    Joined,
    /// The budget is used up, or there are too many cubes.
    Unknown,
}

/// Checks whether obstacles separate start and goal, with a grid of one of the resolutions of [`FINENESS`].
pub(super) fn separated(
    problem: &PlanningProblem,
    (share, max_cubes): (f64, usize),
    meter: &mut BudgetTracker,
) -> Flood {
    VoxelGrid::new(problem, share * problem.required_clearance.distance).flood(problem, max_cubes, meter)
}

/// A grid of cubes that contains the start, the goal and all obstacles except half spaces. A cube that no body of the
/// maximum length can pass counts as blocked.
struct VoxelGrid {
    side: f64,
    origin: Vector3<f64>,
    /// Index of the last cube along each axis. The first one is 0.
    last: [i32; 3],
}

type Cube = [i32; 3];

impl VoxelGrid {
    fn new(problem: &PlanningProblem, side: f64) -> Self {
        let goal = Bounds::of(&[problem.goal.position()]).inflated(problem.tolerance());
        let ends = Bounds::of(&[problem.start.position]).with(&goal);
        // Beyond all obstacles a body can go round.
        let bounds = problem.scene.bounds().with(&ends).inflated(problem.required_clearance.distance + 3.0 * side);
        let size = (bounds.max - bounds.min) / side;
        let last = [size.x, size.y, size.z].map(|count| count.ceil().min(f64::from(i32::MAX / 2)) as i32);
        Self { side, origin: bounds.min, last }
    }

    fn cube(&self, point: &Vector3<f64>) -> Cube {
        let at = (point - self.origin) / self.side;
        [at.x, at.y, at.z].map(|at| at.floor() as i32)
    }

    fn is_open(&self, problem: &PlanningProblem, cube: &Cube, meter: &mut BudgetTracker) -> bool {
        if cube.iter().zip(&self.last).any(|(at, last)| *at < 0 || at > last) {
            return false;
        }
        let centre = self.origin + Vector3::from(cube.map(|at| f64::from(at) + 0.5)) * self.side;
        let half_diagonal = 0.5 * 3.0_f64.sqrt() * self.side;
        let (start, goal) = (problem.start.position, problem.goal.position());
        let at_least = (centre - start).norm() + (centre - goal).norm() - 2.0 * half_diagonal - problem.tolerance();
        if at_least > problem.max_length {
            return false;
        }
        meter.work.0 += 1;
        let enough = problem.required_clearance.distance - half_diagonal;
        problem.scene.distance_within(&centre, enough) >= enough
    }

    /// Returns the cubes in which a body may end: the goal's cube or, if the goal has a tolerance, the free cubes
    /// within the tolerance. Returns `None` if there are more than `max_cubes`.
    fn at_goal(&self, problem: &PlanningProblem, max_cubes: usize, meter: &mut BudgetTracker) -> Option<Vec<Cube>> {
        let (goal, tolerance) = (problem.goal.position(), problem.tolerance());
        let centre = self.cube(&goal);
        if tolerance <= 0.0 {
            return Some(vec![centre]);
        }
        let beside = Vector3::repeat(tolerance);
        let (from, to) = (self.cube(&(goal - beside)), self.cube(&(goal + beside)));
        let count = from.iter().zip(&to).map(|(from, to)| f64::from(to - from) + 1.0).product::<f64>();
        if count > max_cubes as f64 {
            return None;
        }
        let mut cubes = Vec::new();
        for x in from[0]..=to[0] {
            for y in from[1]..=to[1] {
                for z in from[2]..=to[2] {
                    if self.is_open(problem, &[x, y, z], meter) {
                        cubes.push([x, y, z]);
                    }
                }
            }
        }
        Some(cubes)
    }

    /// Floods the free cubes alternately from the start and from the goal, each flood towards the other. If one flood
    /// cannot grow any more before the two meet, start and goal are separated.
    fn flood(&self, problem: &PlanningProblem, max_cubes: usize, meter: &mut BudgetTracker) -> Flood {
        let ends = [self.cube(&problem.start.position), self.cube(&problem.goal.position())];
        let Some(at_goal) = self.at_goal(problem, max_cubes, meter) else { return Flood::Unknown };
        if at_goal.contains(&ends[0]) {
            return Flood::Joined;
        }
        let begun = [vec![ends[0]], at_goal];
        let mut reached = begun.clone().map(|cubes| cubes.into_iter().collect::<HashSet<_>>());
        let mut fronts = begun.map(|cubes| cubes.into_iter().map(|cube| (Reverse(0), cube)).collect::<BinaryHeap<_>>());
        loop {
            for side in 0..2 {
                let Some((_, cube)) = fronts[side].pop() else { return Flood::Separated };
                for (axis, step) in [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)] {
                    let mut next = cube;
                    next[axis] += step;
                    if reached[1 - side].contains(&next) {
                        return Flood::Joined;
                    }
                    if !reached[side].contains(&next) && self.is_open(problem, &next, meter) {
                        reached[side].insert(next);
                        fronts[side].push((Reverse(apart(&next, &ends[1 - side])), next));
                    }
                }
            }
            if meter.check_exhausted() || reached[0].len() + reached[1].len() > max_cubes {
                return Flood::Unknown;
            }
        }
    }
}

/// Returns the square of the distance between two cubes, in units of a cube's side.
fn apart(a: &Cube, b: &Cube) -> i64 {
    a.iter().zip(b).map(|(a, b)| (i64::from(*a) - i64::from(*b)).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centreline::TipPose;
    use crate::clearance::RequiredClearance;
    use crate::planner::problem::PlannerGoal;
    use crate::scene::Scene;
    use crate::shapes::Shape;

    #[test]
    fn walls_within_the_goal_tolerance_do_not_separate_the_goal() {
        let walls = (0..6).map(|side| {
            let (mut centre, mut half) = (Vector3::new(0.0, 0.0, 500.0), Vector3::repeat(100.0));
            centre[side / 2] += if side % 2 == 0 { 95.0 } else { -95.0 };
            half[side / 2] = 5.0;
            Shape::Box { centre, half_extents: half, rotation: nalgebra::Rotation3::identity() }
        });
        let scene = Scene::new(walls.collect(), vec![], vec![], vec![]);
        for (tolerance, expected) in [(0.0, Flood::Separated), (50.0, Flood::Separated), (200.0, Flood::Joined)] {
            let problem = PlanningProblem {
                scene: &scene,
                start: TipPose { position: Vector3::zeros(), direction: Vector3::z() },
                goal: PlannerGoal::Position { at: Vector3::new(0.0, 0.0, 500.0), tolerance },
                radius: 100.0,
                required_clearance: RequiredClearance { distance: 20.0, tolerance: 0.02 },
                max_length: 1000.0,
                accept: &|_| true,
            };
            let mut meter = BudgetTracker::new(u64::MAX, None);
            assert_eq!(separated(&problem, FINENESS[0], &mut meter), expected, "{tolerance} mm");
        }
    }
}
