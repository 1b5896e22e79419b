//! Status of a robot, as the service reports it.

use growbot_client::stop_signal::StopLevel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// State of the robot's connection: disconnected, ready or busy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RobotState {
    /// The robot's port is missing, or its board does not respond.
    Disconnected,
    /// The robot is connected and has no job.
    Ready,
    /// The robot has a job.
    Busy,
}

/// A robot, its board and its job, as the service last received them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobotStatus {
    /// Name of the robot in the service.
    pub name: String,
    /// Port of the robot.
    pub port: String,
    /// True if the robot is simulated.
    pub simulated: bool,
    /// Pace of the robot's time, in multiples of real time. Null if it is not known.
    pub pace: Option<f64>,
    /// State of the connection.
    pub state: RobotState,
    /// Reason why the robot is not connected. Null if it is connected.
    pub connection_error: Option<String>,
    /// Name of the robot description. Null until the first connection to the board.
    pub robot: Option<String>,
    /// State of the board. Null if the robot is not connected.
    pub board_state: Option<String>,
    /// Code of the latched fault. Null if no fault is latched.
    pub fault: Option<String>,
    /// Explanation of the fault. Null if no fault is latched.
    pub fault_explanation: Option<String>,
    /// Code of the cause of a pause. Null if the board does not pause.
    pub pause_cause: Option<String>,
    /// Explanation of the pause. Null if the board does not pause.
    pub pause_explanation: Option<String>,
    /// Temperature of the nozzle, C. Null without a reading.
    pub temperature_c: Option<f64>,
    /// Target temperature of the nozzle, C. Null while the heater is off.
    pub target_c: Option<f64>,
    /// Number of laid layers of the job that the board stores.
    pub laid: u32,
    /// Number of layers of the job that the board stores.
    pub layers: u32,
    /// Identifier of the active job. Null if the robot has no job.
    pub job: Option<String>,
    /// Expected time of the last layer, RFC 3339. Null unless the robot grows at a known pace.
    pub finish_utc: Option<String>,
    /// Time since the board's latest report, s. The rest of the status is as old. Null before the first report.
    pub status_age_s: Option<f64>,
    /// True if the latest report is older than 5 s, or if there is none. The board may be in another state by now.
    pub stale: bool,
    /// Reason why the board did not carry out the latest command, or why the run log cannot be written. Null otherwise.
    pub command_error: Option<String>,
    /// Stop that the board has not confirmed. It is sent before anything else, also after a restart of the service.
    /// Null if there is none.
    pub pending_stop: Option<StopLevel>,
}

impl RobotStatus {
    /// Returns a copy of the status without its age, so that two statuses can be compared.
    pub(super) fn without_age(&self) -> Self {
        Self { status_age_s: None, ..self.clone() }
    }
}
