//! A robot that a command controls.

use std::path::PathBuf;

use growbot_client::growth::{GrowthRequest, LogTarget, OnInterrupted};
use growbot_client::robot_command::RobotCommand;
use growbot_core::link::message::HostSilencePolicy;
use growbot_plan::robot_kind::RobotKind;
use growbot_remote::remote_robot::LeasedPort;

use super::board_report::BoardReport;
use super::body_input::BodyInput;
use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::watch_options::WatchArgs;

/// A robot that a command controls. This program owns its port, or a service does, and the command does not know which.
/// What one of them cannot do is a failure with a remedy.
pub trait RobotHandle {
    /// Returns the kind of the robot.
    fn kind(&self) -> RobotKind;

    /// Requests the status of the robot.
    fn status(&self) -> Result<BoardReport, Failure>;

    /// Sends a command, and waits until the board has carried it out. A running growth only receives a pause or a
    /// continuation. Returns the result as text.
    fn command(&self, command: RobotCommand) -> Result<String, Failure>;

    /// Runs a maintenance task. Returns the result as text.
    fn maintain(&self, task: &str, value: &str) -> Result<String, Failure>;

    /// Shows the growth in progress to its end.
    fn attach(&self, print: ResultFormat) -> Result<(), Failure>;

    /// Grows a body, shows it, and prints its result.
    fn grow(&self, growth: NewGrowth) -> Result<(), Failure>;

    /// Resumes an unfinished body, shows it, and prints its result.
    fn resume(&self, growth: ResumedGrowth) -> Result<(), Failure>;

    /// Leases the port for a command that communicates with the board itself. The lease ends when it is dropped.
    /// `None` if no other program owns the port.
    fn lease(&self, _command: &str) -> Result<Option<LeasedPort>, Failure> {
        Ok(None)
    }
}

/// A growth that a command begins.
pub struct NewGrowth<'a> {
    /// The growth, which has been checked.
    pub request: GrowthRequest<'a>,
    /// Inputs of the growth.
    pub opened: &'a BodyInput,
    /// Name of the growth.
    pub name: String,
    /// Absolute path of the scene. `None` without a scene.
    pub scene_path: Option<String>,
    /// File of the run log.
    pub log: LogTarget,
    /// Reaction of the board if it receives nothing from this program for too long.
    pub silence: HostSilencePolicy,
    /// Page of the growth.
    pub watching: &'a WatchArgs,
    /// Format of the printed result.
    pub print: ResultFormat,
}

/// A growth that a command resumes.
pub struct ResumedGrowth<'a> {
    /// File of the run log or of the plan, with its content. `None` for the latest job of the robot.
    pub opened: Option<(&'a PathBuf, BodyInput)>,
    /// File of the scene, if it is not the one of the plan.
    pub scene: Option<&'a PathBuf>,
    /// Treatment of an interrupted layer.
    pub interrupted: OnInterrupted,
    /// Reaction of the board if it receives nothing from this program for too long.
    pub silence: HostSilencePolicy,
    /// True if the user has confirmed that the robot may heat and move.
    pub is_confirmed: bool,
    /// Page of the growth.
    pub watching: &'a WatchArgs,
    /// Format of the printed result.
    pub print: ResultFormat,
}
