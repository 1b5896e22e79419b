//! The planning problem: scene, start, goal and requirements of the body.

use nalgebra::Vector3;

use super::via_path::ViaPath;
use crate::centreline::TipPose;
use crate::clearance::RequiredClearance;
use crate::scene::Scene;

/// Goal of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlannerGoal {
    /// A position with any direction.
    Position {
        /// The position, mm.
        at: Vector3<f64>,
        /// Maximum distance from the position at which the body may end, mm.
        tolerance: f64,
    },
    /// A position with a direction.
    Pose(TipPose),
}

impl PlannerGoal {
    /// Returns the position, mm.
    pub fn position(&self) -> Vector3<f64> {
        match self {
            Self::Position { at, .. } => *at,
            Self::Pose(tip) => tip.position,
        }
    }
}

/// A planning problem: scene, start, goal and requirements of the body.
#[derive(Clone, Copy)]
pub struct PlanningProblem<'a> {
    /// The obstacles.
    pub scene: &'a Scene,
    /// Start of the body.
    pub start: TipPose,
    /// Goal of the body.
    pub goal: PlannerGoal,
    /// Minimum radius of bends, mm.
    pub radius: f64,
    /// Minimum distance of the centreline from the obstacles.
    pub required_clearance: RequiredClearance,
    /// Maximum length of the body, mm.
    pub max_length: f64,
    /// Further condition for a clear body, such as that it is clear of itself.
    pub accept: &'a dyn Fn(&ViaPath) -> bool,
}

impl PlanningProblem<'_> {
    /// Returns the maximum distance from the goal's position at which a body may end, mm.
    pub(super) fn tolerance(&self) -> f64 {
        match self.goal {
            PlannerGoal::Position { tolerance, .. } => tolerance,
            PlannerGoal::Pose(_) => 0.0,
        }
    }

    /// Reports whether a body that ends at this position has arrived within the tolerance of the goal.
    pub(super) fn is_at_goal(&self, position: &Vector3<f64>) -> bool {
        let tolerance = self.tolerance();
        tolerance > 0.0 && (position - self.goal.position()).norm() <= tolerance
    }
}
