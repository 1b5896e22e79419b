//! The HTTP API of the service: its routes, from which the OpenAPI document is generated, and the rights of its
//! clients.

use std::sync::Arc;

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use aide::openapi::{Info, OpenApi};
use aide::transform::TransformOperation;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{Method, Uri};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use growbot_client::status::RobotStatus;
use growbot_remote::api::{PageUrls, RobotCommand};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use super::audit::CommandSource;
use super::command_routes::{command_robot, maintain, send_command, send_live_command};
use super::handler::{ApiResult, ServiceState, find_robot};
use super::job_routes::{job, job_log, job_view, jobs, live, live_update_socket, live_updates, new_job, resume};
use super::plan_routes::{new_plan, new_scene, view_plan};
use super::port_lease::lease_port;
use super::problem::Problem;
use super::request_kind::MAX_BODY;
use super::service::Service;
use super::{command_socket, event_routes, openapi};
use crate::access::Access;

/// Returns the router of the API, and the OpenAPI document of its main routes.
pub fn routes() -> (Router<Arc<Service>>, Value) {
    let mut document = OpenApi {
        info: Info {
            title: "growbot serve".to_owned(),
            description: Some(
                "Robots, their jobs, and commands to them. Lengths are in mm, angles in degrees, temperatures in C: \
                 names carry the unit. Requests carry the access token of the URLs that `growbot serve` prints, as \
                 `Authorization: Bearer TOKEN`; requests on the Unix socket in the user's runtime directory need none."
                    .to_owned(),
            ),
            version: "1".to_owned(),
            ..Info::default()
        },
        ..OpenApi::default()
    };
    let router = ApiRouter::new()
        .api_route("/access", get_with(access, describe("Permissions of this URL.")))
        .api_route("/robots", get_with(robots, describe("All robots.")))
        .api_route("/robots/{robot}", get_with(robot, describe("One robot.")))
        .api_route(
            "/robots/{robot}/jobs",
            post_with(
                new_job,
                describe(
                    "Start a job from a plan or a goal. A repeated request with the same Idempotency-Key returns the \
                     existing job.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/commands",
            post_with(
                send_command,
                describe(
                    "Send a command. The response to an emergency stop is sent after the board has confirmed that \
                     everything is off.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/stop",
            post_with(
                |state, access, permits, name| command_robot(state, access, permits, name, RobotCommand::Stop),
                describe("Stop. The body of the request is ignored, and the request waits for no other."),
            ),
        )
        .api_route(
            "/robots/{robot}/emergency-stop",
            post_with(
                |state, access, permits, name| command_robot(state, access, permits, name, RobotCommand::EmergencyStop),
                describe(
                    "Turn everything off. The body of the request is ignored, and the request waits for no other.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/maintenance",
            post_with(
                maintain,
                describe("Heat, load, unload, purge, home, rotate or jog, as `growbot maintain` does."),
            ),
        )
        .api_route("/plans", post_with(new_plan, describe("Plan a path; nothing is heated or moved.")))
        .api_route(
            "/scenes",
            post_with(
                new_scene,
                describe(
                    "Store a scene for planning: a scene file that names no other files, a mesh or a point cloud.",
                ),
            ),
        )
        .api_route("/jobs", get_with(jobs, describe("The latest jobs, newest first.")))
        .api_route("/jobs/{job}", get_with(job, describe("One job.")))
        .api_route("/jobs/{job}/resume", post_with(resume, describe("Resume an unfinished job.")))
        .route("/robots/{robot}/port-lease", post(lease_port))
        .route("/page-urls", get(addresses))
        .route("/plans/{number}/view", get(view_plan))
        .route("/jobs/{job}/log", get(job_log))
        .route("/jobs/{job}/view", get(job_view))
        .route("/jobs/{job}/live/", get(live))
        .route("/jobs/{job}/live/updates", get(live_updates))
        .route("/jobs/{job}/live/updates/ws", get(live_update_socket))
        .route("/jobs/{job}/live/commands/ws", get(command_socket::job_commands))
        .route("/jobs/{job}/live/commands/{command}", post(send_live_command))
        .route("/jobs/{job}/events", get(event_routes::job_stream))
        .route("/jobs/{job}/events/ws", get(event_routes::job_socket))
        .route("/events", get(event_routes::robot_stream))
        .route("/events/ws", get(event_routes::robot_socket))
        .route("/commands/ws", get(command_socket::robot_commands))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .finish_api(&mut document);
    (router, openapi::complete(&document))
}

/// Returns a function that sets the description of an operation in the OpenAPI document, and problem details as its
/// default response.
fn describe(words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.description(words).default_response::<Problem>()
}

/// Rejects a request for a path that this release does not have.
pub async fn unknown_route(method: Method, uri: Uri) -> Problem {
    Problem::unknown_route(&method, uri.path())
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

async fn addresses(State(service): ServiceState, Extension(access): Extension<Access>) -> ApiResult<PageUrls> {
    match access {
        Access::Control(CommandSource::Socket) => Ok(Json(service.addresses.get().cloned().unwrap_or_default())),
        _ => Err(Problem::forbidden("only commands on the service's machine may read the URLs")),
    }
}

async fn robots(State(service): ServiceState) -> Json<Vec<RobotStatus>> {
    Json(service.robots())
}

async fn robot(State(service): ServiceState, Path(name): Path<String>) -> ApiResult<RobotStatus> {
    Ok(Json(find_robot(&service, &name)?.status()))
}
