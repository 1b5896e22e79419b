//! `growbot plan`: plans a path between two poses, or one for each query of a file.

use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_core::robot::Robot;
use growbot_host::output::{is_standard_output, print, write_to};
use growbot_host::progress::{Progress, ResultTiming};
use growbot_pictures::clock_text::now_here;
use growbot_pictures::plan_table;
use growbot_plan::atomic_file::{AtomicFile, format_from_extension};
use growbot_plan::batch::{Batch, Defaults, QueryError, answers as answers_table, check_length_limit};
use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::input::{self, BoundedLines};
use growbot_plan::plan::{Plan, PlanOptions};
use growbot_plan::plan_file::PlanFile;
use growbot_plan::pose_text::{TypedGoal, parse_goal};
use growbot_plan::run_log::RecordedRun;
use growbot_plan::scene_planning::MAX_LENGTH_MM;

use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::remedies;
use super::robot_arg::RobotArg;
use super::scene_options::{SceneArgs, plan_failure};
use super::search::PlanningOptions;
use super::units::mm;

/// Plan a path from one pose to another, or through several
///
/// A path consists of arcs (C), straight lines (S) and helicoidal arcs (H). The command prints a table, or with --json
/// the plan as one line of JSON. -o writes the plan to a file, for `growbot layers` and other commands.
///
/// The warnings of a plan are reasons not to grow it: thin-layer, self-collision (the body would run into itself),
/// filament-short (not enough filament on the spool), layer-limit (a layer that the robot cannot lay). `growbot grow`
/// refuses the last three.
#[derive(Args)]
#[command(override_usage = USAGE, after_help = AFTER_HELP)]
pub struct PlanArgs {
    /// Goal pose X,Y,Z,HEADING,PITCH, or goal position X,Y,Z with any direction
    #[arg(
        long,
        value_name = "POSE",
        required_unless_present = "batch",
        allow_hyphen_values = true,
        value_parser = parse_goal
    )]
    to: Option<TypedGoal>,
    #[command(flatten)]
    search: PlanningOptions,
    /// Begin at the tip of the body of this run log, which stays in place
    #[arg(long = "continue", value_name = "LOG", conflicts_with_all = ["from", "batch"])]
    continued: Option<PathBuf>,
    /// Take the shortest path that does not run into the body. If every path does, take the shortest of all, as without
    /// this option
    #[arg(long)]
    avoid_self_collision: bool,
    /// Maximum length of the body, mm. A longer plan is refused
    #[arg(long, value_name = "MM", value_parser = length)]
    max_length: Option<f64>,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    robot: RobotArg,
    /// Print the plan as one line of JSON, or each plan of a batch
    #[arg(long)]
    json: bool,
    /// Write the plan to this file (.json, or - for standard output). For a batch, write the answers as CSV or JSON
    /// lines (.csv, .jsonl)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Plan every query of a CSV file (- for standard input), and print CSV, or JSON lines with --json
    #[arg(long, value_name = "CSV", conflicts_with_all = ["via", "via_csv", "to", "scene"])]
    batch: Option<PathBuf>,
}

const USAGE: &str = "growbot plan [--from <POSE>] --to <POSE> [OPTIONS]
       growbot plan --batch <CSV> [OPTIONS]";

const AFTER_HELP: &str = "\
Examples:
  growbot plan --to 200,100,600,0,45 -o plan.json
  growbot plan --from 0,0,0,0,90 --to -120,0,400,180,0 --radius 120 --json
  growbot plan --via 200,0,400,0,0 --via 600,0,300,0,-45 --to 800,0,0,0,-90
  growbot plan --to 0,0,-300,0,90 --avoid-self-collision
  growbot plan --continue run.jsonl --to 400,200,800,30,0
  growbot plan --to 200,100,600
  growbot plan --to 200,100,600 --scene room.toml --time-limit 5
  growbot plan --to 200,100,600 --scene room.toml --max-length 900
  growbot plan --via-csv stations.csv --to 0.8m,0,0,0deg,-90deg
  growbot plan --batch queries.csv -o answers.csv
  growbot plan --batch queries.csv --json > plans.jsonl

A batch has the columns id,to_x_mm,to_y_mm,to_z_mm in any order, and perhaps
  to_heading_deg,to_pitch_deg    without them, or empty: any direction
  from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg
  radius_mm, planner
An option applies to a query that leaves its column out or empty. There are no
columns for poses on the way. Each query gives one line: its plan, or its id
and an error.
The exit code is 1 if any failed.";

/// Runs the command.
pub fn run(args: &PlanArgs) -> Result<(), Failure> {
    if let (Some(output), None) = (&args.output, &args.batch) {
        format_from_extension(output, &["json"])?;
    }
    let robot = args.robot.load()?;
    match (&args.batch, &args.to) {
        (Some(queries), _) => run_batch(args, queries, &robot),
        (None, Some(goal)) => run_one(args, &robot, &plan(args, &robot, goal)?),
        (None, None) => Err(Failure::bad_input("give a goal with --to, or queries with --batch")),
    }
}

fn plan(args: &PlanArgs, robot: &Robot, goal: &TypedGoal) -> Result<Plan, Failure> {
    let continued = args.continued.as_ref().map(|log| continued_body(log, robot)).transpose()?;
    let existing = continued.as_ref().map(ContinuedBody::existing);
    let tip = continued.as_ref().map(ContinuedBody::tip);
    let (start, mut goals) = args.search.start_and_goals(robot, goal, tip)?;
    let plan = if let Some(scene) = &args.scene.scene {
        let search = PlanOptions { existing, ..args.search.search(robot) };
        let loaded = args.scene.load(scene)?;
        let max_length = args.max_length.unwrap_or(MAX_LENGTH_MM);
        let planned = args.scene.plan((scene, &loaded), robot, &(start, goals), &search, max_length);
        planned.map_err(|error| plan_failure(&error, ResultFormat::of(args.json)))?
    } else {
        let avoid_self_collision = args.avoid_self_collision;
        let search = PlanOptions { avoid_self_collision, existing, ..args.search.search(robot) };
        let goal = goals.pop().unwrap_or(goal.goal);
        let plan = Plan::through_waypoints(robot, &start, &goals, &goal, &search)?;
        check_length_limit(plan, args.max_length).map_err(|error| Failure::during_request(&error))?
    };
    Ok(plan.after_layers(continued.map(|body| body.layers).unwrap_or_default(), robot))
}

/// Returns the body of a run log of this robot.
fn continued_body(log: &Path, robot: &Robot) -> Result<ContinuedBody, Failure> {
    let record = RecordedRun::open(log)?;
    if record.robot.hash != robot.hash() {
        return Err(Failure::bad_input(format!(
            "{}: the body was grown by {} ({:016x}), but the plan is for {} ({:016x}): pass the robot of the body with \
             --robot",
            log.display(),
            record.robot.name,
            record.robot.hash,
            robot.name(),
            robot.hash()
        )));
    }
    ContinuedBody::of(&record).map_err(|error| Failure::bad_input(format!("{}: {error}", log.display())))
}

/// Parses a length above 0, mm.
fn length(text: &str) -> Result<f64, String> {
    let length = mm(text)?;
    if length > 0.0 && length <= MAX_LENGTH_MM {
        return Ok(length);
    }
    Err(format!("the value is {length} mm: give a length above 0 and at most {MAX_LENGTH_MM} mm"))
}

fn run_one(args: &PlanArgs, robot: &Robot, plan: &Plan) -> Result<(), Failure> {
    let written = PlanFile::with_robot(plan, robot);
    if let Some(path) = &args.output {
        let text = if args.json && is_standard_output(path) { written.to_line() } else { written.to_text() };
        if !write_to(path, text.as_bytes())? {
            return Ok(());
        }
        growbot_host::note!("plan written to {}", path.display());
    }
    // The time is not printed into a pipe, where the same plan must give the same text.
    let now = io::stdout().is_terminal().then(now_here);
    Ok(print(&if args.json { written.to_line() } else { plan_table::table(plan, now, remedies::warning_message) })?)
}

/// Formats of the answers to a batch.
#[derive(Clone, Copy, PartialEq)]
enum PlanFormat {
    Csv,
    JsonLines,
}

/// Destination of the answers to a batch.
struct BatchOutput {
    format: PlanFormat,
    file: Option<AtomicFile>,
}

impl BatchOutput {
    fn begin(args: &PlanArgs) -> Result<Self, Failure> {
        let to = args.output.as_deref().filter(|path| !is_standard_output(path));
        let formats: &[&str] = if args.json { &["json", "jsonl"] } else { &["csv", "json", "jsonl"] };
        let ending = to.map(|path| format_from_extension(path, formats)).transpose()?.flatten();
        let as_json = args.json || matches!(ending, Some("json" | "jsonl"));
        let format = if as_json { PlanFormat::JsonLines } else { PlanFormat::Csv };
        let file = to.map(AtomicFile::begin).transpose()?;
        let mut answers = Self { format, file };
        if format == PlanFormat::Csv {
            answers.write(&answers_table(message).csv_header())?;
        }
        Ok(answers)
    }

    /// Writes a line at once, because a program may wait for it before it sends the next query.
    fn write(&mut self, text: &str) -> Result<(), Failure> {
        match &mut self.file {
            Some(file) => Ok(file.add(text.as_bytes())?),
            None => Ok(print(text)?),
        }
    }

    /// Returns the name of the part of the output that has the errors of failed queries, for messages.
    fn name_of_errors(&self) -> &'static str {
        if self.format == PlanFormat::Csv { "the column error" } else { "the lines with \"error\"" }
    }

    fn finish(self, args: &PlanArgs) -> Result<(), Failure> {
        if let (Some(file), Some(path)) = (self.file, &args.output) {
            file.finish()?;
            growbot_host::note!("answers written to {}", path.display());
        }
        Ok(())
    }
}

/// Returns the text of an error of a query, with its remedies.
fn message(error: &QueryError) -> String {
    remedies::message(error)
}

fn run_batch(args: &PlanArgs, queries: &Path, robot: &Robot) -> Result<(), Failure> {
    let search = PlanOptions { avoid_self_collision: args.avoid_self_collision, ..args.search.search(robot) };
    let defaults = Defaults { start: args.search.start()?, search, max_length: args.max_length };
    // A radius that is invalid for every query is an error of the command, not of each query.
    let start = defaults.start;
    Plan::through_waypoints(robot, &start, &[], &start, &defaults.search)?;

    let name = input::display_name(queries);
    let total = fs::metadata(queries).ok().filter(fs::Metadata::is_file).map(|file| file.len());
    let named = |error| Failure::bad_input(format!("{name}: {error}"));
    let mut batch = Batch::open(BoundedLines::of(input::open(queries)?), defaults).map_err(named)?;
    let mut answers = BatchOutput::begin(args)?;
    let results = if answers.file.is_some() { ResultTiming::AtEnd } else { ResultTiming::Streamed };
    let mut progress = Progress::start(total, results);
    let (mut done, mut failed) = (0_u64, 0_u64);
    while let Some(answer) = batch.next(robot).map_err(named)? {
        done += 1;
        failed += u64::from(answer.outcome.is_err());
        answers.write(&match answers.format {
            PlanFormat::Csv => answer.to_row(message),
            _ => answer.to_line(robot, message),
        })?;
        progress.update(batch.bytes_read(), || format!("{done} planned, {failed} failed"));
    }
    progress.finish();
    let errors = answers.name_of_errors();
    answers.finish(args)?;
    if failed > 0 {
        return Err(Failure::request_failed(format!("{failed} of {done} queries failed: see {errors}")));
    }
    Ok(())
}
