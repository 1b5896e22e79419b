//! `growbot view`: a plan or a growth as a page to look at.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_core::robot::Robot;
use growbot_host::input::{is_standard_input, name_of};
use growbot_host::output::replace_file;
use growbot_host::plan::Plan;
use growbot_host::plan_file::{self, PlanFileError};
use growbot_host::robot_file;
use growbot_host::run_log::{RunRecord, RunRecordError};
use growbot_host::view::Subject;

use super::Failure;

/// Write a plan, or the log of a growth, as one HTML page to look at
///
/// The page opens in any browser, without a network: the tube in three dimensions, its layers coloured by their height, and a slider that
/// grows it, with start, goal, the tip's frame and the numbers beside it. Of a growth it shows what was planned against what was built.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot view plan.json\n  growbot view run.jsonl -o growth.html\n  growbot plan --to 0,0,500,0,90 --json | growbot view - -o plan.html"
)]
pub struct ViewArgs {
    /// The plan, as `growbot plan -o` writes it (- for standard input), or the
    /// run log, as `growbot grow --log` does
    #[arg(value_name = "PLAN|RUN")]
    file: PathBuf,
    /// Write the page to this file [default: beside the file, ending in .html]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The robot: a built-in name or a TOML file [default: the built-in one that
    /// the file names]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &ViewArgs) -> Result<(), Failure> {
    let output = args.output()?;
    let (robot, plan, run) = open(&args.file, args.robot.as_deref())?;
    if let Some(run) = run.as_ref().filter(|run| run.cut_off > 0) {
        let bytes = run.cut_off;
        growbot_host::tell!("growbot: the last {bytes} bytes are no whole line: the log was cut off there");
    }
    let name = args.file.file_name().map_or_else(|| name_of(&args.file), |name| name.to_string_lossy().into_owned());
    let subject = Subject { name: &name, robot: &robot, plan: &plan, run: run.as_ref() };
    let page = subject.page().map_err(Failure::bad_input)?;
    replace_file(&output, page.as_bytes())?;
    growbot_host::tell!("growbot: view written to {}: open it in a browser", output.display());
    Ok(())
}

impl ViewArgs {
    /// Where the page goes: never over what it is made from.
    fn output(&self) -> Result<PathBuf, Failure> {
        let output = match &self.output {
            Some(output) if is_standard_input(output) => return Err(Failure::bad_input("-o takes a file")),
            Some(output) => output.clone(),
            None if is_standard_input(&self.file) => {
                return Err(Failure::bad_input(
                    "a plan from standard input has no name: say where the page goes with -o",
                ));
            }
            None => self.file.with_extension("html"),
        };
        let same =
            fs::canonicalize(&output).is_ok_and(|output| fs::canonicalize(&self.file).is_ok_and(|file| file == output));
        if same {
            let file = self.file.display();
            return Err(Failure::bad_input(format!("the page would replace {file}: choose another place with -o")));
        }
        Ok(output)
    }
}

/// What is in the file: a plan, or a plan and how it was grown.
fn open(file: &Path, robot: Option<&Path>) -> Result<(Robot, Plan, Option<RunRecord>), Failure> {
    let as_plan = || plan_file::open(file, robot);
    if is_standard_input(file) {
        let (robot, plan) = as_plan()?;
        return Ok((robot, plan, None));
    }
    match RunRecord::open(file) {
        Ok(record) => {
            let robot = robot_file::load(robot.unwrap_or(record.robot.0.as_ref()))?;
            let plan = record.plan(&robot)?;
            Ok((robot, plan, Some(record)))
        }
        Err(RunRecordError::File { file, error }) => Err(Failure::bad_input(format!("cannot read {file}: {error}"))),
        Err(no_run) => match as_plan() {
            Ok((robot, plan)) => Ok((robot, plan, None)),
            Err(PlanFileError::NotJson { .. } | PlanFileError::NoPlan { .. }) => {
                Err(Failure::bad_input(format!("{no_run}; it is no plan either, as `growbot plan -o` writes one")))
            }
            Err(no_plan) => Err(no_plan.into()),
        },
    }
}
