//! Routes of the API for jobs: start, list, run logs and pages.

use std::fs::File;
use std::io::{self, Read};
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HeaderMap};
use axum::response::{Html, IntoResponse, Response};
use axum::{Extension, Json};
use futures_util::stream::unfold;
use growbot_client::growth::{GrowthRefusal, Override};
use growbot_client::stop_signal::Permit;
use growbot_core::robot::Robot;
use growbot_plan::plan::Plan;
use growbot_plan::run_log::utc_now;
use growbot_plan::warning::BLOCKING;
use growbot_remote::api::{GrowRequest, Job, JobState};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::task::spawn_blocking;

use super::access::{Access, require_control};
use super::commands::START_TIMEOUT;
use super::event_stream::job_events;
use super::grow_request::{PlanInScene, request_hash, resolve_request};
use super::handler::{ApiResult, ServiceState, find_robot, found_job, run_blocking};
use super::job_pages::page_of;
use super::json_body::JsonBody;
use super::limits::{RoleLimits, holding};
use super::page_source::ArrivalPermits;
use super::problem::Problem;
use super::robot_error::RobotRequestError;
use super::robot_request::{Claim, NewBody, NewJob, RobotRequest};
use super::robot_worker::RobotWorker;
use super::service::Service;
use crate::watch::sockets::EventSink;

/// Maximum number of jobs in a response.
const MAX_JOBS: u32 = 1000;
/// Length of the parts in which a run log is sent, bytes.
const LOG_PART: u64 = 64 << 10;

/// Response to a request that starts a job.
pub(super) type NewJobResponse = Result<(StatusCode, Json<Job>), Problem>;

/// Parts of a request that starts a job.
pub(super) type JobOrder =
    (ServiceState, Extension<ArrivalPermits>, Extension<Arc<RoleLimits>>, Path<String>, HeaderMap);

pub async fn new_job(order: JobOrder, JsonBody(wanted): JsonBody<GrowRequest>) -> NewJobResponse {
    start_job(order, move |_, start| start(&wanted)).await
}

/// Starts a job. `begin` calls its second argument with the request to grow, on the thread of the computation, which
/// goes on if the client disconnects.
pub(super) async fn start_job(
    (State(service), Extension(permits), Extension(limits), Path(name), headers): JobOrder,
    begin: impl FnOnce(&Service, &dyn Fn(&GrowRequest) -> NewJobResponse) -> NewJobResponse + Send + 'static,
) -> NewJobResponse {
    let access = limits.access();
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let (permit, claim) = (permits.recent(&name)?.clone(), Claim::default());
    let requester = Requester(claim.clone());
    let key = headers.get("idempotency-key").and_then(|key| key.to_str().ok()).map(str::to_owned);
    let made = limits.compute(move |computation| {
        begin(&service, &|wanted| {
            let plan = |robot: &Robot| {
                let last_body = |job: &str| keeper.last_body(job);
                resolve_request(wanted, robot, &last_body, service.places(), access, computation)
            };
            let order = Order { permit: permit.clone(), claim: claim.clone() };
            let made = make_job(&service, &keeper, wanted, plan, order, key.as_deref());
            let order = if wanted.ignore_scene { "grow, ignoring the scene" } else { "grow" };
            service.shared.audit.note(by, &name, order, &made);
            made
        })
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
    let body = check_body(keeper, wanted, plan)?;
    let request = body.request(keeper.is_simulated().into());
    let (ignore_scene, board_job) = (request.ignores_scene(), request.job());
    let _begins = keeper.lock_job_start();
    // Another request with the same key may have created the job in the meantime.
    if let Some(job) = before()? {
        return Ok((StatusCode::OK, Json(job)));
    }
    keeper.ensure_idle().and_then(|()| order.claim.check())?;
    keeper.ensure_at_last_tip(&body.plan)?;
    let id = service.shared.jobs().new_id(&keeper.name);
    let job = Job {
        robot: keeper.name.clone(),
        name: job_name(wanted),
        state: JobState::Active,
        plan_id: format!("{:016x}", board_job.plan_id),
        layers: u32::try_from(board_job.layers.len()).unwrap_or(u32::MAX),
        laid: 0,
        length_mm: body.plan.requirements.length,
        simulated: keeper.is_simulated(),
        ignore_scene,
        created_utc: utc_now(),
        ended_utc: None,
        reason: None,
        id,
    };
    service.shared.jobs().insert(&job, key.map(|key| (key, &*hash))).map_err(Problem::internal)?;
    let new = NewJob { job: job.clone(), body, permit: order.permit };
    let grow = RobotRequest::Grow(Box::new(new));
    if let Err(why) = keeper.request_claimed(grow, &order.claim, START_TIMEOUT) {
        // A job that has started after the timeout keeps the state that its robot reports.
        if !service.shared.jobs_to_read().log_path(&job.id).exists() {
            service.shared.jobs().mark_rejected(&job.id, &why.to_string());
        }
        return Err(why.into());
    }
    Ok((StatusCode::CREATED, Json(job)))
}

/// Returns the body of a request, or the reason why it is refused. `plan` plans it for the robot.
pub(super) fn check_body(
    keeper: &RobotWorker,
    wanted: &GrowRequest,
    plan: impl FnOnce(&Robot) -> Result<PlanInScene, Problem>,
) -> Result<NewBody, Problem> {
    let robot = keeper.description().map_err(Problem::conflict)?;
    let PlanInScene { plan, scene } = plan(&robot)?;
    let overrides = Override::given([(wanted.force, Override::Warnings), (wanted.ignore_scene, Override::Scene)]);
    let body = NewBody { plan, robot, scene, overrides, feedback: wanted.feedback };
    body.request(keeper.is_simulated().into()).check().map_err(|refusal| refused(&refusal, &body.plan))?;
    Ok(body)
}

/// Returns the name of a request's job for users.
pub(super) fn job_name(wanted: &GrowRequest) -> String {
    wanted.name.clone().or_else(|| wanted.to.clone()).unwrap_or_else(|| "a plan".to_owned())
}

/// Returns the problem of a growth that is refused, with the remedy.
fn refused(refusal: &GrowthRefusal, plan: &Plan) -> Problem {
    let remedy = match refusal {
        GrowthRefusal::Warnings { .. } => {
            let blocking = plan.warnings.iter().filter(|warning| BLOCKING.contains(&warning.code.as_str()));
            let messages: Vec<&str> = blocking.map(|warning| warning.message.as_str()).collect();
            let messages = messages.join("; ");
            let detail = format!("{refusal}: {messages}; change the plan, or set \"force\" to ignore the warnings");
            return Problem { code: Some(refusal.code()), ..Problem::conflict(detail) };
        }
        GrowthRefusal::Scene(_) => "plan through the scene, or set ignore_scene",
        GrowthRefusal::Clearance(_) => "set a larger margin_mm or another radius for the plan, or set ignore_scene",
        GrowthRefusal::NoSensor { .. } => "give it sensors.filament_motion or sensors.orientation, or remove feedback",
        GrowthRefusal::Disturbance | GrowthRefusal::SensorNoise => "remove them",
    };
    Problem { code: Some(refusal.code()), ..Problem::conflict(format!("{refusal}: {remedy}")) }
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
    let order = Order { permit: permits.recent(&job.robot)?.clone(), claim: Claim::default() };
    let requester = Requester(order.claim.clone());
    let resumed = run_blocking(move || {
        let resumed = resume_job(&keeper, &job, order);
        service.shared.audit.note(by, &job.robot, "resume", &resumed);
        resumed?;
        found_job(&service, &id).map(Json)
    });
    let resumed = resumed.await;
    drop(requester);
    resumed
}

/// Resumes a job on its robot, unless the client that ordered it has gone.
pub(super) fn resume_job(keeper: &RobotWorker, job: &Job, order: Order) -> Result<(), RobotRequestError> {
    let _begins = keeper.lock_job_start();
    keeper.ensure_idle()?;
    ensure_resumable(job)?;
    let resume = RobotRequest::Resume(Box::new(job.clone()), order.permit);
    keeper.request_claimed(resume, &order.claim, START_TIMEOUT).map(drop)
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

/// Query of a request for the events of a job.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EventQuery {
    /// Number of the log line after which the stream starts. Ignored if the request has the header `Last-Event-ID`.
    after: Option<u64>,
}

/// Returns the number of the log line after which the stream starts: from the header `Last-Event-ID`, otherwise from
/// the query, otherwise 0.
fn start_line(headers: &HeaderMap, EventQuery { after }: EventQuery) -> u64 {
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse().ok());
    last.or(after).unwrap_or(0)
}

pub async fn job_log_lines(
    State(service): ServiceState,
    Path(id): Path<String>,
    Query(query): Query<EventQuery>,
    headers: HeaderMap,
    sink: EventSink,
) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    Ok(sink.send(job_events(service, job.id, start_line(&headers, query))))
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

pub async fn job_view(
    State(service): ServiceState,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Path(id): Path<String>,
) -> Result<Html<Bytes>, Problem> {
    page_of(&service, &limits, found_job(&service, &id)?, None).await
}

#[cfg(test)]
mod tests {
    use growbot_core::link::message::State as BoardState;

    use super::*;
    use crate::audit::CommandSource;
    use crate::limits::Computation;
    use crate::stop_model::{Case, Step, service};

    #[test]
    fn a_job_whose_requester_goes_once_it_is_planned_is_not_made() {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        let wanted = GrowRequest { to: Some("0,0,20,0,90".to_owned()), ..GrowRequest::default() };
        let access = Access::Control(CommandSource::Socket);
        let (claim, computation) = (Claim::default(), Computation::new(&Arc::default()));
        let order = Order { permit: case.worker.signal().permit(), claim: claim.clone() };
        let plan = |robot: &Robot| {
            let planned = resolve_request(
                &wanted,
                robot,
                &|job| case.worker.last_body(job),
                service.places(),
                access,
                &computation,
            );
            drop(Requester(claim.clone()));
            planned
        };
        let refused = make_job(&service, &case.worker, &wanted, plan, order, None).unwrap_err();
        assert_eq!(refused.detail, RobotRequestError::GivenUp.to_string());
        assert_eq!(service.shared.jobs_to_read().latest(1).unwrap(), []);
        assert_eq!(case.line.board().state, BoardState::Idle);
    }

    #[test]
    fn a_resume_whose_requester_has_gone_does_not_begin() {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let mut case = Case::new(&service, "lab".to_owned());
        assert_eq!(case.run([Step::Grow, Step::Stop].into_iter()), Vec::<String>::new());
        let job = service.shared.jobs_to_read().latest(1).unwrap().remove(0);
        for (has_gone, resumed) in [(true, Err(RobotRequestError::GivenUp)), (false, Ok(()))] {
            let order = Order { permit: case.worker.signal().permit(), claim: Claim::default() };
            let requester = Requester(order.claim.clone());
            if has_gone {
                drop(requester);
            }
            let found = resume_job(&case.worker, &job, order);
            assert_eq!(found.map_err(|error| error.to_string()), resumed.map_err(|error| error.to_string()));
        }
    }
}
