//! The HTTP interface: its requests and responses, from which the OpenAPI document is generated.

use std::fs;
use std::future::ready;
use std::sync::Arc;
use std::time::Duration;

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use aide::openapi::{Info, OpenApi};
use aide::transform::TransformOperation;
use axum::body::Bytes;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::header::{CONTENT_TYPE, HeaderMap};
use axum::http::{Method, StatusCode, Uri};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use futures_util::stream::{BoxStream, StreamExt, once, unfold};
use growbot_client::feedback::can_measure;
use growbot_client::growth::Command;
use growbot_client::plan_file::PlanFile;
use growbot_client::run_log::{RecordedRun, utc_now};
use growbot_client::stop_signal::Permit;
use growbot_client::warning::BLOCKING;
use growbot_core::job::{MAX_JOB_LAYERS, job_layers, plan_id};
use growbot_scene::scene_file::SceneBox;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use super::audit::CommandSource;
use super::command_socket;
use super::commands::{COMMAND_TIMEOUT, CommandRequest, RobotCommand, run_command};
use super::event_routes;
use super::grow_request::{GrowRequest, PlanInScene};
use super::job_store::{Job, JobState};
use super::limits::{MAX_BODY, StreamPermit};
use super::openapi;
use super::port_lease::lease_port;
use super::problem::Problem;
use super::robot_worker::{Claim, NewJob, RobotRequest, RobotStatus, RobotWorker};
use super::scene_store;
use super::{ArrivalPermits, Service};
use crate::watch::LiveGrowth;
use crate::watch::server::{self as watch, LiveEvent, updates_of};
use crate::watch::sockets::{limited, send_texts};
use growbot_pictures::view::{NamedScene, Subject, page};

/// Path of the interface, relative to the address of a page or to the socket.
pub const PREFIX: &str = "/api/v1";
/// Delay before the page of a disconnected robot's job has to request updates again.
const AWAY: Duration = Duration::from_secs(2);
/// Name of the maintenance task that switches the heater off.
const COOL_DOWN: &str = "cooldown";
/// Maximum number of jobs that are listed.
const MAX_JOBS: u32 = 1000;

/// Rights of a client. They depend on the address that it uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// The client can only read.
    View,
    /// The client can read and send commands.
    Control(CommandSource),
}

pub(super) type ServiceState = State<Arc<Service>>;
type ApiResult<T> = Result<Json<T>, Problem>;

/// Returns all routes and the OpenAPI document that describes them.
pub fn routes() -> (Router<Arc<Service>>, Value) {
    let mut document = OpenApi {
        info: Info {
            title: "growbot serve".to_owned(),
            description: Some(
                "Robots, their jobs, and commands to them. Lengths are in mm, angles in degrees, temperatures in C: \
                 names carry the unit. URLs contain an access token, which `growbot serve` prints; requests on the \
                 Unix socket in the user's runtime directory need none."
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

/// Sets the description of a route, and problem details as its default response.
fn describe(words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.description(words).default_response::<Problem>()
}

/// Rejects a request for a path that this release does not have.
pub async fn unknown_route(method: Method, uri: Uri) -> Problem {
    Problem::unknown_route(&method, uri.path())
}

fn find_robot<'a>(service: &'a Service, name: &str) -> Result<&'a Arc<RobotWorker>, Problem> {
    service.robot(name).ok_or_else(|| Problem::not_found("robot", name))
}

pub(super) fn found_job(service: &Service, id: &str) -> Result<Job, Problem> {
    service.job(id).ok_or_else(|| Problem::not_found("job", id))
}

/// Returns the client's kind if it can send commands, otherwise an error.
fn require_control(access: Access) -> Result<CommandSource, Problem> {
    match access {
        Access::Control(by) => Ok(by),
        Access::View => Err(Problem::read_only()),
    }
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

/// Addresses of the service's page. Only growbot's commands can request them, and those need no token.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
pub struct PageUrls {
    /// Address for sending commands.
    pub control_url: String,
    /// Read-only address.
    pub view_url: String,
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

/// Runs a slow task on a thread of its own, so that it does not block the server.
async fn run_blocking<T: Send + 'static>(
    what: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    spawn_blocking(what).await.map_err(Problem::internal)?
}

pub(super) async fn new_job(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path(name): Path<String>,
    headers: HeaderMap,
    Json(wanted): Json<GrowRequest>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let order = Order { permit: permits.recent(&name)?.clone(), claim: Claim::default() };
    let requester = Requester(order.claim.clone());
    let key = headers.get("idempotency-key").and_then(|key| key.to_str().ok()).map(str::to_owned);
    let made = run_blocking(move || {
        let made = make_job(&service, &keeper, &wanted, access, order, key.as_deref());
        let refused = made.as_ref().err().map(|problem| problem.detail.clone());
        let order = if wanted.ignore_scene { "grow, ignoring the scene" } else { "grow" };
        service.shared.audit.note(by, &name, order, refused.as_deref());
        made
    })
    .await;
    drop(requester);
    made
}

/// An order that arrived: its permit, and whether its requester is still there.
pub(super) struct Order {
    pub permit: Permit,
    pub claim: Claim,
}

/// The requester of an order. The server drops it when the connection closes. An order that the robot's thread has not
/// taken by then does not begin.
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
    access: Access,
    order: Order,
    key: Option<&str>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let hash = wanted.hash();
    let before = || {
        let found = key.map_or(Ok(None), |key| service.shared.jobs().find_by_key(key)).map_err(Problem::internal)?;
        match found {
            Some((job, _)) if job.robot != keeper.name => Err(Problem::bad(format!(
                "the idempotency key was used for job {} on robot {}: use a new key for each job",
                job.id, job.robot
            ))),
            Some((job, of)) if of != hash => Err(Problem::conflict(format!(
                "the idempotency key was used for job {}, whose request was another: use a new key for each job",
                job.id
            ))),
            found => Ok(found.map(|(job, _)| job)),
        }
    };
    if let Some(job) = before()? {
        return Ok((StatusCode::OK, Json(job)));
    }
    let robot = keeper.description().map_err(Problem::conflict)?;
    if wanted.feedback && !can_measure(&robot) {
        return Err(Problem::conflict(format!(
            "robot {} has no sensor that measures layers: give it sensors.filament_motion or sensors.orientation, or \
             remove feedback",
            robot.name()
        )));
    }
    let PlanInScene { plan, scene } = wanted.resolve(&robot, service.places(), access)?;
    ensure_storable(plan.requirements.layers)?;
    let preventing = plan.warnings.iter().find(|warning| BLOCKING.contains(&warning.code.as_str()));
    if let Some(warning) = preventing.filter(|_| !wanted.force) {
        return Err(Problem::conflict(format!(
            "not grown because of {}: {}; change the plan, or set force",
            warning.code, warning.message
        )));
    }
    let _begins = keeper.lock_job_start();
    // Another request with the same key may have created the job in the meantime.
    if let Some(job) = before()? {
        return Ok((StatusCode::OK, Json(job)));
    }
    keeper.ensure_idle().and_then(|()| order.claim.check()).map_err(Problem::conflict)?;
    let layers: Vec<_> = job_layers(&plan.path, &robot).collect();
    let id = service.shared.jobs().new_id(&keeper.name);
    let job = Job {
        robot: keeper.name.clone(),
        name: wanted.name.clone().unwrap_or_else(|| wanted.to.clone().unwrap_or_else(|| "a plan".to_owned())),
        state: JobState::Active,
        plan_id: format!("{:016x}", plan_id(&robot, &layers)),
        layers: u32::try_from(layers.len()).unwrap_or(u32::MAX),
        laid: 0,
        length_mm: plan.requirements.length,
        simulated: keeper.is_simulated(),
        ignore_scene: scene.is_some() && wanted.ignore_scene,
        created_utc: utc_now(),
        ended_utc: None,
        reason: None,
        id,
    };
    service.shared.jobs().insert(&job, key.map(|key| (key, &*hash))).map_err(Problem::internal)?;
    let scene = scene.filter(|_| !wanted.ignore_scene);
    let new = NewJob { job: job.clone(), plan, robot, scene, feedback: wanted.feedback, permit: order.permit };
    let grow = RobotRequest::Grow(Box::new(new));
    if let Err(why) = keeper.request_claimed(grow, &order.claim, COMMAND_TIMEOUT) {
        // A job that has started after the timeout keeps the state that its robot reports.
        if !service.shared.jobs_to_read().log_path(&job.id).exists() {
            service.shared.jobs().mark_rejected(&job.id, &why).map_err(Problem::internal)?;
        }
        return Err(Problem::conflict(why));
    }
    Ok((StatusCode::CREATED, Json(job)))
}

/// Returns an error if no board can store a job of this many layers, before any of them is computed.
fn ensure_storable(layers: usize) -> Result<(), Problem> {
    if layers <= MAX_JOB_LAYERS as usize {
        return Ok(());
    }
    Err(Problem::conflict(format!(
        "the plan has {layers} layers, but a board can store {MAX_JOB_LAYERS}: choose a nearer goal, or a robot with \
         higher layers"
    )))
}

async fn resume(
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
        service.shared.audit.note(by, &job.robot, "resume", outcome.as_ref().err().map(String::as_str));
        outcome.map_err(Problem::conflict)?;
        found_job(&service, &id).map(Json)
    })
    .await
}

/// Returns an error if the job cannot be resumed.
fn ensure_resumable(job: &Job) -> Result<(), String> {
    match job.state {
        JobState::Active | JobState::Interrupted => Ok(()),
        JobState::Done => Err(format!("job {} is done: there is nothing to resume", job.id)),
        JobState::Failed => Err(format!("job {} ended before it started: grow its plan again", job.id)),
    }
}

pub(super) async fn send_command(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path(name): Path<String>,
    Json(CommandRequest { command }): Json<CommandRequest>,
) -> ApiResult<RobotStatus> {
    let by = require_control(access)?;
    let keeper = Arc::clone(find_robot(&service, &name)?);
    let permit = if command.stops_or_pauses() { permits.of(&name)? } else { permits.recent(&name)? }.clone();
    run_blocking(move || {
        let given = run_command(&keeper, command, &permit);
        service.shared.audit.note(by, &name, command.name(), given.as_ref().err().map(String::as_str));
        given.map_err(Problem::conflict)?;
        Ok(Json(keeper.status()))
    })
    .await
}

/// A maintenance task, as `growbot maintain` runs it.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaintenanceRequest {
    /// Name of the task: preheat, cooldown, load, unload, purge, home, rotate or jog.
    pub task: String,
    /// Value of the task: a temperature in C, a length in mm, an angle in degrees, or a material.
    #[serde(default)]
    pub value: String,
}

async fn maintain(
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
            (None, _) => return Err(Problem::bad(format!("unknown maintenance task {task:?}"))),
            (Some(Err(why)), _) => return Err(Problem::bad(why)),
            (Some(Ok(_)), Some(_)) => Err(format!("robot {name} has an active job: pause the job and use its page")),
            (Some(Ok(task)), None) => keeper.request(RobotRequest::Task(task, permit), COMMAND_TIMEOUT),
        };
        service.shared.audit.note(by, &name, &task, outcome.as_ref().err().map(String::as_str));
        outcome.map_err(Problem::conflict)?;
        Ok(Json(keeper.status()))
    })
    .await
}

/// The robot to plan for.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PlanQuery {
    /// Name of the robot in the service.
    robot: String,
}

/// A plan and its page.
#[derive(Debug, Serialize, JsonSchema)]
struct PlanResponse {
    /// The plan, in the format of `growbot plan --json`.
    plan: Value,
    /// Path of its page, relative to the address of this interface. The service keeps only the latest pages.
    view_path: String,
}

async fn new_plan(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Query(PlanQuery { robot }): Query<PlanQuery>,
    Json(wanted): Json<GrowRequest>,
) -> ApiResult<PlanResponse> {
    let keeper = Arc::clone(find_robot(&service, &robot)?);
    run_blocking(move || {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let PlanInScene { plan, scene } = wanted.resolve(&robot, service.places(), access)?;
        let file = plan.scene.as_ref().map_or("", |scene| scene.file.rsplit('/').next().unwrap_or_default());
        let scene = scene.as_ref().map(|loaded| NamedScene { file, scene: &loaded.scene });
        let subject = Subject { name: "preview", robot: &robot, plan: &plan, run: None, laid: None, scene };
        let page = page::render(&subject).map_err(Problem::bad)?;
        let view = format!("plans/{}/view", service.shared.keep_preview(page));
        let plan = serde_json::to_value(PlanFile::with_robot(&plan, &robot)).map_err(Problem::internal)?;
        Ok(Json(PlanResponse { plan, view_path: view }))
    })
    .await
}

/// Name of a scene's file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SceneUploadQuery {
    /// File name. Its extension is the format: .toml, .stl, .obj, .ply, .glb or .pcd.
    name: String,
}

/// A scene that the service has stored.
#[derive(Debug, Serialize, JsonSchema)]
struct SceneUploadResponse {
    /// Name of the scene, for the field `scene` of a plan or job request.
    scene: String,
    /// Box that holds everything but half spaces, as it was read. `null` if there is nothing else.
    #[serde(rename = "box")]
    bounds: Option<SceneBox>,
}

async fn new_scene(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Query(SceneUploadQuery { name }): Query<SceneUploadQuery>,
    bytes: Bytes,
) -> ApiResult<SceneUploadResponse> {
    require_control(access)?;
    run_blocking(move || {
        let (scene, bounds) = scene_store::store(service.places(), &name, &bytes)?;
        Ok(Json(SceneUploadResponse { scene, bounds }))
    })
    .await
}

async fn view_plan(State(service): ServiceState, Path(number): Path<u64>) -> Result<Html<String>, Problem> {
    let page = service.shared.preview(number);
    page.map(Html).ok_or_else(|| Problem::not_found("preview any more, of", &number.to_string()))
}

/// Limit of a list of jobs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct JobListQuery {
    /// Maximum number of jobs. The default is 100, and the service lists at most 1000.
    #[schemars(range(max = 4_294_967_295_u32))]
    limit: Option<u32>,
}

async fn jobs(
    State(service): ServiceState,
    Query(JobListQuery { limit: max }): Query<JobListQuery>,
) -> ApiResult<Vec<Job>> {
    let max = max.unwrap_or(100).min(MAX_JOBS);
    service.shared.jobs_to_read().latest(max).map(Json).map_err(Problem::internal)
}

async fn job(State(service): ServiceState, Path(id): Path<String>) -> ApiResult<Job> {
    found_job(&service, &id).map(Json)
}

async fn job_log(State(service): ServiceState, Path(id): Path<String>) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    let path = service.shared.jobs_to_read().log_path(&job.id);
    let bytes = fs::read(path).map_err(|error| Problem::conflict(format!("its run log cannot be read: {error}")))?;
    Ok(([(CONTENT_TYPE, "application/jsonl")], bytes).into_response())
}

/// Returns the page that follows an active job. For any other job the page shows its run log.
async fn live(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Path(id): Path<String>,
) -> Result<Html<String>, Problem> {
    let job = found_job(&service, &id)?;
    let is_live = find_robot(&service, &job.robot).is_ok_and(|keeper| keeper.live(&id).is_some());
    page_of(&service, job, is_live.then_some(access != Access::View)).await
}

fn live_of(service: &Service, job: &Job) -> Result<Arc<LiveGrowth>, Problem> {
    let live = find_robot(service, &job.robot)?.live(&job.id);
    live.ok_or_else(|| Problem::conflict(format!("job {} is not active", job.id)))
}

async fn live_updates(State(service): ServiceState, Path(id): Path<String>) -> Result<Response, Problem> {
    Ok(watch::sse_response(live_events(&service, &found_job(&service, &id)?)))
}

async fn live_update_socket(
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

/// Returns the events of a job's page. If the robot of an active job is disconnected, the page has to connect again
/// after a while. The stream of any other job contains only the event that it has ended.
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

pub(super) async fn send_live_command(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(permits): Extension<ArrivalPermits>,
    Path((id, order)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let by = require_control(access)?;
    let job = found_job(&service, &id)?;
    let stops = [(Command::Stop, RobotCommand::Stop), (Command::EmergencyStop, RobotCommand::EmergencyStop)];
    let Some((_, stop)) = stops.into_iter().find(|(command, _)| command.name() == order) else {
        let live = live_of(&service, &job)?;
        let answer = watch::send_command(&live, &order, &permits.age).await;
        if answer.status().is_success() {
            service.shared.audit.note(by, &job.robot, &order, None);
        }
        return Ok(answer);
    };
    let keeper = Arc::clone(find_robot(&service, &job.robot)?);
    let permit = permits.of(&job.robot)?.clone();
    run_blocking(move || {
        let given = run_command(&keeper, stop, &permit);
        service.shared.audit.note(by, &job.robot, &order, given.as_ref().err().map(String::as_str));
        given.map_err(Problem::conflict)
    })
    .await?;
    Ok(StatusCode::ACCEPTED.into_response())
}

async fn job_view(State(service): ServiceState, Path(id): Path<String>) -> Result<Html<String>, Problem> {
    page_of(&service, found_job(&service, &id)?, None).await
}

/// Returns the page of a job's run log. For an active job, `control` is true if the page can send commands.
async fn page_of(service: &Service, job: Job, control: Option<bool>) -> Result<Html<String>, Problem> {
    let path = service.shared.jobs_to_read().log_path(&job.id);
    run_blocking(move || {
        let record = RecordedRun::open(&path).map_err(Problem::conflict)?;
        let robot = record.own_robot().map_err(Problem::conflict)?;
        let plan = record.plan(&robot).map_err(Problem::conflict)?;
        let name = format!("{} on {}", job.name, job.robot);
        let of = |run| Subject { name: &name, robot: &robot, plan: &plan, run, laid: None, scene: None };
        let page = match control {
            Some(control) => page::render_live(&of(None), control),
            None => page::render(&of(Some(&record))),
        };
        page.map(Html).map_err(Problem::bad)
    })
    .await
}
