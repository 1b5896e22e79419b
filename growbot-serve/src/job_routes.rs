//! Routes of the API for jobs: start, list, run logs and pages.

use std::fs::File;
use std::future::ready;
use std::io::{self, Read};
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HeaderMap};
use axum::response::{Html, IntoResponse, Response};
use axum::{Extension, Json};
use futures_util::stream::{BoxStream, StreamExt, once, unfold};
use growbot_client::growth::{GrowthRefusal, GrowthRequest, Override};
use growbot_client::stop_signal::Permit;
use growbot_core::robot::Robot;
use growbot_pictures::view::page::PageAccess;
use growbot_pictures::view::{NamedScene, Subject, page};
use growbot_plan::feedback::assumed_noise;
use growbot_plan::plan::Plan;
use growbot_plan::run_log::{RecordedRun, utc_now};
use growbot_plan::warning::BLOCKING;
use growbot_remote::api::{GrowRequest, Job, JobState};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use super::access::{Access, require_control};
use super::commands::COMMAND_TIMEOUT;
use super::grow_request::{PlanInScene, request_hash, resolve_request};
use super::handler::{ApiResult, ServiceState, find_robot, found_job, run_blocking};
use super::json_body::JsonBody;
use super::limits::{RoleLimits, StreamPermit, holding};
use super::plan_routes::scene_name;
use super::problem::Problem;
use super::robot_error::RobotRequestError;
use super::robot_request::{Claim, NewJob, RobotRequest};
use super::robot_worker::RobotWorker;
use super::service::{ArrivalPermits, Service};
use crate::watch::LiveGrowth;
use crate::watch::server::{self as watch, LiveEvent, updates_of};
use crate::watch::sockets::{limited, send_texts};

/// Time after which the stream of updates of an active job ends if its robot is disconnected. The page then requests
/// the updates again.
const AWAY: Duration = Duration::from_secs(2);
/// Maximum number of jobs in a response.
const MAX_JOBS: u32 = 1000;
/// Length of the parts in which a run log is sent, bytes.
const LOG_PART: u64 = 64 << 10;

pub async fn new_job(
    State(service): ServiceState,
    Extension(permits): Extension<ArrivalPermits>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(name): Path<String>,
    headers: HeaderMap,
    JsonBody(wanted): JsonBody<GrowRequest>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let access = limits.access();
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let order = Order { permit: permits.recent(&name)?.clone(), claim: Claim::default() };
    let requester = Requester(order.claim.clone());
    let key = headers.get("idempotency-key").and_then(|key| key.to_str().ok()).map(str::to_owned);
    let made = limits.compute(move |computation| {
        let plan = |robot: &Robot| resolve_request(&wanted, robot, service.places(), access, computation);
        let made = make_job(&service, &keeper, &wanted, plan, order, key.as_deref());
        let order = if wanted.ignore_scene { "grow, ignoring the scene" } else { "grow" };
        service.shared.audit.note(by, &name, order, &made);
        made
    });
    let made = made.await;
    drop(requester);
    made
}

/// An order to start a job: the permit that was issued when the order arrived, and the claim that is given up when the
/// client disconnects.
pub(super) struct Order {
    pub permit: Permit,
    pub claim: Claim,
}

/// Guard for the client that ordered a job. The server drops the guard when the connection closes. A job that the
/// robot's thread has not started by then is not started.
struct Requester(Claim);

impl Drop for Requester {
    fn drop(&mut self) {
        self.0.take();
    }
}

pub(super) fn make_job(
    service: &Service,
    keeper: &RobotWorker,
    wanted: &GrowRequest,
    plan: impl FnOnce(&Robot) -> Result<PlanInScene, Problem>,
    order: Order,
    key: Option<&str>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let hash = request_hash(wanted);
    let before = || {
        let found = key.map_or(Ok(None), |key| service.shared.jobs().find_by_key(key)).map_err(Problem::internal)?;
        match found {
            Some((job, _)) if job.robot != keeper.name => Err(Problem::bad(format!(
                "the idempotency key was already used for job {} on robot {}: use a new key for each job",
                job.id, job.robot
            ))),
            Some((job, of)) if of != hash => Err(Problem::conflict(format!(
                "the idempotency key was already used for job {} with a different request: use a new key for each job",
                job.id
            ))),
            found => Ok(found.map(|(job, _)| job)),
        }
    };
    if let Some(job) = before()? {
        return Ok((StatusCode::OK, Json(job)));
    }
    let robot = keeper.description().map_err(Problem::conflict)?;
    let PlanInScene { plan, scene } = plan(&robot)?;
    let overrides = Override::given([(wanted.force, Override::Warnings), (wanted.ignore_scene, Override::Scene)]);
    let request = GrowthRequest {
        scene: scene.as_ref(),
        overrides: &overrides,
        feedback: wanted.feedback.then(|| assumed_noise(keeper.is_simulated().into())),
        kind: keeper.is_simulated().into(),
        ..GrowthRequest::new(&robot, &plan)
    };
    request.check().map_err(|refusal| refused(&refusal, &plan))?;
    let (ignore_scene, board_job) = (request.ignores_scene(), request.job());
    let _begins = keeper.lock_job_start();
    // Another request with the same key may have created the job in the meantime.
    if let Some(job) = before()? {
        return Ok((StatusCode::OK, Json(job)));
    }
    keeper.ensure_idle().and_then(|()| order.claim.check())?;
    let id = service.shared.jobs().new_id(&keeper.name);
    let job = Job {
        robot: keeper.name.clone(),
        name: wanted.name.clone().unwrap_or_else(|| wanted.to.clone().unwrap_or_else(|| "a plan".to_owned())),
        state: JobState::Active,
        plan_id: format!("{:016x}", board_job.plan_id),
        layers: u32::try_from(board_job.layers.len()).unwrap_or(u32::MAX),
        laid: 0,
        length_mm: plan.requirements.length,
        simulated: keeper.is_simulated(),
        ignore_scene,
        created_utc: utc_now(),
        ended_utc: None,
        reason: None,
        id,
    };
    service.shared.jobs().insert(&job, key.map(|key| (key, &*hash))).map_err(Problem::internal)?;
    let new = NewJob { job: job.clone(), plan, robot, scene, feedback: wanted.feedback, permit: order.permit };
    let grow = RobotRequest::Grow(Box::new(new));
    if let Err(why) = keeper.request_claimed(grow, &order.claim, COMMAND_TIMEOUT) {
        // A job that has started after the timeout keeps the state that its robot reports.
        if !service.shared.jobs_to_read().log_path(&job.id).exists() {
            service.shared.jobs().mark_rejected(&job.id, &why.to_string());
        }
        return Err(why.into());
    }
    Ok((StatusCode::CREATED, Json(job)))
}

/// Returns the problem of a growth that is refused, with the remedy.
fn refused(refusal: &GrowthRefusal, plan: &Plan) -> Problem {
    let remedy = match refusal {
        GrowthRefusal::Warnings { .. } => {
            let blocking = plan.warnings.iter().filter(|warning| BLOCKING.contains(&warning.code.as_str()));
            let messages: Vec<&str> = blocking.map(|warning| warning.message.as_str()).collect();
            let messages = messages.join("; ");
            return Problem::conflict(format!(
                "{refusal}: {messages}; change the plan, or set \"force\" to ignore the warnings"
            ));
        }
        GrowthRefusal::Scene(_) => "plan through the scene, or set ignore_scene",
        GrowthRefusal::Clearance(_) => "set a larger margin_mm or another radius for the plan, or set ignore_scene",
        GrowthRefusal::NoSensor { .. } => "give it sensors.filament_motion or sensors.orientation, or remove feedback",
        GrowthRefusal::Disturbance | GrowthRefusal::SensorNoise => "remove them",
    };
    Problem::conflict(format!("{refusal}: {remedy}"))
}

pub async fn resume(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path(id): Path<String>,
) -> ApiResult<Job> {
    let by = require_control(access)?;
    let job = found_job(&service, &id)?;
    let keeper = Arc::clone(find_robot(&service, &job.robot)?);
    let permit = permits.recent(&job.robot)?.clone();
    run_blocking(move || {
        let begins = keeper.lock_job_start();
        let outcome = keeper
            .ensure_idle()
            .and_then(|()| ensure_resumable(&job))
            .and_then(|()| keeper.request(RobotRequest::Resume(Box::new(job.clone()), permit), COMMAND_TIMEOUT));
        drop(begins);
        service.shared.audit.note(by, &job.robot, "resume", &outcome);
        outcome?;
        found_job(&service, &id).map(Json)
    })
    .await
}

/// Returns an error if the job cannot be resumed.
fn ensure_resumable(job: &Job) -> Result<(), RobotRequestError> {
    let id = || job.id.clone();
    match job.state {
        JobState::Active | JobState::Interrupted => Ok(()),
        JobState::Done => Err(RobotRequestError::JobDone { job: id() }),
        JobState::Failed => Err(RobotRequestError::JobFailed { job: id(), reason: job.reason.clone() }),
    }
}

/// Query of a request for the list of jobs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JobListQuery {
    /// Maximum number of jobs. The default is 100, and the service lists at most 1000.
    #[schemars(range(max = 4_294_967_295_u32))]
    limit: Option<u32>,
}

pub async fn jobs(
    State(service): ServiceState,
    Query(JobListQuery { limit: max }): Query<JobListQuery>,
) -> ApiResult<Vec<Job>> {
    let max = max.unwrap_or(100).min(MAX_JOBS);
    service.shared.jobs_to_read().latest(max).map(Json).map_err(Problem::internal)
}

pub async fn job(State(service): ServiceState, Path(id): Path<String>) -> ApiResult<Job> {
    found_job(&service, &id).map(Json)
}

pub async fn job_log(
    State(service): ServiceState,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(id): Path<String>,
) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    let permit = limits.permit_download()?;
    let path = service.shared.jobs_to_read().log_path(&job.id);
    let unread = |error| {
        Problem::conflict(format!("cannot read the run log of the job: {error}; a job that never started has none"))
    };
    let file = run_blocking(move || File::open(path).map_err(unread)).await?;
    let body = Body::from_stream(unfold(Some(file), |file| async { next_part(file?).await }));
    Ok(holding(permit, ([(CONTENT_TYPE, "application/jsonl")], body).into_response()))
}

/// Reads the next part of a file. Returns the part, and the file unless reading has failed. `None` at the end of the
/// file.
async fn next_part(mut file: File) -> Option<(io::Result<Vec<u8>>, Option<File>)> {
    let read = spawn_blocking(move || {
        let mut part = Vec::new();
        let read = file.by_ref().take(LOG_PART).read_to_end(&mut part);
        read.map(|_| (part, file))
    });
    match read.await.unwrap_or_else(|error| Err(io::Error::other(error))) {
        Ok((part, _)) if part.is_empty() => None,
        Ok((part, file)) => Some((Ok(part), Some(file))),
        Err(error) => Some((Err(error), None)),
    }
}

/// Returns the live page of an active job. For a job that is not active, returns the page of its run log.
pub async fn live(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(id): Path<String>,
) -> Result<Html<String>, Problem> {
    let job = found_job(&service, &id)?;
    let is_live = find_robot(&service, &job.robot).is_ok_and(|keeper| keeper.live(&id).is_some());
    let on_page = if access == Access::View { PageAccess::View } else { PageAccess::Control };
    page_of(&service, &limits, job, is_live.then_some(on_page)).await
}

fn live_of(service: &Service, job: &Job) -> Result<Arc<LiveGrowth>, Problem> {
    let live = find_robot(service, &job.robot)?.live(&job.id);
    live.ok_or_else(|| Problem::conflict(format!("job {} is {}", job.id, job.state.name())))
}

pub async fn live_updates(State(service): ServiceState, Path(id): Path<String>) -> Result<Response, Problem> {
    Ok(watch::sse_response(live_events(&service, &found_job(&service, &id)?)))
}

pub async fn live_update_socket(
    State(service): ServiceState,
    Extension(permit): Extension<StreamPermit>,
    Path(id): Path<String>,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    let events = live_events(&service, &found_job(&service, &id)?);
    Ok(limited(upgrade).on_upgrade(|socket| async move {
        send_texts(socket, events.map(|event| event.text())).await;
        drop(permit);
    }))
}

/// Returns the stream of events for the live page of a job. If the robot of an active job is disconnected, the stream
/// ends after one heartbeat and a pause, and the page connects again. For a job that is not active, the stream contains
/// only the event that the job has ended.
fn live_events(service: &Service, job: &Job) -> BoxStream<'static, LiveEvent> {
    match live_of(service, job) {
        Ok(live) => updates_of(live).boxed(),
        Err(_) if job.state == JobState::Active => {
            let age = service.robot(&job.robot).and_then(|robot| robot.status().status_age_s);
            let pause = unfold((), |()| async {
                sleep(AWAY).await;
                None
            });
            once(ready(LiveEvent::heartbeat(age))).chain(pause).boxed()
        }
        Err(problem) => once(ready(LiveEvent::end(&problem.detail))).boxed(),
    }
}

pub async fn job_view(
    State(service): ServiceState,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(id): Path<String>,
) -> Result<Html<String>, Problem> {
    page_of(&service, &limits, found_job(&service, &id)?, None).await
}

/// Returns the page of a job: a live page with this access, or the page of its run log if `access` is `None`.
async fn page_of(
    service: &Service,
    limits: &RoleLimits,
    job: Job,
    access: Option<PageAccess>,
) -> Result<Html<String>, Problem> {
    let path = service.shared.jobs_to_read().log_path(&job.id);
    let computed = limits.compute(move |_| {
        let record = RecordedRun::open(&path).map_err(Problem::conflict)?;
        let robot = record.own_robot().map_err(Problem::conflict)?;
        let plan = record.plan(&robot).map_err(Problem::conflict)?;
        let name = format!("{} on {}", job.name, job.robot);
        // A body can be shown without its scene.
        let scene = record.scene(&plan, &robot, None).ok().flatten();
        let scene = scene.as_ref().map(|loaded| NamedScene { file: scene_name(&plan), scene: &loaded.scene });
        let of = |run| Subject { name: &name, robot: &robot, plan: &plan, run, laid: None, scene };
        let page = match access {
            Some(access) => page::render_live(&of(None), access),
            None => page::render(&of(Some(&record))),
        };
        page.map(Html).map_err(Problem::bad)
    });
    computed.await
}
