//! Growths on a board. `python/growbot/_board.py` wraps these classes in context managers and typed events.
//!
//! A thread owns the connection to the board and receives requests as messages. Python threads can therefore run, and
//! Ctrl-C has an effect, while a body grows.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{Beginning, CommandQueue, GrowthBoard, GrowthRequest, LogTarget, OnParked, Override};
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::robot::Robot as Described;
use growbot_core::simulation::ErrorModel;
use growbot_plan::job::Command;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{BoardRecord, BoardStatus, GrowthResult, OutcomeKind, RunEvent, to_run_events};
use growbot_sim::port::{OpenPort, PortName, TipSettings, open};
use growbot_sim::simulated_tip::{SimulatedTip, ground_truth};
use pyo3::prelude::*;

use crate::arguments::{flag, path, word, wrong_type};
use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::preconditions::{check_conditions, refused, scene_for_growth};
use crate::py_plan::PyPlan;
use crate::robot::robot_of;
use crate::run::json_of;
use crate::scene::PyScene;
use crate::simulate::seed_of;

/// Interval at which a waiting call polls whether the user has pressed Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);
/// Maximum number of unread events of a simulated robot. The simulation then waits until Python reads some. The events
/// of a real robot are not limited.
const AHEAD: usize = 10_000;

/// A request to the thread that owns the connection to the board, with the sender for its response.
enum WorkerRequest {
    Hello(Sender<Result<String, Error>>),
    Status(Sender<Result<String, Error>>),
    Stop(Sender<Result<String, Error>>),
    EmergencyStop(Sender<Result<String, Error>>),
    Grow(Box<GrowTask>),
}

/// A growth that the thread of the connection shall execute.
struct GrowTask {
    plan: PyPlan,
    conditions: Conditions,
    /// Scene of the growth, from which the corrections of feedback stay clear. `None` without a scene.
    scene: Option<PyScene>,
    overrides: Vec<Override>,
    seed: u64,
    log: LogTarget,
    events: EventSender,
    commands: Arc<CommandQueue>,
}

impl GrowTask {
    /// Returns the growth that this task requests, on a robot that is simulated or not.
    fn request(&self, kind: RobotKind) -> GrowthRequest<'_> {
        let Self { plan: PyPlan { inner: plan, robot }, conditions, scene, overrides, seed, .. } = self;
        let noise = if kind.is_simulated() { conditions.sensor_noise() } else { conditions.assumed_noise() };
        GrowthRequest {
            robot,
            plan,
            beginning: Beginning::FirstLayer,
            scene: scene.as_ref().map(|scene| &*scene.loaded),
            scene_error: None,
            overrides,
            feedback: conditions.feedback().then_some(noise),
            imperfection: ErrorModel {
                disturbance: conditions.disturbance(),
                noise: conditions.sensor_noise(),
                seed: *seed,
            },
            kind,
        }
    }
}

/// A message from the thread of a growth to Python.
enum GrowthMessage {
    Event(String),
    /// The end of the growth: the result as JSON, and the error unless the growth is done or was stopped.
    End(Option<String>, Option<Error>),
}

/// Sender of the messages of a growth to Python.
enum EventSender {
    Bounded(mpsc::SyncSender<GrowthMessage>),
    Unbounded(Sender<GrowthMessage>),
}

impl EventSender {
    /// Sends a message. Returns false if Python has dropped the receiver.
    fn send(&self, message: GrowthMessage) -> bool {
        match self {
            Self::Bounded(sender) => sender.send(message).is_ok(),
            Self::Unbounded(sender) => sender.send(message).is_ok(),
        }
    }
}

/// An open connection: the client, and the access to the tip of a simulated robot.
struct BoardLink {
    client: Client,
    simulated_tip: Option<Box<dyn SimulatedTip>>,
}

/// State of the thread that owns the connection to the board.
struct BoardWorker {
    robot: Arc<Described>,
    port: PortName,
    name: String,
    take_over: bool,
    link: Option<BoardLink>,
}

fn board_error(error: impl std::error::Error + 'static) -> Error {
    Error::of(ErrorKind::Board, &error)
}

fn closed() -> Error {
    Error::new(ErrorKind::Board, "the board's port is closed: connect again with growbot.connect")
}

impl BoardWorker {
    fn serve(&mut self, requests: &Receiver<WorkerRequest>) {
        while let Ok(request) = requests.recv() {
            match request {
                WorkerRequest::Hello(response) => drop(response.send(self.hello())),
                WorkerRequest::Status(response) => drop(response.send(self.status())),
                WorkerRequest::Stop(response) => drop(response.send(self.stop())),
                WorkerRequest::EmergencyStop(response) => drop(response.send(self.emergency_stop())),
                WorkerRequest::Grow(task) => self.grow(&task),
            }
        }
    }

    fn open(&mut self, settings: &TipSettings) -> Result<&mut BoardLink, Error> {
        // Only one program at a time can use a robot's port.
        self.link = None;
        let OpenPort { port, simulated_tip } = open(&self.port, &self.robot, settings).map_err(board_error)?;
        let name = if self.port.is_simulated() { format!("{} (simulated)", self.name) } else { self.name.clone() };
        let client = Client::new(port, &name);
        let client = if self.take_over { client.with_take_over() } else { client };
        Ok(self.link.insert(BoardLink { client, simulated_tip }))
    }

    fn link(&mut self) -> Result<&mut BoardLink, Error> {
        if self.link.is_none() {
            self.open(&TipSettings::default())?;
        }
        self.link.as_mut().ok_or_else(closed)
    }

    fn hello(&mut self) -> Result<String, Error> {
        let hello = self.link()?.client.open_session().map_err(board_error)?;
        Ok(json_of(RunEvent::Board(BoardRecord::from(&hello))))
    }

    fn status(&mut self) -> Result<String, Error> {
        let client = &mut self.link()?.client;
        let status =
            client.status().or_else(|_| client.open_session().and_then(|_| client.status())).map_err(board_error)?;
        Ok(json_of(RunEvent::Status(BoardStatus::from(&status))))
    }

    fn stop(&mut self) -> Result<String, Error> {
        let kind = self.port.kind();
        self.hello()?;
        Ok(self.link()?.client.stop().map_err(board_error)?.message(kind))
    }

    fn emergency_stop(&mut self) -> Result<String, Error> {
        self.link()?.client.emergency_stop().map_err(board_error)?;
        Ok("emergency stop".to_owned())
    }

    fn grow(&mut self, task: &GrowTask) {
        let events = &task.events;
        let (result, error) = match self.grow_body(task) {
            Ok((result, error)) => (serde_json::to_string(&result).ok(), error),
            Err(error) => (None, Some(error)),
        };
        events.send(GrowthMessage::End(result, error));
    }

    /// Grows a body. Returns the result, and the error unless the growth is done or was stopped.
    fn grow_body(&mut self, task: &GrowTask) -> Result<(GrowthResult, Option<Error>), Error> {
        let GrowTask { plan: PyPlan { inner: plan, robot }, commands, .. } = task;
        let request = task.request(self.port.kind());
        if request.kind.is_simulated() {
            self.robot = Arc::clone(robot);
            self.open(&TipSettings { start: Some(plan.start), imperfection: request.imperfection, pace: None })?;
        }
        let (port, link) = (self.name.clone(), self.link()?);
        let job = request.job();
        let mut log = request.open_log(&task.log, &job, &port).map_err(|error| Error::of(ErrorKind::File, &error))?;
        let mut tip = plan.start.frame();
        let board = GrowthBoard {
            client: &mut link.client,
            truth: ground_truth(&mut link.simulated_tip),
            commands,
            silence: HostSilencePolicy::Pause,
            parked: OnParked::Wait,
        };
        let grown = request.run(&job, board, &mut |event| {
            // A line that cannot be written is retried later. Lines that are still missing at the end are counted.
            let _ = log.record(event);
            for event in to_run_events(event, &mut tip) {
                if !task.events.send(GrowthMessage::Event(json_of(event))) {
                    commands.push(Command::Stop);
                }
            }
        });
        let (result, _) = request.end(&grown, &mut log);
        let error = match grown {
            Ok(_) => outcome_error(&result),
            Err(error) => Some(board_error(error)),
        };
        Ok((result, error))
    }
}

/// Returns the error for a growth that ended in another way than done or stopped, or whose log is incomplete. `None`
/// otherwise.
fn outcome_error(result: &GrowthResult) -> Option<Error> {
    let outcome = result.outcome.name();
    let why = match (result.outcome, result.log_lines_missing) {
        (OutcomeKind::Done | OutcomeKind::Stopped, None) => return None,
        (OutcomeKind::Done | OutcomeKind::Stopped, Some(missing)) => {
            format!(
                "the growth ended with {outcome}, but {missing} lines of its run log could not be written: free disk \
                 space before the next growth, and check that the file is writable"
            )
        }
        (_, _) => {
            let of_fault = result.fault.as_ref().map_or_else(String::new, |fault| format!(" ({fault})"));
            let robot = if result.simulated { "simulated robot" } else { "robot" };
            format!(
                "the growth ended with {outcome}{of_fault}: check the {robot}, then resume the body with `growbot \
                 resume` if the robot still stores it"
            )
        }
    };
    Some(Error::with(ErrorKind::Board, why, outcome, "done"))
}

/// A robot at a port.
#[pyclass(name = "Board", frozen, module = "growbot._growbot")]
pub struct PyBoard {
    requests: Mutex<Option<Sender<WorkerRequest>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    /// Commands for the current or the latest growth.
    commands: Mutex<Arc<CommandQueue>>,
    simulated: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PyBoard {
    fn send_request(&self, request: WorkerRequest) -> Result<(), Error> {
        let disconnected = "the board is disconnected: connect again with growbot.connect";
        let closed = || Error::new(ErrorKind::Board, disconnected);
        lock(&self.requests).as_ref().ok_or_else(closed)?.send(request).map_err(|_| closed())
    }

    /// Sends a request to the thread of the connection and waits for the response. Ctrl-C ends the wait.
    fn request(
        &self,
        py: Python<'_>,
        request: impl FnOnce(Sender<Result<String, Error>>) -> WorkerRequest,
    ) -> Result<String, Error> {
        let (sender, receiver) = mpsc::channel();
        self.send_request(request(sender))?;
        let receiver = Mutex::new(receiver);
        loop {
            match py.detach(|| lock(&receiver).recv_timeout(LOOK)) {
                Ok(response) => return response,
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(closed());
                }
            }
        }
    }
}

#[pymethods]
impl PyBoard {
    #[new]
    #[pyo3(signature = (port, robot = None, take_over = None))]
    fn new(
        py: Python<'_>,
        port: &Bound<PyAny>,
        robot: Option<&Bound<PyAny>>,
        take_over: Option<&Bound<PyAny>>,
    ) -> Result<Self, Error> {
        let robot = robot_of(robot)?;
        let name = word("port", port)?;
        let port: PortName = name.parse().map_err(|error: growbot_sim::port::OpenError| {
            Error::with(ErrorKind::Input, error, name.as_str(), "sim, emulator, tcp:HOST:PORT, a device")
        })?;
        let take_over = take_over.map_or(Ok(false), |value| flag("take_over", value))?;
        let (sender, receiver) = mpsc::channel();
        let simulated = port.is_simulated();
        let begins_with_growth = simulated && port.resident().is_none();
        let thread = thread::Builder::new().name("growbot".to_owned()).spawn(move || {
            BoardWorker { robot, port, name, take_over, link: None }.serve(&receiver);
        });
        let thread = thread.map_err(|error| {
            let message = format!("cannot start a thread for the board's port ({error}): end other programs");
            Error::new(ErrorKind::Board, message)
        })?;
        let board = Self {
            requests: Mutex::new(Some(sender)),
            thread: Mutex::new(Some(thread)),
            commands: Mutex::new(Arc::default()),
            simulated,
        };
        if !begins_with_growth && let Err(error) = board.request(py, WorkerRequest::Hello) {
            board.close(py);
            return Err(error);
        }
        Ok(board)
    }

    #[getter]
    fn simulated(&self) -> bool {
        self.simulated
    }

    fn status_json(&self, py: Python<'_>) -> Result<String, Error> {
        self.request(py, WorkerRequest::Status)
    }

    fn stop(&self, py: Python<'_>) -> Result<String, Error> {
        self.request(py, WorkerRequest::Stop)
    }

    fn emergency_stop(&self, py: Python<'_>) -> Result<String, Error> {
        self.request(py, WorkerRequest::EmergencyStop)
    }

    #[pyo3(signature = (plan, conditions = None, seed = None, log = None, overwrite = None, force = None, ignore_scene = None, scene = None))]
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    fn grow(
        &self,
        plan: &Bound<PyAny>,
        conditions: Option<&Bound<PyAny>>,
        seed: Option<&Bound<PyAny>>,
        log: Option<&Bound<PyAny>>,
        overwrite: Option<&Bound<PyAny>>,
        force: Option<&Bound<PyAny>>,
        ignore_scene: Option<&Bound<PyAny>>,
        scene: Option<&Bound<PyAny>>,
    ) -> Result<Growth, Error> {
        let py = plan.py();
        let plan = plan.cast::<PyPlan>().map_err(|_| wrong_type("plan", plan, "a growbot.Plan"))?.get().clone();
        let conditions = Conditions::read(conditions)?;
        let seed = seed_of(seed)?;
        let log = log.map(|file| path("log", file)).transpose()?;
        let overwrite = overwrite.map_or(Ok(false), |value| flag("overwrite", value))?;
        let log = match log {
            None => LogTarget::Disabled,
            Some(file) if overwrite => LogTarget::Replaced(file),
            Some(file) => LogTarget::File(file),
        };
        let force = force.map_or(Ok(false), |value| flag("force", value))?;
        check_conditions(&conditions)?;
        let ignore_scene = ignore_scene.map_or(Ok(false), |value| flag("ignore_scene", value))?;
        let overrides = Override::given([(force, Override::Warnings), (ignore_scene, Override::Scene)]);
        let (scene, scene_error) = if ignore_scene { (None, None) } else { scene_for_growth(&plan, scene)? };
        let (events, messages) = if self.simulated {
            let (sender, receiver) = mpsc::sync_channel(AHEAD);
            (EventSender::Bounded(sender), receiver)
        } else {
            let (sender, receiver) = mpsc::channel();
            (EventSender::Unbounded(sender), receiver)
        };
        let commands: Arc<CommandQueue> = Arc::default();
        *lock(&self.commands) = Arc::clone(&commands);
        let task = GrowTask { plan, conditions, scene, overrides, seed, log, events, commands: Arc::clone(&commands) };
        let request = GrowthRequest { scene_error: scene_error.as_ref(), ..task.request(self.simulated.into()) };
        py.detach(|| request.check()).map_err(|refusal| refused(&refusal))?;
        self.send_request(WorkerRequest::Grow(Box::new(task)))?;
        Ok(Growth { messages: Mutex::new(Some(messages)), commands, result: Mutex::new(None) })
    }

    /// Stops the current growth, and disconnects.
    fn close(&self, py: Python<'_>) {
        lock(&self.commands).push(Command::Stop);
        drop(lock(&self.requests).take());
        let thread = lock(&self.thread).take();
        if let Some(thread) = thread {
            // A panic of the thread was printed already.
            py.detach(|| drop(thread.join()));
        }
    }
}

/// A growth in progress.
#[pyclass(frozen, module = "growbot._growbot")]
pub struct Growth {
    messages: Mutex<Option<Receiver<GrowthMessage>>>,
    commands: Arc<CommandQueue>,
    result: Mutex<Option<String>>,
}

impl Growth {
    /// Records the end of the growth, and returns its error.
    fn end(&self, result: Option<String>, error: Option<Error>) -> Result<(), Error> {
        drop(lock(&self.messages).take());
        *lock(&self.result) = result;
        error.map_or(Ok(()), Err)
    }
}

#[pymethods]
impl Growth {
    /// Returns the next event as JSON, or None at the end.
    fn next_json(&self, py: Python<'_>) -> Result<Option<String>, Error> {
        let mut interrupted = None;
        loop {
            let next = py.detach(|| lock(&self.messages).as_ref().map(|messages| messages.recv_timeout(LOOK)));
            match next {
                None => return Ok(None),
                Some(Ok(GrowthMessage::Event(_))) if interrupted.is_some() => {}
                Some(Ok(GrowthMessage::Event(event))) => return Ok(Some(event)),
                Some(Ok(GrowthMessage::End(result, error))) => {
                    let ended = self.end(result, error);
                    return interrupted.map_or_else(|| ended.map(|()| None), |error: PyErr| Err(error.into()));
                }
                Some(Err(RecvTimeoutError::Timeout)) => {}
                Some(Err(RecvTimeoutError::Disconnected)) => {
                    self.end(None, Some(closed()))?;
                }
            }
            if let Err(error) = py.check_signals() {
                // The first Ctrl-C stops the robot. A second one sends the emergency stop.
                self.commands.push(if interrupted.is_some() { Command::EmergencyStop } else { Command::Stop });
                interrupted = Some(error);
            }
        }
    }

    #[getter]
    fn ended(&self) -> bool {
        lock(&self.messages).is_none()
    }

    #[getter]
    fn result_json(&self) -> Option<String> {
        lock(&self.result).clone()
    }

    /// Sends a command by its name.
    #[pyo3(signature = (name))]
    fn send_command(&self, name: &Bound<PyAny>) -> Result<(), Error> {
        let name = word("name", name)?;
        let command = name.parse().map_err(|_| {
            let known = Command::ALL.map(Command::name).join(", ");
            Error::with(
                ErrorKind::Input,
                format!("unknown command {name:?}: give one of {known}"),
                name.as_str(),
                known,
            )
        })?;
        self.commands.push(command);
        Ok(())
    }
}
