//! Commands to a robot, and what they have done. The command line, the console, the service with its page, and Python
//! send these commands and show these outcomes.

use growbot_core::link::message::{MaintenanceTask, State};
use growbot_plan::job::Command;
use growbot_plan::robot_kind::RobotKind;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::maintenance::task_message;

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

/// Way in which [`crate::client::Client::stop`] has stopped a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopOutcome {
    /// The board has executed the request to stop. The body can be resumed.
    #[default]
    ByRequest,
    /// The board has confirmed the emergency stop, because it did not respond to the request to stop, or because
    /// another user sent the emergency stop at the same time.
    ByEmergencyStop,
}

impl StopOutcome {
    /// Returns a message for the user.
    pub fn message(self, robot: RobotKind) -> String {
        let kind = robot.prefix();
        match self {
            Self::ByRequest => format!("stopped: heater and steppers of the {kind}robot are off"),
            Self::ByEmergencyStop => format!(
                "emergency stop, because the board did not respond to the stop request: heater and steppers of the \
                 {kind}robot are off until the emergency stop is cleared"
            ),
        }
    }
}

/// Effect of a command or another request on a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CommandOutcome {
    /// Heater and steppers are off.
    Stopped(StopOutcome),
    /// Heater and steppers are off until the emergency stop is cleared.
    EmergencyStopped,
    /// The board has discarded a body of which it had laid this number of layers.
    Cancelled {
        /// Plan id of the body.
        plan_id: u64,
        /// Number of laid layers.
        laid: u32,
    },
    /// The board had no body to discard.
    NothingToCancel,
    /// The board has left this state, a fault or an emergency stop.
    Cleared(State),
    /// The board was in this state, which is neither a fault nor an emergency stop.
    NothingToClear(State),
    /// An unconfirmed stop will not be sent again.
    StopWithdrawn,
    /// The growth in progress has received this command, and carries it out as soon as it can.
    Ordered(Command),
    /// The board runs this task.
    Task(MaintenanceTask),
    /// The board tunes its heater at this temperature, degrees Celsius.
    TuningStarted {
        /// Target temperature, degrees Celsius.
        target_c: f64,
    },
    /// A growth has begun.
    Started,
    /// The board has reported its details.
    Reported,
    /// The port is closed, so that another program can use it.
    PortReleased,
}

impl CommandOutcome {
    /// Returns a message for the user.
    pub fn message(self, robot: RobotKind) -> String {
        let kind = robot.prefix();
        match self {
            Self::Stopped(stopped) => stopped.message(robot),
            Self::EmergencyStopped => format!("emergency stop: heater and steppers of the {kind}robot are off"),
            Self::Cancelled { plan_id, laid } => {
                format!("plan {plan_id:016x} discarded by the {kind}board after {laid} layers")
            }
            Self::NothingToCancel => {
                format!("the {kind}board stores no body: there is nothing to discard; heater and steppers are off")
            }
            Self::Cleared(state) => format!("the {} is cleared: the {kind}robot accepts jobs again", state.name()),
            Self::NothingToClear(state) => {
                format!("there is nothing to clear: the {kind}robot is in the state {}", state.name())
            }
            Self::StopWithdrawn => format!("the stop of the {kind}robot is withdrawn"),
            Self::Ordered(Command::Pause) => format!("the {kind}robot was ordered to pause after its layer"),
            Self::Ordered(command) => format!("the {kind}robot was ordered to {}", command.name()),
            Self::Task(task) if robot.is_simulated() => format!("simulated robot: {}", task_message(task)),
            Self::Task(task) => task_message(task),
            Self::TuningStarted { target_c } => format!(
                "the {kind}robot tunes its heater at {target_c} C, which takes some minutes: the nozzle gets hot, and \
                 no motor moves"
            ),
            // No command has these outcomes.
            Self::Started | Self::Reported | Self::PortReleased => format!("the {kind}robot has responded"),
        }
    }
}
