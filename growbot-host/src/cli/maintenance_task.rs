//! Maintenance tasks of a board, for the command and the console.

use growbot_client::client::{Client, ClientError};
use growbot_client::maintenance::{MaterialPresets, task_message};
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{Refusal, State};
use growbot_core::robot::Robot;

use super::failure::Failure;

/// Sends the task of a maintenance command to the board, and returns a description of the task.
pub fn maintain(
    client: &mut Client,
    robot: &Robot,
    presets: &MaterialPresets,
    word: &str,
    rest: &str,
    permit: &Permit,
) -> Result<String, Failure> {
    let Some(task) = presets.task(word, rest, robot) else {
        return Err(Failure::request_failed(format!("unknown maintenance command {word:?}")));
    };
    let task = task.map_err(|error| Failure::during_request(&error))?;
    client.maintain(task, permit).map_err(|error| match error {
        ClientError::Refused { refusal: Refusal::WrongState { state: State::Idle }, .. } => Failure::request_failed(
            format!("{error}: motors turn only while the nozzle is hot; preheat the nozzle first"),
        ),
        error => error.into(),
    })?;
    Ok(format!("{}\n", task_message(task)))
}
