//! Settings of the service in `growbot.toml`, and the robots that it owns: `[robots.NAME]`.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::path::Path;
use std::time::Duration;

use schemars::JsonSchema;
use serde::de::Error;
use serde::{Deserialize, Deserializer};

use super::notification::NotificationEvent;
use crate::settings_paths::{port_from, robot_from};
use crate::watch::allowed_origins::Origin;

/// Pace of the practice robot's time, in multiples of real time.
const PRACTICE_PACE: f64 = 60.0;
/// Name of the practice robot, a simulated robot that is used if no robot is configured.
pub const PRACTICE: &str = "practice";
/// Default timeout of a request's body, s.
const REQUEST_S: u32 = 20;

/// A robot in `growbot.toml`.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotEntry {
    /// Port of the robot.
    pub port: String,
    /// Robot description: a built-in name or a file. The default is the built-in description whose name the board
    /// reports.
    pub robot: Option<String>,
    /// Pace of the time of a simulated robot `sim:NAME`, in multiples of real time. The default is 1.
    pub pace: Option<f64>,
}

impl RobotEntry {
    /// Returns the entry with its paths resolved relative to the directory of `growbot.toml`.
    #[must_use]
    pub fn in_directory(self, directory: &Path) -> Self {
        Self {
            port: port_from(&self.port, directory),
            robot: self.robot.map(|robot| robot_from(&robot, directory)),
            pace: self.pace,
        }
    }
}

/// Settings of the service in `growbot.toml`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ServeEntry {
    /// TCP port of the service's pages on this machine.
    pub port: Option<u16>,
    /// Timeout of a request's body, s. The default is 20. The timeout of a request's head, and that of the pause before
    /// it, are half as long.
    pub request_s: Option<NonZeroU32>,
    /// Origins of the reverse proxies that show the pages, such as `https://robots.example`.
    #[serde(default)]
    pub origins: Vec<Origin>,
    /// Receivers of notices. By default there are none.
    #[serde(default)]
    pub notify: NotifyEntry,
    /// Address of the camera of each robot that has one, `https:` or `http:`: of a picture or of an MJPEG stream.
    #[serde(default, deserialize_with = "read_cameras")]
    pub cameras: BTreeMap<String, String>,
}

impl ServeEntry {
    /// Returns the settings with their paths resolved relative to the directory of `growbot.toml`.
    #[must_use]
    pub fn in_directory(mut self, directory: &Path) -> Self {
        let program = self.notify.command.as_mut().and_then(|command| command.first_mut());
        if let Some(program) = program.filter(|program| program.contains('/')) {
            *program = directory.join(&*program).to_string_lossy().into_owned();
        }
        self
    }

    /// Returns the timeout of a request's body.
    pub fn request(&self) -> Duration {
        Duration::from_secs(self.request_s.map_or(REQUEST_S, NonZeroU32::get).into())
    }
}

/// Reads the table of cameras. An error repeats no value, because it may contain a secret.
fn read_cameras<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<String, String>, D::Error> {
    BTreeMap::deserialize(from).map_err(|_| {
        D::Error::custom("give the address of each robot's camera as a text: [serve.cameras], lab-1 = \"http://...\"")
    })
}

/// Receivers of notices about the robots.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotifyEntry {
    /// Address of a webhook that receives each notice, `https:` or `http:`.
    pub webhook: Option<String>,
    /// Program, with its arguments, that is run for each notice.
    pub command: Option<Vec<String>>,
    /// Events about which notices are sent. The default is all events.
    pub events: Option<Vec<NotificationEvent>>,
}

/// Returns the robots of a service without configured robots: one simulated robot to practise with, with this robot
/// description.
pub fn practice(robot: &str) -> BTreeMap<String, RobotEntry> {
    let entry =
        RobotEntry { port: format!("sim:{PRACTICE}"), robot: Some(robot.to_owned()), pace: Some(PRACTICE_PACE) };
    BTreeMap::from([(PRACTICE.to_owned(), entry)])
}
