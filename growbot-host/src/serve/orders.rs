//! Commands to a robot, and the waits for their effect.

use std::time::{Duration, Instant};

use growbot_client::growth::Command;
use growbot_core::link::message::State as BoardState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::robot::{Ask, Keeper};

/// Timeout of a robot's response to a command.
pub(super) const ANSWER: Duration = Duration::from_secs(10);
/// Timeout of an emergency stop.
const EMERGENCY: Duration = Duration::from_secs(2);
/// Time within which an active growth that processes commands carries out an emergency stop.
const AT_ONCE: Duration = Duration::from_millis(60);
/// Time within which a robot without a growth carries out an emergency stop, unless it is busy with another request.
const SOON: Duration = Duration::from_millis(250);
/// Message after an emergency stop that failed.
const NOT_OFF: &str = "nobody has acknowledged the emergency stop: cut the power of the robot now";

/// A command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OrderName {
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

impl OrderName {
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
pub struct Given {
    /// Command to send.
    pub order: OrderName,
}

/// Sends a command. Waits until the robot has carried it out, except for pause and continue, which the growth only
/// queues.
pub(super) fn give(keeper: &Keeper, order: OrderName) -> Result<(), String> {
    let of_growth = match order {
        OrderName::Pause => Some(Command::Pause),
        OrderName::Continue => Some(Command::Continue),
        OrderName::Stop => Some(Command::Stop),
        OrderName::EmergencyStop => Some(Command::EmergencyStop),
        OrderName::ClearFault | OrderName::Cancel => None,
    };
    match (order, of_growth) {
        (OrderName::EmergencyStop, Some(stop)) if keeper.order(stop) => wait_until_off(keeper),
        (OrderName::EmergencyStop, _) => keeper
            .ask(Ask::EmergencyStop, SOON)
            .or_else(|_| keeper.stop_beside())
            .map_err(|why| format!("{NOT_OFF} ({why})")),
        (OrderName::Stop, Some(stop)) if keeper.order(stop) => wait_until_stopped(keeper),
        (_, Some(order)) if keeper.order(order) => Ok(()),
        (OrderName::Stop, _) => keeper.ask(Ask::Stop, ANSWER),
        (OrderName::ClearFault, _) => keeper.ask(Ask::ClearFault, ANSWER),
        (OrderName::Cancel, _) if keeper.view().job.is_some() => {
            Err(format!("robot {} has a job under way: stop it first", keeper.name))
        }
        (OrderName::Cancel, _) => keeper.ask(Ask::Cancel, ANSWER),
        (OrderName::Pause | OrderName::Continue, _) => {
            Err(format!("robot {} has no job under way, so there is nothing to {}", keeper.name, order.name()))
        }
    }
}

/// Waits until the board has reported the emergency stop. If the growth is still waiting for the board, sends the stop
/// on another connection.
fn wait_until_off(keeper: &Keeper) -> Result<(), String> {
    let began = Instant::now();
    let mut is_sent_beside = false;
    loop {
        if keeper.view().board.as_deref() == Some(BoardState::EmergencyStop.name()) {
            return Ok(());
        }
        if began.elapsed() > EMERGENCY {
            return Err(NOT_OFF.to_owned());
        }
        if began.elapsed() > AT_ONCE && !is_sent_beside {
            is_sent_beside = true;
            if keeper.stop_beside().is_ok() {
                return Ok(());
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits until the growth has ended. It ends when the board has confirmed that it is off.
fn wait_until_stopped(keeper: &Keeper) -> Result<(), String> {
    let began = Instant::now();
    loop {
        let view = keeper.view();
        if let Some(trouble) = view.trouble {
            return Err(format!(
                "the stop is given when the robot {} is there again ({trouble}): give the emergency stop, or cut its \
                 power, if it must be off now",
                keeper.name
            ));
        }
        if view.job.is_none() {
            return Ok(());
        }
        if began.elapsed() > ANSWER {
            let (robot, limit) = (&keeper.name, ANSWER.as_secs());
            return Err(format!(
                "robot {robot} has not confirmed the stop within {limit} s: give the emergency stop, or cut its power"
            ));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
