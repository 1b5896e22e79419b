//! Tests of a robot's thread with sequences of orders and faults. The results are compared with a model: a robot heats
//! only after an order that nothing later has voided, and no stop gets lost.
//!
//! All pairs of steps run as a test, and some triples. `cargo stop-triples` runs all triples.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::task::{Context, Waker};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use axum::Extension;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use growbot_client::robot_command::RobotCommand;
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{MaintenanceTask, PauseCause, State as BoardState};
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_plan::run_log::utc_now;
use growbot_remote::api::{GrowRequest, Job, JobState, QueuedBody};
use strum::VariantArray;

use super::access::Access;
use super::audit::{Audit, CommandSource};
use super::camera::Cameras;
use super::commands::{COMMAND_TIMEOUT, run_command};
use super::config::{NotifyEntry, RobotEntry};
use super::fake_board::{FakeLine, LineState};
use super::grow_request::resolve_request;
use super::job_routes::{Order, make_job, new_job, resume_job};
use super::job_store::JobStore;
use super::json_body::JsonBody;
use super::library_store::LibraryStore;
use super::limits::{Computation, RoleLimits};
use super::notifier::Notifier;
use super::page_source::PageSource as _;
use super::paths::ServicePaths;
use super::problem::Problem;
use super::queue_store::QueueStore;
use super::robot_error::RobotRequestError;
use super::robot_request::{Claim, NewBody, NewJob, RobotRequest};
use super::robot_worker::RobotWorker;
use super::service::Service;
use super::service_context::ServiceContext;
use super::snapshot_store::SnapshotStore;
use crate::watch::heartbeat::OrderAge;

/// Number of test cases that run at the same time.
const PARALLEL: usize = 96;
/// Minimum time after each step in which the robot's thread can act by itself.
const SETTLE: Duration = Duration::from_millis(8);
/// Number of waits for bytes after which the robot's thread has carried out all queued requests.
const SETTLE_WAITS: u32 = 8;
/// Maximum time of a wait of a test, for example until the robot's thread has connected again.
const CONNECT_LIMIT: Duration = Duration::from_secs(300);
pub(super) const ROBOT: &str = "growbot-a2";

/// An order of a person, or an event of the board, its line or the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub(super) enum Step {
    Grow,
    /// A person confirms that the last body is removed, so the queued body grows.
    GrowQueued,
    Resume,
    Continue,
    Preheat,
    Tune,
    Pause,
    Stop,
    EmergencyStop,
    Cancel,
    ClearFault,
    WithdrawStop,
    BoardLosesHost,
    BoardParks,
    BoardFails,
    BoardLosesPower,
    LineLost,
    LineSilent,
    LineBack,
    ServiceRestarts,
    DiskFails,
}

impl Step {
    const ALL: [Self; 21] = *Self::VARIANTS.as_array().unwrap();

    fn is_heating_order(self) -> bool {
        matches!(self, Self::Grow | Self::GrowQueued | Self::Resume | Self::Continue | Self::Preheat | Self::Tune)
    }
}

/// State of the robot in which a test case begins.
#[derive(Debug, Clone, Copy)]
enum Start {
    Idle,
    Growing,
    Paused,
    Parked,
    Stopped,
    Fault,
}

impl Start {
    const ALL: [Self; 6] = [Self::Idle, Self::Growing, Self::Paused, Self::Parked, Self::Stopped, Self::Fault];

    fn steps(self) -> &'static [Step] {
        match self {
            Self::Idle => &[],
            Self::Growing => &[Step::Grow],
            Self::Paused => &[Step::Grow, Step::Pause],
            Self::Parked => &[Step::Grow, Step::BoardParks],
            Self::Stopped => &[Step::Grow, Step::Stop],
            Self::Fault => &[Step::Grow, Step::BoardFails],
        }
    }
}

/// Model of the orders and events of a sequence: whether they allow the robot to heat, and whether they require it to
/// be off.
///
/// An order to continue that is repeated on a silent line stays valid when the board parks, because a person has given
/// it and only a later stop or pause voids it.
#[derive(Default)]
struct Model {
    may_heat: bool,
    must_be_off: bool,
    is_silent: bool,
    /// True while an order to continue is repeated on a silent line.
    continues: bool,
}

impl Model {
    fn step(&mut self, step: Step, accepted: bool) {
        self.is_silent = match step {
            Step::LineSilent => true,
            Step::LineLost | Step::LineBack => false,
            _ => self.is_silent,
        };
        self.continues = match step {
            Step::Continue if accepted => self.is_silent,
            Step::Pause if accepted => false,
            Step::Stop | Step::EmergencyStop | Step::BoardFails | Step::BoardLosesPower => false,
            Step::LineLost | Step::LineBack | Step::ServiceRestarts => false,
            _ => self.continues,
        };
        match step {
            step if step.is_heating_order() && accepted => {
                (self.may_heat, self.must_be_off) = (true, false);
            }
            Step::Stop | Step::EmergencyStop => (self.may_heat, self.must_be_off) = (false, true),
            Step::Pause | Step::Cancel if accepted => self.may_heat = false,
            Step::WithdrawStop if accepted => self.must_be_off = false,
            Step::BoardParks if self.continues => {}
            Step::BoardParks | Step::BoardFails | Step::BoardLosesPower => self.may_heat = false,
            _ => {}
        }
    }
}

/// A test case: one robot of a service, its simulated line and the model of its orders.
pub(super) struct Case<'a> {
    service: &'a Service,
    name: String,
    pub(super) line: FakeLine,
    pub(super) worker: Arc<RobotWorker>,
    model: Model,
    /// Number of bodies that must be in the queue: one until it has grown.
    queued: usize,
}

impl<'a> Case<'a> {
    pub(super) fn new(service: &'a Service, name: String) -> Self {
        let line = FakeLine::new(robot_file::load(ROBOT.as_ref()).unwrap());
        let worker = start(service, &name, &line);
        let body = QueuedBody {
            id: String::new(),
            name: "a body".to_owned(),
            layers: 8,
            length_mm: 8.0,
            duration_s: 8.0,
            feedback: false,
            force: false,
            ignore_scene: false,
            created_utc: utc_now(),
        };
        service.shared.queue.push(&name, body, short_body()).unwrap();
        Self { service, name, line, worker, model: Model::default(), queued: 1 }
    }

    pub(super) fn run(&mut self, steps: impl Iterator<Item = Step>) -> Vec<String> {
        self.wait_for_connection();
        for step in steps {
            self.step(step);
            self.settle();
        }
        self.finish()
    }

    /// Ends the case: the line comes back, and the service follows. Returns what breaks the model.
    pub(super) fn finish(&mut self) -> Vec<String> {
        self.line.board().line = LineState::Up;
        self.wait_for_connection();
        self.settle();
        let board = self.line.board();
        let mut violations = board.violations.clone();
        if self.model.must_be_off && board.is_hot() {
            violations.push(format!("{} after a stop", board.state.name()));
        }
        let queued = self.service.shared.queue.bodies(&self.name).unwrap().len();
        if queued != self.queued {
            violations.push(format!("{queued} bodies in the queue instead of {}", self.queued));
        }
        violations
    }

    /// Waits until the robot's thread has had time to act by itself and, if it is connected, to carry out all queued
    /// requests.
    pub(super) fn settle(&self) {
        let waits = self.line.waits();
        sleep(SETTLE);
        let began = Instant::now();
        while self.line.waits() < waits + SETTLE_WAITS && self.worker.status().connection_error.is_none() {
            assert!(began.elapsed() < CONNECT_LIMIT, "{}: {:?}", self.name, self.worker.status());
            sleep(Duration::from_millis(1));
        }
    }

    pub(super) fn wait_for_connection(&self) {
        let began = Instant::now();
        while self.worker.status().connection_error.is_some() {
            assert!(began.elapsed() < CONNECT_LIMIT, "{}: {:?}", self.name, self.worker.status());
            sleep(Duration::from_millis(1));
        }
    }

    pub(super) fn step(&mut self, step: Step) {
        let before = self.model.may_heat;
        if step.is_heating_order() {
            self.line.board().may_heat = true;
        }
        let accepted = self.carry_out(step).is_ok();
        self.model.step(step, accepted);
        self.line.board().may_heat = self.model.may_heat;
        if !accepted {
            assert!(self.model.may_heat == before || !self.model.may_heat);
        }
    }

    fn grow(&self, wanted: &GrowRequest, permit: Permit) -> Result<(), Problem> {
        let access = Access::Control(CommandSource::Socket);
        let order = Order { permit, claim: Claim::default() };
        let computation = Computation::new(&Arc::default());
        let plan = |robot: &Robot| {
            resolve_request(
                wanted,
                robot,
                &|job| self.worker.last_body(job),
                self.service.places(),
                access,
                &computation,
            )
        };
        make_job(self.service, &self.worker, wanted, plan, order, None).map(drop)
    }

    pub(super) fn carry_out(&mut self, step: Step) -> Result<(), Problem> {
        let permit = self.worker.signal().permit();
        let command = |command| Ok(run_command(&self.worker, command, &permit).map(drop)?);
        match step {
            Step::Grow => return self.grow(&short_body(), permit),
            Step::GrowQueued => {
                let queue = &self.service.shared.queue;
                let first = queue.bodies(&self.name)?.into_iter().next();
                let id = first.ok_or_else(|| Problem::not_found("queued body", ""))?.id;
                queue.start(&self.name, &id, |wanted| self.grow(&wanted, permit))?;
                self.queued = 0;
                return Ok(());
            }
            Step::Resume => {
                let jobs = self.service.shared.jobs_to_read().latest(1000).map_err(Problem::internal)?;
                let job =
                    jobs.into_iter().find(|job| job.robot == self.name).ok_or_else(|| Problem::not_found("job", ""))?;
                return Ok(resume_job(&self.worker, &job, Order { permit, claim: Claim::default() })?);
            }
            Step::Preheat => {
                self.worker.ensure_idle()?;
                let task = MaintenanceTask::Preheat { target_centi_c: 20_000 };
                return Ok(self.worker.request(RobotRequest::Task(task, permit), COMMAND_TIMEOUT).map(drop)?);
            }
            Step::Tune => {
                self.worker.ensure_idle()?;
                return Ok(self.worker.request(RobotRequest::Tune(200.0, permit), COMMAND_TIMEOUT).map(drop)?);
            }
            Step::Continue => return command(RobotCommand::Continue),
            Step::Pause => return command(RobotCommand::Pause),
            Step::Stop => return command(RobotCommand::Stop),
            Step::EmergencyStop => return command(RobotCommand::EmergencyStop),
            Step::Cancel => return command(RobotCommand::Cancel),
            Step::ClearFault => return command(RobotCommand::ClearFault),
            Step::WithdrawStop => return command(RobotCommand::WithdrawStop),
            _ => {}
        }
        let mut board = self.line.board();
        match step {
            Step::BoardLosesHost if board.state == BoardState::Growing => {
                (board.state, board.pause) = (BoardState::Paused, PauseCause::HostSilent);
            }
            Step::BoardParks if matches!(board.state, BoardState::Growing | BoardState::Paused) => {
                board.state = BoardState::Parked;
            }
            Step::BoardFails => board.state = BoardState::Fault,
            Step::BoardLosesPower => board.lose_power(),
            Step::LineLost => board.line = LineState::Missing,
            Step::LineSilent => board.line = LineState::Silent,
            Step::LineBack => board.line = LineState::Up,
            Step::DiskFails => {
                // A directory in the file's place: the stop cannot be stored.
                let file = self.service.places.stops().join(format!("{}.json", self.name));
                let _ = std::fs::create_dir_all(file.join("full"));
            }
            Step::ServiceRestarts => {
                drop(board);
                self.line.kill_service();
                self.line = self.line.for_next_service();
                self.worker = start(self.service, &self.name, &self.line);
            }
            _ => {}
        }
        Ok(())
    }
}

/// Returns the request to grow a short body.
fn short_body() -> GrowRequest {
    GrowRequest { to: Some("0,0,8,0,90".to_owned()), ..GrowRequest::default() }
}

pub(super) fn start(service: &Service, name: &str, line: &FakeLine) -> Arc<RobotWorker> {
    start_at("tcp:127.0.0.1:1", service, name, line)
}

fn start_at(port: &str, service: &Service, name: &str, line: &FakeLine) -> Arc<RobotWorker> {
    let entry = RobotEntry { port: port.to_owned(), robot: Some(ROBOT.to_owned()), pace: None };
    RobotWorker::start_with(name, &entry, Arc::new(line.clone()), &service.places, Arc::clone(&service.shared))
}

pub(super) fn service(directory: &tempfile::TempDir) -> Service {
    service_with(directory, &NotifyEntry::default())
}

/// Returns a service without robots, with these settings of notices. Its notices stay in their queues, because no
/// thread sends them.
pub(super) fn service_with(directory: &tempfile::TempDir, notify: &NotifyEntry) -> Service {
    let places = ServicePaths::in_dir(directory.path().to_path_buf());
    let jobs = JobStore::open(&places).unwrap();
    let (notifier, _) = Notifier::new(notify, &places).unwrap();
    let shared = Arc::new(ServiceContext {
        job_writer: Arc::new(Mutex::new(jobs)),
        job_reader: Mutex::new(JobStore::open_to_read(&places).unwrap()),
        audit: Audit::open(&places.audit()).unwrap(),
        notifier,
        cameras: Cameras::start(&BTreeMap::new(), &BTreeMap::new(), SnapshotStore::new(&places)).unwrap(),
        previews: Mutex::default(),
        queue: QueueStore::new(&places),
        library: LibraryStore::new(&places),
        changes: tokio::sync::watch::Sender::new(0),
    });
    Service { places, robots: BTreeMap::new(), shared, addresses: OnceLock::new() }
}

/// Runs every `stride`th sequence of `length` steps, from each start state. Returns descriptions of the sequences that
/// break the model, and the number of sequences that were run.
fn failures(length: u32, stride: usize) -> (Vec<String>, usize) {
    let steps = Step::ALL.len();
    let sequences = steps.pow(length);
    let count = (Start::ALL.len() * sequences).div_ceil(stride);
    let (next, failures) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..PARALLEL {
            scope.spawn(|| {
                let directory = tempfile::tempdir().unwrap();
                let service = service(&directory);
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        return;
                    }
                    let number = number * stride;
                    let start = Start::ALL[number / sequences];
                    let digits = (0..length).map(|digit| Step::ALL[number % sequences / steps.pow(digit) % steps]);
                    let sequence: Vec<Step> = start.steps().iter().copied().chain(digits).collect();
                    let mut case = Case::new(&service, format!("robot{number}"));
                    let broken = case.run(sequence.iter().copied());
                    case.line.kill_service();
                    if !broken.is_empty() {
                        failures.lock().unwrap().push(format!("{start:?} {sequence:?}: {broken:?}"));
                    }
                }
            });
        }
    });
    (failures.into_inner().unwrap(), count)
}

#[test]
fn every_pair_of_orders_and_faults_heats_only_as_ordered() {
    let (failures, count) = failures(2, 1);
    assert!(failures.is_empty(), "{} of {count}:\n{}", failures.len(), failures.join("\n"));
}

/// Runs every 197th triple of steps. The environment variable `GROWBOT_TRIPLE_STEP` sets another number; 1 runs all
/// triples.
#[test]
fn triples_of_orders_and_faults_heat_only_as_ordered() {
    // The default is coprime to the number of steps, so that each step comes at each place.
    let stride = std::env::var("GROWBOT_TRIPLE_STEP").map_or(197, |stride| stride.parse().unwrap());
    let (failures, count) = failures(3, stride);
    println!("{count} sequences, {} broken", failures.len());
    assert!(failures.is_empty(), "{} of {count}:\n{}", failures.len(), failures.join("\n"));
}

/// Waits until `is_so` returns true. Panics after [`CONNECT_LIMIT`].
pub(super) fn wait_until(is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < CONNECT_LIMIT);
        sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_stop_reaches_a_growth_that_is_being_prepared() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    // After the connection the thread corrects the list of jobs, for which it must not wait below.
    case.settle();
    let worker = &case.worker;
    let wanted = short_body();
    let robot = worker.description().unwrap();
    let access = Access::Control(CommandSource::Socket);
    let computation = Computation::new(&Arc::default());
    let plan = resolve_request(&wanted, &robot, &|job| worker.last_body(job), &service.places, access, &computation)
        .unwrap_or_else(|_| panic!("no plan"))
        .plan;
    let job = Job {
        id: "20261123T014500123_lab".to_owned(),
        robot: "lab".to_owned(),
        name: "a body".to_owned(),
        state: JobState::Active,
        plan_id: String::new(),
        layers: 8,
        laid: 0,
        length_mm: 8.0,
        simulated: false,
        ignore_scene: false,
        created_utc: String::new(),
        ended_utc: None,
        reason: None,
    };
    let permit = worker.signal().permit();
    let body = NewBody { plan, robot, scene: None, overrides: Vec::new(), feedback: false };
    let new = NewJob { job, body, permit: permit.clone() };
    thread::scope(|scope| {
        // The preparation needs the list of jobs, which this test holds.
        let jobs = service.shared.jobs();
        let grow = scope.spawn(|| worker.request(RobotRequest::Grow(Box::new(new)), COMMAND_TIMEOUT));
        wait_until(|| worker.status().job.is_some());
        let stop = scope.spawn(|| run_command(worker, RobotCommand::Stop, &permit));
        wait_until(|| worker.status().pending_stop.is_some());
        drop(jobs);
        assert!(matches!(grow.join().unwrap(), Err(RobotRequestError::Voided)));
        stop.join().unwrap().unwrap();
    });
    let board = case.line.board();
    assert!(board.violations.is_empty() && board.state == BoardState::Stopped, "{:?}", board.violations);
}

#[test]
fn an_idle_thread_on_a_virtual_clock_sends_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let line = FakeLine::new(robot_file::load(ROBOT.as_ref()).unwrap());
    let worker = start_at("sim", &service, "lab", &line);
    wait_until(|| worker.status().connection_error.is_none());
    let frames = line.board().frames;
    sleep(20 * SETTLE);
    assert_eq!(line.board().frames, frames);
    // It still carries out requests and stops.
    let permit = worker.signal().permit();
    let task = MaintenanceTask::Preheat { target_centi_c: 20_000 };
    line.board().may_heat = true;
    worker.request(RobotRequest::Task(task, permit.clone()), COMMAND_TIMEOUT).unwrap();
    assert_eq!(worker.status().state.as_deref(), Some(BoardState::Maintenance.name()));
    run_command(&worker, RobotCommand::Stop, &permit).unwrap();
    assert_eq!(line.board().state, BoardState::Stopped);
}

#[test]
fn an_emergency_stop_reaches_the_board_although_the_thread_has_ended() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    case.step(Step::Grow);
    case.line.end_thread();
    // The thread ends at its next use of the line. The stop does not use it.
    wait_until(|| !case.line.has_thread());
    let permit = case.worker.signal().permit();
    run_command(&case.worker, RobotCommand::EmergencyStop, &permit).unwrap();
    assert_eq!(case.line.board().state, BoardState::EmergencyStop);
}

#[test]
fn a_job_whose_requester_has_gone_does_not_begin() {
    let directory = tempfile::tempdir().unwrap();
    let mut service = service(&directory);
    let line = FakeLine::new(robot_file::load(ROBOT.as_ref()).unwrap());
    let worker = start(&service, "lab", &line);
    service.robots.insert("lab".to_owned(), Arc::clone(&worker));
    wait_until(|| worker.status().connection_error.is_none());
    let service = Arc::new(service);
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    let wanted = short_body();
    {
        let _runtime = runtime.enter();
        // The plan is ready, and waits for this lock, when the requester goes.
        let _begins = worker.lock_job_start();
        let order = (
            State(Arc::clone(&service)),
            Extension(service.permits(OrderAge::default())),
            Extension(RoleLimits::new(Access::Control(CommandSource::Socket))),
            Path("lab".to_owned()),
            HeaderMap::new(),
        );
        let mut order = Box::pin(new_job(order, JsonBody(wanted)));
        assert!(order.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        drop(order);
    }
    let audit = || std::fs::read_to_string(service.places.audit()).unwrap();
    wait_until(|| !audit().is_empty());
    assert!(audit().contains("closed the connection"), "{}", audit());
    assert_eq!(service.shared.jobs_to_read().latest(1).unwrap(), []);
    assert_eq!(line.board().state, BoardState::Idle);
}

#[test]
fn a_stop_of_another_origin_voids_earlier_orders() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for step in [Step::Preheat, Step::Grow] {
        for state in [BoardState::EmergencyStop, BoardState::Fault, BoardState::Stopped] {
            case.line.board().state = BoardState::Idle;
            wait_until(|| case.worker.status().state.as_deref() == Some(BoardState::Idle.name()));
            assert_eq!(case.carry_out(step), Ok(()));
            wait_until(|| case.worker.status().target_c.is_some());
            let permit = case.worker.signal().permit();
            assert!(permit.is_valid());
            case.line.board().state = state;
            wait_until(|| case.worker.status().state.as_deref() == Some(state.name()));
            assert!(!permit.is_valid(), "{step:?} {state:?}");
            wait_until(|| case.worker.status().job.is_none());
        }
    }
    let permit = case.worker.signal().permit();
    run_command(&case.worker, RobotCommand::Cancel, &permit).unwrap();
    assert!(!permit.is_valid(), "a cancellation");
}
