//! Sends the emergency stop of a robot on a thread of its own, over a duplicate of the robot's connection or over a
//! separate connection. So an emergency stop does not wait for a queue, a job, a file or a database.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, EMERGENCY_PAUSE};
use growbot_client::port::{Port, PortError};
use growbot_client::stop_signal::StopSignal;
use growbot_sim::port::OpenError;

use super::connector::Connector;

/// Maximum time to open a separate connection for an emergency stop.
const CONNECT_LIMIT: Duration = Duration::from_millis(500);
/// Interval of the checks whether the robot's thread has received the confirmation of the stop.
const CONFIRM_POLL_INTERVAL: Duration = Duration::from_millis(2);
/// Time beyond the time limit of an emergency stop for which a caller waits for the result.
const RESPONSE_MARGIN: Duration = Duration::from_secs(1);

type Line = Box<dyn Port + Send>;

/// Reason why the board has not confirmed an emergency stop.
#[derive(Debug, thiserror::Error)]
pub enum EmergencyStopError {
    #[error("the robot is not connected")]
    NotConnected,
    /// The board at the port with this name has not responded.
    #[error("no response at {0}")]
    NoResponse(String),
    #[error("the robot's link accepts no stop")]
    Late,
    #[error("the thread of the emergency stop has ended")]
    ThreadEnded,
    #[error("{0}")]
    Port(#[from] PortError),
    #[error("{0}")]
    Open(#[from] OpenError),
}

type StopResult = Result<(), EmergencyStopError>;

/// Handle of the thread that sends a robot's emergency stops.
pub struct Stopper {
    tasks: Sender<Sender<StopResult>>,
    line: Arc<Mutex<Option<Line>>>,
    limit: Duration,
}

/// An emergency stop that is being sent, with the channel of its result.
pub struct StopTicket {
    result: Receiver<StopResult>,
    limit: Duration,
}

impl StopTicket {
    /// Waits until the board has confirmed the stop.
    ///
    /// # Errors
    /// [`EmergencyStopError`].
    pub fn wait(self) -> StopResult {
        match self.result.recv_timeout(self.limit + RESPONSE_MARGIN) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => Err(EmergencyStopError::Late),
            Err(RecvTimeoutError::Disconnected) => Err(EmergencyStopError::ThreadEnded),
        }
    }
}

impl Stopper {
    /// Starts the thread that sends emergency stops. `name` is the name of the port in messages.
    pub fn start(name: &str, signal: &Arc<StopSignal>, connector: Arc<dyn Connector>) -> Self {
        let (tasks, received) = mpsc::channel();
        let line = Arc::<Mutex<Option<Line>>>::default();
        let limit = connector.emergency_limit();
        let sender =
            StopSender { name: name.to_owned(), signal: Arc::clone(signal), connector, line: Arc::clone(&line) };
        let spawned = thread::Builder::new().name(format!("stop {name}")).spawn(move || sender.run(&received));
        if let Err(error) = spawned {
            log::warn!("cannot start the thread of the emergency stop at {name}: {error}");
        }
        Self { tasks, line, limit }
    }

    /// Sets the connection on which emergency stops are sent: a duplicate of the robot's open connection, or `None`
    /// once that connection is closed.
    pub fn publish(&self, line: Option<Line>) {
        *self.line.lock().unwrap_or_else(PoisonError::into_inner) = line;
    }

    /// Orders the thread to send the emergency stop, and returns at once.
    pub fn send(&self) -> StopTicket {
        let (reply, result) = mpsc::channel();
        // If the thread has ended, the ticket reports it.
        let _ = self.tasks.send(reply);
        StopTicket { result, limit: self.limit }
    }
}

/// State of the thread that sends emergency stops.
struct StopSender {
    name: String,
    signal: Arc<StopSignal>,
    connector: Arc<dyn Connector>,
    line: Arc<Mutex<Option<Line>>>,
}

impl StopSender {
    fn run(&self, tasks: &Receiver<Sender<StopResult>>) {
        for reply in tasks {
            // The caller may no longer wait for the result.
            let _ = reply.send(self.stop());
        }
    }

    /// Sends the emergency stop, in turn on a duplicate of the robot's connection and on a separate connection, until
    /// the board confirms it or the time limit is over.
    fn stop(&self) -> StopResult {
        let until = Instant::now() + self.connector.emergency_limit();
        let mut why = EmergencyStopError::NotConnected;
        loop {
            if let Some(line) = self.duplicate() {
                match self.send_on(line) {
                    Ok(()) => return Ok(()),
                    Err(error) => why = error,
                }
            }
            let left = until.saturating_duration_since(Instant::now());
            if self.is_confirmed() {
                return Ok(());
            }
            if left.is_zero() {
                return Err(why);
            }
            match self.connector.open_for_emergency_stop(CONNECT_LIMIT.min(left)) {
                Ok(line) => match self.send_on(line) {
                    Ok(()) => return Ok(()),
                    Err(error) => why = error,
                },
                Err(error) => {
                    why = error.into();
                    // The robot may be in this process. Then only its own thread reaches it.
                    let pause = Instant::now() + EMERGENCY_PAUSE;
                    while Instant::now() < pause && !self.is_confirmed() {
                        thread::sleep(CONFIRM_POLL_INTERVAL);
                    }
                }
            }
        }
    }

    /// Returns a new duplicate of the robot's connection. `None` if the robot is not connected, or if another thread,
    /// which may hang, holds the lock.
    fn duplicate(&self) -> Option<Line> {
        match self.line.try_lock() {
            Ok(mut line) => line.as_mut()?.emergency_port(),
            Err(TryLockError::Poisoned(line)) => line.into_inner().as_mut()?.emergency_port(),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    fn send_on(&self, line: Box<dyn Port>) -> StopResult {
        match Client::new(line, &self.name).emergency_stop_within(EMERGENCY_PAUSE, &mut 0)? {
            true => Ok(()),
            false => Err(EmergencyStopError::NoResponse(self.name.clone())),
        }
    }

    /// Returns true if every stop of the robot is confirmed, for example because the robot's thread has delivered it.
    fn is_confirmed(&self) -> bool {
        self.signal.level().is_none()
    }
}
