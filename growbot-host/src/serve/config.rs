//! Which robots the service owns: `[robots.NAME]` of `growbot.toml`.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::path::Path;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::notices::Happening;
use crate::settings::{port_from, robot_from};

/// How fast the time of a simulated robot passes that nobody has configured.
const PRACTICE_PACE: f64 = 60.0;
/// and what it is called.
pub const PRACTICE: &str = "practice";
/// Default limit of the time for the body of a request, s.
const REQUEST_S: u32 = 20;

/// A robot as `growbot.toml` has it.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotEntry {
    /// Its port.
    pub port: String,
    /// Its description: a built-in name or a file. Without it, the board says which built-in one it is.
    pub robot: Option<String>,
    /// How many times as fast as real time the time of `sim:NAME` passes.
    pub pace: Option<f64>,
}

impl RobotEntry {
    /// The robot, of a file in this directory: its paths are relative to that.
    #[must_use]
    pub fn in_directory(self, directory: &Path) -> Self {
        Self {
            port: port_from(&self.port, directory),
            robot: self.robot.map(|robot| robot_from(&robot, directory)),
            pace: self.pace,
        }
    }
}

/// The service as `growbot.toml` has it.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ServeEntry {
    /// The port of the pages' address on this machine.
    pub port: Option<u16>,
    /// Limit of the time for the body of a request, s; 20 without it. The head, and the pause before it, have half of it.
    pub request_s: Option<NonZeroU32>,
    /// Who is told what happens; nobody, unless somebody is named.
    #[serde(default)]
    pub notify: NotifyEntry,
}

impl ServeEntry {
    /// The service, of a file in this directory: its paths are relative to that.
    #[must_use]
    pub fn in_directory(mut self, directory: &Path) -> Self {
        let program = self.notify.command.as_mut().and_then(|command| command.first_mut());
        if let Some(program) = program.filter(|program| program.contains('/')) {
            *program = directory.join(&*program).to_string_lossy().into_owned();
        }
        self
    }

    /// Limit of the time for the body of a request.
    #[must_use]
    pub fn request(&self) -> Duration {
        Duration::from_secs(self.request_s.map_or(REQUEST_S, NonZeroU32::get).into())
    }
}

/// Who is told what happens.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotifyEntry {
    /// An address that is sent each notice, `https:` or `http:`.
    pub webhook: Option<String>,
    /// A program and its arguments, which is run for each notice.
    pub command: Option<Vec<String>>,
    /// What is told; everything without it.
    pub events: Option<Vec<Happening>>,
}

/// The robots of someone who has configured none: a simulated one to practise with.
#[must_use]
pub fn practice(robot: &str) -> BTreeMap<String, RobotEntry> {
    let entry =
        RobotEntry { port: format!("sim:{PRACTICE}"), robot: Some(robot.to_owned()), pace: Some(PRACTICE_PACE) };
    BTreeMap::from([(PRACTICE.to_owned(), entry)])
}
