//! What is to be grown: a plan from a file, or one that is made for a goal.

use std::path::PathBuf;

use clap::Args;
use growbot_client::input::name_of;
use growbot_client::plan::Plan;
use growbot_client::plan_file::{self, Opened};
use growbot_client::pose_text::{TypedGoal, parse_goal};
use growbot_client::through_scene::{self, UnclearError};
use growbot_core::robot::Robot;
use growbot_scene::scene_file::{self, LoadedScene};

use super::scene::SceneArgs;
use super::search::SearchArgs;
use super::{Failure, RobotArg};

/// The options that make a plan, and so have no place beside one.
const CONFLICTING: [&str; 9] =
    ["from", "via", "via_csv", "to", "planner", "radius", "clear_of_self", "effort", "time_limit"];

/// A plan or a goal, and the robot.
#[derive(Args)]
pub struct GoalArgs {
    /// The plan, as `growbot plan -o` writes it
    #[arg(value_name = "PLAN", conflicts_with_all = CONFLICTING)]
    plan: Option<PathBuf>,
    /// Where it is to arrive, and pointing where: X,Y,Z,HEADING,PITCH; pointing
    /// anywhere: X,Y,Z
    #[arg(long, value_name = "POSE", allow_hyphen_values = true, value_parser = parse_goal)]
    to: Option<TypedGoal>,
    #[command(flatten)]
    search: SearchArgs,
    /// Take the shortest path that does not run into the body; so it is without
    /// --planner, which alone gives the shortest path of all
    #[arg(long)]
    clear_of_self: bool,
    #[command(flatten)]
    scene: SceneArgs,
    /// The robot: a built-in name or a TOML file [default: the plan's; without a
    /// plan what GROWBOT_ROBOT or growbot.toml says, or else growbot-a]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
}

impl GoalArgs {
    /// How what is grown is called: by its file, where it has one, or by the command.
    pub fn name(&self, command: &str) -> String {
        let file = self.plan.as_ref().and_then(|plan| plan.file_name());
        file.map_or_else(|| command.to_owned(), |file| file.to_string_lossy().into_owned())
    }

    /// The whole path of the scene that a plan leads through, for a program that runs in another directory.
    pub fn place_of_scene(&self, plan: &Plan) -> Result<Option<String>, Failure> {
        let Some(scene) = &plan.scene else { return Ok(None) };
        let beside = self.plan.as_ref().and_then(|plan| plan.parent()).map(|parent| parent.join(&scene.file));
        let found = self.scene.scene.clone().or(beside.filter(|path| path.exists()));
        let path =
            std::path::absolute(found.unwrap_or_else(|| PathBuf::from(&scene.file))).map_err(Failure::bad_input)?;
        Ok(Some(path.display().to_string()))
    }

    /// How the scene is called: by the file that is given, or as the plan calls it.
    pub fn scene_file(&self, plan: &Plan) -> String {
        let given = self.scene.scene.as_ref().map(|file| file.display().to_string());
        given.or_else(|| plan.scene.as_ref().map(|scene| scene.file.clone())).unwrap_or_default()
    }

    /// Reads the plan, or makes it; the robot is its own, and the scene the one that it leads through, or that is given.
    pub fn open(&self, json: bool) -> Result<ToGrow, Failure> {
        let given = self.scene.scene.as_deref();
        if let Some(path) = &self.plan {
            let Opened { robot, mut plan, scene } = plan_file::open_in_scene(path, self.robot.as_deref(), given)?;
            if self.robot.is_none() {
                growbot_host::detail!("robot {}, from: {}", robot.name(), name_of(path));
            }
            let (Some(file), None) = (given, &scene) else {
                return Ok(ToGrow { robot, plan, scene, unclear: None });
            };
            // The plan knows nothing of the scene.
            let loaded = scene_file::load(file)?;
            let unclear = match through_scene::clear_in(&plan, &robot, &file.display().to_string(), &loaded) {
                Ok(clearance) => {
                    plan.scene = Some(clearance);
                    None
                }
                Err(unclear) => Some(unclear),
            };
            return Ok(ToGrow { robot, plan, scene: Some(loaded), unclear });
        }
        let robot = RobotArg { robot: self.robot.clone() }.load()?;
        let goal = self
            .to
            .as_ref()
            .ok_or_else(|| Failure::bad_input("there is nothing to grow: give a plan's file, or a goal with --to"))?;
        if let Some(file) = given {
            let ends = self.search.start_and_goals(&robot, goal)?;
            let loaded = scene_file::load(file)?;
            let plan =
                self.scene.plan_in((file, &loaded), &robot, &ends, &self.search.search(&robot, true), None, json)?;
            return Ok(ToGrow { robot, plan, scene: Some(loaded), unclear: None });
        }
        let plan = self.search.plan(&robot, goal, self.clear_of_self || self.search.planner.is_none())?;
        Ok(ToGrow { robot, plan, scene: None, unclear: None })
    }
}

/// What is to be grown.
pub struct ToGrow {
    pub robot: Robot,
    pub plan: Plan,
    /// What it grows among.
    pub scene: Option<LoadedScene>,
    /// Why the plan is not clear of that.
    pub unclear: Option<UnclearError>,
}
