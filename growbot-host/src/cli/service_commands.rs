//! `growbot pause`, `growbot continue` and `growbot attach`, for the growths of a service.

use clap::Args;
use growbot_client::robot_command::RobotCommand;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::growth_monitor::ResultFormat;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Pause the present growth of the service, after the layer under way
#[derive(Args)]
#[command(
    after_help = "Example:\n  growbot pause --port /dev/ttyACM0\n\nA growth without a service is paused from its \
                        own terminal or page."
)]
pub struct PauseArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Continue a paused growth of the service
#[derive(Args)]
#[command(after_help = "Example:\n  growbot continue --port /dev/ttyACM0")]
pub struct ContinueArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Follow the present growth of the service to its end
#[derive(Args)]
#[command(after_help = "Example:\n  growbot attach --port /dev/ttyACM0")]
pub struct AttachArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    /// End with one line of JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs `growbot pause`.
pub fn run_pause(args: &PauseArgs) -> Result<(), Failure> {
    let port = args.port.resolve_or_only()?;
    args.json.print(&port, &robot_at(&port, &RobotArg::default())?.command(RobotCommand::Pause)?)
}

/// Runs `growbot continue`.
pub fn run_continue(args: &ContinueArgs) -> Result<(), Failure> {
    let port = args.port.resolve_or_only()?;
    args.json.print(&port, &robot_at(&port, &RobotArg::default())?.command(RobotCommand::Continue)?)
}

/// Runs `growbot attach`.
pub fn run_attach(args: &AttachArgs) -> Result<(), Failure> {
    robot_at(&args.port.resolve_or_only()?, &RobotArg::default())?.attach(ResultFormat::of(args.json))
}
