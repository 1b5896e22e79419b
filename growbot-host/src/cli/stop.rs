//! `growbot stop`: switches heater and steppers off.

use clap::Args;
use growbot_client::robot_command::RobotCommand;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Stop the robot: heater and steppers off at once
///
/// A layer under way is interrupted. The board stores its data of the body. `growbot resume` resumes the body, and
/// `growbot cancel` discards it.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot stop --port /dev/ttyACM0")]
pub struct StopArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Runs the command.
pub fn run(args: &StopArgs) -> Result<(), Failure> {
    let port = args.port.resolve_for_stop()?;
    args.json.print(&port, &robot_at(&port, &args.robot)?.command(RobotCommand::Stop)?)
}
