//! Findings of the commissioning as text for the terminal.

use std::fmt;

use growbot_client::commissioning_report::{CommissioningReport, Finding, StepOutcome};
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};

/// Column at which the text of a line begins.
const INDENT: usize = 24;

/// Returns the finding of the step `step` as one or more lines.
pub fn line(finding: &Finding, step: &str) -> String {
    let outcome = match finding.outcome {
        StepOutcome::Passed => "passed",
        StepOutcome::Failed => "failed",
        StepOutcome::Skipped => "skipped",
        StepOutcome::Absent => "absent",
        StepOutcome::NotDone => "not done",
    };
    let head = format!("{outcome:9}{step:15}");
    let remedy = finding.remedy.as_deref().map_or(String::new(), |remedy| format!("; {remedy}"));
    wrap(&format!("{}{remedy}", finding.found), TERMINAL_WIDTH, &head, &" ".repeat(INDENT))
}

/// Outcomes of the steps.
pub struct Summary(Vec<(&'static str, StepOutcome)>);

impl Summary {
    /// Returns the summary of the steps `names` of a report.
    pub fn new(report: &CommissioningReport, names: &[&'static str]) -> Self {
        Self(names.iter().map(|name| (*name, report.outcome(name))).collect())
    }

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
                write!(f, "{}", line(&list, &names.len().to_string()))?;
            }
        }
        Ok(())
    }
}
