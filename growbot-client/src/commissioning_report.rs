//! The report about the commissioning of a robot: the finding of each step, and each answer with its time.

use std::fs;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use growbot_core::robot::Robot;
use growbot_plan::atomic_file::{FileError, write_atomic};
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::utc_text;
use growbot_plan::sanitize::{json_line, one_line};
use serde::{Deserialize, Serialize};
use time::OffsetDateTime;

/// Identifier of the file's format.
const FORMAT: &str = "growbot-doctor/1";
/// Maximum size of a report, bytes.
const LARGEST: u64 = 1 << 20;

/// Outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StepOutcome {
    /// The step passed.
    Passed,
    /// The step failed.
    Failed,
    /// The user skipped the step.
    Skipped,
    /// The robot does not have the part.
    Absent,
    /// The step was interrupted, was not done, or must be repeated.
    NotDone,
}

/// Finding of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Finding {
    /// Outcome of the step.
    pub outcome: StepOutcome,
    /// Observation, with the values and their limits.
    pub found: String,
    /// Remedy, if the step failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Finding {
    /// Returns the finding of a step that passed.
    pub fn passed(found: impl Into<String>) -> Self {
        Self { outcome: StepOutcome::Passed, found: found.into(), remedy: None }
    }

    /// Returns the finding of a step that failed, with the remedy.
    pub fn failed(found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { outcome: StepOutcome::Failed, found: found.into(), remedy: Some(remedy.into()) }
    }

    /// Returns the finding of a step that the user skipped.
    pub fn skipped() -> Self {
        Self { outcome: StepOutcome::Skipped, found: "left out by choice".to_owned(), remedy: None }
    }

    /// Returns the finding of a step for a part that the robot does not have. `key` is the part's key in the robot
    /// file.
    pub fn absent(key: &str) -> Self {
        Self { outcome: StepOutcome::Absent, found: format!("the robot file has no {key}"), remedy: None }
    }

    /// Returns the finding of a step that was interrupted.
    pub fn not_done(why: &str) -> Self {
        Self { outcome: StepOutcome::NotDone, found: one_line(why).into_owned(), remedy: None }
    }
}

/// An answer, with its question and its time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RecordedAnswer {
    /// The question.
    pub question: String,
    /// Text that the user typed.
    pub answer: String,
    /// Time of the answer, UTC.
    pub utc: String,
}

impl RecordedAnswer {
    /// Returns an answer that the user has typed now.
    pub fn new(question: &str, answer: &str) -> Self {
        Self { question: question.to_owned(), answer: one_line(answer).into_owned(), utc: now() }
    }
}

/// Error of a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The file cannot be read.
    #[error("cannot use {file} as a report of the commissioning: {error}; name another file")]
    Unreadable {
        /// Name of the file.
        file: String,
        /// Error of the operating system.
        #[source]
        error: io::Error,
    },
    /// The file is not a report.
    #[error("cannot use {file} as a report of the commissioning: {error}; name another file")]
    NotAReport {
        /// Name of the file.
        file: String,
        /// Error in its JSON.
        #[source]
        error: serde_json::Error,
    },
    /// The file has another format.
    #[error(
        "cannot use {file} as a report of the commissioning: the format of the file is {format:?}, not {FORMAT:?}; \
         name another file"
    )]
    OtherFormat {
        /// Name of the file.
        file: String,
        /// Format of the file.
        format: String,
    },
    /// The report is about another robot.
    #[error(
        "the report is for the {}robot {known:?}, but this is the {}robot {name:?}: name another file",
        .known_kind.prefix(),
        .kind.prefix()
    )]
    OtherRobot {
        /// Robot of the report.
        known: String,
        /// Kind of the robot of the report.
        known_kind: RobotKind,
        /// Name of the robot.
        name: String,
        /// Kind of the robot.
        kind: RobotKind,
    },
}

/// A step in the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct DoctorStep {
    /// Name of the step.
    step: String,
    #[serde(flatten)]
    finding: Finding,
    /// Answers of the user.
    #[serde(default)]
    answers: Vec<RecordedAnswer>,
    /// Time of the end of the step, UTC.
    utc: String,
    /// Hash of the robot's description when the step was done, 16 hexadecimal digits. Empty if it is not known.
    #[serde(default)]
    description: String,
}

/// The report about the commissioning of a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CommissioningReport {
    /// Identifier of the file's format.
    format: String,
    /// Name of the robot.
    robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    #[serde(default)]
    description: String,
    /// Port of the robot.
    port: String,
    /// True for a simulated robot.
    simulated: bool,
    /// Steps that were done, in the order of their first results.
    steps: Vec<DoctorStep>,
}

impl Default for CommissioningReport {
    fn default() -> Self {
        Self {
            format: FORMAT.to_owned(),
            robot: String::new(),
            description: String::new(),
            port: String::new(),
            simulated: false,
            steps: Vec::new(),
        }
    }
}

impl CommissioningReport {
    /// Reads the report from this file, or creates one if the file does not exist.
    ///
    /// # Errors
    /// [`ReportError`], if the file cannot be read or is not such a report.
    pub fn open(file: &Path) -> Result<Self, ReportError> {
        let name = || file.display().to_string();
        let unreadable = |error| ReportError::Unreadable { file: name(), error };
        let mut text = String::new();
        match fs::File::open(file) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(unreadable(error)),
            Ok(opened) => opened.take(LARGEST).read_to_string(&mut text).map_err(unreadable)?,
        };
        let report: Self =
            serde_json::from_str(&text).map_err(|error| ReportError::NotAReport { file: name(), error })?;
        if report.format != FORMAT {
            return Err(ReportError::OtherFormat { file: name(), format: report.format });
        }
        Ok(report)
    }

    /// Sets the robot of the report.
    ///
    /// # Errors
    /// [`ReportError::OtherRobot`], if the report is about another robot.
    pub fn begin(&mut self, robot: &Robot, port: &str, kind: RobotKind) -> Result<(), ReportError> {
        let name = robot.name();
        let is_new = self.robot.is_empty();
        if !is_new && (self.robot != name || self.simulated != kind.is_simulated()) {
            return Err(ReportError::OtherRobot {
                known: self.robot.clone(),
                known_kind: self.simulated.into(),
                name: name.to_owned(),
                kind,
            });
        }
        (self.robot, self.port, self.simulated) = (name.to_owned(), port.to_owned(), kind.is_simulated());
        self.description = format!("{:016x}", robot.hash());
        Ok(())
    }

    /// Returns the outcome of a step.
    pub fn outcome(&self, step: &str) -> StepOutcome {
        let done = self.steps.iter().find(|done| done.step == step);
        done.map_or(StepOutcome::NotDone, |done| done.finding.outcome)
    }

    /// Returns the time at which this step passed. `None` if it did not pass.
    pub fn passed_at(&self, step: &str) -> Option<&str> {
        let done = self.steps.iter().find(|done| done.step == step)?;
        (done.finding.outcome == StepOutcome::Passed).then_some(done.utc.as_str())
    }

    /// Marks the steps in `names` as not done that passed with another description of the robot. Returns a message
    /// about each of them.
    pub fn outdate(&mut self, names: &[&str]) -> Vec<String> {
        let now = &self.description;
        let outdated = self.steps.iter_mut().filter(|done| {
            done.finding.outcome == StepOutcome::Passed
                && done.description != *now
                && names.contains(&done.step.as_str())
        });
        outdated
            .map(|done| {
                let then = if done.description.is_empty() { "unknown" } else { &done.description };
                let why = format!("passed at {} with another robot description ({then}; now {now})", done.utc);
                done.finding = Finding::not_done(&why);
                format!("{} {why}", done.step)
            })
            .collect()
    }

    /// Adds a step, or replaces an earlier result of it.
    pub fn add(&mut self, step: &str, finding: Finding, answers: Vec<RecordedAnswer>) {
        let done =
            DoctorStep { step: step.to_owned(), finding, answers, utc: now(), description: self.description.clone() };
        match self.steps.iter_mut().find(|known| known.step == step) {
            Some(known) => *known = done,
            None => self.steps.push(done),
        }
    }

    /// Writes the report, whole or not at all.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, file: &Path) -> Result<(), FileError> {
        write_atomic(file, json_line(self).as_bytes())
    }
}

/// Returns the present time as text, UTC.
fn now() -> String {
    utc_text(OffsetDateTime::now_utc())
}
