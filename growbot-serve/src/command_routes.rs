//! Routes of the API for commands to a robot. Stops and other commands are handled on the thread that accepts
//! connections.

use std::sync::Arc;

use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, State};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_client::robot_command::{CommandOutcome, RobotCommand};
use growbot_client::status::RobotStatus;
use growbot_plan::job::Command;
use growbot_remote::api::{CommandRequest, CommandResponse, MaintenanceRequest, TuningRequest};
use serde_json::Value;

use super::access::{Access, require_control};
use super::commands::{COMMAND_TIMEOUT, full_status, run_command};
use super::handler::{ApiResult, ServiceState, find_robot, run_blocking};
use super::page_source::{ArrivalPermits, PageSource as _};
use super::problem::Problem;
use super::robot_error::RobotRequestError;
use super::robot_request::RobotRequest;
use super::robot_worker::RobotWorker;
use crate::watch::sockets::{CommandMessage, command_socket};

/// Name of the maintenance task that switches the heater off.
const COOL_DOWN: &str = "cooldown";

/// Parts of a request for an order to a robot.
pub type CommandOrder = (ServiceState, Extension<Access>, Extension<ArrivalPermits>, Path<String>);

pub async fn send_command(order: CommandOrder, Json(request): Json<CommandRequest>) -> ApiResult<CommandResponse> {
    command_robot(order, request.command).await
}

/// Opens a WebSocket, and carries out the commands to any robot that arrive on it. A browser opens few connections to a
/// host and queues further requests, so a stop by HTTP may wait for other requests of any tab. A message on an open
/// WebSocket does not wait for other requests.
pub async fn robot_commands(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    command_socket(upgrade, access, move |message: CommandMessage| {
        // The permits are those of the moment at which the message arrived.
        let permits = service.permits(message.age());
        let order = (State(Arc::clone(&service)), Extension(access), Extension(permits), Path(message.robot));
        let command = serde_json::from_value(Value::String(message.command));
        async move {
            match command {
                Ok(command) => command_robot(order, command).await.into_response(),
                Err(error) => {
                    Problem::bad(format!("the message is invalid ({error}): correct the message")).into_response()
                }
            }
        }
    })
}

pub async fn get_full_status(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
) -> ApiResult<RobotStatus> {
    // It is a request to the board, so a client that only looks cannot keep the robot's thread busy with it.
    require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    run_blocking(move || Ok(Json(full_status(&keeper)))).await
}

/// Sends a command to a robot, and returns its result with the robot's status after it.
pub async fn command_robot(
    (State(service), Extension(access), Extension(permits), Path(name)): CommandOrder,
    command: RobotCommand,
) -> ApiResult<CommandResponse> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = if command.stops_or_pauses() { permits.of(&name)? } else { permits.recent(&name)? }.clone();
    run_blocking(move || {
        let given = run_command(&keeper, command, &permit);
        service.shared.audit.note(by, &name, command.name(), &given);
        respond(&keeper, given?)
    })
    .await
}

pub async fn maintain(
    (State(service), Extension(access), Extension(permits), Path(name)): CommandOrder,
    Json(MaintenanceRequest { task, value }): Json<MaintenanceRequest>,
) -> ApiResult<CommandResponse> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = if task == COOL_DOWN { permits.of(&name)? } else { permits.recent(&name)? }.clone();
    run_blocking(move || {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let understood = keeper.presets().task(&task, &value, &robot).map_err(Problem::bad)?;
        let outcome = match keeper.status().job {
            Some(job) => match filament_command(&task, &value) {
                Some(command) if keeper.is_paused() => keeper.order_growth(command, Some(&job), &permit),
                _ => Err(RobotRequestError::MaintenanceDuringJob { robot: name.clone() }),
            },
            None => keeper.request(RobotRequest::Task(understood, permit), COMMAND_TIMEOUT),
        };
        service.shared.audit.note(by, &name, &task, &outcome);
        respond(&keeper, outcome?)
    })
    .await
}

pub async fn tune(
    (State(service), Extension(access), Extension(permits), Path(name)): CommandOrder,
    Json(TuningRequest { target_c }): Json<TuningRequest>,
) -> ApiResult<CommandResponse> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = permits.recent(&name)?.clone();
    run_blocking(move || {
        let growth_c = keeper.description().map_err(Problem::conflict)?.description().heater.target_c;
        let target_c = target_c.unwrap_or(growth_c);
        let outcome = match keeper.status().job {
            Some(_) => Err(RobotRequestError::MaintenanceDuringJob { robot: name.clone() }),
            None => keeper.request(RobotRequest::Tune(target_c, permit), COMMAND_TIMEOUT),
        };
        service.shared.audit.note(by, &name, "tune", &outcome);
        respond(&keeper, outcome?)
    })
    .await
}

/// Returns the response to a command that has this outcome.
fn respond(keeper: &RobotWorker, outcome: CommandOutcome) -> ApiResult<CommandResponse> {
    let message = outcome.message(keeper.is_simulated().into());
    Ok(Json(CommandResponse { message, robot: keeper.status() }))
}

/// Returns the command by which an active growth runs a maintenance task in its pause. `None` for other tasks, and for
/// a task with a value.
fn filament_command(task: &str, value: &str) -> Option<Command> {
    let filament = [Command::Preheat, Command::Unload, Command::Load, Command::Purge];
    filament.into_iter().find(|command| command.name() == task && value.is_empty())
}
