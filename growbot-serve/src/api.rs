//! The HTTP API of the service: the routes of pages, and those for jobs, plans and commands to robots.

use std::sync::Arc;

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use axum::extract::{Path, State};
use axum::routing::{get, post};
use axum::{Extension, Json};
use growbot_client::procedure::Procedure;
use growbot_client::recovery::RecoverySequence;
use growbot_client::robot_command::RobotCommand;
use growbot_remote::api::{Job, PageUrls};
use serde_json::json;

use super::access::Access;
use super::audit::CommandSource;
use super::camera_routes;
use super::command_routes::{
    CommandOrder, command_robot, get_full_status, maintain, robot_commands, send_command, tune,
};
use super::handler::{ApiResult, ServiceState, find_robot};
use super::job_routes::{job, job_log, job_log_lines, job_view, jobs, new_job, resume};
use super::library_routes;
use super::live_routes;
use super::openapi::{Content, describe, describe_creation, returns, with_header, with_order_time};
use super::plan_routes::{new_plan, new_scene, view_plan};
use super::port_lease::lease_port;
use super::problem::Problem;
use super::queue_routes;
use super::service::Service;

/// Returns the routes of the service's API.
pub fn routes() -> ApiRouter<Arc<Service>> {
    live_routes::routes()
        .merge(queue_routes::routes())
        .merge(library_routes::routes())
        .merge(camera_routes::routes())
        .api_route(
            "/robots/{robot}/recovery",
            get_with(
                recovery,
                describe(
                    "getRecovery",
                    "The steps by which a person brings the robot out of a fault, a stop, a pause or a runout. Null if \
                     the robot needs nothing. Each step that is not safe needs a confirmation.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/jobs",
            post_with(new_job, |operation| {
                let words = "Start a job from a plan or a goal. A repeated request with the same Idempotency-Key \
                             returns the existing job.";
                let operation = operation.with(describe_creation::<Job>("startJob", words)).with(with_order_time);
                let key = "Key of the job, for a repetition of the request.";
                let operation = with_header(operation, "idempotency-key", key, &json!({ "type": "string" }));
                operation.response::<200, Json<Job>>()
            }),
        )
        .api_route(
            "/robots/{robot}/status",
            get_with(get_full_status, |operation| {
                let words = "The full status of one robot. The service requests the sensors, the latest fault, the \
                             latest crash and the check of the firmware from the board. They are null if the robot has \
                             a job, is not connected, or does not report them within a second. A read-only address \
                             gets 403.";
                operation.with(describe("getFullStatus", words))
            }),
        )
        .api_route(
            "/robots/{robot}/commands",
            post_with(send_command, |operation| {
                let words = "Send a command. The response to an emergency stop is sent after the board has confirmed \
                             that everything is off. A WebSocket at `commands/ws` takes the same commands.";
                operation.with(describe("sendCommand", words)).with(with_order_time)
            }),
        )
        .api_route(
            "/robots/{robot}/stop",
            post_with(
                |order: CommandOrder| command_robot(order, RobotCommand::Stop),
                describe("stop", "Stop. The body of the request is ignored, and the request waits for no other."),
            ),
        )
        .api_route(
            "/robots/{robot}/emergency-stop",
            post_with(
                |order: CommandOrder| command_robot(order, RobotCommand::EmergencyStop),
                describe(
                    "emergencyStop",
                    "Turn everything off. The body of the request is ignored, and the request waits for no other.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/maintenance",
            post_with(maintain, |operation| {
                let words = "Heat, load, unload, purge, home, rotate or jog.";
                operation.with(describe("maintain", words)).with(with_order_time)
            }),
        )
        .api_route(
            "/robots/{robot}/tuning",
            post_with(tune, |operation| {
                let words = "Find the gains of the heater. The nozzle gets hot for some minutes, and no motor moves. \
                             The status of the robot then has the gains.";
                operation.with(describe("tuneHeater", words)).with(with_order_time)
            }),
        )
        .api_route(
            "/procedures",
            get_with(
                procedures,
                describe(
                    "listProcedures",
                    "The steps of calibration and commissioning, which a person begins. Each step that is not safe \
                     needs a confirmation.",
                ),
            ),
        )
        .api_route("/plans", post_with(new_plan, describe("planPath", "Plan a path; nothing is heated or moved.")))
        .api_route(
            "/scenes",
            post_with(
                new_scene,
                describe(
                    "uploadScene",
                    "Store a scene for planning: a scene file that names no other files, a mesh or a point cloud.",
                ),
            ),
        )
        .api_route("/jobs", get_with(jobs, describe("listJobs", "The latest jobs, newest first.")))
        .api_route("/jobs/{job}", get_with(job, describe("getJob", "One job.")))
        .api_route(
            "/jobs/{job}/resume",
            post_with(resume, |operation| {
                operation.with(describe("resumeJob", "Resume an unfinished job.")).with(with_order_time)
            }),
        )
        .api_route(
            "/plans/{number}/view",
            get_with(view_plan, |operation| {
                let words = "The page of a plan, with its body in 3D.";
                operation.with(describe("viewPlan", words)).with(returns("The page.", &[("text/html", Content::Text)]))
            }),
        )
        .api_route(
            "/jobs/{job}/view",
            get_with(job_view, |operation| {
                let words = "The page of a job, with its body in 3D as it was planned and as it was built.";
                operation.with(describe("viewJob", words)).with(returns("The page.", &[("text/html", Content::Text)]))
            }),
        )
        .api_route(
            "/jobs/{job}/log",
            get_with(job_log, |operation| {
                let words = "The run log of a job.";
                let log = "Lines of JSON, as the book describes them under Files.";
                operation.with(describe("getJobLog", words)).with(returns(log, &[("application/jsonl", Content::Text)]))
            }),
        )
        .api_route(
            "/jobs/{job}/events",
            get_with(job_log_lines, |operation| {
                let words = "The lines of a job's run log, each once, until the job ends. `jobs/{job}/events/ws` has \
                             the same events on a WebSocket.";
                let events = "Events with the name `log`. Their `id` is the number of the line, their `data` is the \
                              line.";
                let id = "Number of the log line after which the stream starts.";
                let operation = operation.with(describe("streamJobLog", words));
                let number = json!({ "type": "integer", "minimum": 0 });
                let operation = with_header(operation, "last-event-id", id, &number);
                operation.with(returns(events, &[("text/event-stream", Content::Text)]))
            }),
        )
        .route("/robots/{robot}/port-lease", post(lease_port))
        .route("/page-urls", get(addresses))
        .route("/jobs/{job}/events/ws", get(job_log_lines))
        .route("/commands/ws", get(robot_commands))
}

async fn addresses(State(service): ServiceState, Extension(access): Extension<Access>) -> ApiResult<PageUrls> {
    match access {
        Access::Control(CommandSource::Socket) => Ok(Json(service.addresses.get().cloned().unwrap_or_default())),
        _ => Err(Problem::forbidden("only commands on the service's machine may read the URLs")),
    }
}

async fn procedures() -> Json<Vec<Procedure>> {
    Json(Procedure::all().into())
}

async fn recovery(State(service): ServiceState, Path(name): Path<String>) -> ApiResult<Option<RecoverySequence>> {
    Ok(Json(RecoverySequence::of(&find_robot(&service, &name)?.status())))
}
