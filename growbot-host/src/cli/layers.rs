//! `growbot layers`: prints the layers that the head lays, turn by turn.

use std::path::PathBuf;

use clap::Args;
use growbot_host::output::{OutputError, write_to};
use growbot_pictures::layer_table::write_layers;
use growbot_plan::atomic_file::format_from_extension;
use growbot_plan::plan_file;

use super::failure::Failure;

/// Print the layers of a plan as CSV
///
/// The columns are layer,segment,alpha_deg,height_mm,tilt_deg. Layers and segments count from 0. Alpha is the angle of
/// most material in the tip's frame. Tilt is the angle by which the tip bends away from there.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot layers plan.json > layers.csv\n  growbot layers plan.json -o layers.csv\n  \
                  growbot plan --to 0,0,500,0,90 --json | growbot layers -"
)]
pub struct LayersArgs {
    /// The plan, as `growbot plan -o` writes it (- for standard input)
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Write to this file, which ends in .csv [default: standard output]
    #[arg(short, long, value_name = "FILE", default_value = "-", hide_default_value = true)]
    output: PathBuf,
    /// The robot: a built-in name or a TOML file [default: the one
    /// that the plan describes]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &LayersArgs) -> Result<(), Failure> {
    format_from_extension(&args.output, &["csv"])?;
    let (robot, plan) = plan_file::open(&args.plan, args.robot.as_deref())?;
    let mut table = Vec::new();
    write_layers(&mut table, &plan.path, &robot).map_err(OutputError::from)?;
    if write_to(&args.output, &table)? {
        growbot_host::note!("layers written to {}", args.output.display());
    }
    Ok(())
}
