//! Which goals a body of a given length reaches through a scene.
//!
//! Goals are spread evenly in the ball round the start. Each is planned to for itself, and has one of three answers: a
//! path, which is proven to be clear; none, with the reason; or none found with the effort that was allowed, which says
//! nothing.

use growbot_client::plan::{Goal, Search};
use growbot_client::through_scene::{self, NoPath, Through, ThroughError};
use growbot_core::path;
use growbot_core::pose::{Pose, Position};
use growbot_sim::parallel;
use nalgebra::Vector3;

use super::{POSITIONS, Question, in_ball, shortest_to};

/// Shells by which goals are counted: of fewer goals each, shares would tell little.
const BANDS: usize = 5;

/// What is known of a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// A body of this length, mm, leads there.
    Path(f64),
    /// It is farther than the body is long, even without obstacles.
    TooFar,
    /// It is in an obstacle, or too near to one.
    TooNear,
    /// Every way there is too narrow for the body.
    Separated,
    /// No path exists of arcs and lines of this length, mm.
    NoneAt(f64),
    /// The one path of the two-plane planner is not clear.
    NotClear,
    /// Nothing was found with this effort: there may be a path.
    NotFound,
}

/// A goal, and what is known of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// Where it is, in the base's frame, mm.
    pub position: Vector3<f64>,
    /// How far from the start, mm.
    pub distance: f64,
    /// The answer.
    pub known: Known,
}

/// How many goals have which answer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// A path.
    pub path: usize,
    /// None, whatever the reason.
    pub none: usize,
    /// None found.
    pub not_found: usize,
}

impl Counts {
    fn of<'a>(asked: impl IntoIterator<Item = &'a Asked>) -> Self {
        let mut counts = Self::default();
        for asked in asked {
            *match asked.known {
                Known::Path(_) => &mut counts.path,
                Known::NotFound => &mut counts.not_found,
                _ => &mut counts.none,
            } += 1;
        }
        counts
    }
}

/// The goals in a scene, with the answers.
#[derive(Debug, Clone, PartialEq)]
pub struct InScene {
    /// All goals.
    pub goals: Vec<Asked>,
    /// Radius of the ball that they are in, mm.
    pub length: f64,
}

impl InScene {
    /// How many have which answer.
    #[must_use]
    pub fn counts(&self) -> Counts {
        Counts::of(&self.goals)
    }

    /// How many of the goals without a path have this reason.
    #[must_use]
    pub fn because(&self, is_this: impl Fn(&Known) -> bool) -> usize {
        self.goals.iter().filter(|asked| is_this(&asked.known)).count()
    }

    /// The coarsest resolution at which there is no path to some goal: length of arcs and lines, mm.
    #[must_use]
    pub fn resolution(&self) -> Option<f64> {
        let steps = self.goals.iter().filter_map(|asked| match asked.known {
            Known::NoneAt(step) => Some(step),
            _ => None,
        });
        steps.max_by(f64::total_cmp)
    }

    /// Counts by distance: shells' outer radii, mm, and the goals in them.
    #[must_use]
    pub fn bands(&self) -> Vec<(f64, Counts)> {
        let to = |band: usize| self.length * band as f64 / BANDS as f64;
        let in_band = |band| self.goals.iter().filter(move |asked| (to(band)..to(band + 1)).contains(&asked.distance));
        (0..BANDS).map(|band| (to(band + 1), Counts::of(in_band(band)))).collect()
    }

    /// The volume of that share of the ball, and its standard error, mm^3.
    #[must_use]
    pub fn volume(&self, count: usize) -> (f64, f64) {
        let number = self.goals.len() as f64;
        let share = count as f64 / number;
        let ball = super::ball(self.length);
        (share * ball, libm::sqrt(share * (1.0 - share) / number) * ball)
    }
}

/// Plans to all goals. `at` hears how many are done, of how many.
///
/// # Errors
/// What is wrong with every goal: the radius, or a start that is too near to an obstacle.
pub fn in_scene(question: &Question, through: &Through, mut at: impl FnMut(u64, u64)) -> Result<InScene, ThroughError> {
    question.check()?;
    let goals: Vec<Vector3<f64>> = (0..POSITIONS).map(|index| in_ball(index) * question.length).collect();
    let answer = |goal: &Vector3<f64>| -> Result<Asked, ThroughError> {
        let position = question.position(*goal);
        Ok(Asked { position, distance: goal.norm(), known: question.known(through, *goal, position)? })
    };
    let answers = parallel::map(&goals, answer, |done| at(done as u64, POSITIONS as u64));
    Ok(InScene { goals: answers.into_iter().collect::<Result<_, _>>()?, length: question.length })
}

impl Question<'_> {
    /// What is known of a goal, which is given in the start's frame and in the base's.
    fn known(&self, through: &Through, of_start: Vector3<f64>, position: Vector3<f64>) -> Result<Known, ThroughError> {
        let (at_least, goal) = match self.direction {
            None => {
                let lateral = libm::hypot(of_start.x, of_start.y);
                (shortest_to(of_start.z, lateral, self.radius), Position::new(position).map(Goal::Position))
            }
            Some((heading, pitch)) => {
                (self.at_least(of_start, heading, pitch), Pose::new(position, heading, pitch).map(Goal::Pose))
            }
        };
        // What cannot be written down as a goal is beyond all that can be planned.
        let Some(goal) = goal.ok().filter(|_| at_least <= self.length * (1.0 + 1e-9)) else {
            return Ok(Known::TooFar);
        };
        let search = Search { radius: self.radius, planner: self.planner, clear_of_self: true };
        match through_scene::plan(self.robot, &self.start, &[goal], &search, through) {
            Ok(plan) => Ok(Known::Path(path::length(&plan.path))),
            Err(ThroughError::NoPath(start @ NoPath::Start { .. })) => Err(start.into()),
            Err(ThroughError::NoPath(no_path)) => Ok(match no_path {
                NoPath::TooFar { .. } => Known::TooFar,
                NoPath::Goal { .. } => Known::TooNear,
                NoPath::Separated { .. } => Known::Separated,
                NoPath::AtResolution { step, .. } => Known::NoneAt(step),
                NoPath::NotClear => Known::NotClear,
                NoPath::Start { .. } | NoPath::NotFound => Known::NotFound,
            }),
            // Nothing is said of a goal to which the planner of empty space has no path.
            Err(ThroughError::Plan(_)) => Ok(Known::NotFound),
        }
    }
}
