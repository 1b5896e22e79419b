//! Goals that a body of a given length reaches through a scene.
//!
//! Goals are spread evenly in the ball around the start, and each one is planned for separately. There are three
//! results: a path that is proven clear, a proof that there is none, or no path found with the allowed effort. The
//! third result proves nothing.

use growbot_core::path;
use growbot_core::pose::{Pose, Position};
use nalgebra::Vector3;

use super::{POSITIONS, WorkspaceQuery, in_ball, shortest_to};
use crate::parallel;
use crate::plan::{Goal, PlanOptions};
use crate::scene_planning::{self, NoPathError, SceneOptions, ScenePlanError};

/// Number of spherical shells around the start by which goals are counted. With more shells, each would have too few
/// goals for a meaningful share.
const BANDS: usize = 5;

/// Result for a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reachability {
    /// A path exists, with a body of this length, mm.
    Reachable(f64),
    /// The goal needs a longer body, even without obstacles.
    TooFar,
    /// The goal is in an obstacle or too near to one.
    TooNear,
    /// Every way to the goal is too narrow for the body.
    Separated,
    /// No path exists that consists of arcs and lines of this length, mm.
    NoPathAtResolution(f64),
    /// The only path of the two-plane planner is not clear.
    NotClear,
    /// The search ended without a result. A path may exist.
    NotFound,
}

/// A goal with its result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalResult {
    /// Position in the base's frame, mm.
    pub position: Vector3<f64>,
    /// Distance from the start, mm.
    pub distance: f64,
    /// Result for the goal.
    pub reachability: Reachability,
}

/// Number of goals with each kind of result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GoalCounts {
    /// Goals with a path.
    pub reachable: usize,
    /// Goals that the body cannot reach, for one of the reasons of [`Reachability`].
    pub none: usize,
    /// Goals for which the search ended without a result.
    pub not_found: usize,
}

impl GoalCounts {
    fn of<'a>(goals: impl IntoIterator<Item = &'a GoalResult>) -> Self {
        let mut counts = Self::default();
        for goal in goals {
            *match goal.reachability {
                Reachability::Reachable(_) => &mut counts.reachable,
                Reachability::NotFound => &mut counts.not_found,
                _ => &mut counts.none,
            } += 1;
        }
        counts
    }
}

/// Results for all goals in a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneWorkspace {
    /// All goals.
    pub goals: Vec<GoalResult>,
    /// Radius of the ball that contains the goals, mm.
    pub length: f64,
}

impl SceneWorkspace {
    /// Counts the goals with each kind of result.
    pub fn counts(&self) -> GoalCounts {
        GoalCounts::of(&self.goals)
    }

    /// Counts the goals whose result satisfies `is_this`.
    pub fn because(&self, is_this: impl Fn(&Reachability) -> bool) -> usize {
        self.goals.iter().filter(|goal| is_this(&goal.reachability)).count()
    }

    /// Returns the coarsest resolution at which some goal has no path: the length of arcs and lines, mm. `None` without
    /// such a goal.
    pub fn resolution(&self) -> Option<f64> {
        let steps = self.goals.iter().filter_map(|goal| match goal.reachability {
            Reachability::NoPathAtResolution(step) => Some(step),
            _ => None,
        });
        steps.max_by(f64::total_cmp)
    }

    /// Returns the outer radius of each shell, mm, and the counts of the goals in the shell.
    pub fn bands(&self) -> Vec<(f64, GoalCounts)> {
        let to = |band: usize| self.length * band as f64 / BANDS as f64;
        let in_band = |band| self.goals.iter().filter(move |goal| (to(band)..to(band + 1)).contains(&goal.distance));
        (0..BANDS).map(|band| (to(band + 1), GoalCounts::of(in_band(band)))).collect()
    }

    /// Returns the estimated volume of the positions with a result that `count` of all goals have, and its standard
    /// error, mm^3.
    pub fn volume(&self, count: usize) -> (f64, f64) {
        let number = self.goals.len() as f64;
        let share = count as f64 / number;
        let ball = super::ball(self.length);
        (share * ball, libm::sqrt(share * (1.0 - share) / number) * ball)
    }
}

/// Plans to all goals. `at` receives the number of finished goals and the number of all goals.
///
/// # Errors
/// An error that concerns every goal: the radius is invalid, or the start is too near to an obstacle.
pub fn scene_workspace(
    question: &WorkspaceQuery,
    through: &SceneOptions,
    mut at: impl FnMut(u64, u64),
) -> Result<SceneWorkspace, ScenePlanError> {
    question.check()?;
    let goals: Vec<Vector3<f64>> = (0..POSITIONS).map(|index| in_ball(index) * question.length).collect();
    let answer = |goal: &Vector3<f64>| -> Result<GoalResult, ScenePlanError> {
        let position = question.position(*goal);
        Ok(GoalResult { position, distance: goal.norm(), reachability: question.known(through, *goal, position)? })
    };
    let answers = parallel::map(&goals, answer, |done| at(done as u64, POSITIONS as u64));
    Ok(SceneWorkspace { goals: answers.into_iter().collect::<Result<_, _>>()?, length: question.length })
}

impl WorkspaceQuery<'_> {
    /// Plans to one goal, and returns its result. The position of the goal is given in the start's frame (`of_start`)
    /// and in the base's frame (`position`), mm.
    fn known(
        &self,
        through: &SceneOptions,
        of_start: Vector3<f64>,
        position: Vector3<f64>,
    ) -> Result<Reachability, ScenePlanError> {
        let (at_least, goal) = match self.direction {
            None => {
                let lateral = libm::hypot(of_start.x, of_start.y);
                (shortest_to(of_start.z, lateral, self.radius), Position::new(position).map(Goal::Position))
            }
            Some((heading, pitch)) => {
                (self.at_least(of_start, heading, pitch), Pose::new(position, heading, pitch).map(Goal::Pose))
            }
        };
        // A position that is not valid as a goal is beyond all goals that can be planned for.
        let Some(goal) = goal.ok().filter(|_| at_least <= self.length * (1.0 + 1e-9)) else {
            return Ok(Reachability::TooFar);
        };
        let search =
            PlanOptions { radius: self.radius, planner: self.planner, avoid_self_collision: true, existing: None };
        match scene_planning::plan(self.robot, &self.start, &[goal], &search, through) {
            Ok(plan) => Ok(Reachability::Reachable(path::length(&plan.path))),
            Err(ScenePlanError::NoPath(start @ NoPathError::Start { .. })) => Err(start.into()),
            Err(ScenePlanError::NoPath(no_path)) => Ok(match no_path {
                NoPathError::TooFar { .. } => Reachability::TooFar,
                NoPathError::Goal { .. } => Reachability::TooNear,
                NoPathError::Separated { .. } => Reachability::Separated,
                NoPathError::AtResolution { step, .. } => Reachability::NoPathAtResolution(step),
                NoPathError::TwoPlaneBlocked => Reachability::NotClear,
                NoPathError::Start { .. } | NoPathError::NotFound => Reachability::NotFound,
            }),
            // A goal without a path in empty space counts as not found, because the planner's error proves nothing.
            Err(ScenePlanError::Plan(_)) => Ok(Reachability::NotFound),
        }
    }
}
