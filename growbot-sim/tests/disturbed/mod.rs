//! A connection to a simulated board that is disturbed at chosen frames of a growth.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::port::{Port, PortError};
use growbot_core::link::frame::{FrameHeader, MAX_BODY_LEN, encode};
use growbot_core::link::message::{
    BeginJob, Cancel, Empty, Hello, HostName, HostSilencePolicy, Message, ResetCause, Resume, SCHEMA_HASH, Start, State,
};
use growbot_sim::port::sim::Sim;

/// A simulated board that a test shares with the connection to it.
pub type Board = Rc<RefCell<Sim>>;

/// Disturbance at one frame of the connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// The whole frame is lost.
    Lost,
    /// Two copies of the frame arrive.
    Doubled,
    /// The frame arrives after the next one in its direction.
    Swapped,
    /// The second half of the frame is lost, so its first half is joined to the next frame.
    Cut,
    /// Delayed frames of a session that was closed before the growth arrive before the frame.
    OldSession,
    /// The watchdog resets the board.
    WatchdogReset,
    /// The board is reset by its pin.
    PinReset,
    /// The board loses power.
    PowerLoss,
    /// The host's program is killed.
    HostKilled,
    /// Another host takes the board over and ends its session.
    OtherLeaves,
    /// Another host takes the board over and then sends nothing more.
    OtherFallsSilent,
    /// Another host takes the board over, requests to resume the job, and ends its session.
    OtherResumes,
    /// Another host takes the board over, stops it, and ends its session.
    OtherStops,
    /// Another host takes the board over, stops it, resumes the job without starting it, and ends its session, which
    /// leaves the board in `Idle`.
    OtherLeavesIdle,
    /// Another host takes the board over, stops it, resumes and starts the job, and ends its session.
    OtherRestarts,
}

impl Disturbance {
    /// All disturbances.
    pub const ALL: [Self; 15] = [
        Self::Lost,
        Self::Doubled,
        Self::Swapped,
        Self::Cut,
        Self::OldSession,
        Self::WatchdogReset,
        Self::PinReset,
        Self::PowerLoss,
        Self::HostKilled,
        Self::OtherLeaves,
        Self::OtherFallsSilent,
        Self::OtherResumes,
        Self::OtherStops,
        Self::OtherLeavesIdle,
        Self::OtherRestarts,
    ];

    /// Returns true if only the connection is disturbed. The host must overcome such a disturbance.
    pub fn is_of_line(self) -> bool {
        matches!(self, Self::Lost | Self::Doubled | Self::Swapped | Self::Cut | Self::OldSession)
    }

    /// Reports whether the board restarts.
    pub fn is_reset(self) -> bool {
        matches!(self, Self::WatchdogReset | Self::PinReset | Self::PowerLoss)
    }

    /// Returns true if another host takes the board over.
    pub fn is_other_host(self) -> bool {
        !(self.is_of_line() || self.is_reset() || self == Self::HostKilled)
    }

    /// Returns true if another host stops the growth.
    pub fn is_stop(self) -> bool {
        matches!(self, Self::OtherStops | Self::OtherLeavesIdle)
    }
}

/// Direction of a frame on the connection.
#[derive(Clone, Copy)]
enum Direction {
    ToBoard,
    ToHost,
}

/// Error message of a connection whose host was killed.
pub const KILLED: &str = "the host was killed";
/// Error message of a connection on which a growth took too long.
pub const ENDLESS: &str = "the growth is followed for ever";

/// A connection that is disturbed at chosen frames. Frames are counted from 0 in both directions together.
pub struct DisturbedLine {
    board: Board,
    plan_id: u64,
    silence: HostSilencePolicy,
    disturbances: Vec<(usize, Disturbance)>,
    frames: usize,
    /// Number of times that another host has taken the board over.
    visits: u32,
    /// Time on the board's clock after which the connection fails.
    limit: Duration,
    is_killed: bool,
    /// Frame that is held back until the next frame has passed, for each [`Direction`].
    held: [Option<Vec<u8>>; 2],
    /// Received bytes of an incomplete frame from the board.
    partial: Vec<u8>,
    to_host: VecDeque<u8>,
    old_frames: [Vec<u8>; 2],
}

impl DisturbedLine {
    /// Creates a connection to a board for a growth of the plan `plan_id`. Other hosts that start the growth use the
    /// setting `silence`.
    pub fn new(
        board: &Board,
        plan_id: u64,
        silence: HostSilencePolicy,
        disturbances: &[(usize, Disturbance)],
        limit: Duration,
    ) -> Self {
        Self {
            old_frames: closed_session(board),
            board: Rc::clone(board),
            plan_id,
            silence,
            disturbances: disturbances.to_vec(),
            frames: 0,
            visits: 0,
            limit,
            is_killed: false,
            held: [None, None],
            partial: Vec::new(),
            to_host: VecDeque::new(),
        }
    }

    /// Returns the number of frames so far, in both directions.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Lets a frame pass, with the disturbances at it. Returns the bytes that arrive.
    fn pass(&mut self, direction: Direction, frame: Vec<u8>) -> Result<Vec<u8>, PortError> {
        let held = self.held[direction as usize].take();
        let mut arriving = vec![frame];
        let at = self.frames;
        for (_, disturbance) in self.disturbances.clone().into_iter().filter(|(frame, _)| *frame == at) {
            match disturbance {
                Disturbance::Lost => arriving.clear(),
                Disturbance::Doubled => arriving.extend(arriving.clone()),
                Disturbance::Swapped => self.held[direction as usize] = Some(std::mem::take(&mut arriving).concat()),
                Disturbance::Cut => arriving.iter_mut().for_each(|frame| frame.truncate(frame.len() / 2)),
                Disturbance::OldSession => arriving.insert(0, self.old_frames[direction as usize].clone()),
                Disturbance::WatchdogReset => self.board.borrow_mut().reset(ResetCause::Watchdog),
                Disturbance::PinReset => self.board.borrow_mut().reset(ResetCause::External),
                Disturbance::PowerLoss => self.board.borrow_mut().reset(ResetCause::PowerOn),
                Disturbance::HostKilled => self.is_killed = true,
                _ => self.visit(disturbance),
            }
        }
        self.frames += 1;
        arriving.extend(held);
        self.check()?;
        Ok(arriving.concat())
    }

    /// Lets another host take the board over and send the requests of `disturbance`.
    fn visit(&mut self, disturbance: Disturbance) {
        self.visits += 1;
        let mut board = self.board.borrow_mut();
        let goodbye = Message::Goodbye(Empty {});
        let stop = Message::Stop(Empty {});
        // After a stop the board reports the layers that are laid. Nothing is laid between these requests.
        let resume = |laid| Message::Resume(Resume { plan_id: self.plan_id, start_layer: laid, reported_layers: laid });
        let start =
            Message::Start(Start { plan_id: self.plan_id, on_host_silence: self.silence, is_continuation: false });
        let laid = board.controller().layers_laid();
        let requests = match disturbance {
            Disturbance::OtherLeaves => vec![goodbye],
            Disturbance::OtherResumes => vec![resume(laid), goodbye],
            Disturbance::OtherStops => vec![stop, goodbye],
            Disturbance::OtherLeavesIdle => vec![stop, resume(laid), goodbye],
            Disturbance::OtherRestarts => vec![stop, resume(laid), start, goodbye],
            _ => vec![],
        };
        converse(&mut board, 0x0700_0000 + self.visits, &requests);
    }

    fn check(&self) -> Result<(), PortError> {
        let lost = |why: &str| Err(PortError::Lost("the line".to_string(), io::Error::other(why)));
        match self {
            Self { is_killed: true, .. } => lost(KILLED),
            _ if self.board.borrow().now() > self.limit => lost(ENDLESS),
            _ => Ok(()),
        }
    }
}

impl Port for DisturbedLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.check()?;
        let arriving = self.pass(Direction::ToBoard, bytes.to_vec())?;
        self.board.borrow_mut().send(&arriving)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.check()?;
        let deadline = self.now() + timeout;
        while self.to_host.is_empty() {
            let mut bytes = [0; 256];
            let left = deadline.saturating_sub(self.now());
            let count = self.board.borrow_mut().receive(&mut bytes, left)?;
            for byte in &bytes[..count] {
                self.partial.push(*byte);
                if *byte == 0 {
                    let frame = std::mem::take(&mut self.partial);
                    let arriving = self.pass(Direction::ToHost, frame)?;
                    self.to_host.extend(arriving);
                }
            }
            if count == 0 {
                self.check()?;
                return Ok(0);
            }
        }
        let count = buffer.len().min(self.to_host.len());
        for (slot, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.board.borrow().now()
    }
}

/// Takes the board over with a new session and sends requests in this session. Returns the bytes that were sent.
fn converse(board: &mut Sim, session: u32, requests: &[Message]) -> Vec<u8> {
    let host = HostName::from_slice(b"another host").expect("it is short");
    let hello = Message::Hello(Hello { schema: SCHEMA_HASH, host, take_over: true });
    let mut sent = Vec::new();
    for (seq, message) in (1..).zip(std::iter::once(&hello).chain(requests)) {
        let mut buffer = [0; MAX_BODY_LEN];
        let body = message.encode(&mut buffer).expect("it is short");
        let header = FrameHeader { kind: message.kind(), session, seq, ack: 0 };
        sent.extend_from_slice(&encode(&header, body).expect("it is short"));
    }
    board.send(&sent).expect("a simulated line does not break");
    sent
}

/// Runs a session that ends before the growth. Returns the bytes that were sent to the board, which contain requests
/// that would end a growth, and the bytes that were sent to the host.
fn closed_session(board: &Board) -> [Vec<u8>; 2] {
    let mut board = board.borrow_mut();
    // A board at its start takes no job until it has tested its sensors.
    while board.state() == State::SelfTest {
        board.run_for(Duration::from_millis(100));
    }
    let begin = BeginJob { plan_id: 7, layers: 1, robot_hash: board.robot().hash() };
    let cancel = Cancel { plan_id: 7 };
    let requests = [Message::BeginJob(begin), Message::Cancel(cancel), Message::Goodbye(Empty {})];
    let to_board = converse(&mut board, 0x0600_0001, &requests);
    let mut to_host = Vec::new();
    let mut bytes = [0; 256];
    loop {
        match board.receive(&mut bytes, Duration::ZERO).expect("a simulated line does not break") {
            0 => return [to_board, to_host],
            count => to_host.extend_from_slice(&bytes[..count]),
        }
    }
}
