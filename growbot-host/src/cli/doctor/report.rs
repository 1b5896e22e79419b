//! The report: what each step found, and what was answered when.

use std::fmt;
use std::fs;
use std::io::{ErrorKind, Read};
use std::path::Path;

use growbot_client::files::replace_file;
use growbot_client::printable::{json_line, one_line};
use growbot_client::run_log::utc_text;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use time::OffsetDateTime;

use crate::cli::Failure;

/// What the file says it is.
const FORMAT: &str = "growbot-doctor/1";
/// No report is larger than this, bytes.
const LARGEST: u64 = 1 << 20;
/// Columns of a line on the terminal.
const WIDTH: usize = 80;
/// Where the text of a line begins.
const INDENT: usize = 24;

/// How a step ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// As it should.
    Passed,
    /// Not as it should.
    Failed,
    /// It was left out by choice.
    Skipped,
    /// The robot does not have the part.
    Absent,
    /// It was broken off.
    NotDone,
}

impl Outcome {
    /// In a word.
    fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
            Self::Absent => "absent",
            Self::NotDone => "not done",
        }
    }
}

/// What a step found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// How it ended.
    pub outcome: Outcome,
    /// What was found, with the values and their limits.
    pub found: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Finding {
    /// A step that passed.
    pub fn passed(found: impl Into<String>) -> Self {
        Self { outcome: Outcome::Passed, found: found.into(), remedy: None }
    }

    /// A step that failed, and what to do.
    pub fn failed(found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { outcome: Outcome::Failed, found: found.into(), remedy: Some(remedy.into()) }
    }

    /// A step that was left out by choice.
    pub fn skipped() -> Self {
        Self { outcome: Outcome::Skipped, found: "left out by choice".to_owned(), remedy: None }
    }

    /// A step for a part that the robot does not have, by this key of its file.
    pub fn absent(key: &str) -> Self {
        Self { outcome: Outcome::Absent, found: format!("the robot file has no {key}"), remedy: None }
    }

    /// A step that was broken off.
    pub fn not_done(why: &str) -> Self {
        Self { outcome: Outcome::NotDone, found: one_line(why).into_owned(), remedy: None }
    }

    /// As a line, or some, for the terminal.
    pub fn line(&self, step: &str) -> String {
        let mut text = format!("{:9}{step:15}", self.outcome.name());
        let remedy = self.remedy.as_deref().map_or(String::new(), |remedy| format!("; {remedy}"));
        let mut columns = INDENT;
        for word in format!("{}{remedy}", self.found).split(' ') {
            let width = word.chars().count();
            if columns > INDENT && columns + 1 + width > WIDTH {
                text += &format!("\n{:INDENT$}", "");
                columns = INDENT;
            } else if columns > INDENT {
                text.push(' ');
                columns += 1;
            }
            text += word;
            columns += width;
        }
        text + "\n"
    }
}

/// An answer, with its question and its time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answered {
    /// What was asked.
    pub question: String,
    /// What was typed.
    pub answer: String,
    /// When.
    pub utc: String,
}

/// A step that was done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Done {
    step: String,
    #[serde(flatten)]
    finding: Finding,
    #[serde(default)]
    answers: Vec<Answered>,
    utc: String,
    /// Hash of the robot's description then, 16 hexadecimal digits; empty where it is not known.
    #[serde(default)]
    description: String,
}

/// The report of a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    format: String,
    robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    #[serde(default)]
    description: String,
    port: String,
    simulated: bool,
    steps: Vec<Done>,
}

impl Default for Report {
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

impl Report {
    /// The report of this file, or a new one where there is none.
    pub fn open(file: &Path) -> Result<Self, Failure> {
        let unusable = |what: &str| {
            Failure::bad_input(format!("{} is no report of growbot doctor: {what}; name another file", file.display()))
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
            return Err(unusable(&format!("its format is {:?}, not {FORMAT:?}", report.format)));
        }
        Ok(report)
    }

    /// It is about this robot from now on.
    pub fn begin(&mut self, robot: &Robot, port: &str, simulated: bool) -> Result<(), Failure> {
        let name = robot.name();
        let is_new = self.robot.is_empty();
        if !is_new && (self.robot != name || self.simulated != simulated) {
            let kind = |simulated| if simulated { "simulated " } else { "" };
            return Err(Failure::bad_input(format!(
                "the report is about the {}robot {:?}, and this is the {}robot {name:?}: name another file with -o",
                kind(self.simulated),
                self.robot,
                kind(simulated)
            )));
        }
        (self.robot, self.port, self.simulated) = (name.to_owned(), port.to_owned(), simulated);
        self.description = format!("{:016x}", robot.hash());
        Ok(())
    }

    /// When this step passed.
    pub fn passed_at(&self, step: &str) -> Option<&str> {
        let done = self.steps.iter().find(|done| done.step == step)?;
        (done.finding.outcome == Outcome::Passed).then_some(done.utc.as_str())
    }

    /// Of these steps, those that passed with another description count as not done. Says which, and why.
    pub fn outdate(&mut self, names: &[&str]) -> Vec<String> {
        let now = &self.description;
        let outdated = self.steps.iter_mut().filter(|done| {
            done.finding.outcome == Outcome::Passed && done.description != *now && names.contains(&done.step.as_str())
        });
        outdated
            .map(|done| {
                let then = if done.description.is_empty() { "unknown" } else { &done.description };
                let why = format!("passed {} with another robot description ({then}; now {now})", done.utc);
                done.finding = Finding::not_done(&why);
                format!("{} {why}", done.step)
            })
            .collect()
    }

    /// Adds a step, or replaces what is known of it.
    pub fn add(&mut self, step: &str, finding: Finding, answers: Vec<Answered>) {
        let done = Done { step: step.to_owned(), finding, answers, utc: now(), description: self.description.clone() };
        match self.steps.iter_mut().find(|known| known.step == step) {
            Some(known) => *known = done,
            None => self.steps.push(done),
        }
    }

    /// Writes it, whole or not at all.
    pub fn write(&self, file: &Path) -> Result<(), Failure> {
        Ok(replace_file(file, json_line(&self.json()).as_bytes())?)
    }

    /// As JSON.
    pub fn json(&self) -> Value {
        serde_json::to_value(self).unwrap_or_default()
    }

    /// What came of these steps.
    pub fn summary(&self, names: &[&'static str]) -> Summary {
        let outcome = |name: &str| {
            let done = self.steps.iter().find(|done| done.step == name);
            done.map_or(Outcome::NotDone, |done| done.finding.outcome)
        };
        Summary(names.iter().map(|name| (*name, outcome(name))).collect())
    }
}

/// The present time.
pub fn now() -> String {
    utc_text(OffsetDateTime::now_utc())
}

/// How the steps ended.
pub struct Summary(Vec<(&'static str, Outcome)>);

impl Summary {
    /// Whether nothing is left to be done.
    pub fn is_good(&self) -> bool {
        !self.0.iter().any(|(_, outcome)| matches!(outcome, Outcome::Failed | Outcome::NotDone))
    }

    fn of(&self, outcome: Outcome) -> Vec<&'static str> {
        self.0.iter().filter(|(_, other)| *other == outcome).map(|(name, _)| *name).collect()
    }

    /// What is not good, in words.
    pub fn in_words(&self) -> String {
        let part = |outcome: Outcome, words: &str| {
            let names = self.of(outcome);
            (!names.is_empty()).then(|| format!("{words}: {}", names.join(", ")))
        };
        let parts = [part(Outcome::Failed, "failed"), part(Outcome::NotDone, "not done")];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        format!("{}; mend that, and run growbot doctor again", parts.join("; "))
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for outcome in [Outcome::Passed, Outcome::Failed, Outcome::Skipped, Outcome::Absent, Outcome::NotDone] {
            let names = self.of(outcome);
            if !names.is_empty() {
                let list = Finding { outcome, found: names.join(", "), remedy: None };
                write!(f, "{}", list.line(&names.len().to_string()))?;
            }
        }
        Ok(())
    }
}
