//! The report: the finding of each step, and each answer with its time.

use std::fmt;
use std::fs;
use std::io::{ErrorKind, Read};
use std::path::Path;

use growbot_core::robot::Robot;
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::utc_text;
use growbot_plan::sanitize::{json_line, one_line};
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use strum::IntoStaticStr;
use time::OffsetDateTime;

use crate::cli::failure::Failure;

/// Identifier of the file's format.
const FORMAT: &str = "growbot-doctor/1";
/// Maximum size of a report, bytes.
const LARGEST: u64 = 1 << 20;
/// Column at which the text of a line begins.
const INDENT: usize = 24;

/// Outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "lowercase")]
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
    #[strum(serialize = "not done")]
    NotDone,
}

impl StepOutcome {
    /// Returns the name of the outcome for the terminal.
    fn name(self) -> &'static str {
        self.into()
    }
}

/// Finding of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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

    /// Returns the finding of the step `step` as one or more lines for the terminal.
    pub fn line(&self, step: &str) -> String {
        let head = format!("{:9}{step:15}", self.outcome.name());
        let remedy = self.remedy.as_deref().map_or(String::new(), |remedy| format!("; {remedy}"));
        wrap(&format!("{}{remedy}", self.found), TERMINAL_WIDTH, &head, &" ".repeat(INDENT))
    }
}

/// An answer, with its question and its time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedAnswer {
    /// The question.
    pub question: String,
    /// Text that the user typed.
    pub answer: String,
    /// Time of the answer, UTC.
    pub utc: String,
}

/// A step in the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct DoctorStep {
    step: String,
    #[serde(flatten)]
    finding: Finding,
    #[serde(default)]
    answers: Vec<RecordedAnswer>,
    utc: String,
    /// Hash of the robot's description when the step was done, 16 hexadecimal digits. Empty if it is not known.
    #[serde(default)]
    description: String,
}

/// The report about the commissioning of a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CommissioningReport {
    format: String,
    robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    #[serde(default)]
    description: String,
    port: String,
    simulated: bool,
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
    pub fn open(file: &Path) -> Result<Self, Failure> {
        let unusable = |what: &str| {
            Failure::bad_input(format!(
                "cannot use {} as a report of growbot doctor: {what}; name another file with -o",
                file.display()
            ))
        };
        let mut text = String::new();
        match fs::File::open(file) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(unusable(&error.to_string())),
            Ok(opened) => {
                opened.take(LARGEST).read_to_string(&mut text).map_err(|error| unusable(&error.to_string()))?
            }
        };
        let report: Self = serde_json::from_str(&text).map_err(|error| unusable(&error.to_string()))?;
        if report.format != FORMAT {
            return Err(unusable(&format!("the format of the file is {:?}, not {FORMAT:?}", report.format)));
        }
        Ok(report)
    }

    /// Sets the robot of the report. Returns an error if the report is about another robot.
    pub fn begin(&mut self, robot: &Robot, port: &str, kind: RobotKind) -> Result<(), Failure> {
        let name = robot.name();
        let is_new = self.robot.is_empty();
        if !is_new && (self.robot != name || self.simulated != kind.is_simulated()) {
            return Err(Failure::bad_input(format!(
                "the report is for the {}robot {:?}, but this is the {}robot {name:?}: name another file with -o",
                RobotKind::from(self.simulated).prefix(),
                self.robot,
                kind.prefix()
            )));
        }
        (self.robot, self.port, self.simulated) = (name.to_owned(), port.to_owned(), kind.is_simulated());
        self.description = format!("{:016x}", robot.hash());
        Ok(())
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
    pub fn write(&self, file: &Path) -> Result<(), Failure> {
        Ok(write_atomic(file, json_line(&self.json()).as_bytes())?)
    }

    /// Returns the report as JSON.
    pub fn json(&self) -> Value {
        serde_json::to_value(self).unwrap_or_default()
    }

    /// Returns the summary of these steps.
    pub fn summary(&self, names: &[&'static str]) -> Summary {
        let outcome = |name: &str| {
            let done = self.steps.iter().find(|done| done.step == name);
            done.map_or(StepOutcome::NotDone, |done| done.finding.outcome)
        };
        Summary(names.iter().map(|name| (*name, outcome(name))).collect())
    }
}

/// Returns the present time as text, UTC.
pub fn now() -> String {
    utc_text(OffsetDateTime::now_utc())
}

/// Outcomes of the steps.
pub struct Summary(Vec<(&'static str, StepOutcome)>);

impl Summary {
    /// Returns true if every step passed, was skipped, or is for a part that the robot does not have.
    pub fn is_good(&self) -> bool {
        !self.0.iter().any(|(_, outcome)| matches!(outcome, StepOutcome::Failed | StepOutcome::NotDone))
    }

    fn of(&self, outcome: StepOutcome) -> Vec<&'static str> {
        self.0.iter().filter(|(_, other)| *other == outcome).map(|(name, _)| *name).collect()
    }

    /// Returns a text about the steps that failed or were not done.
    pub fn describe(&self) -> String {
        let part = |outcome: StepOutcome, words: &str| {
            let names = self.of(outcome);
            (!names.is_empty()).then(|| format!("{words}: {}", names.join(", ")))
        };
        let parts = [part(StepOutcome::Failed, "failed"), part(StepOutcome::NotDone, "not done")];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        format!("{}; fix this and run `growbot doctor` again", parts.join("; "))
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for outcome in
            [StepOutcome::Passed, StepOutcome::Failed, StepOutcome::Skipped, StepOutcome::Absent, StepOutcome::NotDone]
        {
            let names = self.of(outcome);
            if !names.is_empty() {
                let list = Finding { outcome, found: names.join(", "), remedy: None };
                write!(f, "{}", list.line(&names.len().to_string()))?;
            }
        }
        Ok(())
    }
}
