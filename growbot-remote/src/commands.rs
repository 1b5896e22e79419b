//! Commands to a robot of the service.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

/// Command to a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum RobotCommand {
    /// Pause after the current layer.
    Pause,
    /// Continue after a pause.
    Continue,
    /// Turn off heater and steppers. The body can be resumed.
    Stop,
    /// Turn everything off, before any other command.
    EmergencyStop,
    /// Clear a fault or an emergency stop.
    ClearFault,
    /// Discard the body that hangs on the robot.
    Cancel,
    /// Drop a stop that the board has not confirmed.
    WithdrawStop,
}

impl RobotCommand {
    /// Returns true if the command stops or pauses the robot. Such a command is never refused because of its age.
    pub fn stops_or_pauses(self) -> bool {
        matches!(self, Self::Pause | Self::Stop | Self::EmergencyStop)
    }

    /// Returns the name of the command in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Request to send a command.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CommandRequest {
    /// Command to send.
    pub command: RobotCommand,
}

/// A maintenance task, as `growbot maintain` runs it.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MaintenanceRequest {
    /// Name of the task: preheat, cooldown, load, unload, purge, home, rotate or jog.
    pub task: String,
    /// Value of the task: a temperature in C, a length in mm, an angle in degrees, or a material.
    #[serde(default)]
    pub value: String,
}

/// Request for a lease of a robot's port.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LeaseRequest {
    /// Name of the command that requests the port.
    pub holder: String,
}
