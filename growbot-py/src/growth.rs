//! Class `growbot._growbot.Growth`: a growth in progress, on a board of this program or of the service.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};

use growbot_plan::job::Command;
use growbot_plan::run_log::{GrowthResult, OutcomeKind};
use pyo3::prelude::*;

use crate::arguments::word;
use crate::error::{Error, ErrorKind};
use crate::interruptible::{LOOK, disconnected, lock, receive};

/// Maximum number of unread events of a growth. A simulation, or the connection to the service, then waits until Python
/// reads some.
pub const AHEAD: usize = 10_000;

/// A message from the thread of a growth to Python.
pub enum GrowthMessage {
    Event(String),
    /// The end of the growth: the result as JSON, and the error unless the growth is done or was stopped.
    End(Option<String>, Result<(), Error>),
    /// The growth goes on without an event. The thread ends if Python does not receive it.
    NoChange,
}

/// Function that sends a command to a growth. Returns the channel of the result, or `None` for a command that is
/// queued.
pub type CommandSender = Box<dyn Fn(Command) -> Option<Receiver<Result<(), Error>>> + Send + Sync>;

/// Returns an error for a growth that ended in another way than done or stopped, or whose log is incomplete.
pub fn check_outcome(result: &GrowthResult) -> Result<(), Error> {
    let outcome = result.outcome.name();
    let why = match (result.outcome, result.log_lines_missing) {
        (OutcomeKind::Done | OutcomeKind::Stopped, None) => return Ok(()),
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
    Err(Error::with(ErrorKind::Board, why, outcome, "done"))
}

/// Returns the error for a stop that was not sent, because the program can have no thread for it.
fn unsent_stop() -> Error {
    let message = "the stop was not sent, because this program can start no thread: run `growbot estop`, or cut the \
                   robot's power";
    Error::new(ErrorKind::Board, message)
}

/// A growth in progress.
#[pyclass(frozen, module = "growbot._growbot")]
pub struct Growth {
    messages: Mutex<Option<Receiver<GrowthMessage>>>,
    commands: CommandSender,
    result: Mutex<Option<String>>,
}

impl Growth {
    /// Creates a growth that sends these messages and accepts these commands.
    pub fn new(messages: Receiver<GrowthMessage>, commands: CommandSender) -> Self {
        Self { messages: Mutex::new(Some(messages)), commands, result: Mutex::new(None) }
    }

    /// Records the end of the growth, and returns its error.
    fn end(&self, result: Option<String>, ended: Result<(), Error>) -> Result<(), Error> {
        drop(lock(&self.messages).take());
        *lock(&self.result) = result;
        ended
    }
}

#[pymethods]
impl Growth {
    /// Returns the next event as JSON, or None at the end.
    fn next_json(&self, py: Python<'_>) -> Result<Option<String>, Error> {
        let mut interrupted = None;
        let mut stopped: Option<Receiver<_>> = None;
        loop {
            let next = py.detach(|| lock(&self.messages).as_ref().map(|messages| messages.recv_timeout(LOOK)));
            match next {
                None => return Ok(None),
                Some(Ok(GrowthMessage::NoChange)) => {}
                Some(Ok(GrowthMessage::Event(_))) if interrupted.is_some() => {}
                Some(Ok(GrowthMessage::Event(event))) => return Ok(Some(event)),
                Some(Ok(GrowthMessage::End(result, ended))) => {
                    let ended = self.end(result, ended);
                    return interrupted.map_or_else(|| ended.map(|()| None), |error: PyErr| Err(error.into()));
                }
                Some(Err(RecvTimeoutError::Timeout)) => {}
                Some(Err(RecvTimeoutError::Disconnected)) => {
                    self.end(None, Err(disconnected()))?;
                }
            }
            match stopped.as_ref().map(Receiver::try_recv) {
                Some(Ok(response)) => {
                    stopped = None;
                    response?;
                }
                Some(Err(TryRecvError::Disconnected)) => return Err(unsent_stop()),
                Some(Err(TryRecvError::Empty)) | None => {}
            }
            if let Err(error) = py.check_signals() {
                // The first Ctrl-C stops the robot. A second one sends the emergency stop.
                stopped = (self.commands)(if interrupted.is_some() { Command::EmergencyStop } else { Command::Stop });
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
        let py = name.py();
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
        (self.commands)(command).map_or(Ok(()), |result| receive(py, result))
    }
}
