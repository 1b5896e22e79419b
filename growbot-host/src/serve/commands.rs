//! Commands to a robot, and the waits for their effect.

use std::time::{Duration, Instant};

use growbot_client::growth::Command;
use growbot_core::link::message::State as BoardState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::robot_worker::{RobotRequest, RobotWorker};

/// Timeout of a robot's response to a command.
pub(super) const COMMAND_TIMEOUT: Duration = Duration::from_secs(10);
/// Timeout of an emergency stop.
const ESTOP_TIMEOUT: Duration = Duration::from_secs(2);
/// Time within which an active growth that processes commands carries out an emergency stop.
const ESTOP_OUT_OF_BAND_DELAY: Duration = Duration::from_millis(60);
/// Time within which a robot without a growth carries out an emergency stop, unless it is busy with another request.
const ESTOP_IDLE_TIMEOUT: Duration = Duration::from_millis(250);
/// Message after an emergency stop that failed.
const ESTOP_UNCONFIRMED: &str = "the board did not confirm the emergency stop: cut the robot's power now";

/// A command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
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
}

impl RobotCommand {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::Continue => "continue",
            Self::Stop => "stop",
            Self::EmergencyStop => "emergency-stop",
            Self::ClearFault => "clear-fault",
            Self::Cancel => "cancel",
        }
    }
}

/// Request to send a command.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CommandRequest {
    /// Command to send.
    pub command: RobotCommand,
}

/// Sends a command. Waits until the robot has carried it out, except for pause and continue, which the growth only
/// queues.
pub(super) fn run_command(keeper: &RobotWorker, order: RobotCommand) -> Result<(), String> {
    let of_growth = match order {
        RobotCommand::Pause => Some(Command::Pause),
        RobotCommand::Continue => Some(Command::Continue),
        RobotCommand::Stop => Some(Command::Stop),
        RobotCommand::EmergencyStop => Some(Command::EmergencyStop),
        RobotCommand::ClearFault | RobotCommand::Cancel => None,
    };
    match (order, of_growth) {
        (RobotCommand::EmergencyStop, Some(stop)) if keeper.send_command(stop) => wait_until_off(keeper),
        (RobotCommand::EmergencyStop, _) => keeper
            .request(RobotRequest::EmergencyStop, ESTOP_IDLE_TIMEOUT)
            .or_else(|_| keeper.emergency_stop_out_of_band())
            .map_err(|why| format!("{ESTOP_UNCONFIRMED} ({why})")),
        (RobotCommand::Stop, Some(stop)) if keeper.send_command(stop) => wait_until_stopped(keeper),
        (_, Some(order)) if keeper.send_command(order) => Ok(()),
        (RobotCommand::Stop, _) => keeper.request(RobotRequest::Stop, COMMAND_TIMEOUT),
        (RobotCommand::ClearFault, _) => keeper.request(RobotRequest::ClearFault, COMMAND_TIMEOUT),
        (RobotCommand::Cancel, _) if keeper.status().job.is_some() => {
            Err(format!("robot {} has an active job: stop the job first", keeper.name))
        }
        (RobotCommand::Cancel, _) => keeper.request(RobotRequest::Cancel, COMMAND_TIMEOUT),
        (RobotCommand::Pause | RobotCommand::Continue, _) => {
            Err(format!("robot {} has no active job, so there is nothing to {}", keeper.name, order.name()))
        }
    }
}

/// Waits until the board has reported the emergency stop. If the growth is still waiting for the board, sends the stop
/// on another connection.
fn wait_until_off(keeper: &RobotWorker) -> Result<(), String> {
    let began = Instant::now();
    let mut is_sent_beside = false;
    loop {
        if keeper.status().board_state.as_deref() == Some(BoardState::EmergencyStop.name()) {
            return Ok(());
        }
        if began.elapsed() > ESTOP_TIMEOUT {
            return Err(ESTOP_UNCONFIRMED.to_owned());
        }
        if began.elapsed() > ESTOP_OUT_OF_BAND_DELAY && !is_sent_beside {
            is_sent_beside = true;
            if keeper.emergency_stop_out_of_band().is_ok() {
                return Ok(());
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits until the growth has ended. It ends when the board has confirmed that it is off.
fn wait_until_stopped(keeper: &RobotWorker) -> Result<(), String> {
    let began = Instant::now();
    loop {
        let view = keeper.status();
        if let Some(trouble) = view.connection_error {
            return Err(format!(
                "the stop will be sent when robot {} is connected again ({trouble}): if it must be off now, send the \
                 emergency stop or cut its power",
                keeper.name
            ));
        }
        if view.job.is_none() {
            return Ok(());
        }
        if began.elapsed() > COMMAND_TIMEOUT {
            let (robot, limit) = (&keeper.name, COMMAND_TIMEOUT.as_secs());
            return Err(format!(
                "robot {robot} did not confirm the stop within {limit} s: send the emergency stop, or cut its power"
            ));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
