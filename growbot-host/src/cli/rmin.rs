//! `growbot rmin`: prints the tightest bend of a robot.

use clap::Args;
use growbot_host::output::print;
use growbot_plan::robot_json::MinRadius;
use growbot_plan::sanitize::json_line;

use super::failure::Failure;
use super::robot_arg::RobotArg;

/// Print the tightest bend of a robot, R_min, in mm
///
/// R_min is the minimum radius of the centreline. It is the larger of two limits. By the packaging limit, the parts
/// inside the tube must pass the bend (Eq 7 of Del Dottore et al. 2019). The limit by the layers follows from their
/// minimum and maximum heights and their maximum tilt.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot rmin --robot growbot-b")]
pub struct RminArgs {
    #[command(flatten)]
    robot: RobotArg,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &RminArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let rmin = MinRadius::from(&robot);
    if args.json {
        return Ok(print(&json_line(&rmin))?);
    }
    let MinRadius { robot, r_min_mm, r_min_geometry_mm, r_min_layers_mm } = rmin;
    Ok(print(&format!(
        "{robot}: R_min is {r_min_mm:.2} mm\n  by its mechanics {r_min_geometry_mm:>8.2} mm\n  by its \
         layers    {r_min_layers_mm:>8.2} mm\n"
    ))?)
}
