//! Audit log: a record of all commands, in a file to which lines are only appended.

use std::error::Error;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use growbot_plan::run_log::utc_now;
use growbot_plan::sanitize::json_line;
use serde::Serialize;

use super::job_store::JobStoreError;

/// File of the audit log.
pub struct Audit(Mutex<File>);

/// Origin of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandSource {
    /// A page or a program that knows the token for commands.
    Web,
    /// A growbot command of the user, through the Unix socket.
    Socket,
}

/// A line of the audit log: a command and its outcome.
#[derive(Serialize)]
struct AuditRecord<'a> {
    time_utc: String,
    source: CommandSource,
    robot: &'a str,
    command: &'a str,
    /// Reason why the command failed. `None` if the command was carried out or accepted.
    error: Option<String>,
}

impl Audit {
    pub fn open(path: &Path) -> Result<Self, JobStoreError> {
        let file = OpenOptions::new().append(true).create(true).mode(0o600).open(path);
        file.map(|file| Self(Mutex::new(file))).map_err(|error| JobStoreError::from_io(path, error))
    }

    /// Appends a command with its source and its outcome to the audit log.
    pub fn note<T, E: Error>(&self, by: CommandSource, robot: &str, order: &str, outcome: &Result<T, E>) {
        let error = outcome.as_ref().err().map(ToString::to_string);
        let line = json_line(&AuditRecord { time_utc: utc_now(), source: by, robot, command: order, error });
        let mut file = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Err(error) = file.write_all(line.as_bytes()) {
            log::warn!("cannot record a command in the audit log: {error}");
        }
    }
}
