//! `growbot plan`: from two poses to a path, or from a file of queries to as many.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_client::files::{refuse_ending, replace_file};
use growbot_client::input::{self, BoundedLines};
use growbot_client::plan::Plan;
use growbot_client::plan_file::PlanFile;
use growbot_client::pose_text::{TypedGoal, parse_goal};
use growbot_core::robot::Robot;
use growbot_host::batch::Batch;
use growbot_host::output::print;
use growbot_host::progress::{Progress, Results};

use super::search::SearchArgs;
use super::{Failure, RobotArg, plan_table};

/// Plan a path from one pose to another, or through several
///
/// A path is made of arcs (C), straight lines (S) and helicoidal arcs (H). Prints a table, or the plan as one line of
/// JSON with --json; -o writes the plan to a file, for `growbot layers` and the like.
///
/// What speaks against growing the path is said in the plan's warnings: thin-layer, self-collision (the body would run
/// into itself), filament-short (not enough filament on the spool), layer-limit (a layer that the robot cannot lay).
/// `growbot grow` refuses the last three.
#[derive(Args)]
#[command(override_usage = USAGE, after_help = AFTER_HELP)]
pub struct PlanArgs {
    /// Where it is to arrive, and pointing where: X,Y,Z,HEADING,PITCH; pointing
    /// anywhere: X,Y,Z
    #[arg(
        long,
        value_name = "POSE",
        required_unless_present = "batch",
        allow_hyphen_values = true,
        value_parser = parse_goal
    )]
    to: Option<TypedGoal>,
    #[command(flatten)]
    search: SearchArgs,
    /// Take the shortest path that does not run into the body instead of the
    /// shortest of all; if every one does, the shortest of all
    #[arg(long)]
    clear_of_self: bool,
    #[command(flatten)]
    robot: RobotArg,
    /// Print the plan as one line of JSON
    #[arg(long)]
    json: bool,
    /// Write the plan to this file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Plan every query of a CSV file (- for standard input); needs --json
    #[arg(long, value_name = "CSV", conflicts_with_all = ["from", "via", "via_csv", "to", "output"])]
    batch: Option<PathBuf>,
}

const USAGE: &str = "growbot plan [--from <POSE>] --to <POSE> [OPTIONS]
       growbot plan --batch <CSV> --json [OPTIONS]";

const AFTER_HELP: &str = "\
Examples:
  growbot plan --to 200,100,600,0,45 -o plan.json
  growbot plan --from 0,0,0,0,90 --to -120,0,400,180,0 --radius 120 --json
  growbot plan --via 200,0,400,0,0 --via 600,0,300,0,-45 --to 800,0,0,0,-90
  growbot plan --to 0,0,-300,0,90 --clear-of-self
  growbot plan --batch queries.csv --json > plans.jsonl

A batch has the header
  id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,
  to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg
in one line and in any order, and perhaps columns radius_mm and planner; the
options apply where a query does not say. There are no columns for poses on the
way. Each query is answered by one line: its plan, or its id and an error. The
exit code is 1 if any failed.";

/// Runs the command.
pub fn run(args: &PlanArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    match (&args.batch, &args.to) {
        (Some(queries), _) => run_batch(args, queries, &robot),
        (None, Some(goal)) => run_one(args, &args.search.plan(&robot, goal, args.clear_of_self)?),
        (None, None) => Err(Failure::bad_input("give a goal with --to, or queries with --batch")),
    }
}

fn run_one(args: &PlanArgs, plan: &Plan) -> Result<(), Failure> {
    let written = PlanFile::from(plan);
    if let Some(path) = &args.output {
        if input::is_standard_input(path) {
            return Err(Failure::bad_input("-o takes a file: for standard output use --json"));
        }
        refuse_ending(path, &["json"])?;
        replace_file(path, written.to_text().as_bytes())?;
        growbot_host::tell!("growbot: plan written to {}", path.display());
    }
    Ok(print(&if args.json { written.to_line() } else { plan_table::table(plan) })?)
}

fn run_batch(args: &PlanArgs, queries: &Path, robot: &Robot) -> Result<(), Failure> {
    let search = args.search.search(robot, args.clear_of_self);
    if !args.json {
        return Err(Failure::bad_input("--batch prints one JSON object a line: add --json"));
    }
    // A radius that no query can have is a fault of the command, not of each query.
    let start = args.search.start()?;
    Plan::through(robot, &start, &[], &start, &search)?;

    let name = input::name_of(queries);
    let total = fs::metadata(queries).ok().filter(fs::Metadata::is_file).map(|file| file.len());
    let named = |error| Failure::bad_input(format!("{name}: {error}"));
    let mut batch = Batch::open(BoundedLines::of(input::open(queries)?), search).map_err(named)?;
    let mut progress = Progress::start(total, Results::Streamed);
    let (mut done, mut failed) = (0_u64, 0_u64);
    while let Some(answer) = batch.next(robot).map_err(named)? {
        done += 1;
        failed += u64::from(answer.outcome.is_err());
        // Each line leaves at once: a program may wait for it before it asks the next.
        print(&answer.to_line())?;
        progress.at(batch.bytes_read(), || format!("{done} planned, {failed} failed"));
    }
    progress.finish();
    if failed > 0 {
        return Err(Failure::answered_no(format!("{failed} of {done} queries failed: see the lines with \"error\"")));
    }
    Ok(())
}
