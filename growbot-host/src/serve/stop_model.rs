//! Sequences of orders and faults against a model: a robot heats only after an order that nothing later has voided, and
//! no stop gets lost.
//!
//! All pairs run as a test. `cargo stop-triples` runs all triples.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use growbot_client::robot_file;
use growbot_core::link::message::{MaintenanceTask, PauseCause, State};

use super::api::{Access, Order, make_job};
use super::audit::{Audit, CommandSource};
use super::commands::{COMMAND_TIMEOUT, RobotCommand, run_command};
use super::config::{NotifyEntry, RobotEntry};
use super::fake_board::{FakeLine, LineState};
use super::grow_request::GrowRequest;
use super::job_store::JobStore;
use super::notifier::Notifier;
use super::robot_worker::{Claim, RobotRequest, RobotWorker};
use super::{Service, ServiceContext, ServicePaths};

/// Number of cases at a time.
const PARALLEL: usize = 96;
/// Time after each step for what the robot's thread does by itself.
const SETTLE: Duration = Duration::from_millis(8);
/// Maximum time until the robot's thread has connected again.
const CONNECT_LIMIT: Duration = Duration::from_secs(20);
const ROBOT: &str = "growbot-a2";

/// An order of a person, or an event of the board, its line or the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Grow,
    Resume,
    Continue,
    Preheat,
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
    const ALL: [Self; 19] = [
        Self::Grow,
        Self::Resume,
        Self::Continue,
        Self::Preheat,
        Self::Pause,
        Self::Stop,
        Self::EmergencyStop,
        Self::Cancel,
        Self::ClearFault,
        Self::WithdrawStop,
        Self::BoardLosesHost,
        Self::BoardParks,
        Self::BoardFails,
        Self::BoardLosesPower,
        Self::LineLost,
        Self::LineSilent,
        Self::LineBack,
        Self::ServiceRestarts,
        Self::DiskFails,
    ];
}

/// State in which a case begins.
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

/// The model: what the orders of a person allow and require.
#[derive(Default)]
struct Model {
    may_heat: bool,
    must_be_off: bool,
}

impl Model {
    fn step(&mut self, step: Step, accepted: bool) {
        match step {
            Step::Grow | Step::Resume | Step::Continue | Step::Preheat if accepted => {
                (self.may_heat, self.must_be_off) = (true, false);
            }
            Step::Stop | Step::EmergencyStop => (self.may_heat, self.must_be_off) = (false, true),
            Step::Pause | Step::Cancel if accepted => self.may_heat = false,
            Step::WithdrawStop if accepted => self.must_be_off = false,
            Step::BoardParks | Step::BoardFails | Step::BoardLosesPower => self.may_heat = false,
            _ => {}
        }
    }
}

/// A service with one robot.
struct Case<'a> {
    service: &'a Service,
    name: String,
    line: FakeLine,
    worker: Arc<RobotWorker>,
    model: Model,
}

impl<'a> Case<'a> {
    fn new(service: &'a Service, name: String) -> Self {
        let line = FakeLine::new(robot_file::load(ROBOT.as_ref()).unwrap());
        let worker = start(service, &name, &line);
        Self { service, name, line, worker, model: Model::default() }
    }

    fn run(&mut self, steps: impl Iterator<Item = Step>) -> Vec<String> {
        self.wait_for_connection();
        for step in steps {
            self.step(step);
            sleep(SETTLE);
        }
        // However the case ends, the line comes back and the service follows.
        self.line.board().line = LineState::Up;
        self.wait_for_connection();
        sleep(SETTLE);
        let board = self.line.board();
        let mut violations = board.violations.clone();
        if self.model.must_be_off && board.is_hot() {
            violations.push(format!("{} after a stop", board.state.name()));
        }
        violations
    }

    fn wait_for_connection(&self) {
        let began = Instant::now();
        while self.worker.status().connection_error.is_some() {
            assert!(began.elapsed() < CONNECT_LIMIT, "{}: {:?}", self.name, self.worker.status());
            sleep(Duration::from_millis(1));
        }
    }

    fn step(&mut self, step: Step) {
        let before = self.model.may_heat;
        if matches!(step, Step::Grow | Step::Resume | Step::Continue | Step::Preheat) {
            self.line.board().may_heat = true;
        }
        let accepted = self.carry_out(step).is_ok();
        self.model.step(step, accepted);
        self.line.board().may_heat = self.model.may_heat;
        if !accepted {
            assert!(self.model.may_heat == before || !self.model.may_heat);
        }
    }

    fn carry_out(&mut self, step: Step) -> Result<(), String> {
        let permit = self.worker.signal().permit();
        let command = |command| run_command(&self.worker, command, &permit);
        match step {
            Step::Grow => {
                let wanted = GrowRequest { to: Some("0,0,8,0,90".to_owned()), ..GrowRequest::default() };
                let access = Access::Control(CommandSource::Socket);
                let order = Order { permit, claim: Claim::default() };
                let made = make_job(self.service, &self.worker, &wanted, access, order, None);
                return made.map(drop).map_err(|problem| problem.detail);
            }
            Step::Resume => {
                let jobs = self.service.shared.jobs_to_read().latest(1000).map_err(|error| error.to_string())?;
                let job = jobs.into_iter().find(|job| job.robot == self.name).ok_or("no job")?;
                self.worker.ensure_idle()?;
                return self.worker.request(RobotRequest::Resume(Box::new(job), permit), COMMAND_TIMEOUT);
            }
            Step::Preheat => {
                self.worker.ensure_idle()?;
                let task = MaintenanceTask::Preheat { target_centi_c: 20_000 };
                return self.worker.request(RobotRequest::Task(task, permit), COMMAND_TIMEOUT);
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
            Step::BoardLosesHost if board.state == State::Growing => {
                (board.state, board.pause) = (State::Paused, PauseCause::HostSilent);
            }
            Step::BoardParks if matches!(board.state, State::Growing | State::Paused) => board.state = State::Parked,
            Step::BoardFails => board.state = State::Fault,
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

fn start(service: &Service, name: &str, line: &FakeLine) -> Arc<RobotWorker> {
    let entry = RobotEntry { port: "tcp:127.0.0.1:1".to_owned(), robot: Some(ROBOT.to_owned()), pace: None };
    RobotWorker::start_with(name, &entry, Arc::new(line.clone()), &service.places, Arc::clone(&service.shared))
}

fn service(directory: &tempfile::TempDir) -> Service {
    let places = ServicePaths::in_dir(directory.path().to_path_buf());
    let jobs = JobStore::open(&places).unwrap();
    let (notifier, _) = Notifier::new(&NotifyEntry::default(), &places).unwrap();
    let shared = Arc::new(ServiceContext {
        job_writer: Mutex::new(jobs),
        job_reader: Mutex::new(JobStore::open_to_read(&places).unwrap()),
        audit: Audit::open(&places.audit()).unwrap(),
        notifier,
        previews: Mutex::default(),
        changes: tokio::sync::watch::Sender::new(0),
    });
    Service { places, robots: BTreeMap::new(), shared, addresses: OnceLock::new() }
}

/// Runs all sequences of `length` steps in every state. Returns those that break the model, and the number of all.
fn failures(length: u32) -> (Vec<String>, usize) {
    let steps = Step::ALL.len();
    let sequences = steps.pow(length);
    let count = Start::ALL.len() * sequences;
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
    let (failures, count) = failures(2);
    assert!(failures.is_empty(), "{} of {count}:\n{}", failures.len(), failures.join("\n"));
}

#[test]
#[ignore = "takes minutes; cargo stop-triples runs it"]
fn every_triple_of_orders_and_faults_heats_only_as_ordered() {
    let (failures, count) = failures(3);
    println!("{count} sequences, {} broken", failures.len());
    assert!(failures.is_empty(), "{} of {count}:\n{}", failures.len(), failures.join("\n"));
}
