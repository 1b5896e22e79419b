//! `growbot maintain`: preheat, load, purge and similar tasks, without a job.

use clap::Args;
use growbot_client::maintenance::COMMANDS;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;

/// Heat the nozzle, load, unload or purge filament, home or turn the head
///
/// The board refuses unsafe tasks: a move with a nozzle that is not hot, or while a body grows. Heater and motors go
/// off 10 minutes after the latest of these commands. Materials are tables [materials.NAME] of the robot file, with
/// nozzle_c, load_mm, unload_mm and purge_mm.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct MaintainArgs {
    /// Task: preheat, cooldown, load, unload, purge, home, rotate or jog
    #[arg(value_parser = COMMANDS.map(|(name, ..)| name))]
    task: String,
    /// A temperature in C, a length in mm, an angle in degrees, or a material
    #[arg(allow_hyphen_values = true, default_value = "")]
    value: String,
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    #[command(flatten)]
    json: JsonArg,
}

const EXAMPLES: &str = "\
Examples:
  growbot maintain preheat 200 --port /dev/ttyACM0
  growbot maintain load pla --port /dev/ttyACM0 --robot mine.toml
  growbot maintain jog -5 --port /dev/ttyACM0
  growbot maintain cooldown --port /dev/ttyACM0";

/// Runs the command.
pub fn run(args: &MaintainArgs) -> Result<(), Failure> {
    let port = args.port.resolve_or_only()?;
    args.json.print(&port, &robot_at(&port, &args.robot)?.maintain(&args.task, &args.value)?)
}
