//! `growbot clear`: clears a fault or an emergency stop.

use clap::Args;
use growbot_client::robot_command::RobotCommand;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Clear a fault or an emergency stop, after which the robot accepts jobs again
///
/// Nothing heats or moves. First remove the cause, which `growbot status` shows. The board refuses while the cause
/// lasts, for example while its emergency-stop button is pressed.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot clear --port /dev/ttyACM0")]
pub struct ClearArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Runs the command.
pub fn run(args: &ClearArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    args.json.print(&port, &robot_at(&port, &args.robot)?.command(RobotCommand::ClearFault)?)
}
