//! The HTTP interface: its requests and answers, from which its OpenAPI document is made.

use std::convert::Infallible;
use std::fs;
use std::sync::Arc;
use std::time::{Duration, Instant};

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use aide::openapi::{Info, OpenApi};
use aide::transform::TransformOperation;
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, HeaderMap};
use axum::response::sse::{KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use growbot_client::growth::Order;
use growbot_client::input::name_of;
use growbot_client::plan::{Plan, Search};
use growbot_client::plan_file::{self, PlanFile};
use growbot_client::pose_text::{parse_goal, parse_pose};
use growbot_client::run_log::{RunRecord, utc_now};
use growbot_client::warning::PREVENTING;
use growbot_core::job::{job_layers, plan_id};
use growbot_core::link::message::State as BoardState;
use growbot_core::plan::Planner;
use growbot_core::robot::Robot;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::task::spawn_blocking;

use super::Service;
use super::audit::By;
use super::events;
use super::jobs::{Job, JobState};
use super::problem::Problem;
use super::robot::{Ask, Keeper, NewJob, RobotView};
use crate::view::{Subject, page};
use crate::watch::Live;
use crate::watch::server::{self as watch, updates_of};

/// Where the interface is, below the address of a page or of the socket.
pub const PREFIX: &str = "/api/v1";
/// No request is longer, bytes.
const MAX_BODY: usize = 16 << 20;
/// A robot answers an order within this.
const ANSWER: Duration = Duration::from_secs(10);
/// and an emergency stop.
const EMERGENCY: Duration = Duration::from_secs(2);
/// Jobs that are listed at most.
const MAX_JOBS: u32 = 1000;

/// What who asks may do, by the address that was used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Look.
    Read,
    /// Look, and give orders.
    Operate(By),
}

type Shared = State<Arc<Service>>;
type Answer<T> = Result<Json<T>, Problem>;

/// All routes, and the document that describes them.
pub fn routes() -> (Router<Arc<Service>>, OpenApi) {
    let mut document = OpenApi {
        info: Info {
            title: "growbot serve".to_owned(),
            description: Some(
                "Robots that grow, their jobs, and orders to them. Lengths are in mm, angles in degrees, temperatures \
                 in C: names carry the unit. Every address begins with a secret, which `growbot serve` prints; on the \
                 socket of the user's runtime directory there is none."
                    .to_owned(),
            ),
            version: "1".to_owned(),
            ..Info::default()
        },
        ..OpenApi::default()
    };
    let router = ApiRouter::new()
        .api_route("/robots", get_with(robots, says("All robots.")))
        .api_route("/robots/{robot}", get_with(robot, says("One robot.")))
        .api_route(
            "/robots/{robot}/jobs",
            post_with(
                new_job,
                says("Grow a body: a plan, or straight to a goal. The same Idempotency-Key begins no second job."),
            ),
        )
        .api_route(
            "/robots/{robot}/orders",
            post_with(
                order,
                says("Give an order. An emergency stop is answered once the board says that everything is off."),
            ),
        )
        .api_route(
            "/robots/{robot}/maintenance",
            post_with(maintain, says("Heat, load, unload, purge, home, rotate or jog, as `growbot maintain` does.")),
        )
        .api_route("/plans", post_with(new_plan, says("Plan a path; nothing is heated or moved.")))
        .api_route("/jobs", get_with(jobs, says("The latest jobs, the newest first.")))
        .api_route("/jobs/{job}", get_with(job, says("One job.")))
        .api_route("/jobs/{job}/resume", post_with(resume, says("Resume a job that was left unfinished.")))
        .route("/plans/{number}/view", get(view_plan))
        .route("/jobs/{job}/log", get(log))
        .route("/jobs/{job}/view", get(view))
        .route("/jobs/{job}/live/", get(live))
        .route("/jobs/{job}/live/updates", get(live_updates))
        .route("/jobs/{job}/live/orders/{order}", post(live_order))
        .route("/jobs/{job}/events", get(job_events))
        .route("/events", get(robot_events))
        .fallback(nowhere)
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .finish_api(&mut document);
    (router, document)
}

/// What a route is for.
fn says(words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.description(words).default_response::<Problem>()
}

async fn nowhere() -> Problem {
    Problem::not_found("address", "here")
}

fn found<'a>(service: &'a Service, name: &str) -> Result<&'a Arc<Keeper>, Problem> {
    service.robot(name).ok_or_else(|| Problem::not_found("robot", name))
}

fn found_job(service: &Service, id: &str) -> Result<Job, Problem> {
    service.job(id).ok_or_else(|| Problem::not_found("job", id))
}

/// Who may give orders, or the refusal.
fn operator(access: Access) -> Result<By, Problem> {
    match access {
        Access::Operate(by) => Ok(by),
        Access::Read => Err(Problem::read_only()),
    }
}

async fn robots(State(service): Shared) -> Json<Vec<RobotView>> {
    Json(service.robots())
}

async fn robot(State(service): Shared, Path(name): Path<String>) -> Answer<RobotView> {
    Ok(Json(found(&service, &name)?.view()))
}

/// What is to be grown, or planned.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wanted {
    /// A plan, as `growbot plan -o` writes it; without it, a goal.
    pub plan: Option<Value>,
    /// The goal: X,Y,Z,HEADING,PITCH, or X,Y,Z in any direction.
    pub to: Option<String>,
    /// The start; `0,0,0,0,90` without it.
    pub from: Option<String>,
    /// Poses or positions to lead through, in order.
    #[serde(default)]
    pub via: Vec<String>,
    /// Radius of the bends, mm; the robot's planning radius without it.
    pub radius_mm: Option<f64>,
    /// Measure each layer, and plan the rest again from where the tip is.
    #[serde(default)]
    pub feedback: bool,
    /// Grow in spite of self-collision, filament-short or layer-limit.
    #[serde(default)]
    pub force: bool,
    /// What people call the job.
    pub name: Option<String>,
}

impl Wanted {
    /// The plan, and its robot; `robot` is the one that is to grow it.
    fn plan(&self, robot: &Robot) -> Result<Plan, Problem> {
        match (&self.plan, &self.to) {
            (Some(_), Some(_)) => Err(Problem::bad("both plan and to are given: leave one of them out")),
            (None, None) => Err(Problem::bad("there is nothing to grow: give plan, or to")),
            (Some(plan), None) => {
                let text = plan.to_string();
                let (of, plan) = plan_file::read(&text, "the plan", None).map_err(Problem::bad)?;
                if of.hash() != robot.hash() {
                    return Err(Problem::conflict(format!(
                        "the plan is for {} ({:016x}), and the robot is {} ({:016x}): plan for that one",
                        of.name(),
                        of.hash(),
                        robot.name(),
                        robot.hash()
                    )));
                }
                Ok(plan)
            }
            (None, Some(goal)) => {
                let goal = parse_goal(goal).map_err(Problem::bad)?.goal;
                let start = parse_pose(self.from.as_deref().unwrap_or("0,0,0,0,90")).map_err(Problem::bad)?;
                let via: Result<Vec<_>, _> =
                    self.via.iter().map(|via| parse_goal(via).map(|typed| typed.goal)).collect();
                let search = Search {
                    radius: self.radius_mm.unwrap_or(robot.description().planning_radius_mm),
                    planner: Planner::Shortest,
                    clear_of_self: true,
                };
                Plan::through(robot, &start, &via.map_err(Problem::bad)?, &goal, &search).map_err(Problem::bad)
            }
        }
    }
}

/// Something that takes long is done beside the server.
async fn beside<T: Send + 'static>(what: impl FnOnce() -> Result<T, Problem> + Send + 'static) -> Result<T, Problem> {
    spawn_blocking(what).await.map_err(Problem::internal)?
}

async fn new_job(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
    headers: HeaderMap,
    Json(wanted): Json<Wanted>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let by = operator(access)?;
    let keeper = Arc::clone(found(&service, &name)?);
    let key = headers.get("idempotency-key").and_then(|key| key.to_str().ok()).map(str::to_owned);
    beside(move || {
        let made = make_job(&service, &keeper, &wanted, key.as_deref());
        let refused = made.as_ref().err().map(|problem| problem.detail.clone());
        service.shared.audit.note(by, &name, "grow", refused.as_deref());
        made
    })
    .await
}

fn make_job(
    service: &Service,
    keeper: &Keeper,
    wanted: &Wanted,
    key: Option<&str>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let before = key.map(|key| service.shared.jobs().with_key(key)).transpose().map_err(Problem::internal)?;
    if let Some(job) = before.flatten() {
        return Ok((StatusCode::OK, Json(job)));
    }
    let robot = keeper.description().map_err(Problem::conflict)?;
    let plan = wanted.plan(&robot)?;
    let preventing = plan.warnings.iter().find(|warning| PREVENTING.contains(&warning.code.as_str()));
    if let Some(warning) = preventing.filter(|_| !wanted.force) {
        return Err(Problem::conflict(format!(
            "not grown because of {}: {}; change the plan, or say force",
            warning.code, warning.message
        )));
    }
    if let Some(job) = keeper.view().job {
        return Err(Problem::conflict(format!("robot {} has a job, {job}: wait for its end, or stop it", keeper.name)));
    }
    let layers: Vec<_> = job_layers(&plan.path, &robot).collect();
    let id = service.shared.jobs().new_id(&keeper.name);
    let job = Job {
        robot: keeper.name.clone(),
        name: wanted.name.clone().unwrap_or_else(|| wanted.to.clone().unwrap_or_else(|| "a plan".to_owned())),
        state: JobState::Active,
        plan_id: format!("{:016x}", plan_id(&robot, &layers)),
        layers: u32::try_from(layers.len()).unwrap_or(u32::MAX),
        laid: 0,
        length_mm: plan.needs.length,
        simulated: keeper.is_simulated(),
        created_utc: utc_now(),
        ended_utc: None,
        why: None,
        id,
    };
    service.shared.jobs().enter(&job, key).map_err(Problem::internal)?;
    let new = NewJob { job: job.clone(), plan, robot, feedback: wanted.feedback };
    if let Err(why) = keeper.ask(Ask::Grow(Box::new(new)), ANSWER) {
        // One that has begun since stands as its robot says.
        if !service.shared.jobs().log(&job.id).exists() {
            service.shared.jobs().set(&job.id, JobState::Ended, Some(&why)).map_err(Problem::internal)?;
        }
        return Err(Problem::conflict(why));
    }
    Ok((StatusCode::CREATED, Json(job)))
}

async fn resume(State(service): Shared, Extension(access): Extension<Access>, Path(id): Path<String>) -> Answer<Job> {
    let by = operator(access)?;
    let job = found_job(&service, &id)?;
    let keeper = Arc::clone(found(&service, &job.robot)?);
    beside(move || {
        let asked = match keeper.view().job {
            Some(other) => Err(format!("robot {} has a job, {other}: wait for its end, or stop it", job.robot)),
            None => keeper.ask(Ask::Resume(Box::new(job.clone())), ANSWER),
        };
        service.shared.audit.note(by, &job.robot, "resume", asked.as_ref().err().map(String::as_str));
        asked.map_err(Problem::conflict)?;
        found_job(&service, &id).map(Json)
    })
    .await
}

/// An order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OrderName {
    /// Pause after the layer under way.
    Pause,
    /// Continue after a pause.
    Continue,
    /// Heater and steppers off; the body can be resumed.
    Stop,
    /// Everything off, ahead of all else.
    EmergencyStop,
    /// Leave a fault or an emergency stop.
    ClearFault,
    /// Give up the body that hangs on the robot.
    Cancel,
}

impl OrderName {
    fn name(self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::Continue => "continue",
            Self::Stop => "stop",
            Self::EmergencyStop => "emergency-stop",
            Self::ClearFault => "clear-fault",
            Self::Cancel => "cancel",
        }
    }
}

/// The order to give.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Given {
    /// The order.
    pub order: OrderName,
}

async fn order(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
    Json(Given { order }): Json<Given>,
) -> Answer<RobotView> {
    let by = operator(access)?;
    let keeper = Arc::clone(found(&service, &name)?);
    beside(move || {
        let given = give(&keeper, order);
        service.shared.audit.note(by, &name, order.name(), given.as_ref().err().map(String::as_str));
        given.map_err(Problem::conflict)?;
        Ok(Json(keeper.view()))
    })
    .await
}

fn give(keeper: &Keeper, order: OrderName) -> Result<(), String> {
    let of_growth = match order {
        OrderName::Pause => Some(Order::Pause),
        OrderName::Continue => Some(Order::Continue),
        OrderName::Stop => Some(Order::Stop),
        OrderName::EmergencyStop => Some(Order::EmergencyStop),
        OrderName::ClearFault | OrderName::Cancel => None,
    };
    match (order, of_growth) {
        (OrderName::EmergencyStop, Some(stop)) if keeper.order(stop) => wait_until_off(keeper),
        (_, Some(order)) if keeper.order(order) => Ok(()),
        (OrderName::EmergencyStop, _) => keeper.ask(Ask::EmergencyStop, EMERGENCY),
        (OrderName::Stop, _) => keeper.ask(Ask::Stop, ANSWER),
        (OrderName::ClearFault, _) => keeper.ask(Ask::ClearFault, ANSWER),
        (OrderName::Cancel, _) if keeper.view().job.is_some() => {
            Err(format!("robot {} has a job under way: stop it first", keeper.name))
        }
        (OrderName::Cancel, _) => keeper.ask(Ask::Cancel, ANSWER),
        (OrderName::Pause | OrderName::Continue, _) => {
            Err(format!("robot {} has no job under way, so there is nothing to {}", keeper.name, order.name()))
        }
    }
}

/// Waits until the board has said that everything is off.
fn wait_until_off(keeper: &Keeper) -> Result<(), String> {
    let began = Instant::now();
    loop {
        if keeper.view().board.as_deref() == Some(BoardState::EmergencyStop.name()) {
            return Ok(());
        }
        if began.elapsed() > EMERGENCY {
            return Err("nobody has acknowledged the emergency stop: cut the power of the robot now".to_owned());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Maintenance, in the words of `growbot maintain`.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Maintenance {
    /// preheat, cooldown, load, unload, purge, home, rotate or jog.
    pub task: String,
    /// A temperature in C, a length in mm, an angle in degrees, or a material.
    #[serde(default)]
    pub value: String,
}

async fn maintain(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
    Json(Maintenance { task, value }): Json<Maintenance>,
) -> Answer<RobotView> {
    let by = operator(access)?;
    let keeper = Arc::clone(found(&service, &name)?);
    beside(move || {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let understood = keeper.presets().task(&task, &value, &robot);
        let asked = match (understood, keeper.view().job) {
            (None, _) => return Err(Problem::bad(format!("{task:?} is no task of maintenance"))),
            (Some(Err(why)), _) => return Err(Problem::bad(why)),
            (Some(Ok(_)), Some(_)) => Err(format!("robot {name} has a job under way: pause it, and use its page")),
            (Some(Ok(task)), None) => keeper.ask(Ask::Task(task), ANSWER),
        };
        service.shared.audit.note(by, &name, &task, asked.as_ref().err().map(String::as_str));
        asked.map_err(Problem::conflict)?;
        Ok(Json(keeper.view()))
    })
    .await
}

/// The robot that a plan is for.
#[derive(Debug, Deserialize, JsonSchema)]
struct ForRobot {
    /// As the service calls it.
    robot: String,
}

/// A plan, and where it can be looked at.
#[derive(Debug, Serialize, JsonSchema)]
struct Planned {
    /// The plan, as `growbot plan --json` gives it.
    plan: Value,
    /// Its page, below the address of this interface: for a while.
    view: String,
}

async fn new_plan(
    State(service): Shared,
    Query(ForRobot { robot }): Query<ForRobot>,
    Json(wanted): Json<Wanted>,
) -> Answer<Planned> {
    let keeper = Arc::clone(found(&service, &robot)?);
    beside(move || {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let plan = wanted.plan(&robot)?;
        let subject = Subject { name: "preview", robot: &robot, plan: &plan, run: None, laid: None };
        let page = page::of_one(&subject).map_err(Problem::bad)?;
        let view = format!("plans/{}/view", service.shared.keep_preview(page));
        let plan = serde_json::to_value(PlanFile::with_robot(&plan, &robot)).map_err(Problem::internal)?;
        Ok(Json(Planned { plan, view }))
    })
    .await
}

async fn view_plan(State(service): Shared, Path(number): Path<u64>) -> Result<Html<String>, Problem> {
    let page = service.shared.preview(number);
    page.map(Html).ok_or_else(|| Problem::not_found("preview any more, of", &number.to_string()))
}

/// How many jobs are listed.
#[derive(Debug, Deserialize, JsonSchema)]
struct Listed {
    /// At most so many: 100 unless given, 1000 at most.
    max: Option<u32>,
}

async fn jobs(State(service): Shared, Query(Listed { max }): Query<Listed>) -> Answer<Vec<Job>> {
    let max = max.unwrap_or(100).min(MAX_JOBS);
    service.shared.jobs().latest(max).map(Json).map_err(Problem::internal)
}

async fn job(State(service): Shared, Path(id): Path<String>) -> Answer<Job> {
    found_job(&service, &id).map(Json)
}

async fn log(State(service): Shared, Path(id): Path<String>) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    let path = service.shared.jobs().log(&job.id);
    let bytes = fs::read(path).map_err(|error| Problem::conflict(format!("its run log cannot be read: {error}")))?;
    Ok(([(CONTENT_TYPE, "application/jsonl")], bytes).into_response())
}

/// The page that follows a job under way; of one that has ended, what is left of it.
async fn live(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path(id): Path<String>,
) -> Result<Html<String>, Problem> {
    let job = found_job(&service, &id)?;
    let is_live = found(&service, &job.robot).is_ok_and(|keeper| keeper.live(&id).is_some());
    page_of(&service, &id, is_live.then_some(access != Access::Read)).await
}

fn live_of(service: &Service, id: &str) -> Result<(Job, Arc<Live>), Problem> {
    let job = found_job(service, id)?;
    let live = found(service, &job.robot)?.live(id);
    live.map(|live| (job, live)).ok_or_else(|| Problem::conflict(format!("job {id} is not under way")))
}

async fn live_updates(State(service): Shared, Path(id): Path<String>) -> Result<Response, Problem> {
    live_of(&service, &id).map(|(_, live)| updates_of(live).into_response())
}

async fn live_order(
    State(service): Shared,
    Extension(access): Extension<Access>,
    Path((id, order)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let by = operator(access)?;
    let (job, live) = live_of(&service, &id)?;
    service.shared.audit.note(by, &job.robot, &order, None);
    Ok(watch::give(&live, &order).await)
}

async fn view(State(service): Shared, Path(id): Path<String>) -> Result<Html<String>, Problem> {
    found_job(&service, &id)?;
    page_of(&service, &id, None).await
}

/// The page of a job's run log; of one under way with whether it may give orders.
async fn page_of(service: &Service, id: &str, control: Option<bool>) -> Result<Html<String>, Problem> {
    let path = service.shared.jobs().log(id);
    beside(move || {
        let record = RunRecord::open(&path).map_err(Problem::conflict)?;
        let robot = record.own_robot().map_err(Problem::conflict)?;
        let plan = record.plan(&robot).map_err(Problem::conflict)?;
        let name = name_of(&path);
        let of = |run| Subject { name: &name, robot: &robot, plan: &plan, run, laid: None };
        let page = match control {
            Some(control) => page::of_growth(&of(None), control),
            None => page::of_one(&of(Some(&record))),
        };
        page.map(Html).map_err(Problem::bad)
    })
    .await
}

/// From where on events are wanted.
#[derive(Debug, Deserialize)]
struct After {
    after: Option<u64>,
}

async fn job_events(
    State(service): Shared,
    Path(id): Path<String>,
    Query(After { after }): Query<After>,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let job = found_job(&service, &id)?;
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse().ok());
    let after = last.or(after).unwrap_or(0);
    Ok(Sse::new(events::of_job(service, job.id, after)).keep_alive(KeepAlive::default()))
}

async fn robot_events(
    State(service): Shared,
) -> Sse<impl futures_util::Stream<Item = Result<axum::response::sse::Event, Infallible>>> {
    Sse::new(events::of_robots(service)).keep_alive(KeepAlive::default())
}
