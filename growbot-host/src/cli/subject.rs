//! A plan or a run log, whichever a file is.

use std::path::Path;

use growbot_client::input::{LONGEST_LOG, name_of, read_bytes, text_of};
use growbot_client::plan::Plan;
use growbot_client::plan_file::{self, PlanFileError};
use growbot_client::run_log::RunRecord;
use growbot_core::robot::Robot;
use serde_json::Value;

use super::{Failure, robot_of, say_damage};

/// A plan, and how it was grown, where there is a log of that.
pub struct Subject {
    pub robot: Robot,
    pub plan: Plan,
    /// The run log: what it tells, and its bytes.
    pub run: Option<(RunRecord, Vec<u8>)>,
}

impl Subject {
    /// Reads it from a file, from standard input (`-`), or from a pipe that the shell has opened: once, as none of
    /// these but the file can be read again.
    pub fn open(file: &Path, robot: Option<&Path>) -> Result<Self, Failure> {
        let bytes = read_bytes(file, LONGEST_LOG)?;
        if is_log(&bytes) {
            let record = RunRecord::read(&bytes, &name_of(file)).map_err(Failure::bad_input)?;
            say_damage(&record, file);
            let robot = robot_of(&record, robot)?;
            let plan = record.plan(&robot)?;
            return Ok(Self { robot, plan, run: Some((record, bytes)) });
        }
        match plan_file::read(&text_of(bytes, file)?, &name_of(file), robot) {
            Err(PlanFileError::NotJson { file, reason }) => Err(neither(&file, &format!("no JSON: {reason}"))),
            Err(PlanFileError::NoPlan { file, reason }) => Err(neither(&file, &reason)),
            opened => opened.map(|(robot, plan)| Self { robot, plan, run: None }).map_err(Failure::from),
        }
    }
}

fn neither(file: &str, reason: &str) -> Failure {
    Failure::bad_input(format_args!(
        "{file} is no run log and no plan ({reason}): give a file that `growbot grow --log` or `growbot plan -o` has \
         written"
    ))
}

/// Whether a file begins as run logs do: with a line of JSON that is an event.
fn is_log(bytes: &[u8]) -> bool {
    let first = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    serde_json::from_slice::<Value>(first).is_ok_and(|line| line.get("event").is_some())
}
