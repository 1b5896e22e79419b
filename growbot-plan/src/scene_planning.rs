//! Planning of paths through a scene with obstacles. Each leg is proven to be clear of all obstacles, of itself and of
//! the earlier legs.

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use growbot_core::compact_number::CompactNumber;
use growbot_core::job::job_layers;
use growbot_core::layer_bytes::decode;
use growbot_core::path::{self, Segment};
use growbot_core::plan::{PlanError, Planner};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_scene::centreline::{TipPose, to_path_segments};
use growbot_scene::clearance::{Clearance, RequiredClearance};
use growbot_scene::path_clearance::{CLEARANCE_TOLERANCE_MM, clearance, clearance_until, is_path_clear, point_along};
use growbot_scene::planner::{
    self, InfeasibleReason, PlanningProblem, SearchBudget, SearchOutcome, SearchResolution, ViaPath,
};
use growbot_scene::scene_file::{LoadedScene, SceneError, load};

use crate::hexadecimal::format_hash;
use crate::margin::near_obstacle;
use crate::plan::{Goal, Plan, PlanOptions, PlannedLeg, SceneClearance, plan_where};
use crate::plan_file::json::SceneRefJson;
use crate::self_collision::closest_self_approach;
use crate::warning::NEAR_OBSTACLE;

/// Tolerance of the required clearance, as a fraction of it. A path whose clearance exceeds the required one by less
/// than this may be rejected.
const SLACK: f64 = 1e-3;
/// Maximum number of distance queries of a search for each unit of `--effort`. They take about 0.1 s.
const WORK_PER_EFFORT: u64 = 100_000;
/// Default effort of a search, in units of about 0.1 s.
pub const EFFORT: u64 = 5;
/// Additional time after the deadline of the search for computing the clearance of the plan, because the search may use
/// all of its time.
const GRACE: Duration = Duration::from_millis(200);
/// Default limit of the length of a body, mm.
pub const MAX_LENGTH_MM: f64 = 1e7;

/// Maximum distance between the path that [`laid`] returns and the layers in fixed point that a board receives, mm. It
/// is subtracted from each proven clearance. `tests/laid_centrelines.rs` measures it.
pub const MAX_LAYER_OFFSET_MM: f64 = 1e-4;

/// Maximum clearance that is reported, mm. It is also the clearance in an empty scene.
pub const MAX_CLEARANCE: f64 = 1e7;

/// A scene with obstacles, and the limits of the search for a path through it.
#[derive(Debug)]
pub struct SceneOptions<'a> {
    /// Name of the scene's file, which is written to the plan.
    pub file: &'a str,
    /// Obstacles of the scene, loaded from `file`.
    pub loaded: &'a LoadedScene,
    /// Minimum distance that a path must keep between the outside of the tube and all obstacles, mm. The default is
    /// [`planning_margin_mm`](crate::margin::planning_margin_mm).
    pub margin: f64,
    /// Maximum effort of the search, in units of 100,000 distance queries. Unlike a limit in time, it gives the same
    /// result on every machine.
    pub effort: u64,
    /// Time at which the search ends with the best path found so far. `None` without a limit in time.
    pub deadline: Option<Instant>,
    /// True to end the search at the first path that is found, instead of searching for a shorter one.
    pub first_only: bool,
    /// Maximum length of the body, mm: [`MAX_LENGTH_MM`] by default.
    pub max_length: f64,
}

/// Reason why no plan through a scene was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoPathError {
    /// The start is too near to an obstacle.
    #[error(
        "the start is {}, but the centreline needs {} mm (half the tube plus the margin): choose another start, or \
         lower the margin", place(.distance), CompactNumber(.need)
    )]
    Start {
        /// Distance of the start from the nearest obstacle, mm. Negative inside.
        distance: f64,
        /// Required distance of the centreline from obstacles, mm: half the tube's diameter plus the margin.
        need: f64,
    },
    /// The goal is too near to an obstacle.
    #[error(
        "the goal is {}, but the centreline needs {} mm (half the tube plus the margin): choose another goal, or lower \
         the margin", place(.distance), CompactNumber(.need)
    )]
    Goal {
        /// Distance of the goal from the nearest obstacle, mm. Negative inside.
        distance: f64,
        /// Required distance of the centreline from obstacles, mm: half the tube's diameter plus the margin.
        need: f64,
    },
    /// The straight line to the goal is longer than the remaining length of the body.
    #[error(
        "the goal is {} mm from the start of its leg, but only {} mm of the maximum length remain",
        CompactNumber(.distance), CompactNumber(.left)
    )]
    TooFar {
        /// Distance of the goal from the start of its leg, mm.
        distance: f64,
        /// Remaining length of the body at the start of the leg, mm: the maximum length less the earlier legs.
        left: f64,
    },
    /// Every passage between start and goal is too narrow for the tube and the margin.
    #[error(
        "no body can reach the goal: every passage between start and goal is narrower than the {} mm that the \
         centreline needs on each side; make a passage of the scene wider, or lower the margin",
        CompactNumber(.need)
    )]
    Separated {
        /// Required distance of the centreline from obstacles, mm: half the tube's diameter plus the margin.
        need: f64,
    },
    /// The search has tried all paths at its finest resolution, and none of them reaches the goal.
    #[error(
        "no path exists at the resolution of this search (arcs and lines of {} mm, bends in {rolls} directions, cells \
         of {} mm): give a smaller radius, or another goal", CompactNumber(.step), CompactNumber(.cell)
    )]
    AtResolution {
        /// Length of an arc or a line that the search appends to a path, mm.
        step: f64,
        /// Number of directions in which the search bends an arc.
        rolls: u32,
        /// Side of the cells into which the search divides positions, mm.
        cell: f64,
    },
    /// The only path of the two-plane planner is too near to an obstacle.
    #[error(
        "no path of the planner two-plane is clear of the scene and of the body itself within the maximum length, and \
         this planner does not search for others: use the planner shortest, which does"
    )]
    TwoPlaneBlocked,
    /// The search ended without a path because its effort or its time was used up.
    #[error("no path was found with this effort and time limit, but a path may exist")]
    NotFound,
}

/// Formats the distance of a point from the nearest obstacle (mm, negative inside) for an error message.
fn place(distance: &f64) -> String {
    if *distance < 0.0 {
        return format!("inside an obstacle, {} mm deep", CompactNumber(&-distance));
    }
    format!("{} mm from an obstacle", CompactNumber(distance))
}

impl NoPathError {
    /// Returns the code of the error in the output of `--json`.
    pub fn code(&self) -> &'static str {
        if *self == Self::NotFound { "not-found-in-time" } else { "none-at-resolution" }
    }

    fn because(why: InfeasibleReason, need: f64, left: f64) -> Self {
        match why {
            InfeasibleReason::GoalTooFar(distance) => Self::TooFar { distance, left },
            InfeasibleReason::StartTooClose(distance) => Self::Start { distance, need },
            InfeasibleReason::GoalTooClose(distance) => Self::Goal { distance, need },
            InfeasibleReason::Separated => Self::Separated { need },
        }
    }

    fn at(SearchResolution { step, bend_directions: rolls, position, .. }: SearchResolution) -> Self {
        Self::AtResolution { step, rolls, cell: position }
    }
}

/// Error of planning through a scene: no path was found, or a parameter is not valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenePlanError {
    /// A parameter is not valid, for example a radius to which the robot cannot bend.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No path through the scene was found.
    #[error("{0}")]
    NoPath(#[from] NoPathError),
}

/// Error of proving that a plan is clear of a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneCheckError {
    /// The scene cannot be read.
    #[error("the plan leads through a scene: {0}; put the scene file next to the plan")]
    Scene(#[from] SceneError),
    /// The scene's file is not the one for which the plan was made.
    #[error(
        "the plan was made for {file} with hash {plan}, but the file has hash {here}: the scene has changed; plan \
         again"
    )]
    OtherScene {
        /// Name of the scene's file.
        file: String,
        /// Hash of the scene, as stored in the plan.
        plan: String,
        /// Hash of the scene's file as it is now.
        here: String,
    },
    /// The body would come nearer to an obstacle than the scene's margin.
    #[error(
        "the plan would {} {obstacle} in {file}, {at:.0} mm along the body, but the margin is {margin} mm: plan \
         through the scene",
        describe_clearance(*found), margin = CompactNumber(margin)
    )]
    MarginViolated {
        /// Name of the scene's file.
        file: String,
        /// Proven clearance between the outside of the tube and the obstacles, mm. Negative inside an obstacle.
        found: f64,
        /// Margin that the scene requires, mm.
        margin: f64,
        /// Length of the body from its start to the nearest place, mm.
        at: f64,
        /// Name of the obstacle that is too near.
        obstacle: String,
    },
    /// The body would come nearer to an obstacle than the plan states.
    #[error(
        "the plan claims {claimed} mm of clearance in {file}, and {found} mm could be verified, less than it claims or \
         less than its margin: plan again"
    )]
    ClearanceOverstated {
        /// Name of the scene's file.
        file: String,
        /// Clearance that the plan states, mm.
        claimed: f64,
        /// Clearance that could be proven, mm.
        found: f64,
    },
}

/// Plans a path from the start through these goals, in order, that is clear of a scene. Each leg is the shortest
/// candidate of the planner for empty space that is clear, or otherwise the result of a search around the obstacles.
/// The direction at a position is the one in which the leg to it arrives.
///
/// # Errors
/// Like [`Plan::new`], and if no path through the scene is found.
pub fn plan(
    robot: &Robot,
    start: &Pose,
    goals: &[Goal],
    search: &PlanOptions,
    through: &SceneOptions,
) -> Result<Plan, ScenePlanError> {
    plan_while(robot, start, goals, search, through, &|| Ok(()))
}

/// Like [`plan`], but calls `check` before each leg. An error of `check` ends the planning.
///
/// # Errors
/// Like [`plan`], and the error of `check`.
pub fn plan_while<E: From<ScenePlanError>>(
    robot: &Robot,
    start: &Pose,
    goals: &[Goal],
    search: &PlanOptions,
    through: &SceneOptions,
    check: &dyn Fn() -> Result<(), E>,
) -> Result<Plan, E> {
    let existing_length = search.existing.map_or(0.0, |existing| path::length(existing.segments));
    let legs_left = Cell::new(goals.len() as u32);
    let leg = LegSearch { robot, search, through, existing_length, legs_left };
    let mut plan = Plan::by_legs(robot, start, goals, search, |from, goal, body, roll| {
        check()?;
        Ok::<_, E>(leg.plan(from, goal, body, roll)?)
    })?;
    let (file, hash) = (through.file.to_owned(), through.loaded.hash);
    // If the time runs out, report the clearance that was required of every leg.
    let proven = nearest_until(&plan, robot, through.loaded, through.deadline.map(|deadline| deadline + GRACE));
    let clearance = proven.map_or(through.margin + CLEARANCE_TOLERANCE_MM, |nearest| nearest.distance);
    plan.warnings.extend(near_obstacle(&plan, robot, through.loaded, clearance));
    plan.scene = Some(SceneClearance { file, hash, clearance, margin: through.margin });
    Ok(plan)
}

/// Returns the centreline of the body that is laid for a path, as segments. Layers of arcs and lines lie exactly on the
/// path. If the path contains a helicoidal arc, its layers are short arcs that deviate from it, so an arc for each
/// layer is returned.
pub fn laid(path: &[Segment], robot: &Robot) -> Vec<Segment> {
    if !path.iter().any(|segment| matches!(segment, Segment::Helicoid { .. })) {
        return path.to_vec();
    }
    let layers = job_layers(path, robot).map(|bytes| decode(&bytes));
    layers.map(|layer| Segment::from(&layer)).collect()
}

/// Returns the proven clearance between the outside of a plan's tube and a scene, mm. [`MAX_CLEARANCE`] in an empty
/// scene.
fn tube_clearance_mm(plan: &Plan, robot: &Robot, loaded: &LoadedScene) -> f64 {
    nearest(plan, robot, loaded).distance
}

/// Returns the proven clearance between the outside of a plan's tube and a scene (mm), and the length along the body at
/// which it is smallest (mm).
fn nearest(plan: &Plan, robot: &Robot, loaded: &LoadedScene) -> Clearance {
    of_outside(clearance(&loaded.scene, &laid(&plan.path, robot), &plan.start.frame()), robot)
}

/// Like [`nearest`], but returns `None` if the deadline passes first.
fn nearest_until(plan: &Plan, robot: &Robot, loaded: &LoadedScene, deadline: Option<Instant>) -> Option<Clearance> {
    let body = laid(&plan.path, robot);
    clearance_until(&loaded.scene, &body, &plan.start.frame(), deadline).map(|found| of_outside(found, robot))
}

/// Converts the clearance of a path's centreline to the clearance of the outside of the tube.
fn of_outside(Clearance { distance, arc_length: at }: Clearance, robot: &Robot) -> Clearance {
    Clearance {
        distance: (distance - 0.5 * robot.outer_diameter() - MAX_LAYER_OFFSET_MM).min(MAX_CLEARANCE),
        arc_length: at,
    }
}

/// Returns a verb phrase for messages, such as "come within 1.20 mm of", for a body with this clearance (mm, negative
/// inside). The name of the obstacle follows the phrase.
pub(crate) fn describe_clearance(clearance: f64) -> String {
    if clearance < 0.0 { format!("run {:.2} mm into", -clearance) } else { format!("come within {clearance:.2} mm of") }
}

/// Proves that a plan keeps the margin of a scene from all its obstacles, or touches none of them if the scene has no
/// margin. The plan need not have been made for the scene.
///
/// # Errors
/// If the plan does not keep the margin.
pub fn check_clearance(
    plan: &Plan,
    robot: &Robot,
    file: &str,
    loaded: &LoadedScene,
) -> Result<SceneClearance, SceneCheckError> {
    let Clearance { distance: found, arc_length: at } = nearest(plan, robot, loaded);
    let margin = loaded.margin.unwrap_or(0.0);
    // The proven clearance is below the true one by up to the tolerance.
    if found + CLEARANCE_TOLERANCE_MM >= margin {
        return Ok(SceneClearance { file: file.to_owned(), hash: loaded.hash, clearance: found, margin });
    }
    let obstacle = loaded
        .scene
        .nearest(&point_along(&plan.path, &plan.start.frame(), at))
        .map_or_else(String::new, |obstacle| obstacle.to_string());
    Err(SceneCheckError::MarginViolated { file: file.to_owned(), found, margin, at, obstacle })
}

/// Adds a scene to a plan that was made without it, if [`check_clearance`] proves that the plan is clear of it. The
/// plan gets a warning if the clearance is smaller than the expected deviation of the robot.
///
/// # Errors
/// If the plan is not clear of the scene. The plan is not changed then.
pub fn attach_scene(plan: &mut Plan, robot: &Robot, file: &str, loaded: &LoadedScene) -> Result<(), SceneCheckError> {
    let scene = check_clearance(plan, robot, file, loaded)?;
    plan.warnings.retain(|warning| warning.code != NEAR_OBSTACLE);
    plan.warnings.extend(near_obstacle(plan, robot, loaded, scene.clearance));
    plan.scene = Some(scene);
    Ok(())
}

/// Loads the scene of a plan and proves again that the plan is clear of it. The file is `given`, or else the one that
/// the plan names, relative to the directory `beside` of the plan or to the current directory.
///
/// # Errors
/// If the scene is missing or has changed, or the body is nearer to it than the plan states.
pub fn load_verified_scene(
    written: &SceneRefJson,
    plan: &Plan,
    robot: &Robot,
    beside: &Path,
    given: Option<&Path>,
) -> Result<(SceneClearance, LoadedScene), SceneCheckError> {
    let beside = beside.join(&written.file);
    let named = if beside.exists() { &beside } else { Path::new(&written.file) };
    let loaded = load(given.unwrap_or(named))?;
    let file = given.map_or_else(|| written.file.clone(), |given| given.display().to_string());
    let here = format_hash(loaded.hash);
    if here != written.hash {
        return Err(SceneCheckError::OtherScene { file, plan: written.hash.clone(), here });
    }
    let found = tube_clearance_mm(plan, robot, &loaded);
    let (claimed, margin) = (written.clearance_mm, written.margin_mm.or(loaded.margin).unwrap_or(0.0).max(0.0));
    // The clearance in the plan was computed by the same proof, to its tolerance. The comparison rejects NaN too.
    if claimed <= found + 2.0 * CLEARANCE_TOLERANCE_MM && found + CLEARANCE_TOLERANCE_MM >= margin {
        Ok((SceneClearance { file, hash: loaded.hash, clearance: claimed.min(found), margin }, loaded))
    } else {
        Err(SceneCheckError::ClearanceOverstated { file, claimed, found })
    }
}

/// Planner of the legs of one plan through a scene.
struct LegSearch<'a> {
    robot: &'a Robot,
    search: &'a PlanOptions<'a>,
    through: &'a SceneOptions<'a>,
    /// Length of the existing body, mm.
    existing_length: f64,
    /// Number of legs that are not planned yet, among which the remaining time is divided.
    legs_left: Cell<u32>,
}

impl LegSearch<'_> {
    /// Returns the clearance that the centreline must have. Twice the tolerance of the proof is added, because the
    /// clearance that is proven for the plan may be smaller than the true one.
    fn need(&self) -> RequiredClearance {
        let distance = 0.5 * self.robot.outer_diameter() + self.through.margin + 2.0 * CLEARANCE_TOLERANCE_MM;
        RequiredClearance { distance, tolerance: SLACK * distance }
    }

    /// Returns the deadline of the next leg, which gets an equal part of the remaining time, and counts this leg as
    /// planned.
    fn deadline(&self) -> Option<Instant> {
        let now = Instant::now();
        let legs = self.legs_left.replace(self.legs_left.get().saturating_sub(1)).max(1);
        self.through.deadline.map(|deadline| now + deadline.saturating_duration_since(now) / legs)
    }

    fn plan(&self, from: &Pose, goal: &Goal, body: &[Segment], roll: f64) -> Result<PlannedLeg, ScenePlanError> {
        let (scene, need) = (&self.through.loaded.scene, self.need());
        let before = path::length(body);
        let left = self.through.max_length - (before - self.existing_length);
        let is_clear_of_self = |path: &[Segment]| {
            let mut whole = body.to_vec();
            whole.extend(path.iter().map(|segment| segment.rolled(roll)));
            closest_self_approach(&whole, self.robot.outer_diameter(), before).is_none()
        };
        let base_from_start = from.frame();
        let mut passed_over = 0;
        let is_clear = |path: &[Segment]| {
            let clear = path::length(path) <= left
                && is_path_clear(scene, &laid(path, self.robot), &base_from_start, &need)
                && is_clear_of_self(path);
            passed_over += usize::from(!clear);
            clear
        };
        if let Some((goal, chosen)) = plan_where(self.robot, from, goal, self.search, is_clear)? {
            self.legs_left.set(self.legs_left.get().saturating_sub(1));
            return Ok(PlannedLeg::chosen(goal, &chosen, passed_over));
        }
        let accept = |chain: &ViaPath| is_clear_of_self(&to_path_segments(&chain.segments, &base_from_start));
        let problem = PlanningProblem {
            scene,
            start: TipPose::from(from),
            goal: match goal {
                Goal::Pose(pose) => planner::PlannerGoal::Pose(TipPose::from(pose)),
                Goal::Position(position) => planner::PlannerGoal::Position { at: position.vector(), tolerance: 0.0 },
            },
            radius: self.search.radius,
            required_clearance: need,
            max_length: left,
            accept: &accept,
        };
        if self.search.planner == Planner::TwoPlane {
            let why = planner::check_feasibility(&problem).map(|why| NoPathError::because(why, need.distance, left));
            return Err(why.unwrap_or(NoPathError::TwoPlaneBlocked).into());
        }
        let work = self.through.effort.saturating_mul(WORK_PER_EFFORT);
        let budget =
            SearchBudget { max_queries: work, deadline: self.deadline(), stop_at_first: self.through.first_only };
        match planner::search(&problem, &budget, &mut |_| ()) {
            SearchOutcome::Found(chain) => {
                let path = to_path_segments(&chain.segments, &base_from_start);
                let goal = arrival(goal, &path, &base_from_start);
                Ok(PlannedLeg { goal, path, choice: None })
            }
            SearchOutcome::Infeasible(why) => Err(NoPathError::because(why, need.distance, left).into()),
            SearchOutcome::ExhaustedAt(resolution) => Err(NoPathError::at(resolution).into()),
            SearchOutcome::BudgetExhausted => Err(NoPathError::NotFound.into()),
        }
    }
}

/// Returns the pose at the end of a path to this goal. For a position, its direction is that in which the path arrives.
fn arrival(goal: &Goal, path: &[Segment], base_from_start: &Frame) -> Pose {
    match goal {
        Goal::Pose(pose) => *pose,
        Goal::Position(position) => Pose::from_frame(&path::end(path, base_from_start)).at(position),
    }
}

#[cfg(test)]
mod tests;
