//! One robot of the service. A thread owns its board and reconnects to it when its port comes back.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::{Command, CommandQueue};
use growbot_client::maintenance::MaterialPresets;
use growbot_client::plan::Plan;
use growbot_client::robot_file;
use growbot_core::link::message::{
    BoardInfo, Cancel, Empty, Fault, MaintenanceTask, Message, PauseCause, State, Status,
};
use growbot_core::robot::Robot;
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::ground_truth::SimulatedTip;
use growbot_sim::port::{self, OpenPort, PortName, TipSettings};
use growbot_sim::sim_daemon::StateDir;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ServiceContext;
use super::config::RobotEntry;
use super::job_store::{Job, JobState};
use super::notification::{AlertState, NotificationContext};
use super::port_lease::PortLease;
use crate::sim_process::switch_on;
use crate::watch::LiveGrowth;

/// Time after which a connection to a missing port is tried again.
const RECONNECT_INTERVAL: Duration = Duration::from_secs(1);
/// Time between two status requests to a board without a job. A request to the robot waits at most this long.
const STATUS_POLL_INTERVAL: Duration = Duration::from_millis(100);

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
    /// Number of layers of that job.
    pub layers: u32,
    /// Identifier of the active job. Null if the robot has no job.
    pub job: Option<String>,
    /// Expected time of the last layer, RFC 3339. Null unless the robot grows at a known pace.
    pub finish_utc: Option<String>,
    /// Reason why the board did not carry out the latest command, or why the run log cannot be written. Null otherwise.
    pub command_error: Option<String>,
}

/// A job to start.
pub struct NewJob {
    pub job: Job,
    pub plan: Plan,
    pub robot: Robot,
    /// Scene that corrections of the path keep clear of.
    pub scene: Option<LoadedScene>,
    pub feedback: bool,
}

/// A request to a robot's thread.
pub enum RobotRequest {
    Grow(Box<NewJob>),
    Resume(Box<Job>),
    Cancel,
    Stop,
    EmergencyStop,
    ClearFault,
    Task(MaintenanceTask),
    /// Close the port until the lease ends.
    Lend(PortLease),
}

/// A request in the queue of a robot's thread, with the channel on which its response is sent.
pub struct PendingRequest {
    pub request: RobotRequest,
    pub reply: Sender<Result<(), String>>,
    /// True once the thread has taken the request or the caller has given it up, whichever comes first.
    claimed: Arc<AtomicBool>,
}

impl PendingRequest {
    /// Takes the request. Returns false if the caller has given it up, except for an emergency stop.
    fn claim(&self) -> bool {
        let is_given_up = self.claimed.swap(true, Ordering::AcqRel);
        !is_given_up || matches!(self.request, RobotRequest::EmergencyStop)
    }

    pub(super) fn respond(self, response: Result<(), String>) {
        // The caller may no longer wait for the response.
        let _ = self.reply.send(response);
    }
}

/// A robot of the service, with its thread.
pub struct RobotWorker {
    pub(super) name: String,
    pub(super) entry: RobotEntry,
    pub(super) shared: Arc<ServiceContext>,
    known: Mutex<WorkerState>,
    requests: Sender<PendingRequest>,
    /// Condition that was reported last in notices. `None` if this process has reported none.
    last_alert: Mutex<Option<AlertState>>,
    /// Lock from the check for an active job to the start of a new job.
    job_start: Mutex<()>,
}

/// Latest known state of a robot.
#[derive(Default)]
pub struct WorkerState {
    pub connection_error: Option<String>,
    /// Robot description. `None` until the first connection to the board.
    pub robot: Option<Robot>,
    pub status: Option<Status>,
    pub job: Option<String>,
    /// Queue of commands to the active growth.
    pub commands: Option<Arc<CommandQueue>>,
    /// Updates of the active growth for pages.
    pub live_growth: Option<Arc<LiveGrowth>>,
    pub finish_utc: Option<String>,
    pub command_error: Option<String>,
    /// True if a stop was sent that the board may not have received before the connection was lost.
    pub stop_on_reconnect: bool,
}

/// An open connection to a board.
pub struct BoardConnection {
    pub client: Client,
    pub simulation: Option<Box<dyn SimulatedTip>>,
    pub robot: Robot,
    pub hello: BoardInfo,
}

/// State of a connection after a request, a job or a check of the board.
pub enum LinkState {
    /// The board is ready for the next request.
    Ready,
    /// The connection is lost or the board does not respond. The text is the reason.
    Lost(String),
    /// The port is to be leased. The channel is that of the client that waits for the port.
    Leased(PortLease, Sender<Result<(), String>>),
}

impl RobotWorker {
    /// Starts a thread that owns a robot.
    pub(super) fn start(name: &str, entry: &RobotEntry, shared: Arc<ServiceContext>) -> Arc<Self> {
        let (sender, requests) = mpsc::channel();
        let known =
            Mutex::new(WorkerState { connection_error: Some("it is looked for".to_owned()), ..WorkerState::default() });
        let keeper = Arc::new(Self {
            name: name.to_owned(),
            entry: entry.clone(),
            shared,
            known,
            requests: sender,
            last_alert: Mutex::default(),
            job_start: Mutex::default(),
        });
        let own = Arc::clone(&keeper);
        let spawned = thread::Builder::new().name(format!("robot {name}")).spawn(move || own.run(&requests));
        if let Err(error) = spawned {
            keeper.update_state(|known| known.connection_error = Some(format!("cannot start its thread: {error}")));
        }
        keeper
    }

    fn lock_state(&self) -> MutexGuard<'_, WorkerState> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the known state and wakes all connections that wait for changes.
    pub(super) fn update_state(&self, change: impl FnOnce(&mut WorkerState)) {
        change(&mut self.lock_state());
        self.shared.signal_change();
    }

    /// Records a status that the board has reported. Sends notices if the robot's condition differs from the one that
    /// was reported last.
    pub(super) fn record_status(&self, status: Status) {
        let condition = AlertState::from_status(&status);
        self.update_state(|known| known.status = Some(status));
        let mut reported = self.last_alert.lock().unwrap_or_else(PoisonError::into_inner);
        if reported.as_ref() != Some(&condition) {
            self.with_notification_context(|about| self.shared.notify_alert(about, &condition));
            *reported = Some(condition);
        }
    }

    /// Calls `send` with the robot and its job, for a notice.
    pub(super) fn with_notification_context(&self, send: impl FnOnce(&NotificationContext)) {
        let view = self.status();
        send(&NotificationContext {
            robot: &self.name,
            simulated: view.simulated,
            job: view.job.as_deref(),
            laid: view.laid,
            layers: view.layers,
        });
    }

    pub(super) fn port(&self) -> Result<PortName, String> {
        self.entry.port.parse().map_err(|error: port::OpenError| error.to_string())
    }

    /// Returns whether the robot is simulated.
    #[must_use]
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
    #[must_use]
    pub fn status(&self) -> RobotStatus {
        let (simulated, pace) = (self.is_simulated(), self.pace());
        let known = self.lock_state();
        let status = known.status.as_ref().filter(|_| known.connection_error.is_none());
        let celsius = |centi: i32| f64::from(centi) / 100.0;
        let fault = status.and_then(|status| status.fault);
        let pauses = |status: &&Status| matches!(status.state, State::Paused | State::Parked);
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
            command_error: known.command_error.clone(),
        }
    }

    /// Returns the description that the board reported, otherwise the configured or default one.
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

    /// Returns the active growth if it belongs to this job.
    pub fn live(&self, job: &str) -> Option<Arc<LiveGrowth>> {
        let known = self.lock_state();
        known.live_growth.clone().filter(|_| known.job.as_deref() == Some(job))
    }

    /// Queues a command for the active growth. Returns false if no growth is active.
    pub fn send_command(&self, order: Command) -> bool {
        let known = self.lock_state();
        known.commands.as_ref().map(|orders| orders.push(order)).is_some()
    }

    /// Locks the start of jobs. While the guard is held, no other caller can start a job.
    pub(super) fn lock_job_start(&self) -> MutexGuard<'_, ()> {
        self.job_start.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns an error if the robot has an active job. A job that has just ended may still be known to the thread, so
    /// the state is read from the list of jobs.
    pub(super) fn ensure_idle(&self) -> Result<(), String> {
        let job = self.lock_state().job.clone();
        let is_active = |id: &String| {
            let job = self.shared.jobs_to_read().get(id);
            job.is_ok_and(|job| job.is_some_and(|job| job.state == JobState::Active))
        };
        job.filter(is_active).map_or(Ok(()), |job| {
            Err(format!("robot {} has an active job, {job}: wait until it ends, or stop it", self.name))
        })
    }

    /// Sends a request to the robot's thread and waits for the response.
    ///
    /// # Errors
    /// The reason why the request was rejected, or that it timed out.
    pub fn request(&self, request: RobotRequest, limit: Duration) -> Result<(), String> {
        let (reply, response) = mpsc::channel();
        let settled = Arc::new(AtomicBool::new(false));
        let pending = PendingRequest { request, reply, claimed: Arc::clone(&settled) };
        self.requests.send(pending).map_err(|_| "its thread has ended: restart the service".to_owned())?;
        response.recv_timeout(limit).unwrap_or_else(|_| {
            let (robot, limit) = (&self.name, limit.as_secs_f64());
            // A request that times out is given up, because it would otherwise run later, when the user no longer
            // expects it.
            Err(match settled.swap(true, Ordering::AcqRel) {
                false => {
                    format!("robot {robot} did not accept the request within {limit:.0} s; it was cancelled: try again")
                }
                true => {
                    format!(
                        "robot {robot} accepted the request, but did not finish it within {limit:.0} s: check the \
                         robot's state"
                    )
                }
            })
        })
    }

    /// Owns the robot until the process ends.
    fn run(self: Arc<Self>, requests: &Receiver<PendingRequest>) {
        let mut switches_on = true;
        loop {
            let left = match self.connect(switches_on) {
                Ok(connection) => self.serve_board(connection, requests),
                Err(why) => LinkState::Lost(why),
            };
            let why = match left {
                LinkState::Ready => continue,
                LinkState::Lost(why) => why,
                LinkState::Leased(loan, reply) => {
                    // The port is closed now. The client that waits for it may be gone.
                    let _ = reply.send(Ok(()));
                    self.wait_for_lease_end(&loan, requests);
                    continue;
                }
            };
            // A user who switches the simulated robot off later wants it to stay off.
            switches_on = false;
            self.update_state(|known| {
                (known.commands, known.live_growth, known.finish_utc) = (None, None, None);
                known.connection_error = Some(why.clone());
            });
            let until = Instant::now() + RECONNECT_INTERVAL;
            while let Ok(pending) = requests.recv_timeout(until.saturating_duration_since(Instant::now())) {
                let is_stopped = matches!(pending.request, RobotRequest::Stop) && self.stop_without_session().is_ok();
                let refusal = || format!("robot {} is not connected: {why}", self.name);
                pending.respond(if is_stopped { Ok(()) } else { Err(refusal()) });
            }
        }
    }

    fn connect(&self, switches_on: bool) -> Result<BoardConnection, String> {
        let name = self.port()?;
        let configured = self.entry.robot.as_ref().map(PathBuf::from);
        let mut robot = match &configured {
            Some(robot) => Some(robot_file::load(robot).map_err(|error| error.to_string())?),
            None => None,
        };
        if let PortName::SimDaemon(name) = &name {
            let place = StateDir::of(name).map_err(|error| error.to_string())?;
            if switches_on && !place.is_on() {
                let pace = self.entry.pace.unwrap_or(1.0);
                switch_on(&place, configured.as_deref(), pace).map_err(|error| error.to_string())?;
            }
            robot = place.robot().map_err(|error| error.to_string())?.or(robot);
        }
        let robot = match robot {
            Some(robot) => Some(robot),
            None if name.is_simulated() => {
                Some(robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|e| e.to_string())?)
            }
            None => None,
        };
        // On a real port the board reports which robot it is.
        let any = robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|error| error.to_string())?;
        let settings = TipSettings::default();
        let opened = port::open(&name, robot.as_ref().unwrap_or(&any), &settings).map_err(|error| error.to_string())?;
        let OpenPort { port, simulated_tip: simulation } = opened;
        let mut client = Client::new(port, &self.entry.port);
        let hello = client.identify().map_err(|error| error.to_string())?;
        let robot = match robot {
            Some(robot) => robot,
            None => robot_file::load(hello.robot_name.as_str().as_ref()).map_err(|_| {
                format!(
                    "its board's robot is {}, which is not built in: set `robot` for it in growbot.toml",
                    hello.robot_name
                )
            })?,
        };
        let hello = client.open_session_for(&robot).map_err(|error| error.to_string())?;
        Ok(BoardConnection { client, simulation, robot, hello })
    }

    /// Stops a board with which the service has no session, because its firmware is of another release.
    fn stop_without_session(&self) -> Result<(), String> {
        let any = robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|error| error.to_string())?;
        let opened = port::open(&self.port()?, &any, &TipSettings::default()).map_err(|error| error.to_string())?;
        let stopped = Client::new(opened.port, &self.entry.port).request("to stop", &Message::Stop(Empty {}));
        stopped.map(drop).map_err(|error| error.to_string())
    }

    /// Owns a connected board until the connection is lost or the port is leased.
    fn serve_board(&self, mut connection: BoardConnection, requests: &Receiver<PendingRequest>) -> LinkState {
        let active = self.shared.jobs().active(&self.name).ok().flatten();
        self.update_state(|known| {
            known.connection_error = None;
            known.robot = Some(connection.robot.clone());
            known.job = active.as_ref().map(|job| job.id.clone());
        });
        self.record_status(connection.hello.status.clone());
        if let Some(job) = active {
            let stops = self.lock_state().stop_on_reconnect;
            let left = match stops {
                true => self.apply_pending_stop(&mut connection, &job),
                false => self.reattach_job(&mut connection, &job),
            };
            if matches!(left, LinkState::Lost(_)) {
                return left;
            }
        }
        loop {
            let done = match requests.try_recv() {
                Ok(pending) if pending.claim() => self.handle_request(&mut connection, pending),
                Ok(_) => LinkState::Ready,
                Err(_) => self.poll_status(&mut connection.client),
            };
            if !matches!(done, LinkState::Ready) {
                return done;
            }
        }
    }

    /// Waits for an event of a board without a job and requests its status.
    fn poll_status(&self, client: &mut Client) -> LinkState {
        let wait = STATUS_POLL_INTERVAL.mul_f64(self.pace().unwrap_or(1.0).max(1.0));
        let looked = client.event(wait).and_then(|_| client.status());
        match looked {
            Ok(status) => {
                let is_new = self.lock_state().status.as_ref() != Some(&status);
                if is_new {
                    self.record_status(status);
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
            RobotRequest::Resume(job) => return self.resume(connection, &job, pending.reply),
            RobotRequest::Lend(loan) => return LinkState::Leased(loan, pending.reply),
            RobotRequest::Cancel => client.status().and_then(|status| {
                let cancel = Message::Cancel(Cancel { plan_id: status.plan_id });
                client.request("to discard the body", &cancel).map(drop)
            }),
            RobotRequest::Stop => client.stop().map(drop),
            RobotRequest::EmergencyStop => client.emergency_stop(),
            RobotRequest::ClearFault => client.clear_fault(),
            RobotRequest::Task(task) => client.maintain(task),
        };
        if is_cancel && done.is_ok() {
            self.give_up_interrupted("discarded: the board has deleted the body");
        }
        let left = match &done {
            Err(error @ (ClientError::Port(_) | ClientError::NoResponse { .. })) => LinkState::Lost(error.to_string()),
            _ => LinkState::Ready,
        };
        let _ = pending.reply.send(done.map_err(|error| error.to_string()));
        left
    }
}

/// Returns an explanation of the pause.
pub(super) fn pause_reason(cause: PauseCause) -> &'static str {
    match cause {
        PauseCause::LayersExhausted => "waiting for layers",
        PauseCause::Requested => "on request",
        PauseCause::FilamentOut => "out of filament: load a spool, and continue",
        PauseCause::HostSilent => "the board lost contact with its host",
    }
}
