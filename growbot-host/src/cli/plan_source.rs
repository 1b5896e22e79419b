//! The plan that a command grows: from a file, or made for a goal.

use std::path::PathBuf;

use clap::Args;
use growbot_plan::input::display_name;
use growbot_plan::plan::{Plan, PlanOptions};
use growbot_plan::plan_file::{self, LoadedPlan};
use growbot_plan::pose_text::{TypedGoal, parse_goal};
use growbot_plan::scene_planning::{self, MAX_LENGTH_MM, SceneCheckError};

use super::body_input::{BodyInput, refuse_pose};
use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::robot_arg::RobotArg;
use super::scene_options::{SceneArgs, plan_failure};
use super::search::PlanningOptions;

/// Options that make a plan, and so conflict with a plan from a file.
const CONFLICTING: [&str; 9] =
    ["from", "via", "via_csv", "to", "planner", "radius", "avoid_self_collision", "effort", "time_limit"];

/// A plan or a goal, and the robot.
#[derive(Args)]
pub struct PlanSourceArgs {
    /// The plan, as `growbot plan -o` writes it
    #[arg(value_name = "PLAN", conflicts_with_all = CONFLICTING)]
    plan: Option<PathBuf>,
    /// Goal pose X,Y,Z,HEADING,PITCH, or goal position X,Y,Z with any direction
    #[arg(long, value_name = "POSE", allow_hyphen_values = true, value_parser = parse_goal)]
    to: Option<TypedGoal>,
    #[command(flatten)]
    search: PlanningOptions,
    /// Take the shortest path that does not run into the body. This is the default without --planner. With --planner
    /// alone, the path is the shortest of all
    #[arg(long)]
    avoid_self_collision: bool,
    #[command(flatten)]
    scene: SceneArgs,
    /// The robot: a built-in name or a TOML file [default: the plan's, or without a plan GROWBOT_ROBOT, then
    /// growbot.toml, then growbot-a]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
}

impl PlanSourceArgs {
    /// Returns the name of the growth: that of the plan's file, or else the command.
    pub fn name(&self, command: &str) -> String {
        let file = self.plan.as_ref().and_then(|plan| plan.file_name());
        file.map_or_else(|| command.to_owned(), |file| file.to_string_lossy().into_owned())
    }

    /// Returns the absolute path of the plan's scene, for a program in another directory. `None` if the plan has no
    /// scene.
    pub fn place_of_scene(&self, plan: &Plan) -> Result<Option<String>, Failure> {
        let Some(scene) = &plan.scene else { return Ok(None) };
        let beside = self.plan.as_ref().and_then(|plan| plan.parent()).map(|parent| parent.join(&scene.file));
        let found = self.scene.scene.clone().or(beside.filter(|path| path.exists()));
        let path =
            std::path::absolute(found.unwrap_or_else(|| PathBuf::from(&scene.file))).map_err(Failure::bad_input)?;
        Ok(Some(path.display().to_string()))
    }

    /// Reads the plan from its file, or plans to the given goal. Robot and scene are those of the plan, unless others
    /// are given. The second value is the reason why the plan is not clear of the scene. It is `None` if it is clear,
    /// or without a scene.
    pub fn open(&self, format: ResultFormat) -> Result<(BodyInput, Option<SceneCheckError>), Failure> {
        let (loaded, clearance_error) = self.load(format)?;
        Ok((BodyInput::of_plan(loaded, self.scene.scene.as_deref()), clearance_error))
    }

    fn load(&self, format: ResultFormat) -> Result<(LoadedPlan, Option<SceneCheckError>), Failure> {
        let given = self.scene.scene.as_deref();
        if let Some(path) = &self.plan {
            refuse_pose(path)?;
            let LoadedPlan { robot, mut plan, scene } = plan_file::open_in_scene(path, self.robot.as_deref(), given)?;
            if self.robot.is_none() {
                growbot_host::detail!("robot {}, from: {}", robot.name(), display_name(path));
            }
            // Checked if the plan does not refer to the scene, or another margin is given.
            let (Some(file), true) = (given, scene.is_none() || self.scene.has_margin()) else {
                return Ok((LoadedPlan { robot, plan, scene }, None));
            };
            let loaded = self.scene.load(file)?;
            let file = file.display().to_string();
            let unclear = scene_planning::attach_scene(&mut plan, &robot, &file, &loaded).err();
            return Ok((LoadedPlan { robot, plan, scene: Some(loaded) }, unclear));
        }
        let robot = RobotArg { robot: self.robot.clone() }.load()?;
        let goal = self
            .to
            .as_ref()
            .ok_or_else(|| Failure::bad_input("there is nothing to grow: give a plan file, or a goal with --to"))?;
        if let Some(file) = given {
            let ends = self.search.start_and_goals(&robot, goal, None)?;
            let loaded = self.scene.load(file)?;
            let plan = self.scene.plan((file, &loaded), &robot, &ends, &self.search.search(&robot), MAX_LENGTH_MM);
            let plan = plan.map_err(|error| plan_failure(&error, format))?;
            return Ok((LoadedPlan { robot, plan, scene: Some(loaded) }, None));
        }
        let avoid_self_collision = self.avoid_self_collision || self.search.planner.is_none();
        let search = PlanOptions { avoid_self_collision, ..self.search.search(&robot) };
        let plan = self.search.plan(&robot, goal, &search)?;
        Ok((LoadedPlan { robot, plan, scene: None }, None))
    }
}
