//! One robot of the service. Its thread owns the connection to the board, and reconnects after the connection was lost.

use std::path::PathBuf;
use std::sync::atomic::AtomicU32;
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_client::command_report::TuningReport;
use growbot_client::growth::CommandQueue;
use growbot_client::maintenance::MaterialPresets;
use growbot_client::port::time_since_boot;
use growbot_client::robot_command::{CommandOutcome, StopOutcome};
use growbot_client::status::{BoardDetails, ConnectionState, RobotStatus};
use growbot_client::stop_signal::{Permit, StopSignal};
use growbot_core::link::message::{BoardInfo, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::job::Command;
use growbot_plan::robot_file::{self, RobotFileError};
use growbot_plan::run_log::RunLog;
use growbot_remote::api::JobState;
use growbot_sim::port::{OpenError, OpenPort, PortName};
use growbot_sim::sim_daemon::StateDir;
use growbot_sim::sim_daemon::process::switch_on;
use time::OffsetDateTime;

use super::alert::LastAlerts;
use super::config::RobotEntry;
use super::connector::{BoardConnection, ConfiguredPort, Connector};
use super::last_body::LastBody;
use super::paths::ServicePaths;
use super::robot_error::{ConnectionError, RobotRequestError};
use super::robot_request::{Claim, PendingRequest, PortLease, Reply, RobotRequest};
use super::service_context::ServiceContext;
use super::stop_file::{PauseFile, StopFile};
use super::stopper::Stopper;
use crate::watch::heartbeat::status_age_s;
use crate::watch::live_growth::LiveGrowth;

/// Time between two status requests to a board without a job. A request to the robot's thread waits at most this time
/// before it is handled.
const STATUS_POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Interval at which the idle thread of a robot with a virtual clock repeats failed writes to the list of jobs and to
/// run logs.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);

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
    last_body: Mutex<Option<LastBody>>,
    /// Run logs of ended jobs that have lines that could not be written yet, each with the identifier of its job.
    pub(super) kept_logs: Mutex<Vec<(String, RunLog)>>,
    /// Lock that is held from the check that the robot has no active job until a new job has started.
    job_start: Mutex<()>,
}

/// Latest known state of a robot.
#[derive(Default)]
pub struct WorkerState {
    pub connection_error: Option<Arc<ConnectionError>>,
    /// Description of the robot. `None` until the first connection to the board.
    pub robot: Option<Robot>,
    /// The board as it reported itself at its latest start or connection.
    pub board: Option<BoardInfo>,
    pub status: Option<Status>,
    /// Time of the board's latest report, since the start of the service's computer. `None` before the first report.
    pub reported: Option<Duration>,
    pub job: Option<String>,
    /// Queue of commands to the active growth. `None` if no growth is active.
    pub commands: Option<Arc<CommandQueue>>,
    /// State of the active growth for live pages. `None` if no growth is active.
    pub live_growth: Option<Arc<LiveGrowth>>,
    /// Expected date and time of the last layer of the active growth.
    pub finish: Option<OffsetDateTime>,
    pub command_error: Option<String>,
    /// Gains that the latest tuning of the heater has found.
    pub tuning: Option<TuningReport>,
    /// While the board tunes its heater, and until it has reported the gains: number of polls since its state is
    /// another one.
    pub polls_after_tuning: Option<u32>,
    /// Way in which the board has confirmed the latest stop.
    pub latest_stop: StopOutcome,
    /// True if the board may not have received an order to pause its growth, because the connection was lost or the
    /// service was restarted. The growth is then paused after the next connection.
    pub pauses_on_reconnect: bool,
}

/// State of the connection to the board after a request, a job or a status request.
pub enum LinkState {
    /// The board is ready for the next request.
    Ready,
    /// The connection is lost or the board does not respond.
    Lost(Arc<ConnectionError>),
    /// The thread must close the port for this lease. The channel reports to the waiting client that the port is
    /// closed.
    Leased(PortLease, Reply),
}

impl LinkState {
    /// Returns the state after a connection is lost for this reason.
    pub fn lost(reason: impl Into<ConnectionError>) -> Self {
        Self::Lost(Arc::new(reason.into()))
    }

    /// Returns the state after a request has failed, and the error for its client.
    pub fn after(error: ClientError) -> (Self, RobotRequestError) {
        if !is_loss(&error) {
            return (Self::Ready, error.into());
        }
        let reason = Arc::new(ConnectionError::from(error));
        (Self::Lost(Arc::clone(&reason)), reason.into())
    }
}

/// Returns true if a request has failed because the connection is lost or the board does not respond.
pub fn is_loss(error: &ClientError) -> bool {
    matches!(error, ClientError::Port(_) | ClientError::NoResponse { .. })
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
        let connection_error = Some(Arc::new(ConnectionError::Searching));
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
            last_body: Mutex::default(),
            kept_logs: Mutex::default(),
            job_start: Mutex::default(),
        });
        let own = Arc::clone(&keeper);
        let spawned = thread::Builder::new().name(format!("robot {name}")).spawn(move || own.run(&requests));
        if let Err(error) = spawned {
            keeper.update_state(|known| known.connection_error = Some(Arc::new(ConnectionError::Thread(error))));
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

    pub(super) fn lock_last_body(&self) -> MutexGuard<'_, Option<LastBody>> {
        self.last_body.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the time since the board's latest report, s. `None` before the first report.
    fn status_age_s(&self, known: &WorkerState, pace: Option<f64>) -> Option<f64> {
        let reported = known.reported?;
        // The time of a robot on a virtual clock passes only in requests to it.
        let is_paused = known.job.is_none() && self.port().is_ok_and(|port| port.is_virtual());
        Some(if is_paused { 0.0 } else { status_age_s(reported, pace) })
    }

    pub(super) fn port(&self) -> Result<PortName, OpenError> {
        self.entry.port.parse()
    }

    /// Returns true if the robot is simulated.
    pub fn is_simulated(&self) -> bool {
        self.port().is_ok_and(|port| port.is_simulated())
    }

    /// Returns the pace of the robot's time, in multiples of real time. `None` if it is not known.
    pub(super) fn pace(&self) -> Option<f64> {
        self.port().ok()?.pace()
    }

    /// Returns the latest known state of the robot.
    pub fn status(&self) -> RobotStatus {
        let (simulated, pace) = (self.is_simulated(), self.pace());
        let known = self.lock_state();
        let age_s = self.status_age_s(&known, pace);
        let mut view = RobotStatus {
            name: Some(self.name.clone()),
            port: self.entry.port.clone(),
            simulated,
            pace,
            connection: match (&known.connection_error, &known.job) {
                (Some(_), _) => ConnectionState::Disconnected,
                (None, Some(_)) => ConnectionState::Busy,
                (None, None) => ConnectionState::Ready,
            },
            connection_error: known.connection_error.as_ref().map(ToString::to_string),
            job: known.job.clone(),
            command_error: known.command_error.clone(),
            pending_stop: self.signal.level(),
            tuning: known.tuning.clone(),
            ..RobotStatus::default()
        };
        view.set_age(age_s);
        let now = OffsetDateTime::now_utc();
        if let (Some(board), None) = (&known.board, &known.connection_error) {
            view.set_board(board);
        }
        if let (Some(status), None) = (&known.status, &known.connection_error) {
            view.set_status(status);
            view.set_finish(known.finish, now);
        }
        view.robot = view.robot.or_else(|| known.robot.as_ref().map(|robot| robot.name().to_owned()));
        view
    }

    /// Returns the robot description with which the board was last connected. Before the first connection, returns the
    /// configured or default description.
    pub fn description(&self) -> Result<Robot, RobotFileError> {
        if let Some(robot) = &self.lock_state().robot {
            return Ok(robot.clone());
        }
        let robot = self.entry.robot.as_deref().unwrap_or(robot_file::DEFAULT);
        robot_file::load(robot.as_ref())
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

    /// Returns true if the board pauses.
    pub(super) fn is_paused(&self) -> bool {
        self.lock_state().status.as_ref().is_some_and(|status| status.state == State::Paused)
    }

    /// Queues a command for the active growth. Returns an error if no growth is active, or if the active growth does
    /// not belong to this job.
    pub(super) fn order_growth(
        &self,
        command: Command,
        job: Option<&str>,
        permit: &Permit,
    ) -> Result<CommandOutcome, RobotRequestError> {
        {
            // Under the lock, because the queue is dropped when the growth ends or its connection is lost.
            let known = self.lock_state();
            let commands = known.commands.as_ref().filter(|_| job.is_none() || job == known.job.as_deref());
            let no_growth = || RobotRequestError::NoGrowth { command: command.name(), robot: self.name.clone() };
            commands.ok_or_else(no_growth)?.push_with(command, permit.clone());
        }
        if command == Command::Pause {
            // The growth removes it once the board has accepted the pause.
            self.pause_file.set(true);
        }
        Ok(CommandOutcome::Ordered(command))
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

    /// Returns an error if the robot has an active job, or tunes its heater. The latest known state may still contain a
    /// job that has just ended, so the job's state is read from the list of jobs.
    pub(super) fn ensure_idle(&self) -> Result<(), RobotRequestError> {
        let (job, is_tuning) = {
            let known = self.lock_state();
            (known.job.clone(), known.polls_after_tuning.is_some() && known.connection_error.is_none())
        };
        if is_tuning {
            return Err(RobotRequestError::Tuning { robot: self.name.clone() });
        }
        let is_active = |id: &String| {
            let job = self.shared.jobs_to_read().get(id);
            job.is_ok_and(|job| job.is_some_and(|job| job.state == JobState::Active))
        };
        job.filter(is_active).map_or(Ok(()), |job| Err(RobotRequestError::Busy { robot: self.name.clone(), job }))
    }

    /// Sends a request to the robot's thread and waits for the response.
    ///
    /// # Errors
    /// [`RobotRequestError`] if the request was rejected or timed out.
    pub fn request(&self, request: RobotRequest, limit: Duration) -> Result<CommandOutcome, RobotRequestError> {
        self.request_claimed(request, &Claim::default(), limit)
    }

    /// Like [`Self::request`], but the caller can give the request up through `claim` until the thread has taken it.
    ///
    /// # Errors
    /// Like [`Self::request`].
    pub(super) fn request_claimed(
        &self,
        request: RobotRequest,
        claim: &Claim,
        limit: Duration,
    ) -> Result<CommandOutcome, RobotRequestError> {
        let (reply, response) = mpsc::channel();
        claim.check()?;
        let pending = PendingRequest { request, reply, claim: claim.clone() };
        self.requests.send(pending).map_err(|_| RobotRequestError::ThreadEnded)?;
        response.recv_timeout(limit).unwrap_or_else(|_| {
            let robot = self.name.clone();
            // A request that times out is given up, because it would otherwise run later, when the user no longer
            // expects it.
            Err(match claim.take() {
                true => RobotRequestError::NotAccepted { robot, limit },
                false => RobotRequestError::NotFinished { robot, limit },
            })
        })
    }

    /// Connects to the board. Delivers an unconfirmed stop before anything else, even to a board of another robot,
    /// owner or release. `switches_on` starts a simulated robot that is switched off.
    pub(super) fn connect(&self, switches_on: bool) -> Result<BoardConnection, ConnectionError> {
        let name = self.port()?;
        let configured = self.entry.robot.as_ref().map(PathBuf::from);
        let mut robot = match &configured {
            Some(robot) => Some(robot_file::load(robot)?),
            None => None,
        };
        if let PortName::SimDaemon(name) = &name {
            let place = StateDir::of(name)?;
            if switches_on && !place.is_on() {
                let pace = self.entry.pace.unwrap_or(1.0);
                switch_on(&place, configured.as_deref(), pace)?;
            }
            robot = place.robot()?.or(robot);
        }
        let robot = match robot {
            Some(robot) => Some(robot),
            None if name.is_simulated() => Some(robot_file::load(robot_file::DEFAULT.as_ref())?),
            None => None,
        };
        // On a real port the board reports which robot it is.
        let any = robot_file::load(robot_file::DEFAULT.as_ref())?;
        let opened = self.connector.open(robot.as_ref().unwrap_or(&any))?;
        let OpenPort { port, simulated_tip: simulation } = opened;
        let mut client = Client::new(port, &self.entry.port);
        self.stopper.publish(client.emergency_port());
        let is_stopped = self.deliver_stop(&mut client)?;
        let hello = client.identify()?;
        let robot = match robot {
            Some(robot) => robot,
            None => robot_file::load(hello.robot_name.as_str().as_ref())
                .map_err(|_| ConnectionError::NotBuiltIn(hello.robot_name.to_string()))?,
        };
        let hello = client.open_session_for(&robot)?;
        Ok(BoardConnection { client, simulation, robot, hello, is_stopped })
    }

    /// Runs the robot's thread until the process ends: connects to the board, handles requests, and reconnects.
    fn run(self: Arc<Self>, requests: &Receiver<PendingRequest>) {
        let mut switches_on = true;
        self.notify_service_restart();
        loop {
            let left = match self.connect(switches_on) {
                Ok(connection) => self.serve_board(connection, requests),
                Err(reason) => LinkState::lost(reason),
            };
            let reason = match left {
                LinkState::Ready => continue,
                LinkState::Lost(reason) => reason,
                LinkState::Leased(loan, reply) => {
                    // The port is closed now, with its duplicate. The client that waits for it may be gone.
                    self.stopper.publish(None);
                    let _ = reply.send(Ok(CommandOutcome::PortReleased));
                    self.wait_for_lease_end(&loan, requests);
                    continue;
                }
            };
            // A user who switches the simulated robot off later wants it to stay off.
            switches_on = false;
            self.stopper.publish(None);
            self.record_connection(Some(&reason.to_string()));
            self.write_kept();
            self.update_state(|known| {
                (known.commands, known.live_growth, known.finish) = (None, None, None);
                known.connection_error = Some(Arc::clone(&reason));
            });
            let until = Instant::now() + self.connector.reconnect_interval();
            while let Ok(pending) = requests.recv_timeout(until.saturating_duration_since(Instant::now())) {
                let (robot, reason) = (self.name.clone(), Arc::clone(&reason));
                self.respond_without_board(pending, RobotRequestError::NotConnected { robot, reason });
            }
        }
    }

    /// Handles a request while the port is closed. Records a stop that the board has confirmed, and rejects any other
    /// request with this error.
    pub(super) fn respond_without_board(&self, pending: PendingRequest, error: RobotRequestError) {
        match pending.request {
            RobotRequest::StopConfirmed(generation) => self.confirm_stop(generation),
            _ => pending.respond(Err(error)),
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
        self.follow_tuning(connection.hello.status.state);
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
                    Err(error) => return LinkState::lost(error),
                },
                Err(error) => return LinkState::lost(error),
            }
            // The time of a virtual clock passes only while this thread waits for the board, so it waits for requests,
            // except while the board tunes.
            let waits = is_virtual && self.lock_state().polls_after_tuning.is_none();
            let next = match waits {
                true if self.has_kept() => requests.recv_timeout(RETRY_INTERVAL).ok(),
                true => requests.recv().ok(),
                false => requests.try_recv().ok(),
            };
            self.write_kept();
            let done = match next {
                Some(pending) if pending.claim.take() => self.handle_request(&mut connection, pending),
                Some(_) => LinkState::Ready,
                None if waits => LinkState::Ready,
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
        let looked = client.event(wait).and_then(|event| {
            let status = client.status()?;
            self.record_gains(client, event)?;
            Ok(status)
        });
        match looked {
            Ok(status) => {
                self.record_if_new(&status);
                self.end_tuning(status.state);
                LinkState::Ready
            }
            Err(error) => LinkState::lost(error),
        }
    }

    /// Records the status of a board without a job, unless it is the one that was recorded before.
    fn record_if_new(&self, status: &Status) {
        let last = {
            let mut known = self.lock_state();
            known.reported = Some(time_since_boot());
            known.status.clone()
        };
        if last.as_ref() != Some(status) {
            self.void_if_stopped_elsewhere(status.state);
            self.record_status(status.clone());
        }
        if last.is_none_or(|last| last.plan_id != status.plan_id) {
            self.reconcile_jobs(status, None);
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
            RobotRequest::Cancel => client.cancel(),
            RobotRequest::ClearFault(permit) => client.clear(&permit),
            RobotRequest::Task(task, permit) => client.maintain(task, &permit),
            RobotRequest::Tune(target_c, permit) => self.start_tuning(client, target_c, &permit),
            RobotRequest::ReadDetails(details) => BoardDetails::read(client).and_then(|read| {
                // The details must not be newer than the status.
                self.record_if_new(&client.status()?);
                // The client may no longer wait for them.
                let _ = details.send(read);
                Ok(CommandOutcome::Reported)
            }),
        };
        if is_cancel && done.is_ok() {
            // A cancelled tuning has no gains.
            self.update_state(|known| known.polls_after_tuning = None);
            self.give_up_others(None, "discarded: the board has deleted the body");
        }
        let (left, response) = match done {
            Ok(outcome) => (LinkState::Ready, Ok(outcome)),
            Err(error) => {
                let (left, error) = LinkState::after(error);
                (left, Err(error))
            }
        };
        if self.port().is_ok_and(|port| port.is_virtual())
            && let Ok(status) = client.status()
        {
            // A board with a virtual clock is not polled, so its status after the request is read here.
            self.record_status(status);
        }
        let _ = pending.reply.send(response);
        left
    }
}
