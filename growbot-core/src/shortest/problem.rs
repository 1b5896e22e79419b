//! The problem of the shortest path, and the error that its solutions may have.

use nalgebra::Vector3;

use crate::pose::Pose;

/// Max error of a path at the goal, radii and radians, for goals within 100 radii. At larger distances it grows in
/// proportion. It is a tenth of the error that [`crate::plan`] accepts.
pub(super) const MAX_GOAL_ERROR: f64 = 1e-10;

/// The problem of the shortest path: the goal in the frame of the tip at the start.
#[derive(Debug, Clone, Copy)]
pub struct PathProblem {
    /// Position of the goal, radii.
    pub(super) goal: Vector3<f64>,
    /// Direction of growth at the goal, a unit vector.
    pub(super) direction: Vector3<f64>,
    /// Two unit vectors perpendicular to the goal's direction and to each other.
    pub(super) across: [Vector3<f64>; 2],
    /// Distance of the goal in units of 100 radii, at least 1. Tolerances of position are multiplied by it.
    pub(super) scale: f64,
}

impl PathProblem {
    /// Creates the problem of a path from a tip at the origin that grows along z, to this goal (radii) with this
    /// direction (a unit vector).
    pub fn new(goal: &Vector3<f64>, direction: &Vector3<f64>) -> Self {
        let e1 = any_perpendicular(direction);
        let e2 = direction.cross(&e1);
        Self { goal: *goal, direction: *direction, across: [e1, e2], scale: (0.01 * goal.norm()).max(1.0) }
    }

    /// Creates the problem of a path from a start pose to a goal pose, with arcs of this radius (mm).
    pub fn from_poses(start: &Pose, goal: &Pose, radius: f64) -> Self {
        let tip_from_base = start.frame().rotation.inverse();
        let offset = (goal.position() - start.position()) / radius;
        Self::new(&(tip_from_base * offset), &(tip_from_base * goal.direction()))
    }
}

/// Returns a unit vector perpendicular to a unit vector.
pub(super) fn any_perpendicular(axis: &Vector3<f64>) -> Vector3<f64> {
    let mut other = Vector3::zeros();
    if let Some(component) = other.get_mut(axis.iamin()) {
        *component = 1.0;
    }
    axis.cross(&other).normalize()
}
