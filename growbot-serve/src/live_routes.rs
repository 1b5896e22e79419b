//! Routes of the API that all pages of growbot use: the robots, and the live page of each growth. The service and the
//! pages of a growth in this process have the same routes.

use std::sync::Arc;

use aide::axum::ApiRouter;
use aide::axum::routing::get_with;
use axum::body::Bytes;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json};
use growbot_client::status::RobotStatus;
use growbot_plan::job::Command;
use schemars::JsonSchema;
use serde::Serialize;

use super::access::{Access, require_control};
use super::event_stream::{RobotEvent, robot_events};
use super::limits::RoleLimits;
use super::openapi::{Content, describe, returns, streams};
use super::page_source::{ArrivalPermits, PageSource};
use super::problem::Problem;
use crate::watch::sockets::{CommandMessage, EventSink, command_socket};

type Source<S> = State<Arc<S>>;

/// Returns the routes that show the robots and growths of `S`.
pub fn routes<S: PageSource>() -> ApiRouter<Arc<S>> {
    ApiRouter::new()
        .api_route("/access", get_with(access, describe("getAccess", "Permissions of this URL.")))
        .api_route("/robots", get_with(robots::<S>, describe("listRobots", "All robots.")))
        .api_route("/robots/{robot}", get_with(robot::<S>, describe("getRobot", "One robot.")))
        .api_route(
            "/events",
            get_with(robot_updates::<S>, |operation| {
                let words = "The state of all robots, whenever something changes. `events/ws` has the same events on a \
                             WebSocket.";
                operation.with(describe("streamRobots", words)).with(streams::<RobotEvent>("The events."))
            }),
        )
        .route("/events/ws", get(robot_updates::<S>))
        .api_route(
            "/jobs/{job}/live/",
            get_with(page::<S>, |operation| {
                let words = "The page of a job that grows, with its body in 3D. The paths below it are for the page.";
                operation
                    .with(describe("viewGrowth", words))
                    .with(returns("The page.", &[("text/html", Content::Text)]))
            }),
        )
        .route("/jobs/{job}/live/updates", get(live_updates::<S>))
        .route("/jobs/{job}/live/updates/ws", get(live_updates::<S>))
        .route("/jobs/{job}/live/commands/ws", get(commands::<S>))
        .route("/jobs/{job}/live/commands/{command}", post(command::<S>))
}

/// Rights of an address.
#[derive(Debug, Serialize, JsonSchema)]
struct AccessInfo {
    /// True if the address can send commands. False if it is read-only.
    can_control: bool,
}

async fn access(Extension(access): Extension<Access>) -> Json<AccessInfo> {
    Json(AccessInfo { can_control: access != Access::View })
}

async fn robots<S: PageSource>(State(source): Source<S>) -> Json<Vec<RobotStatus>> {
    Json(source.robots())
}

async fn robot<S: PageSource>(
    State(source): Source<S>,
    Path(name): Path<String>,
) -> Result<Json<RobotStatus>, Problem> {
    let found = source.robots().into_iter().find(|robot| robot.name.as_ref() == Some(&name));
    found.map(Json).ok_or_else(|| Problem::not_found("robot", &name))
}

async fn robot_updates<S: PageSource>(State(source): Source<S>, sink: EventSink) -> Response {
    sink.send(robot_events(source))
}

async fn page<S: PageSource>(
    State(source): Source<S>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(job): Path<String>,
) -> Result<Html<Bytes>, Problem> {
    source.live_page(&job, &limits).await
}

async fn live_updates<S: PageSource>(
    State(source): Source<S>,
    Path(job): Path<String>,
    sink: EventSink,
) -> Result<Response, Problem> {
    Ok(sink.send(source.live_events(&job)?))
}

/// Opens a WebSocket for the live page of a job, and carries out the commands to the job that arrive on it.
async fn commands<S: PageSource>(
    State(source): Source<S>,
    Extension(access): Extension<Access>,
    Path(job): Path<String>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    command_socket(upgrade, access, move |message: CommandMessage| {
        // The permits are those of the moment at which the message arrived.
        let permits = Extension(source.permits(message.age()));
        let path = Path((job.clone(), message.command));
        let response = command(State(Arc::clone(&source)), Extension(access), permits, path);
        async move { response.await.into_response() }
    })
}

async fn command<S: PageSource>(
    State(source): Source<S>,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path((job, name)): Path<(String, String)>,
) -> Result<StatusCode, Problem> {
    let by = require_control(access)?;
    let command: Command = name.parse().map_err(|_| Problem::not_found("command", &name))?;
    source.send_live_command(by, job, command, permits).await?;
    Ok(StatusCode::ACCEPTED)
}
