//! Routes of the API for the queue of a robot.

use std::sync::Arc;

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::HeaderMap;
use axum::{Extension, Json};
use growbot_plan::plan_file::PlanFile;
use growbot_plan::run_log::utc_now;
use growbot_remote::api::{GrowQueuedRequest, GrowRequest, Job, QueuedBody};
use serde_json::value::to_raw_value;

use super::access::{Access, require_control};
use super::audit::CommandSource;
use super::grow_request::resolve_request;
use super::handler::{ApiResult, ServiceState, find_robot, run_blocking};
use super::job_routes::{NewJobResponse, check_body, job_name, start_job};
use super::json_body::JsonBody;
use super::limits::RoleLimits;
use super::openapi::{describe, describe_creation, with_order_time};
use super::page_source::ArrivalPermits;
use super::problem::Problem;
use super::queue_store::{QueueError, QueueStore};
use super::service::Service;

/// Returns the routes of the queues.
pub fn routes() -> ApiRouter<Arc<Service>> {
    ApiRouter::new()
        .api_route(
            "/robots/{robot}/queue",
            get_with(bodies, describe("listQueue", "The bodies that wait for the robot, the next first.")).post_with(
                push,
                describe_creation::<QueuedBody>(
                    "queueBody",
                    "Add a body to the queue of the robot. A body is refused here for the reasons for which a job is. \
                     Nothing is heated or moved.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/queue/{queued}/grow",
            post_with(grow, |operation| {
                let words = "Start a job from a queued body, after a person has removed the last body from the robot.";
                operation.with(describe_creation::<Job>("growQueuedBody", words)).with(with_order_time)
            }),
        )
        .api_route(
            "/robots/{robot}/queue/{queued}/front",
            post_with(
                move_to_front,
                describe(
                    "moveQueuedBodyToFront",
                    "Move a body to the front of the queue. The response has the bodies that wait.",
                ),
            ),
        )
        .api_route(
            "/robots/{robot}/queue/{queued}/remove",
            post_with(
                remove,
                describe(
                    "removeQueuedBody",
                    "Remove a body from the queue. The response has the bodies that still wait.",
                ),
            ),
        )
}

impl From<QueueError> for Problem {
    fn from(error: QueueError) -> Self {
        match error {
            QueueError::NotFound(id) => Self::not_found("queued body", &id),
            QueueError::Full | QueueError::Starting(_) => Self::conflict(error),
            QueueError::File { .. } | QueueError::Write(_) => Self::internal(error),
        }
    }
}

/// Parts of a request about a queued body.
type QueueOrder =
    (ServiceState, Extension<ArrivalPermits>, Extension<Arc<RoleLimits>>, Path<(String, String)>, HeaderMap);

async fn bodies(State(service): ServiceState, Path(robot): Path<String>) -> ApiResult<Vec<QueuedBody>> {
    find_robot(&service, &robot)?;
    run_blocking(move || Ok(Json(service.shared.queue.bodies(&robot)?))).await
}

async fn push(
    State(service): ServiceState,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(robot): Path<String>,
    JsonBody(mut wanted): JsonBody<GrowRequest>,
) -> Result<(StatusCode, Json<QueuedBody>), Problem> {
    let by = require_control(limits.access())?;
    let keeper = Arc::clone(find_robot(&service, &robot)?);
    let queued = limits.compute(move |computation| {
        // A page can start the body later, and a page names only scenes that the service stores.
        let of_page = Access::Control(CommandSource::Web);
        let body = check_body(&keeper, &wanted, |of| {
            resolve_request(&wanted, of, &|job| keeper.last_body(job), service.places(), of_page, computation)
        })?;
        if !body.plan.existing_layers.is_empty() {
            return Err(Problem::conflict(
                "a body that begins at the tip of the last one cannot wait, because a queued body grows once the last \
                 one is removed: grow it now, or give a start pose",
            ));
        }
        let requirements = &body.plan.requirements;
        let queued = QueuedBody {
            id: String::new(),
            name: job_name(&wanted),
            layers: u32::try_from(requirements.layers).unwrap_or(u32::MAX),
            length_mm: requirements.length,
            duration_s: requirements.duration,
            feedback: wanted.feedback,
            force: wanted.force,
            ignore_scene: wanted.ignore_scene,
            created_utc: utc_now(),
        };
        // What grows is this plan. For a robot whose description has changed, it is refused.
        let plan = to_raw_value(&PlanFile::with_robot(&body.plan, &body.robot)).map_err(Problem::internal)?;
        (wanted.plan, wanted.name) = (Some(plan), Some(queued.name.clone()));
        (wanted.to, wanted.from, wanted.radius_mm) = (None, None, None);
        wanted.via.clear();
        let queued = service.shared.queue.push(&robot, queued, wanted);
        service.shared.audit.note(by, &robot, "queue", &queued);
        Ok((StatusCode::CREATED, Json(queued?)))
    });
    queued.await
}

async fn grow(
    (service, permits, limits, Path((robot, id)), headers): QueueOrder,
    Json(GrowQueuedRequest { last_body_removed }): Json<GrowQueuedRequest>,
) -> NewJobResponse {
    require_control(limits.access())?;
    find_robot(&service, &robot)?;
    if !last_body_removed {
        return Err(Problem::conflict(
            "a queued body grows only after a person has removed the last body: remove it, and set \
             \"last_body_removed\"",
        ));
    }
    let order = (service, permits, limits, Path(robot.clone()), headers);
    start_job(order, move |service, start| service.shared.queue.start(&robot, &id, |wanted| start(&wanted))).await
}

/// Parts of a request that changes the queue.
type QueueChange = (ServiceState, Extension<Access>, Path<(String, String)>);

async fn remove(change: QueueChange) -> ApiResult<Vec<QueuedBody>> {
    change_queue(change, "remove from the queue", QueueStore::remove).await
}

async fn move_to_front(change: QueueChange) -> ApiResult<Vec<QueuedBody>> {
    change_queue(change, "move to the front of the queue", QueueStore::move_to_front).await
}

/// Changes a queue, and records that as `order`. Returns the bodies that wait.
async fn change_queue(
    (State(service), Extension(access), Path((robot, id))): QueueChange,
    order: &'static str,
    change: fn(&QueueStore, &str, &str) -> Result<Vec<QueuedBody>, QueueError>,
) -> ApiResult<Vec<QueuedBody>> {
    let by = require_control(access)?;
    find_robot(&service, &robot)?;
    run_blocking(move || {
        let left = change(&service.shared.queue, &robot, &id);
        service.shared.audit.note(by, &robot, order, &left);
        Ok(Json(left?))
    })
    .await
}
