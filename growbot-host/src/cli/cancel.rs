//! `growbot cancel`: discards the body that the board stores.

use clap::Args;
use growbot_client::robot_command::RobotCommand;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Discard the body under way: heater and steppers go off, and the board forgets it
///
/// After a stop, a fault or a reset the board stores its data of an unfinished body, so that `growbot resume` can
/// continue it.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot cancel --port /dev/ttyACM0")]
pub struct CancelArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Runs the command.
pub fn run(args: &CancelArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    args.json.print(&port, &robot_at(&port, &args.robot)?.command(RobotCommand::Cancel)?)
}
