//! The host's end of the link: requests with answers, and the events in between.

use std::collections::VecDeque;
use std::time::Duration;

use growbot_core::link::frame::{self, Frame, FrameError, Header, LONGEST_BODY, Receiver};
use growbot_core::link::message::{
    BoardHello, Empty, FaultRecord, HostHello, LatestFault, Message, MessageError, Refusal, Refused, SCHEMA_HASH,
    SensorReadings, State, Status,
};
use growbot_core::robot::Robot;

use crate::port::{Port, PortError};

/// How long an answer may take before the request is repeated.
const ANSWER: Duration = Duration::from_millis(1000);
/// How long a plan may take: a board needs up to a minute for a near goal, and emulated by a busy machine some times that.
const PLAN: Duration = Duration::from_secs(180);
/// How often a request is sent before the board counts as silent.
const TRIES: u32 = 4;
/// A board that has just started tests itself for two seconds at most; it is looked at so often,
const MOST_LOOKS_AT_SELF_TEST: u32 = 60;
/// with such pauses.
const SELF_TEST_LOOK: Duration = Duration::from_millis(50);
/// Frames, events and noise that may come before the answer does.
const MOST_FRAMES: usize = 32;

/// Why a request came to nothing.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No byte came back.
    #[error(
        "the board at {port} does not answer ({TRIES} requests, 1 s each): check power, cable and baud rate, and that growbot's firmware is on it"
    )]
    Silent {
        /// The port.
        port: String,
    },
    /// Bytes came back, but no frame.
    #[error(
        "what the board at {port} sends is no growbot frame: check the port, the baud rate (115200) and that growbot's firmware is on it"
    )]
    Garbage {
        /// The port.
        port: String,
    },
    /// Frames of another version.
    #[error("the board at {port} speaks another version of the link: {source}")]
    Version {
        /// The port.
        port: String,
        /// Which.
        source: FrameError,
    },
    /// Messages of another schema.
    #[error(
        "the board's messages (schema {board:016x}) differ from mine ({host:016x}): flash the firmware of this release (`cargo robot`), or use the growbot that belongs to the board's"
    )]
    Schema {
        /// The board's.
        board: u64,
        /// This program's.
        host: u64,
    },
    /// The board belongs to another robot.
    #[error(
        "the board is {board_name} ({board:016x}), the job is for {host_name} ({host:016x}): choose the board's robot with --robot, or flash the board for the job's (GROWBOT_ROBOT={host_name} cargo robot)"
    )]
    OtherRobot {
        /// Name of the board's robot.
        board_name: String,
        /// Hash of its description.
        board: u64,
        /// Name of the job's robot.
        host_name: String,
        /// Hash of its description.
        host: u64,
    },
    /// The board refused.
    #[error("the board refused {request}: {}", explain(.refusal))]
    Refused {
        /// What was asked.
        request: &'static str,
        /// Why not.
        refusal: Refusal,
    },
    /// The board answered something else.
    #[error("the board answered {request} with something else (kind {kind:#04x}): flash the firmware of this release")]
    Unexpected {
        /// What was asked.
        request: &'static str,
        /// Kind of the answer.
        kind: u8,
    },
    /// The line is gone.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// A refusal in words.
fn explain(refusal: &Refusal) -> String {
    match *refusal {
        Refusal::NotUnderstood => "it does not understand the request".to_string(),
        Refusal::OtherSchema { board } => format!("its messages have schema {board:016x}"),
        Refusal::NoSession => "another host has taken over, or the board has restarted".to_string(),
        Refusal::OtherRobot { board } => format!("it is another robot ({board:016x})"),
        Refusal::OtherPlan { board: 0 } => "it holds no plan: hand one over first".to_string(),
        Refusal::OtherPlan { board } => format!("it holds another plan ({board:016x})"),
        Refusal::OutOfOrder { expected } => format!("it expects layer {expected} next"),
        Refusal::Full => "it has no room for more layers now".to_string(),
        Refusal::BadLayer { index } => format!("layer {index} is beyond the robot's limits or the plan's end"),
        Refusal::WrongState { state } => format!("not while it is in state {}", state.name()),
        Refusal::FaultRemains { fault } => format!("{} is still there: {}", fault.code(), fault.explanation()),
        Refusal::NoPlan => "there is no plan for these poses and this radius".to_string(),
        Refusal::PlanTooLong { layers, capacity } => format!("the plan has {layers} layers, it holds {capacity}"),
        Refusal::Temperature { least, greatest } => format!(
            "the temperature must lie between {} and {} C, the limits of its description",
            f64::from(least) / 100.0,
            f64::from(greatest) / 100.0
        ),
        Refusal::EmergencyStop => "the emergency stop is pressed: release it first".to_string(),
    }
}

/// The host's end of the link to one board.
pub struct Client {
    port: Box<dyn Port>,
    name: String,
    receiver: Receiver,
    arrived: VecDeque<u8>,
    session: u32,
    seq: u16,
    events: VecDeque<Message>,
}

impl Client {
    /// A client on an open port. `name` is what errors call it.
    #[must_use]
    pub fn new(port: Box<dyn Port>, name: &str) -> Self {
        Self {
            port,
            name: name.to_string(),
            receiver: Receiver::default(),
            arrived: VecDeque::new(),
            session: new_session(),
            seq: 0,
            events: VecDeque::new(),
        }
    }

    /// The port.
    pub fn port(&mut self) -> &mut dyn Port {
        self.port.as_mut()
    }

    /// Opens the session: both sides say who they are.
    ///
    /// # Errors
    /// A board that is silent, garbled, or of another version.
    pub fn hello(&mut self) -> Result<BoardHello, ClientError> {
        let request = Message::Hello(HostHello { schema: SCHEMA_HASH });
        match self.request("hello", &request) {
            Ok(Message::BoardHello(hello)) if hello.schema == SCHEMA_HASH => self.after_self_test(hello),
            Ok(Message::BoardHello(hello)) => Err(ClientError::Schema { board: hello.schema, host: SCHEMA_HASH }),
            Err(ClientError::Refused { refusal: Refusal::OtherSchema { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            Ok(other) => Err(ClientError::Unexpected { request: "hello", kind: other.kind() }),
            Err(error) => Err(error),
        }
    }

    /// Waits until a board that has just started has tested itself: until then it takes no job.
    fn after_self_test(&mut self, mut hello: BoardHello) -> Result<BoardHello, ClientError> {
        for _ in 0..MOST_LOOKS_AT_SELF_TEST {
            if hello.status.state != State::SelfTest {
                break;
            }
            self.next_frame(SELF_TEST_LOOK)?;
            hello.status = self.status()?;
        }
        Ok(hello)
    }

    /// Opens the session with a board that must belong to this robot.
    ///
    /// # Errors
    /// As [`Client::hello`], or a board of another robot.
    pub fn hello_robot(&mut self, robot: &Robot) -> Result<BoardHello, ClientError> {
        let hello = self.hello()?;
        if hello.robot != robot.hash() {
            return Err(ClientError::OtherRobot {
                board_name: hello.robot_name.to_string(),
                board: hello.robot,
                host_name: robot.name().to_string(),
                host: robot.hash(),
            });
        }
        Ok(hello)
    }

    /// What the board is doing.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn status(&mut self) -> Result<Status, ClientError> {
        let what = "for its status";
        match self.request(what, &Message::AskStatus(Empty {}))? {
            Message::Status(status) => Ok(status),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// What the board's sensors say.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn sensors(&mut self) -> Result<SensorReadings, ClientError> {
        let what = "for its sensors";
        match self.request(what, &Message::AskSensors(Empty {}))? {
            Message::SensorReadings(readings) => Ok(readings),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// The board's latest fault as it was when it came, cleared or not; none if it knows of none.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn latest_fault(&mut self) -> Result<Option<FaultRecord>, ClientError> {
        let what = "for its latest fault";
        match self.request(what, &Message::AskFault(Empty {}))? {
            Message::LatestFault(LatestFault { record }) => Ok(record),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Asks and waits for the answer, repeating the request where none comes. `what` is what errors call it.
    ///
    /// # Errors
    /// No answer, or a refusal.
    pub fn request(&mut self, what: &'static str, request: &Message) -> Result<Message, ClientError> {
        let mut buffer = [0; LONGEST_BODY];
        let body =
            request.encode(&mut buffer).map_err(|_| ClientError::Unexpected { request: what, kind: request.kind() })?;
        // 0 is the acknowledgement of none.
        self.seq = self.seq.wrapping_add(1).max(1);
        let seq = self.seq;
        let header = Header { kind: request.kind(), session: self.session, seq, ack: 0 };
        let bytes = frame::encode(&header, body)
            .map_err(|_| ClientError::Unexpected { request: what, kind: request.kind() })?;
        let patience = if matches!(request, Message::Plan(_)) { PLAN } else { ANSWER };
        let mut heard = None;
        for _ in 0..TRIES {
            self.port.send(&bytes)?;
            for _ in 0..MOST_FRAMES {
                match self.next_frame(patience)? {
                    None => break,
                    Some(Ok(frame)) if frame.header.session == self.session && frame.header.ack == seq => {
                        return answer(what, &frame);
                    }
                    Some(Ok(frame)) => self.take_event(&frame),
                    Some(Err(error)) => heard = Some(error),
                }
            }
        }
        let port = self.name.clone();
        Err(match heard {
            None => ClientError::Silent { port },
            Some(source @ FrameError::Version { .. }) => ClientError::Version { port, source },
            Some(_) => ClientError::Garbage { port },
        })
    }

    /// Waits for an event.
    ///
    /// # Errors
    /// If the line is gone.
    pub fn event(&mut self, timeout: Duration) -> Result<Option<Message>, ClientError> {
        if self.events.is_empty()
            && let Some(Ok(frame)) = self.next_frame(timeout)?
        {
            self.take_event(&frame);
        }
        Ok(self.events.pop_front())
    }

    fn take_event(&mut self, frame: &Frame) {
        // An answer that came too late, or a frame of another session, is not for us.
        if frame.header.session == self.session
            && frame.header.ack == 0
            && let Ok(message) = Message::decode(frame.header.kind, &frame.body)
        {
            self.events.push_back(message);
        }
    }

    /// The next frame, or why bytes were none; nothing if the line is quiet for as long as the timeout.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Result<Frame, FrameError>>, ClientError> {
        let mut taken = 0;
        // What trickles in without ever being a frame must not hold us for ever.
        while taken < 2 * frame::LONGEST_FRAME {
            if self.arrived.is_empty() {
                let mut buffer = [0; 256];
                let count = self.port.receive(&mut buffer, timeout)?;
                self.arrived.extend(&buffer[..count]);
            }
            let Some(byte) = self.arrived.pop_front() else {
                return Ok((taken > 0).then_some(Err(FrameError::Garbled)));
            };
            taken += 1;
            if let Some(frame) = self.receiver.push(byte) {
                return Ok(Some(frame));
            }
        }
        Ok(Some(Err(FrameError::TooLong)))
    }
}

/// The answer in a frame, refusals as errors.
fn answer(request: &'static str, frame: &Frame) -> Result<Message, ClientError> {
    match Message::decode(frame.header.kind, &frame.body) {
        Ok(Message::Refused(Refused { refusal, .. })) => Err(ClientError::Refused { request, refusal }),
        Ok(message) => Ok(message),
        Err(MessageError::UnknownKind { kind } | MessageError::Body { kind }) => {
            Err(ClientError::Unexpected { request, kind })
        }
    }
}

/// A number for this session that another host will hardly have.
fn new_session() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which stands for no session.
    (now.as_secs() as u32).rotate_left(12) ^ now.subsec_nanos() ^ std::process::id() | 1
}
