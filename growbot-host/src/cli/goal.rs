//! What is to be grown: a plan from a file, or one that is made for a goal.

use std::path::PathBuf;

use clap::Args;
use growbot_client::input::name_of;
use growbot_client::plan::Plan;
use growbot_client::plan_file;
use growbot_client::pose_text::{TypedGoal, parse_goal};
use growbot_core::robot::Robot;

use super::search::SearchArgs;
use super::{Failure, RobotArg};

/// The options that make a plan, and so have no place beside one.
const CONFLICTING: [&str; 7] = ["from", "via", "via_csv", "to", "planner", "radius", "clear_of_self"];

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

    /// Reads the plan, or makes it; the robot is its own.
    pub fn robot_and_plan(&self) -> Result<(Robot, Plan), Failure> {
        if let Some(path) = &self.plan {
            let (robot, plan) = plan_file::open(path, self.robot.as_deref())?;
            if self.robot.is_none() {
                growbot_host::detail!("robot {}, from: {}", robot.name(), name_of(path));
            }
            return Ok((robot, plan));
        }
        let robot = RobotArg { robot: self.robot.clone() }.load()?;
        let goal = self
            .to
            .as_ref()
            .ok_or_else(|| Failure::bad_input("there is nothing to grow: give a plan's file, or a goal with --to"))?;
        let plan = self.search.plan(&robot, goal, self.clear_of_self || self.search.planner.is_none())?;
        Ok((robot, plan))
    }
}
