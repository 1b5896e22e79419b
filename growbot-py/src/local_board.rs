//! A board whose port this program owns. A thread owns the connection and receives requests as messages, so that
//! Python's threads can run, and Ctrl-C has an effect, while a body grows.

use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthBoard, GrowthRequest, OnParked, Override};
use growbot_client::status::RobotStatus;
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::robot::Robot as Described;
use growbot_plan::job::Command;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, to_run_events};
use growbot_sim::port::{OpenPort, PortName, TipSettings, open};
use growbot_sim::simulated_tip::{SimulatedTip, ground_truth};
use pyo3::prelude::*;

use crate::board_handle::{BoardHandle, GrowthArguments};
use crate::error::{Error, ErrorKind};
use crate::growth::{AHEAD, Growth, GrowthMessage, check_outcome};
use crate::interruptible::{disconnected, lock, receive};
use crate::preconditions::{refused, scene_for_growth};
use crate::py_plan::PyPlan;
use crate::run::json_of;

/// Interval at which the end of a board's thread is awaited, and Ctrl-C is noticed.
const CLOSE_POLL_INTERVAL: Duration = Duration::from_millis(2);

/// A task of the thread that owns the connection to the board.
type BoardTask = Box<dyn FnOnce(&mut BoardWorker) + Send>;

/// Function that sends a message of a growth to Python. Returns false if Python has dropped the receiver.
type MessageSender = Box<dyn Fn(GrowthMessage) -> bool + Send>;

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

impl BoardWorker {
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
        self.link.as_mut().ok_or_else(disconnected)
    }

    fn hello(&mut self) -> Result<(), Error> {
        self.link()?.client.open_session().map_err(board_error).map(drop)
    }

    fn status(&mut self) -> Result<RobotStatus, Error> {
        let (name, kind, pace) = (self.name.clone(), self.port.kind(), self.port.pace());
        RobotStatus::read(&mut self.link()?.client, &name, kind, pace).map_err(board_error)
    }

    fn stop(&mut self) -> Result<String, Error> {
        let kind = self.port.kind();
        self.hello()?;
        Ok(self.link()?.client.stop().map_err(board_error)?.message(kind))
    }

    fn emergency_stop(&mut self) -> Result<(), Error> {
        self.link()?.client.emergency_stop().map_err(board_error)
    }

    /// Grows a body. Returns the result, with an error unless the growth is done or was stopped.
    fn grow(
        &mut self,
        arguments: &GrowthArguments,
        send: &MessageSender,
        commands: &CommandQueue,
    ) -> Result<(GrowthResult, Result<(), Error>), Error> {
        let GrowthArguments { plan: PyPlan { inner: plan, robot }, log, .. } = arguments;
        let request = arguments.request(self.port.kind());
        if request.kind.is_simulated() {
            self.robot = Arc::clone(robot);
            self.open(&TipSettings { imperfection: request.imperfection, pace: None })?;
        }
        let (port, link) = (self.name.clone(), self.link()?);
        let job = request.job();
        let mut log = request.open_log(log, &job, &port).map_err(|error| Error::of(ErrorKind::File, &error))?;
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
                if !send(GrowthMessage::Event(json_of(event))) {
                    commands.push(Command::Stop);
                }
            }
        });
        let (result, _) = request.end(&grown, &mut log);
        let ended = match grown {
            Ok(_) => check_outcome(&result),
            Err(error) => Err(board_error(error)),
        };
        Ok((result, ended))
    }
}

/// A board whose port this program owns.
pub struct LocalBoard {
    tasks: Mutex<Option<Sender<BoardTask>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    /// Commands for the current or the latest growth.
    commands: Mutex<Arc<CommandQueue>>,
    /// Kind of the robot.
    pub kind: RobotKind,
}

impl LocalBoard {
    /// Opens a port. `robot` is the robot that a simulated port simulates.
    pub fn open(py: Python<'_>, name: String, robot: Arc<Described>, take_over: bool) -> Result<Self, Error> {
        let port: PortName = name.parse().map_err(|error: growbot_sim::port::OpenError| {
            Error::with(ErrorKind::Input, error, name.as_str(), "sim, emulator, tcp:HOST:PORT, a device")
        })?;
        let (sender, receiver) = mpsc::channel::<BoardTask>();
        let kind = port.kind();
        let begins_with_growth = kind.is_simulated() && port.resident().is_none();
        let thread = thread::Builder::new().name("growbot".to_owned()).spawn(move || {
            let mut worker = BoardWorker { robot, port, name, take_over, link: None };
            receiver.into_iter().for_each(|task| task(&mut worker));
        });
        let thread = thread.map_err(|error| {
            let message = format!("cannot start a thread for the board's port ({error}): end other programs");
            Error::new(ErrorKind::Board, message)
        })?;
        let (tasks, thread) = (Mutex::new(Some(sender)), Mutex::new(Some(thread)));
        let board = Self { tasks, thread, commands: Mutex::default(), kind };
        if !begins_with_growth && let Err(error) = board.request(py, BoardWorker::hello) {
            board.close(py)?;
            return Err(error);
        }
        Ok(board)
    }

    fn send_task(&self, task: BoardTask) -> Result<(), Error> {
        lock(&self.tasks).as_ref().ok_or_else(disconnected)?.send(task).map_err(|_| disconnected())
    }

    /// Runs a task on the thread of the connection and waits for the response. Ctrl-C ends the wait.
    fn request<T: Send + 'static>(
        &self,
        py: Python<'_>,
        task: fn(&mut BoardWorker) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let (sender, receiver) = mpsc::channel();
        self.send_task(Box::new(move |worker| drop(sender.send(task(worker)))))?;
        receive(py, receiver)
    }
}

impl BoardHandle for LocalBoard {
    fn status(&self, py: Python<'_>) -> Result<RobotStatus, Error> {
        self.request(py, BoardWorker::status)
    }

    fn stop(&self, py: Python<'_>) -> Result<String, Error> {
        self.request(py, BoardWorker::stop)
    }

    fn emergency_stop(&self, py: Python<'_>) -> Result<(), Error> {
        self.request(py, BoardWorker::emergency_stop)
    }

    fn grow(&self, py: Python<'_>, mut arguments: GrowthArguments) -> Result<Growth, Error> {
        let mut scene_error = None;
        let given = arguments.scene.take();
        if !arguments.overrides.contains(&Override::Scene) {
            (arguments.scene, scene_error) = scene_for_growth(py, &arguments.plan, given)?;
        }
        let request = GrowthRequest { scene_error: scene_error.as_ref(), ..arguments.request(self.kind) };
        py.detach(|| request.check()).map_err(|refusal| refused(&refusal))?;
        let (send, messages): (MessageSender, _) = if self.kind.is_simulated() {
            let (sender, receiver) = mpsc::sync_channel(AHEAD);
            (Box::new(move |message| sender.send(message).is_ok()), receiver)
        } else {
            let (sender, receiver) = mpsc::channel();
            (Box::new(move |message| sender.send(message).is_ok()), receiver)
        };
        let commands: Arc<CommandQueue> = Arc::default();
        *lock(&self.commands) = Arc::clone(&commands);
        let queued = Arc::clone(&commands);
        self.send_task(Box::new(move |worker| {
            let (result, ended) = match worker.grow(&arguments, &send, &queued) {
                Ok((result, ended)) => (serde_json::to_string(&result).ok(), ended),
                Err(error) => (None, Err(error)),
            };
            send(GrowthMessage::End(result, ended));
        }))?;
        let queue = move |command| {
            commands.push(command);
            None
        };
        Ok(Growth::new(messages, Box::new(queue)))
    }

    fn attach(&self, _: Python<'_>) -> Result<Growth, Error> {
        let message = "no service owns the robot: start `growbot serve` with this robot, and connect again";
        Err(Error::new(ErrorKind::Board, message))
    }

    fn close(&self, py: Python<'_>) -> Result<(), Error> {
        lock(&self.commands).push(Command::Stop);
        drop(lock(&self.tasks).take());
        let thread = lock(&self.thread).take();
        while thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            py.detach(|| thread::sleep(CLOSE_POLL_INTERVAL));
            py.check_signals()?;
        }
        Ok(())
    }
}
