//! Requests to the service, and its responses.

use growbot_client::robot_command::RobotCommand;
use growbot_client::status::RobotStatus;
use growbot_core::link::message::State;
use growbot_plan::run_log::{GrowthResult, OutcomeKind};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use strum::{EnumString, IntoStaticStr};

/// Request to send a command.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(example = serde_json::json!({ "command": "pause" })))]
pub struct CommandRequest {
    /// Command to send.
    pub command: RobotCommand,
}

/// Response to a command or a maintenance task: the result, and the status of the robot after it.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CommandResponse {
    /// Result, as text.
    pub message: String,
    /// Status of the robot.
    #[serde(flatten)]
    pub robot: RobotStatus,
}

/// A maintenance task, as `growbot maintain` runs it.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(example = serde_json::json!({ "task": "preheat", "value": "200" })))]
pub struct MaintenanceRequest {
    /// Name of the task: preheat, cooldown, load, unload, purge, home, rotate or jog.
    pub task: String,
    /// Value of the task: a temperature in C, a length in mm, an angle in degrees, or a material.
    #[serde(default)]
    pub value: String,
}

/// Request to tune the heater of a robot.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(example = serde_json::json!({ "target_c": 210.0 })))]
pub struct TuningRequest {
    /// Target temperature, degrees Celsius. The default is that of a growth.
    #[serde(default)]
    pub target_c: Option<f64>,
}

/// Request for a lease of a robot's port.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LeaseRequest {
    /// Name of the command that requests the port.
    pub holder: String,
}

/// A request to grow or to plan.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(example = serde_json::json!({ "to": "0,0,200,0,90", "name": "a rod" })))]
pub struct GrowRequest {
    /// A plan, in the format that `growbot plan -o` writes. Without it, `to` is required.
    #[cfg_attr(feature = "schema", schemars(with = "Option<serde_json::Value>"))]
    pub plan: Option<Box<RawValue>>,
    /// Goal: X,Y,Z,HEADING,PITCH, or X,Y,Z for any direction.
    pub to: Option<String>,
    /// Start pose, or `tip:JOB` to begin at the tip of the body of this job. It must be the last body of the robot, and
    /// stays in place. The default is `0,0,0,0,90`.
    pub from: Option<String>,
    /// Poses or positions that the path passes through, in order.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(length(max = 100)))]
    pub via: Vec<String>,
    /// Radius of the bends, mm. The default is the robot's planning radius.
    pub radius_mm: Option<f64>,
    /// Scene to keep clear of: the name of a scene that `/scenes` has stored. On the user's socket it can also be the
    /// absolute path of a file.
    #[serde(default)]
    pub scene: Option<String>,
    /// Minimum distance between the outside of the tube and the scene, mm. The default is `margin_mm` of the scene, or
    /// else the deviation that is expected of the robot.
    #[cfg_attr(feature = "schema", schemars(range(min = 0.0, max = 1e7)))]
    pub margin_mm: Option<f64>,
    /// Measure each layer, and plan the rest of the path again from the measured tip.
    #[serde(default)]
    pub feedback: bool,
    /// Grow despite the warnings self-collision, filament-short and layer-limit.
    #[serde(default)]
    pub force: bool,
    /// Grow although the plan is not clear of the scene, and do not keep corrections clear of it.
    #[serde(default)]
    pub ignore_scene: bool,
    /// Name of the job for users.
    #[cfg_attr(feature = "schema", schemars(length(max = 512)))]
    pub name: Option<String>,
}

/// A body that waits for its robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct QueuedBody {
    /// Identifier, also in URLs.
    pub id: String,
    /// Name for users.
    pub name: String,
    /// Number of layers.
    pub layers: u32,
    /// Length of the path, mm.
    pub length_mm: f64,
    /// Time that all layers take on the robot's clock, s.
    pub duration_s: f64,
    /// True if the growth measures each layer, and plans the rest of the path again.
    pub feedback: bool,
    /// True if the body grows despite the warnings of its plan.
    pub force: bool,
    /// True if the body grows without regard to its scene.
    pub ignore_scene: bool,
    /// Time when the body was queued, RFC 3339.
    pub created_utc: String,
}

/// Order to grow a queued body.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(example = serde_json::json!({ "last_body_removed": true })))]
pub struct GrowQueuedRequest {
    /// True if a person has removed the last body from the robot. Otherwise the order is refused.
    pub last_body_removed: bool,
}

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

/// URLs of the service's page. Only growbot's commands can request them, on the user's socket.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
pub struct PageUrls {
    /// URL of the page that can send commands.
    pub control_url: String,
    /// URL of the read-only page.
    pub view_url: String,
}
