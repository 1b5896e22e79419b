//! `growbot clear`: clears a fault or an emergency stop.

use clap::Args;
use growbot_host::output::print;

use super::failure::Failure;
use super::find_robot::robot_at;
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
}

/// Runs the command.
pub fn run(args: &ClearArgs) -> Result<(), Failure> {
    Ok(print(&robot_at(&args.port.resolve()?, &args.robot)?.clear()?)?)
}
