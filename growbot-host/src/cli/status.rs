//! `growbot status`: shows the identity and the state of the board.

use std::path::PathBuf;

use clap::Args;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_sim::crash::FirmwareImage;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Show the identity, state and sensors of the robot's board
///
/// The latest fault is shown with its data at that time, until the next fault or until the board loses its power.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot status --port /dev/ttyACM0")]
pub struct StatusArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// After a crash: firmware image that gives the names of functions and lines
    ///
    /// The default is the image that `growbot flash` built last, if it is the one that crashed.
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &StatusArgs) -> Result<(), Failure> {
    let port = args.port.resolve_or_only()?;
    let image = args.elf.as_deref().map(FirmwareImage::open).transpose()?;
    let mut report = robot_at(&port, &args.robot)?.status()?;
    report.look_up_in(image)?;
    Ok(print(&if args.json { json_line(&report.status) } else { report.text() })?)
}
