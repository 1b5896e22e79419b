//! Commands of pages on WebSockets. A browser opens few connections to a host and queues further requests, so a stop by
//! HTTP may wait for other requests of any tab. A message on an open WebSocket does not wait for other requests.

use std::sync::Arc;

use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, State};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_remote::api::CommandRequest;
use serde_json::Value;

use super::access::Access;
use super::command_routes::{send_command, send_live_command};
use super::handler::ServiceState;
use super::problem::Problem;
use super::service::Service;
use crate::watch::sockets::{CommandMessage, limited, serve_commands};

/// Opens a WebSocket, and carries out the commands to any robot that arrive on it.
pub async fn robot_commands(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    serve(upgrade, access, move |message| robot_command(Arc::clone(&service), access, message))
}

/// Opens a WebSocket for the live page of a job, and carries out the commands to the job that arrive on it.
pub async fn job_commands(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Path(job): Path<String>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    serve(upgrade, access, move |message: CommandMessage| {
        let service = Arc::clone(&service);
        let permits = service.permits().with_age(message.age());
        let path = Path((job.clone(), message.command));
        let response = send_live_command(State(service), Extension(access), Extension(permits), path);
        async move { response.await.into_response() }
    })
}

fn serve<R>(
    upgrade: WebSocketUpgrade,
    access: Access,
    carry_out: impl Fn(CommandMessage) -> R + Send + Sync + 'static,
) -> Result<Response, Problem>
where
    R: Future<Output = Response> + Send + 'static,
{
    if access == Access::View {
        return Err(Problem::read_only());
    }
    Ok(limited(upgrade).on_upgrade(|socket| serve_commands(socket, carry_out)))
}

fn robot_command(
    service: Arc<Service>,
    access: Access,
    message: CommandMessage,
) -> impl Future<Output = Response> + Send {
    // The permits are those of the moment at which the message arrived.
    let permits = service.permits().with_age(message.age());
    let command = serde_json::from_value(Value::String(message.command));
    async move {
        match command {
            Ok(command) => {
                let (robot, request) = (Path(message.robot), Json(CommandRequest { command }));
                send_command(State(service), Extension(access), Extension(permits), robot, request)
                    .await
                    .into_response()
            }
            Err(error) => {
                Problem::bad(format!("the message is invalid ({error}): correct the message")).into_response()
            }
        }
    }
}
