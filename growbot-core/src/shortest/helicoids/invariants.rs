//! The relative pose of start and goal, by which arcs of the table are chosen.

use nalgebra::Vector3;

use crate::shortest::problem::PathProblem;

/// Relative pose of start and goal, as numbers that do not depend on the roll. Problems that differ by a mirror image,
/// or by an exchange of start and goal, have the same numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Invariants {
    numbers: [f32; 5],
    /// True if the numbers are those of the mirror image of the problem.
    pub(super) mirrored: bool,
    /// True if the numbers are those of the problem with start and goal exchanged.
    pub(super) reversed: bool,
}

impl Invariants {
    /// Returns the invariants of a problem. The weights of the numbers were found by trial.
    pub(super) fn of(problem: &PathProblem) -> Self {
        let PathProblem { goal, direction, .. } = problem;
        let (along_start, along_goal) = (goal.z, goal.dot(direction));
        let side = Vector3::z().dot(&goal.cross(direction));
        let numbers = [
            along_start.max(along_goal),
            along_start.min(along_goal),
            1.3 * direction.z,
            0.7 * goal.norm(),
            0.7 * side.abs(),
        ];
        Self { numbers: numbers.map(|number| number as f32), mirrored: side < 0.0, reversed: along_start < along_goal }
    }

    /// Returns the square of the distance between these numbers and the numbers of another problem.
    pub(super) fn distance(&self, other: &[f32; 5]) -> f32 {
        self.numbers.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum()
    }
}
