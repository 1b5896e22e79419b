//! The process that runs a simulated robot.

use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Write};
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use std::{fs, io, thread};

use growbot_client::port::Port;
use growbot_core::link::message::ResetCause;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::persistence::PersistentMemory;
use super::protocol::{DaemonResponse, PROTOCOL_VERSION, Request, micros};
use super::{SimDaemonError, StateDir};
use crate::port::TipSettings;
use crate::port::sim::Sim;

/// Maximum time by which the robot's time advances between two checks for requests, at a pace of at most 1. At a faster
/// pace, it is multiplied by the pace.
const STEP: Duration = Duration::from_millis(10);
/// Maximum delay of the robot's time behind real time that the robot makes up for.
const MAX_BEHIND: Duration = Duration::from_secs(1);
/// Maximum real time for which the robot's time stands still to wait for the next request of its owner, the program
/// with the exclusive connection.
const PATIENCE: Duration = Duration::from_secs(1);
/// Maximum time for which the process waits for a request if the robot's time is at most [`STEP`] late.
const LOOK: Duration = Duration::from_millis(1);
/// Maximum number of bytes from the board that wait for one program. Beyond this number, the oldest bytes are dropped.
const MAX_QUEUE: usize = 1 << 16;

/// Runs the simulated robot of the directory `place` until it is switched off. The robot's time advances `pace` times
/// as fast as real time. `ready` is called once programs can connect.
///
/// # Errors
/// [`SimDaemonError`]: another process runs the robot, the directory belongs to another robot, or its files cannot be
/// used.
pub fn serve(place: &StateDir, robot: &Robot, pace: f64, ready: impl FnOnce()) -> Result<(), SimDaemonError> {
    place.create()?;
    let Some(held) = place.hold()? else { return Err(SimDaemonError::AlreadyRunning(place.name().to_owned())) };
    place.claim(robot)?;
    place.set_pace(pace)?;
    let mut sim = Sim::new(robot.clone());
    let (mut store, retains) = PersistentMemory::open(place, &mut sim)?;
    sim.restart(boots(), if retains { ResetCause::External } else { ResetCause::PowerOn });
    store.save(&sim)?;
    let path = place.socket_path()?;
    let asks = fs::remove_file(&path)
        .or_else(|error| if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) })
        .and_then(|()| UnixListener::bind(&path))
        .map(listen)
        .map_err(|error| place.failed("listen at", path, error))?;
    let began = Instant::now();
    let mut player = SimServer { sim, store, pace, began, hosts: BTreeMap::new(), owner: None, last_request: began };
    ready();
    let ended = player.run(&asks);
    drop(held);
    // The program that has switched the robot off waits for the end of the line. The threads that listen keep the line
    // open if this process continues.
    for host in player.hosts.values() {
        let _ = host.stream.shutdown(Shutdown::Both);
    }
    ended
}

/// Returns an initial boot number that differs from process to process.
fn boots() -> u32 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    now.subsec_nanos().rotate_left(13) ^ now.as_secs() as u32
}

/// A message from the thread of a connection: a new connection, a request, or the end of the connection.
enum ConnectionEvent {
    Connected(UnixStream),
    Request(Request),
    Disconnected,
}

type Asks = Receiver<(u64, ConnectionEvent)>;

/// Starts a thread that accepts connections, and one thread for each connection. Returns the channel on which these
/// threads report events.
fn listen(listener: UnixListener) -> Asks {
    let (sender, events) = mpsc::channel();
    thread::spawn(move || {
        for (host, stream) in (0..).zip(listener.incoming()) {
            // No file descriptors are available at present.
            let Ok(stream) = stream else {
                thread::sleep(Duration::from_millis(100));
                continue;
            };
            let sender = sender.clone();
            thread::spawn(move || read_requests(host, stream, &sender));
        }
    });
    events
}

fn read_requests(host: u64, stream: UnixStream, say: &Sender<(u64, ConnectionEvent)>) {
    let Ok(answers) = stream.try_clone() else { return };
    let mut heard = say.send((host, ConnectionEvent::Connected(answers))).is_ok();
    let mut lines = BufReader::new(stream).lines();
    while heard {
        let Some(Ok(line)) = lines.next() else { break };
        let Ok(ask) = serde_json::from_str(&line) else { break };
        heard = say.send((host, ConnectionEvent::Request(ask))).is_ok();
    }
    // If the process ends, nothing receives this message.
    let _ = say.send((host, ConnectionEvent::Disconnected));
}

/// A program that is connected to the robot's process.
struct ClientConnection {
    stream: UnixStream,
    /// Bytes that the board has sent since the connection was opened and that the program has not received.
    queue: VecDeque<u8>,
    is_open: bool,
    /// Deadline of the program's request for bytes, in the robot's time, and the maximum number of bytes. `None` if the
    /// program does not wait for bytes.
    waits: Option<(Duration, usize)>,
}

struct SimServer {
    sim: Sim,
    store: PersistentMemory,
    pace: f64,
    /// Real time at which the robot's time was 0.
    began: Instant,
    hosts: BTreeMap<u64, ClientConnection>,
    /// Number of the program with the exclusive connection.
    owner: Option<u64>,
    /// Real time of the owner's latest request, or of the latest response to a program that waited for bytes.
    last_request: Instant,
}

impl SimServer {
    fn run(&mut self, asks: &Asks) -> Result<(), SimDaemonError> {
        loop {
            let due = self.due();
            if !due.is_zero() {
                self.pass(due.min(STEP.mul_f64(self.pace.max(1.0))));
            }
            self.store.save(&self.sim)?;
            self.answer_waiting();
            let wait = if due > STEP { Duration::ZERO } else { LOOK.min(self.time_to_deadline()) };
            match asks.recv_timeout(wait) {
                Ok((host, event)) => {
                    if self.take(host, event)? == PowerState::Unpowered {
                        return Ok(());
                    }
                    self.store.save(&self.sim)?;
                }
                Err(RecvTimeoutError::Timeout) => {}
                // The thread that accepts connections never ends.
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
    }

    /// Returns the robot's time.
    fn now(&self) -> Duration {
        self.sim.now()
    }

    /// Returns the time by which the robot's time has to advance now. The robot's time stands still while its owner
    /// computes the next request.
    fn due(&mut self) -> Duration {
        let waited_for = self.owner.is_some()
            && self.hosts.values().all(|host| host.waits.is_none())
            && self.last_request.elapsed() < PATIENCE;
        let real = self.now().div_f64(self.pace);
        let behind = self.began.elapsed().saturating_sub(real);
        if waited_for || behind > MAX_BEHIND {
            self.began = Instant::now().checked_sub(real).unwrap_or(self.began);
            return Duration::ZERO;
        }
        behind.mul_f64(self.pace)
    }

    /// Returns the earliest deadline of a program that waits for bytes, in the robot's time.
    fn deadline(&self) -> Option<Duration> {
        self.hosts.values().filter_map(|host| host.waits).map(|(until, _)| until).min()
    }

    /// Returns the real time in which the robot's time reaches the earliest deadline of a program that waits for bytes.
    fn time_to_deadline(&self) -> Duration {
        self.deadline()
            .map(|until| until.saturating_sub(self.now()).as_secs_f64() / self.pace)
            .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
            .unwrap_or(Duration::MAX)
    }

    /// Advances the robot's time by at most `time`, until the board sends bytes or the deadline of a waiting program.
    /// Queues the bytes for all programs.
    fn pass(&mut self, time: Duration) {
        let time = self
            .deadline()
            .map_or(time, |until| time.min(until.saturating_sub(self.now())))
            .max(Duration::from_micros(100));
        let mut buffer = [0; 4096];
        let count = self.sim.receive(&mut buffer, time).unwrap_or(0);
        let bytes = buffer.get(..count).unwrap_or_default();
        for host in self.hosts.values_mut().filter(|host| host.is_open) {
            host.queue.extend(bytes);
            let excess = host.queue.len().saturating_sub(MAX_QUEUE);
            host.queue.drain(..excess);
        }
    }

    fn answer_waiting(&mut self) {
        let now = self.now();
        let mut gone = Vec::new();
        for (name, host) in &mut self.hosts {
            let Some((until, max)) = host.waits else { continue };
            if host.queue.is_empty() && now < until {
                continue;
            }
            host.waits = None;
            let count = max.min(host.queue.len());
            let bytes = host.queue.drain(..count).collect();
            if write_response(&mut host.stream, &DaemonResponse::Bytes { bytes, now_us: micros(now) }).is_err() {
                gone.push(*name);
            }
            self.last_request = Instant::now();
        }
        for host in gone {
            self.forget(host);
        }
    }

    /// Returns true if the owner still has its connection open. The state of the socket is checked, because the thread
    /// that reads from the socket may report the end of the connection only after the request of the next owner.
    fn has_connected_owner(&self) -> bool {
        let Some(owner) = self.owner.and_then(|owner| self.hosts.get(&owner)) else { return false };
        let mut ends = [PollFd::new(&owner.stream, PollFlags::empty())];
        let polled = poll(&mut ends, Some(&Timespec::default()));
        polled.is_err() || !ends[0].revents().contains(PollFlags::HUP)
    }

    fn forget(&mut self, host: u64) {
        self.hosts.remove(&host);
        if self.owner == Some(host) {
            self.owner = None;
        }
    }

    fn take(&mut self, name: u64, event: ConnectionEvent) -> Result<PowerState, SimDaemonError> {
        let ask = match event {
            ConnectionEvent::Connected(stream) => {
                self.hosts
                    .insert(name, ClientConnection { stream, queue: VecDeque::new(), is_open: false, waits: None });
                return Ok(PowerState::Powered);
            }
            ConnectionEvent::Disconnected => {
                self.forget(name);
                return Ok(PowerState::Powered);
            }
            ConnectionEvent::Request(ask) => ask,
        };
        if ask == Request::PowerOff {
            self.store.lose_retained()?;
        }
        let is_off = ask == Request::PowerOff;
        if self.owner == Some(name) {
            self.last_request = Instant::now();
        }
        let answer = self.handle_request(name, ask);
        if let (Some(answer), Some(host)) = (answer, self.hosts.get_mut(&name))
            && write_response(&mut host.stream, &answer).is_err()
        {
            self.forget(name);
        }
        Ok(if is_off { PowerState::Unpowered } else { PowerState::Powered })
    }

    /// Executes the request of a program. Returns `None` if the response is sent later.
    fn handle_request(&mut self, name: u64, ask: Request) -> Option<DaemonResponse> {
        let now = self.now();
        match ask {
            Request::Open { release, .. } if release != PROTOCOL_VERSION => return Some(DaemonResponse::OtherRelease),
            Request::Open { exclusive: true, .. } if self.has_connected_owner() => return Some(DaemonResponse::Busy),
            Request::Open { exclusive: alone, .. } => {
                if alone {
                    (self.owner, self.last_request) = (Some(name), Instant::now());
                }
                self.hosts.get_mut(&name)?.is_open = true;
            }
            Request::Tip(words) => TipSettings::from(words).apply(&mut self.sim.simulated_tip()),
            Request::StartAt(degrees, roll) => {
                if let Ok(pose) = Pose::from_degrees(degrees).and_then(|pose| pose.with_roll(roll)) {
                    self.sim.simulated_tip().start_at(&pose);
                }
            }
            Request::Send(bytes) => self.sim.send(&bytes).unwrap_or_default(),
            Request::Receive { timeout_us, max } => {
                let until = now.saturating_add(Duration::from_micros(timeout_us));
                self.hosts.get_mut(&name)?.waits = Some((until, max));
                return None;
            }
            Request::Laid => {
                let laid = self.sim.tip_handle().laid().unwrap_or_default();
                return Some(DaemonResponse::of_layers(&laid.body, laid.feed_steps));
            }
            Request::Settled { from } => {
                return Some(DaemonResponse::of_layers(&self.sim.tip_handle().settled(from), 0));
            }
            Request::Hand(hand) => self.sim.simulated_tip().apply_action(hand),
            Request::Reset => self.sim.reset(ResetCause::External),
            Request::PowerOff => {}
        }
        Some(DaemonResponse::Done { now_us: micros(self.now()) })
    }
}

/// Power state of the robot after a request.
#[derive(PartialEq, Eq)]
enum PowerState {
    Powered,
    Unpowered,
}

/// Time after which a program that accepts no bytes counts as disconnected.
const STALLED: Duration = Duration::from_secs(2);

fn write_response(stream: &mut UnixStream, answer: &DaemonResponse) -> io::Result<()> {
    let mut line = serde_json::to_vec(answer)?;
    line.push(b'\n');
    stream.set_write_timeout(Some(STALLED))?;
    stream.write_all(&line)
}
