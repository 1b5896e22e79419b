//! A job of the service, and its state.

use growbot_core::link::message::State;
use growbot_plan::run_log::{GrowthResult, OutcomeKind};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

/// State of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, EnumString, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum JobState {
    /// The board has the job or is receiving it, and heats, homes, grows or pauses.
    Active,
    /// The job was left unfinished and can be resumed.
    Interrupted,
    /// All layers are laid.
    Done,
    /// The job ended in another way and cannot be resumed by the service.
    Failed,
}

impl JobState {
    /// Returns the name of the state in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the state of a job after a growth with this outcome.
    pub fn from_outcome(outcome: OutcomeKind) -> Self {
        match outcome {
            OutcomeKind::Done => Self::Done,
            OutcomeKind::Refused => Self::Failed,
            _ => Self::Interrupted,
        }
    }
}

/// A job of the service.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Job {
    /// Identifier, also in URLs: the time of the job's creation, then the name of the robot.
    pub id: String,
    /// Name of the robot in the service.
    pub robot: String,
    /// Name for users.
    pub name: String,
    /// State of the job.
    pub state: JobState,
    /// Hash of the layers when the job was created, 16 hexadecimal digits.
    pub plan_id: String,
    /// Number of layers.
    pub layers: u32,
    /// Number of laid layers.
    pub laid: u32,
    /// Length of the path, mm.
    pub length_mm: f64,
    /// True if the robot is simulated.
    pub simulated: bool,
    /// True if the body was grown without regard to its scene.
    pub ignore_scene: bool,
    /// Time of creation, RFC 3339.
    pub created_utc: String,
    /// Time when the job ended, RFC 3339. Null while it is active.
    pub ended_utc: Option<String>,
    /// Outcome of the job, or the reason why it was interrupted or failed. Null while it is active.
    pub reason: Option<String>,
}

/// Returns the value of [`Job::reason`] for a job that ended with this result, while its board was in this state.
pub fn end_reason(result: &GrowthResult, board_state: Option<&str>) -> String {
    let emergency_stop = Some(State::EmergencyStop.name()).filter(|name| board_state == Some(*name));
    let stop = emergency_stop.filter(|_| result.outcome == OutcomeKind::Stopped);
    result.fault.clone().unwrap_or_else(|| stop.unwrap_or(result.outcome.name()).to_owned())
}
