//! Who has ordered what: a file that only grows.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use growbot_client::printable::json_line;
use growbot_client::run_log::utc_now;
use serde::Serialize;

use super::JobsError;

/// The file.
pub struct Audit(Mutex<File>);

/// Where an order comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum By {
    /// A page or a program that knows the operating token.
    Page,
    /// A command of the user's.
    Command,
}

/// An order as it is kept.
#[derive(Serialize)]
struct Line<'a> {
    time_utc: String,
    by: By,
    robot: &'a str,
    order: &'a str,
    /// None where it was carried out, or taken on.
    refused: Option<&'a str>,
}

impl Audit {
    pub fn open(path: &Path) -> Result<Self, JobsError> {
        let file = OpenOptions::new().append(true).create(true).mode(0o600).open(path);
        file.map(|file| Self(Mutex::new(file))).map_err(|error| JobsError::of(path, &error))
    }

    /// Notes an order, and why it was refused if it was.
    pub fn note(&self, by: By, robot: &str, order: &str, refused: Option<&str>) {
        let line = json_line(&Line { time_utc: utc_now(), by, robot, order, refused });
        let mut file = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Err(error) = file.write_all(line.as_bytes()) {
            crate::warning!("an order could not be noted: {error}");
        }
    }
}
