//! Routes of the API for commands to a robot. Stops and other commands are handled on the thread that accepts
//! connections.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_client::status::RobotStatus;
use growbot_plan::job::Command;
use growbot_remote::api::{CommandRequest, MaintenanceRequest, RobotCommand};

use super::access::{Access, require_control};
use super::commands::{COMMAND_TIMEOUT, run_command};
use super::handler::{ApiResult, ServiceState, find_robot, found_job, run_blocking};
use super::problem::Problem;
use super::robot_error::RobotRequestError;
use super::robot_request::RobotRequest;
use super::robot_worker::RobotWorker;
use super::service::{ArrivalPermits, Service};
use crate::watch::server as watch;

/// Name of the maintenance task that switches the heater off.
const COOL_DOWN: &str = "cooldown";

pub async fn send_command(
    state: ServiceState,
    access: Extension<Access>,
    permits: Extension<ArrivalPermits>,
    name: Path<String>,
    Json(CommandRequest { command }): Json<CommandRequest>,
) -> ApiResult<RobotStatus> {
    command_robot(state, access, permits, name, command).await
}

/// Sends a command to a robot, and returns the robot's status after the command.
pub async fn command_robot(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path(name): Path<String>,
    command: RobotCommand,
) -> ApiResult<RobotStatus> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = if command.stops_or_pauses() { permits.of(&name)? } else { permits.recent(&name)? }.clone();
    run_blocking(move || {
        let given = run_command(&keeper, command, &permit);
        service.shared.audit.note(by, &name, command.name(), &given);
        given?;
        Ok(Json(keeper.status()))
    })
    .await
}

pub async fn maintain(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path(name): Path<String>,
    Json(MaintenanceRequest { task, value }): Json<MaintenanceRequest>,
) -> ApiResult<RobotStatus> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = if task == COOL_DOWN { permits.of(&name)? } else { permits.recent(&name)? }.clone();
    run_blocking(move || {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let understood = keeper.presets().task(&task, &value, &robot);
        let outcome = match (understood, keeper.status().job) {
            (None, _) => {
                return Err(Problem::bad(format!(
                    "unknown maintenance task {task:?}: give preheat, cooldown, load, unload, purge, home, rotate or \
                     jog"
                )));
            }
            (Some(Err(why)), _) => return Err(Problem::bad(why)),
            (Some(Ok(_)), Some(_)) => Err(RobotRequestError::MaintenanceDuringJob { robot: name.clone() }),
            (Some(Ok(task)), None) => keeper.request(RobotRequest::Task(task, permit), COMMAND_TIMEOUT),
        };
        service.shared.audit.note(by, &name, &task, &outcome);
        outcome?;
        Ok(Json(keeper.status()))
    })
    .await
}

pub async fn send_live_command(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path((id, order)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let by = require_control(access)?;
    let keeper = find_robot_of_job(&service, &id).await?;
    let stops = [(Command::Stop, RobotCommand::Stop), (Command::EmergencyStop, RobotCommand::EmergencyStop)];
    let Some((_, stop)) = stops.into_iter().find(|(command, _)| command.name() == order) else {
        let live = keeper.live(&id).ok_or_else(|| {
            Problem::conflict(format!(
                "job {id} accepts no commands, because it is not active or its robot is not connected: check the \
                 robot's state"
            ))
        })?;
        let answer = watch::send_command(&live, &order, &permits.age).await;
        if answer.status().is_success() {
            service.shared.audit.note(by, &keeper.name, &order, &Ok::<_, Problem>(()));
        }
        return Ok(answer);
    };
    let permit = permits.of(&keeper.name)?.clone();
    run_blocking(move || {
        let given = run_command(&keeper, stop, &permit);
        service.shared.audit.note(by, &keeper.name, &order, &given);
        Ok(given?)
    })
    .await?;
    Ok(StatusCode::ACCEPTED.into_response())
}

/// Returns the robot of a job. The robot of an active job is found without the list of jobs, so that a stop does not
/// wait for the database.
async fn find_robot_of_job(service: &Arc<Service>, id: &str) -> Result<Arc<RobotWorker>, Problem> {
    if let Some(worker) = service.robots.values().find(|worker| worker.lock_state().job.as_deref() == Some(id)) {
        return Ok(Arc::clone(worker));
    }
    let (list, id) = (Arc::clone(service), id.to_owned());
    let job = run_blocking(move || found_job(&list, &id)).await?;
    find_robot(service, &job.robot).cloned()
}
