//! Planning of the path of a request for a job or a plan.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use growbot_client::growth::GrowthRefusal;
use growbot_core::hash::Hasher;
use growbot_core::job::MAX_JOB_LAYERS;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::margin::planning_margin_mm;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::plan_file::{self, LoadedPlan};
use growbot_plan::pose_text::{parse_goal, parse_pose};
use growbot_plan::sanitize::json_line;
use growbot_plan::scene_planning::{self, EFFORT, MAX_LENGTH_MM, SceneOptions};
use growbot_remote::api::GrowRequest;
use growbot_scene::scene_file::{LoadedScene, MAX_LENGTH, load};
use serde::Deserialize;
use serde_json::value::RawValue;

use super::access::Access;
use super::audit::CommandSource;
use super::last_tip::TIP_OF_JOB;
use super::limits::Computation;
use super::paths::ServicePaths;
use super::problem::Problem;
use super::scene_store;

/// Maximum number of waypoints in a request. Planning a path with this number takes some seconds.
const MAX_VIA: usize = 100;
/// Maximum length of the name of a job, characters.
const MAX_NAME: usize = 512;

/// The fields of a plan in JSON that are needed before the whole plan is parsed and checked.
#[derive(Default, Deserialize)]
struct PlanOutline {
    layers: Option<u64>,
    scene: Option<SceneOutline>,
}

#[derive(Deserialize)]
struct SceneOutline {
    file: Option<String>,
}

/// Returns the name under which the service has stored the scene of a plan in JSON. `None` if the plan names none.
pub fn scene_of_plan(plan: &RawValue) -> Option<String> {
    let file = PlanOutline::of(plan).scene?.file?;
    file.rsplit('/').next().map(str::to_owned)
}

impl PlanOutline {
    /// Reads the outline of a plan in JSON. All fields are `None` if the plan cannot be read.
    fn of(plan: &RawValue) -> Self {
        serde_json::from_str(plan.get()).unwrap_or_default()
    }
}

/// A plan, and the scene that it was planned in or checked against.
pub struct PlanInScene {
    /// The plan.
    pub plan: Plan,
    /// The scene. `None` if neither the request nor the plan names a scene.
    pub scene: Option<LoadedScene>,
}

/// Returns the hash of the request, by which a repetition with the same idempotency key is recognised.
pub fn request_hash(request: &GrowRequest) -> String {
    let mut hasher = Hasher::default();
    hasher.write_bytes(json_line(request).as_bytes());
    format!("{:016x}", hasher.finish())
}

/// Returns the plan that the request contains, or plans a path to the goal of the request. `robot` is the robot that
/// will grow the plan. `last_body` returns the last body of the robot, which a job has grown.
pub fn resolve_request(
    request: &GrowRequest,
    robot: &Robot,
    last_body: &dyn Fn(&str) -> Result<Arc<ContinuedBody>, Problem>,
    places: &ServicePaths,
    access: Access,
    computation: &Computation,
) -> Result<PlanInScene, Problem> {
    check_limits(request)?;
    let scene = scene_file(request, places, access)?;
    if let (Some(margin), None) = (request.margin_mm, &scene) {
        return Err(Problem::bad(format!(
            "\"margin_mm\" is {margin} mm, but the request has no scene: name it in \"scene\", or remove the margin"
        )));
    }
    let resolved = match (&request.plan, &request.to) {
        (Some(_), Some(_)) => {
            return Err(Problem::bad("the request has both \"plan\" and \"to\": remove one of them"));
        }
        (None, None) => {
            return Err(Problem::bad("the request has neither \"plan\" nor \"to\": give one of them"));
        }
        (Some(plan), None) => given(request, plan, robot, scene.as_deref())?,
        (None, Some(goal)) => {
            let job = request.from.as_deref().and_then(|from| from.strip_prefix(TIP_OF_JOB));
            let existing = job.map(last_body).transpose()?;
            let planned = to_goal(request, goal, robot, existing.as_deref(), scene.as_deref(), computation)?;
            let layers = existing.map(|body| body.layers.clone()).unwrap_or_default();
            PlanInScene { plan: planned.plan.after_layers(layers, robot), ..planned }
        }
    };
    ensure_storable(resolved.plan.requirements.layers as u64)?;
    computation.check()?;
    Ok(resolved)
}

/// Returns an error if the request has too many waypoints, the name of the job is too long, or the margin is too large
/// or negative.
fn check_limits(request: &GrowRequest) -> Result<(), Problem> {
    let via = request.via.len();
    if via > MAX_VIA {
        return Err(Problem::bad(format!("\"via\" has {via} waypoints: give at most {MAX_VIA}")));
    }
    let name = request.name.as_ref().map_or(0, |name| name.chars().count());
    if name > MAX_NAME {
        return Err(Problem::bad(format!("\"name\" has {name} characters: give at most {MAX_NAME}")));
    }
    if let Some(margin) = request.margin_mm.filter(|margin| !(0.0..=MAX_LENGTH).contains(margin)) {
        return Err(Problem::bad(format!("\"margin_mm\" is {margin} mm: give 0 to {MAX_LENGTH} mm")));
    }
    Ok(())
}

/// Returns the path of the scene's file. `None` if neither the request nor its plan names a scene. Only growbot's
/// commands on this machine can name a file that the service has not stored.
fn scene_file(request: &GrowRequest, places: &ServicePaths, access: Access) -> Result<Option<PathBuf>, Problem> {
    let named_by_plan = || PlanOutline::of(request.plan.as_deref()?).scene?.file;
    let Some(name) = request.scene.clone().or_else(named_by_plan) else { return Ok(None) };
    if access == Access::Control(CommandSource::Socket) && Path::new(&name).is_absolute() {
        return Ok(Some(PathBuf::from(name)));
    }
    scene_store::find(places, &name).map(Some)
}

/// Loads a scene from this file. The margin of the request, if there is one, replaces that of the scene.
fn load_scene(request: &GrowRequest, file: &Path) -> Result<LoadedScene, Problem> {
    let loaded = load(file).map_err(Problem::bad)?;
    Ok(LoadedScene { margin: request.margin_mm.or(loaded.margin), ..loaded })
}

fn given(request: &GrowRequest, plan: &RawValue, robot: &Robot, scene: Option<&Path>) -> Result<PlanInScene, Problem> {
    ensure_storable_plan(plan)?;
    let opened = plan_file::read_in_scene(plan.get(), "the plan", None, scene);
    let LoadedPlan { robot: of, mut plan, scene: within } = opened.map_err(Problem::bad)?;
    if of.hash() != robot.hash() {
        return Err(Problem::conflict(format!(
            "the plan is for {} ({:016x}), but the robot is {} ({:016x}): plan for that robot",
            of.name(),
            of.hash(),
            robot.name(),
            robot.hash()
        )));
    }
    let (Some(file), true) = (scene, within.is_none() || request.margin_mm.is_some()) else {
        return Ok(PlanInScene { plan, scene: within });
    };
    // The plan was made without the scene, or for another margin.
    let loaded = load_scene(request, file)?;
    match scene_planning::attach_scene(&mut plan, robot, &file.display().to_string(), &loaded) {
        Ok(()) => {}
        Err(_) if request.ignore_scene => {}
        Err(unclear) => {
            let detail = format!("{unclear}; or set \"ignore_scene\" to grow without checking the scene");
            let code = Some(GrowthRefusal::Scene(&unclear).code());
            return Err(Problem { code, ..Problem::bad(detail) });
        }
    }
    Ok(PlanInScene { plan, scene: Some(loaded) })
}

fn to_goal(
    request: &GrowRequest,
    goal: &str,
    robot: &Robot,
    existing: Option<&ContinuedBody>,
    scene: Option<&Path>,
    computation: &Computation,
) -> Result<PlanInScene, Problem> {
    let goal = parse_goal(goal).map_err(Problem::bad)?.goal;
    let start = match existing {
        Some(body) => body.tip(),
        None => parse_pose(request.from.as_deref().unwrap_or("0,0,0,0,90")).map_err(Problem::bad)?,
    };
    let waypoint = |(index, via): (usize, &String)| match parse_goal(via) {
        Ok(typed) => Ok(typed.goal),
        Err(error) => Err(Problem::bad(format!("waypoint {}: {error}", index + 1))),
    };
    let via = request.via.iter().enumerate().map(waypoint).collect::<Result<Vec<_>, _>>()?;
    let goals: Vec<Goal> = via.iter().copied().chain([goal]).collect();
    ensure_storable(min_layers(robot, &start, &goals))?;
    let search = PlanOptions {
        radius: request.radius_mm.unwrap_or(robot.description().planning_radius_mm),
        planner: Planner::Shortest,
        avoid_self_collision: true,
        existing: existing.map(ContinuedBody::existing),
    };
    let Some(file) = scene else {
        let check = || computation.check();
        let plan = Plan::through_waypoints_while(robot, &start, &via, &goal, &search, &check)?;
        return Ok(PlanInScene { plan, scene: None });
    };
    let loaded = load_scene(request, file)?;
    let through = SceneOptions {
        file: &file.display().to_string(),
        loaded: &loaded,
        margin: planning_margin_mm(robot, &loaded),
        effort: EFFORT,
        deadline: Some(computation.deadline()),
        max_length: MAX_LENGTH_MM,
        first_only: false,
    };
    let check = || computation.check();
    let plan = scene_planning::plan_while(robot, &start, &goals, &search, &through, &check)?;
    Ok(PlanInScene { plan, scene: Some(loaded) })
}

/// Returns an error if no board can store a plan in JSON. A plan whose number of layers does not match its segments is
/// refused before its clearance is proven.
pub fn ensure_storable_plan(plan: &RawValue) -> Result<(), Problem> {
    ensure_storable(PlanOutline::of(plan).layers.unwrap_or(0))
}

/// Returns an error if no board can store a job of this many layers.
fn ensure_storable(layers: u64) -> Result<(), Problem> {
    if layers <= u64::from(MAX_JOB_LAYERS) {
        return Ok(());
    }
    Err(Problem::conflict(format!(
        "the plan needs at least {layers} layers, but a board can store {MAX_JOB_LAYERS}: plan a shorter body, or use \
         a robot with higher layers"
    )))
}

/// Returns a lower bound of the number of layers of a path through these goals: the number for straight lines with
/// layers of the greatest height.
fn min_layers(robot: &Robot, start: &Pose, goals: &[Goal]) -> u64 {
    let positions: Vec<_> = [start.position()].into_iter().chain(goals.iter().map(Goal::position)).collect();
    let length: f64 = positions.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    (length / robot.description().layer.height_max_mm) as u64
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use growbot_plan::robot_file;

    use super::*;

    /// The planning of such a body would end at its first check, because the client has gone.
    #[test]
    fn a_body_that_no_board_can_store_is_not_planned() {
        let directory = tempfile::tempdir().unwrap();
        let places = ServicePaths::in_dir(directory.path().to_path_buf());
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let computation = Computation::new(&Arc::new(AtomicBool::new(true)));
        let no_body = |_: &str| unreachable!();
        let detail_of = |goal: &str| {
            let request = GrowRequest { to: Some(goal.to_owned()), ..GrowRequest::default() };
            let resolved = resolve_request(&request, &robot, &no_body, &places, Access::View, &computation);
            resolved.err().map(|problem| problem.detail).unwrap_or_default()
        };
        assert!(detail_of("0,0,8000,0,90").contains("layers, but a board can store"));
        assert!(detail_of("0,0,400,0,90").contains("has closed the connection"));
    }
}
