//! One robot of the service. Its thread owns the connection to the board, and reconnects after the connection was lost.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::{Command, CommandQueue};
use growbot_client::maintenance::MaterialPresets;
use growbot_client::plan::Plan;
use growbot_client::port::time_since_boot;
use growbot_client::robot_file;
use growbot_client::run_log::RunLog;
use growbot_client::stop_signal::{Generation, Permit, StopLevel, StopSignal};
use growbot_core::link::message::{Cancel, Fault, MaintenanceTask, PassiveRequest, PauseCause, State, Status, celsius};
use growbot_core::robot::Robot;
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::port::{self, PortName};
use growbot_sim::sim_daemon::StateDir;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::config::RobotEntry;
use super::connector::{BoardConnection, ConfiguredPort, Connector};
use super::job_store::{Job, JobState};
use super::port_lease::PortLease;
use super::robot_alerts::LastAlerts;
use super::stop_file::{PauseFile, StopFile};
use super::stopper::Stopper;
use super::{ServiceContext, ServicePaths};
use crate::watch::LiveGrowth;
use crate::watch::heartbeat::{STALE_AFTER, status_age_s};

/// Time between two status requests to a board without a job. A request to the robot's thread waits at most this time
/// before it is handled.
const STATUS_POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Interval at which the idle thread of a robot with a virtual clock repeats failed writes to the list of jobs and to
/// run logs.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);

/// State of the robot's connection: disconnected, ready or busy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RobotState {
    /// The robot's port is missing, or its board does not respond.
    Disconnected,
    /// The robot is connected and has no job.
    Ready,
    /// The robot has a job.
    Busy,
}

/// A robot, its board and its job, as the service last received them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobotStatus {
    /// Name of the robot in the service.
    pub name: String,
    /// Port of the robot.
    pub port: String,
    /// True if the robot is simulated.
    pub simulated: bool,
    /// Pace of the robot's time, in multiples of real time. Null if it is not known.
    pub pace: Option<f64>,
    /// State of the connection.
    pub state: RobotState,
    /// Reason why the robot is not connected. Null if it is connected.
    pub connection_error: Option<String>,
    /// Name of the robot description. Null until the first connection to the board.
    pub robot: Option<String>,
    /// State of the board. Null if the robot is not connected.
    pub board_state: Option<String>,
    /// Code of the latched fault. Null if no fault is latched.
    pub fault: Option<String>,
    /// Explanation of the fault. Null if no fault is latched.
    pub fault_explanation: Option<String>,
    /// Reason why the board pauses. Null if it does not pause.
    pub pause_reason: Option<String>,
    /// Temperature of the nozzle, C. Null without a reading.
    pub temperature_c: Option<f64>,
    /// Target temperature of the nozzle, C. Null while the heater is off.
    pub target_c: Option<f64>,
    /// Number of laid layers of the job that the board stores.
    pub laid: u32,
    /// Number of layers of the job that the board stores.
    pub layers: u32,
    /// Identifier of the active job. Null if the robot has no job.
    pub job: Option<String>,
    /// Expected time of the last layer, RFC 3339. Null unless the robot grows at a known pace.
    pub finish_utc: Option<String>,
    /// Time since the board's latest report, s. The rest of the status is as old. Null before the first report.
    pub status_age_s: Option<f64>,
    /// True if the latest report is older than 5 s, or if there is none. The board may be in another state by now.
    pub stale: bool,
    /// Reason why the board did not carry out the latest command, or why the run log cannot be written. Null otherwise.
    pub command_error: Option<String>,
    /// Stop that the board has not confirmed. It is sent before anything else, also after a restart of the service.
    /// Null if there is none.
    pub pending_stop: Option<StopLevel>,
}

impl RobotStatus {
    /// Returns a copy of the status without its age, so that two statuses can be compared.
    pub(super) fn without_age(&self) -> Self {
        Self { status_age_s: None, ..self.clone() }
    }
}

/// A job to start.
pub struct NewJob {
    pub job: Job,
    pub plan: Plan,
    pub robot: Robot,
    /// Scene with whose obstacles corrections of the path must not collide. `None` if there is none or if it is
    /// ignored.
    pub scene: Option<LoadedScene>,
    pub feedback: bool,
    /// Permit that was issued when the order to grow arrived.
    pub permit: Permit,
}

/// A request that is sent to a robot's thread.
pub enum RobotRequest {
    Grow(Box<NewJob>),
    Resume(Box<Job>, Permit),
    Cancel,
    ClearFault(Permit),
    Task(MaintenanceTask, Permit),
    /// Wake the thread, because a stop was raised that it has to deliver.
    Wake,
    /// Record that the board has confirmed this stop to the thread that sends emergency stops.
    StopConfirmed(Generation),
    /// Lease the port: close it until the lease ends.
    Lend(PortLease),
}

/// A request in the queue of a robot's thread, with the channel on which its response is sent.
pub struct PendingRequest {
    pub request: RobotRequest,
    pub reply: Sender<Result<(), String>>,
    claim: Claim,
}

/// Flag that the robot's thread and the caller share for a request. It is set by the one that acts first: the thread,
/// which takes the request, or the caller, which gives the request up.
#[derive(Clone, Default)]
pub struct Claim(Arc<AtomicBool>);

impl Claim {
    /// Sets the flag. Returns false if it was already set, so that the request had been taken or given up before.
    pub fn take(&self) -> bool {
        !self.0.swap(true, Ordering::AcqRel)
    }

    /// Returns an error if the flag is set. Before the request is sent to the thread, this means that the caller has
    /// given it up.
    pub fn check(&self) -> Result<(), String> {
        if self.0.load(Ordering::Acquire) {
            return Err(
                "the request was not started, because its sender closed the connection: send the request again"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

impl PendingRequest {
    pub(super) fn respond(self, response: Result<(), String>) {
        // The caller may no longer wait for the response.
        let _ = self.reply.send(response);
    }
}

/// One robot of the service: its settings, its latest known state, and the channels to its threads.
pub struct RobotWorker {
    pub(super) name: String,
    pub(super) entry: RobotEntry,
    pub(super) shared: Arc<ServiceContext>,
    known: Mutex<WorkerState>,
    requests: Sender<PendingRequest>,
    pub(super) connector: Arc<dyn Connector>,
    /// Stop signal of the robot. It issues the permits for orders to the robot, and each stop voids them.
    pub(super) signal: Arc<StopSignal>,
    pub(super) stop_file: StopFile,
    pub(super) pause_file: PauseFile,
    pub(super) stopper: Stopper,
    /// Number of stops whose callers wait for the board's confirmation.
    pub(super) stops_in_progress: AtomicU32,
    last_alerts: Mutex<LastAlerts>,
    /// Run logs of ended jobs that have lines that could not be written yet, each with the identifier of its job.
    pub(super) kept_logs: Mutex<Vec<(String, RunLog)>>,
    /// Lock that is held from the check that the robot has no active job until a new job has started.
    job_start: Mutex<()>,
}

/// Latest known state of a robot.
#[derive(Default)]
pub struct WorkerState {
    pub connection_error: Option<String>,
    /// Description of the robot. `None` until the first connection to the board.
    pub robot: Option<Robot>,
    pub status: Option<Status>,
    /// Time of the board's latest report, since the start of the service's computer. `None` before the first report.
    pub reported: Option<Duration>,
    pub job: Option<String>,
    /// Queue of commands to the active growth. `None` if no growth is active.
    pub commands: Option<Arc<CommandQueue>>,
    /// State of the active growth for live pages. `None` if no growth is active.
    pub live_growth: Option<Arc<LiveGrowth>>,
    pub finish_utc: Option<String>,
    pub command_error: Option<String>,
    /// True if the board may not have received an order to pause its growth, because the connection was lost or the
    /// service was restarted. The growth is then paused after the next connection.
    pub pauses_on_reconnect: bool,
}

/// State of the connection to the board after a request, a job or a status request.
pub enum LinkState {
    /// The board is ready for the next request.
    Ready,
    /// The connection is lost or the board does not respond. The text is the reason.
    Lost(String),
    /// The thread must close the port for this lease. The channel reports to the waiting client that the port is
    /// closed.
    Leased(PortLease, Sender<Result<(), String>>),
}

impl RobotWorker {
    /// Starts the threads of a robot that is connected at the port of its entry in `growbot.toml`.
    pub(super) fn start(
        name: &str,
        entry: &RobotEntry,
        places: &ServicePaths,
        shared: Arc<ServiceContext>,
    ) -> Arc<Self> {
        let port = ConfiguredPort(entry.port.clone());
        Self::start_with(name, entry, Arc::new(port), places, shared)
    }

    /// Starts the threads of a robot that is reached through this connector.
    pub(super) fn start_with(
        name: &str,
        entry: &RobotEntry,
        connector: Arc<dyn Connector>,
        places: &ServicePaths,
        shared: Arc<ServiceContext>,
    ) -> Arc<Self> {
        let (sender, requests) = mpsc::channel();
        let signal = Arc::<StopSignal>::default();
        let (stop_file, left) = StopFile::open(places, name);
        // No permit is valid until the board has confirmed this stop.
        if let Some(level) = left {
            signal.raise(level);
        }
        let stopper = Stopper::start(&entry.port, &signal, Arc::clone(&connector));
        let (pause_file, pauses_on_reconnect) = PauseFile::open(places, name);
        let connection_error = Some("the service is looking for the robot".to_owned());
        let known = Mutex::new(WorkerState { connection_error, pauses_on_reconnect, ..WorkerState::default() });
        let keeper = Arc::new(Self {
            name: name.to_owned(),
            entry: entry.clone(),
            shared,
            known,
            requests: sender,
            connector,
            signal,
            stop_file,
            pause_file,
            stopper,
            stops_in_progress: AtomicU32::new(0),
            last_alerts: Mutex::default(),
            kept_logs: Mutex::default(),
            job_start: Mutex::default(),
        });
        let own = Arc::clone(&keeper);
        let spawned = thread::Builder::new().name(format!("robot {name}")).spawn(move || own.run(&requests));
        if let Err(error) = spawned {
            keeper.update_state(|known| {
                known.connection_error = Some(format!("cannot start the thread of the robot: {error}"));
            });
        }
        keeper
    }

    pub(super) fn lock_state(&self) -> MutexGuard<'_, WorkerState> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the robot's latest known state, and wakes all streams of events that wait for a change.
    pub(super) fn update_state(&self, change: impl FnOnce(&mut WorkerState)) {
        change(&mut self.lock_state());
        self.shared.signal_change();
    }

    pub(super) fn lock_last_alerts(&self) -> MutexGuard<'_, LastAlerts> {
        self.last_alerts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the time since the board's latest report, s. `None` before the first report.
    fn status_age_s(&self, known: &WorkerState, pace: Option<f64>) -> Option<f64> {
        let reported = known.reported?;
        // The time of a robot on a virtual clock passes only in requests to it.
        let is_paused = known.job.is_none() && self.port().is_ok_and(|port| port.is_virtual());
        Some(if is_paused { 0.0 } else { status_age_s(reported, pace) })
    }

    pub(super) fn port(&self) -> Result<PortName, String> {
        self.entry.port.parse().map_err(|error: port::OpenError| error.to_string())
    }

    /// Returns true if the robot is simulated.
    pub fn is_simulated(&self) -> bool {
        self.port().is_ok_and(|port| port.is_simulated())
    }

    /// Returns the pace of the robot's time, in multiples of real time. `None` if it is not known.
    pub(super) fn pace(&self) -> Option<f64> {
        match self.port().ok()? {
            PortName::SimDaemon(name) => StateDir::of(&name).ok()?.pace(),
            port if port.is_virtual() => None,
            _ => Some(1.0),
        }
    }

    /// Returns the latest known state of the robot.
    pub fn status(&self) -> RobotStatus {
        let (simulated, pace) = (self.is_simulated(), self.pace());
        let known = self.lock_state();
        let status = known.status.as_ref().filter(|_| known.connection_error.is_none());
        let fault = status.and_then(|status| status.fault);
        let pauses = |status: &&Status| matches!(status.state, State::Paused | State::Parked);
        let age_s = self.status_age_s(&known, pace);
        RobotStatus {
            name: self.name.clone(),
            port: self.entry.port.clone(),
            simulated,
            pace,
            state: match (&known.connection_error, &known.job) {
                (Some(_), _) => RobotState::Disconnected,
                (None, Some(_)) => RobotState::Busy,
                (None, None) => RobotState::Ready,
            },
            connection_error: known.connection_error.clone(),
            robot: known.robot.as_ref().map(|robot| robot.name().to_owned()),
            board_state: status.map(|status| status.state.name().to_owned()),
            fault: fault.map(|fault| Fault::code(fault).to_owned()),
            fault_explanation: fault.map(|fault| fault.explanation().to_owned()),
            pause_reason: status.filter(pauses).map(|status| pause_reason(status.pause_cause).to_owned()),
            temperature_c: status.and_then(|status| status.temperature_centi_c).map(celsius),
            target_c: status.and_then(|status| status.target_centi_c).map(celsius),
            laid: status.map_or(0, |status| status.layers_laid),
            layers: status.map_or(0, |status| status.layer_count),
            job: known.job.clone(),
            finish_utc: known.finish_utc.clone(),
            status_age_s: age_s,
            stale: age_s.is_none_or(|age_s| age_s > STALE_AFTER.as_secs_f64()),
            command_error: known.command_error.clone(),
            pending_stop: self.signal.level(),
        }
    }

    /// Returns the robot description with which the board was last connected. Before the first connection, returns the
    /// configured or default description.
    pub fn description(&self) -> Result<Robot, String> {
        if let Some(robot) = &self.lock_state().robot {
            return Ok(robot.clone());
        }
        let robot = self.entry.robot.as_deref().unwrap_or(robot_file::DEFAULT);
        robot_file::load(robot.as_ref()).map_err(|error| error.to_string())
    }

    /// Returns the material presets of the configured or default robot.
    pub fn presets(&self) -> MaterialPresets {
        let robot = self.entry.robot.as_deref().unwrap_or(robot_file::DEFAULT);
        MaterialPresets::load(robot.as_ref()).unwrap_or_default()
    }

    /// Returns the state of the active growth for live pages. `None` if the active growth does not belong to this job.
    pub fn live(&self, job: &str) -> Option<Arc<LiveGrowth>> {
        let known = self.lock_state();
        known.live_growth.clone().filter(|_| known.job.as_deref() == Some(job))
    }

    /// Queues a command for the active growth. Returns false if no growth is active.
    pub(super) fn send_command(&self, command: Command, permit: &Permit) -> bool {
        {
            // Under the lock, because the queue is dropped when the growth ends or its connection is lost.
            let known = self.lock_state();
            let Some(commands) = &known.commands else { return false };
            commands.push_with(command, permit.clone());
        }
        if command == Command::Pause {
            // The growth removes it once the board has accepted the pause.
            self.pause_file.set(true);
        }
        true
    }

    /// Sends a request to the robot's thread without waiting for the response.
    pub(super) fn notify_thread(&self, request: RobotRequest) {
        // A thread that has ended needs none.
        let _ = self.requests.send(PendingRequest { request, reply: mpsc::channel().0, claim: Claim::default() });
    }

    /// Locks the start of jobs. While the guard is held, no other caller can start a job.
    pub(super) fn lock_job_start(&self) -> MutexGuard<'_, ()> {
        self.job_start.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns an error if the robot has an active job. The latest known state may still contain a job that has just
    /// ended, so the job's state is read from the list of jobs.
    pub(super) fn ensure_idle(&self) -> Result<(), String> {
        let job = self.lock_state().job.clone();
        let is_active = |id: &String| {
            let job = self.shared.jobs_to_read().get(id);
            job.is_ok_and(|job| job.is_some_and(|job| job.state == JobState::Active))
        };
        job.filter(is_active).map_or(Ok(()), |job| {
            Err(format!("robot {} has an active job, {job}: wait until the job ends, or stop the job", self.name))
        })
    }

    /// Sends a request to the robot's thread and waits for the response.
    ///
    /// # Errors
    /// The reason why the request was rejected, or that it timed out.
    pub fn request(&self, request: RobotRequest, limit: Duration) -> Result<(), String> {
        self.request_claimed(request, &Claim::default(), limit)
    }

    /// Like [`Self::request`], but the caller can give the request up through `claim` until the thread has taken it.
    ///
    /// # Errors
    /// Like [`Self::request`].
    pub(super) fn request_claimed(&self, request: RobotRequest, claim: &Claim, limit: Duration) -> Result<(), String> {
        let (reply, response) = mpsc::channel();
        claim.check()?;
        let pending = PendingRequest { request, reply, claim: claim.clone() };
        self.requests
            .send(pending)
            .map_err(|_| "the service's thread for this robot has ended: restart the service".to_owned())?;
        response.recv_timeout(limit).unwrap_or_else(|_| {
            let (robot, limit) = (&self.name, limit.as_secs_f64());
            // A request that times out is given up, because it would otherwise run later, when the user no longer
            // expects it.
            Err(match claim.take() {
                true => {
                    format!(
                        "robot {robot} did not accept the request within {limit:.0} s, so the request was cancelled: \
                         try again"
                    )
                }
                false => {
                    format!(
                        "robot {robot} accepted the request, but did not finish it within {limit:.0} s: check the \
                         robot's state"
                    )
                }
            })
        })
    }

    /// Runs the robot's thread until the process ends: connects to the board, handles requests, and reconnects.
    fn run(self: Arc<Self>, requests: &Receiver<PendingRequest>) {
        let mut switches_on = true;
        self.notify_service_restart();
        loop {
            let left = match self.connect(switches_on) {
                Ok(connection) => self.serve_board(connection, requests),
                Err(why) => LinkState::Lost(why),
            };
            let why = match left {
                LinkState::Ready => continue,
                LinkState::Lost(why) => why,
                LinkState::Leased(loan, reply) => {
                    // The port is closed now, with its duplicate. The client that waits for it may be gone.
                    self.stopper.publish(None);
                    let _ = reply.send(Ok(()));
                    self.wait_for_lease_end(&loan, requests);
                    continue;
                }
            };
            // A user who switches the simulated robot off later wants it to stay off.
            switches_on = false;
            self.stopper.publish(None);
            self.record_connection(Some(&why));
            self.write_kept();
            self.update_state(|known| {
                (known.commands, known.live_growth, known.finish_utc) = (None, None, None);
                known.connection_error = Some(why.clone());
            });
            let until = Instant::now() + self.connector.reconnect_interval();
            while let Ok(pending) = requests.recv_timeout(until.saturating_duration_since(Instant::now())) {
                self.respond_without_board(pending, || format!("robot {} is not connected: {why}", self.name));
            }
        }
    }

    /// Handles a request while the port is closed. Records a stop that the board has confirmed, and rejects any other
    /// request with the reason `why`.
    pub(super) fn respond_without_board(&self, pending: PendingRequest, why: impl Fn() -> String) {
        match pending.request {
            RobotRequest::StopConfirmed(generation) => self.confirm_stop(generation),
            _ => pending.respond(Err(why())),
        }
    }

    /// Handles the requests to a connected board, and the board's active job, until the connection is lost or the port
    /// is leased.
    fn serve_board(&self, mut connection: BoardConnection, requests: &Receiver<PendingRequest>) -> LinkState {
        let active = self.shared.jobs().active(&self.name).ok().flatten();
        self.update_state(|known| {
            known.connection_error = None;
            known.robot = Some(connection.robot.clone());
            known.job = active.as_ref().map(|job| job.id.clone());
        });
        self.record_status(connection.hello.status.clone());
        self.record_boot(&connection.hello);
        self.record_connection(None);
        self.reconcile_jobs(&connection.hello.status, active.as_ref().map(|job| job.id.as_str()));
        let is_virtual = self.port().is_ok_and(|port| port.is_virtual());
        if let Some(job) = active {
            let left = match connection.is_stopped {
                true => self.end_stopped_job(&job, &connection.hello.status),
                false => self.reattach_job(&mut connection, &job),
            };
            if matches!(left, LinkState::Lost(_)) {
                return left;
            }
        }
        loop {
            match self.deliver_stop(&mut connection.client) {
                Ok(false) => {}
                Ok(true) => match connection.client.status() {
                    Ok(status) => self.record_status(status),
                    Err(error) => return LinkState::Lost(error.to_string()),
                },
                Err(why) => return LinkState::Lost(why),
            }
            // The time of a virtual clock passes only while this thread waits for the board, so it waits for requests.
            let next = match is_virtual {
                true if self.has_kept() => requests.recv_timeout(RETRY_INTERVAL).ok(),
                true => requests.recv().ok(),
                false => requests.try_recv().ok(),
            };
            self.write_kept();
            let done = match next {
                Some(pending) if pending.claim.take() => self.handle_request(&mut connection, pending),
                Some(_) => LinkState::Ready,
                None if is_virtual => LinkState::Ready,
                None => self.poll_status(&mut connection.client),
            };
            if !matches!(done, LinkState::Ready) {
                return done;
            }
        }
    }

    /// Waits for an event of a board without a job for one [`STATUS_POLL_INTERVAL`], then requests and records the
    /// board's status.
    fn poll_status(&self, client: &mut Client) -> LinkState {
        let wait = STATUS_POLL_INTERVAL.mul_f64(self.pace().unwrap_or(1.0).max(1.0));
        let looked = client.event(wait).and_then(|_| client.status());
        match looked {
            Ok(status) => {
                let last = {
                    let mut known = self.lock_state();
                    known.reported = Some(time_since_boot());
                    known.status.clone()
                };
                if last.as_ref() != Some(&status) {
                    self.void_if_stopped_elsewhere(status.state);
                    self.record_status(status.clone());
                }
                if last.is_none_or(|last| last.plan_id != status.plan_id) {
                    self.reconcile_jobs(&status, None);
                }
                LinkState::Ready
            }
            Err(error) => LinkState::Lost(error.to_string()),
        }
    }

    fn handle_request(&self, connection: &mut BoardConnection, pending: PendingRequest) -> LinkState {
        let client = &mut connection.client;
        let is_cancel = matches!(pending.request, RobotRequest::Cancel);
        let done = match pending.request {
            RobotRequest::Grow(new) => return self.start_job(connection, *new, pending.reply),
            RobotRequest::Resume(job, permit) => return self.resume(connection, &job, permit, pending.reply),
            RobotRequest::Wake | RobotRequest::StopConfirmed(_) => return LinkState::Ready,
            RobotRequest::Lend(loan) => return LinkState::Leased(loan, pending.reply),
            RobotRequest::Cancel => client.status().and_then(|status| {
                let cancel = PassiveRequest::Cancel(Cancel { plan_id: status.plan_id });
                client.request("the request to discard the body", &cancel).map(drop)
            }),
            RobotRequest::ClearFault(permit) => client.clear_fault(&permit),
            RobotRequest::Task(task, permit) => client.maintain(task, &permit),
        };
        if is_cancel && done.is_ok() {
            self.give_up_others(None, "discarded: the board has deleted the body");
        }
        let left = match &done {
            Err(error @ (ClientError::Port(_) | ClientError::NoResponse { .. })) => LinkState::Lost(error.to_string()),
            _ => LinkState::Ready,
        };
        if self.port().is_ok_and(|port| port.is_virtual())
            && let Ok(status) = client.status()
        {
            // A board with a virtual clock is not polled, so its status after the request is read here.
            self.record_status(status);
        }
        let _ = pending.reply.send(done.map_err(|error| error.to_string()));
        left
    }
}

/// Returns a short explanation of a pause with this cause, for users.
pub(super) fn pause_reason(cause: PauseCause) -> &'static str {
    match cause {
        PauseCause::LayersExhausted => "waiting for layers",
        PauseCause::Requested => "on request",
        PauseCause::FilamentOut => "out of filament: load a spool, and continue",
        PauseCause::HostSilent => "the board lost contact with its host",
    }
}
