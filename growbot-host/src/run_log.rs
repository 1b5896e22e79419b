//! The log of a growth: one JSON object a line, each flushed, so that a log cut off anywhere is readable up to there.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use growbot_core::angle::degrees;
use serde_json::{Value, json};

use crate::growth::News;
use crate::plan::Plan;
use crate::plan_file::PlanFile;

/// Name and version of the format, in the first line.
pub const FORMAT: &str = "growbot-run/1";

/// Why a log could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the run log {file}: {error}; choose another place with --log")]
pub struct RunLogError {
    file: String,
    error: io::Error,
}

/// A log under way, or none.
pub struct RunLog(Option<(File, String)>);

impl RunLog {
    /// A log that is not kept.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// Begins a log with versions, port and plan.
    ///
    /// # Errors
    /// If the file cannot be created. A log that is there already is not overwritten: it may be the only record of a body.
    pub fn begin(path: &Path, plan: &Plan, port: &str) -> Result<Self, RunLogError> {
        let name = path.display().to_string();
        let file = File::create_new(path).map_err(|error| RunLogError { file: name.clone(), error })?;
        let mut log = Self(Some((file, name)));
        log.write(&json!({
            "event": "header",
            "format": FORMAT,
            "growbot": env!("CARGO_PKG_VERSION"),
            "port": port,
            "plan": PlanFile::from(plan),
        }))?;
        Ok(log)
    }

    /// Writes what happened.
    ///
    /// # Errors
    /// If the file cannot be written, say because a disk is full.
    pub fn news(&mut self, news: &News) -> Result<(), RunLogError> {
        match news {
            News::State(state) => self.write(&json!({ "event": "state", "state": state.name() })),
            News::Status(status) => self.write(&json!({
                "event": "status",
                "state": status.state.name(),
                "temperature_c": status.temperature_centi_c.map(|centi| f64::from(centi) / 100.0),
                "uptime_ms": status.uptime_ms,
            })),
            News::Laid(index, layer) => self.write(&json!({
                "event": "laid",
                "layer": index,
                "alpha_deg": degrees(layer.alpha),
                "height_mm": layer.height,
                "tilt_deg": degrees(layer.tilt),
            })),
        }
    }

    /// Takes the log of a job that never began away: there is no body to remember.
    pub fn discard(self) {
        if let Some((_, name)) = self.0 {
            let _ = std::fs::remove_file(name);
        }
    }

    /// Writes how it ended.
    ///
    /// # Errors
    /// As [`RunLog::news`].
    pub fn end(&mut self, result: &Value) -> Result<(), RunLogError> {
        self.write(&json!({ "event": "end", "result": result }))
    }

    fn write(&mut self, line: &Value) -> Result<(), RunLogError> {
        let Some((file, name)) = &mut self.0 else { return Ok(()) };
        writeln!(file, "{line}").and_then(|()| file.flush()).map_err(|error| RunLogError { file: name.clone(), error })
    }
}
