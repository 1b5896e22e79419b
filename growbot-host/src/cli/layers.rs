//! `growbot layers`: prints the layers that the head lays, turn by turn.

use std::path::PathBuf;

use clap::Args;
use growbot_host::output::{OutputError, write_to};
use growbot_pictures::layer_table::write_layers;
use growbot_plan::atomic_file::format_from_extension;
use growbot_plan::plan_file::{self, PlanFile};

use super::failure::Failure;

/// Print the layers of a plan as CSV
///
/// The columns are layer,segment,alpha_deg,height_mm,tilt_deg. Layers and segments count from 0. Alpha is the angle of
/// most material in the tip's frame. Tilt is the angle by which the tip bends away from there.
///
/// With --json the plan is printed with its layers in the field layer_table. Other commands take it like any plan, and
/// check that the layers are those of the plan.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot layers plan.json > layers.csv\n  growbot layers plan.json -o layers.csv\n  \
                  growbot layers plan.json --json > layers.json\n  \
                  growbot plan --to 0,0,500,0,90 --json | growbot layers -"
)]
pub struct LayersArgs {
    /// The plan, as `growbot plan -o` writes it (- for standard input)
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Write to this file, which ends in .csv, or with --json in .json [default: standard output]
    #[arg(short, long, value_name = "FILE", default_value = "-", hide_default_value = true)]
    output: PathBuf,
    /// The robot: a built-in name or a TOML file [default: the one
    /// that the plan describes]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
    /// Print the plan with its layers as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &LayersArgs) -> Result<(), Failure> {
    format_from_extension(&args.output, &[if args.json { "json" } else { "csv" }])?;
    let (robot, plan) = plan_file::open(&args.plan, args.robot.as_deref())?;
    let mut table = Vec::new();
    if args.json {
        table = PlanFile::with_robot(&plan, &robot).with_layer_table(&plan, &robot).to_line().into_bytes();
    } else {
        write_layers(&mut table, &plan.path, &robot).map_err(OutputError::from)?;
    }
    if write_to(&args.output, &table)? {
        growbot_host::note!("layers written to {}", args.output.display());
    }
    Ok(())
}
