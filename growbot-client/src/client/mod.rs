//! The host's end of the link: requests with answers, and the events in between.

mod clock;
mod emergency;
mod error;
mod patience;

use std::collections::VecDeque;
use std::time::Duration;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::frame::{self, Frame, FrameError, Header, LONGEST_BODY, Receiver, next};
use growbot_core::link::message::{
    Accepted, BoardHello, BootReport, Empty, FaultRecord, HostHello, HostName, LatestFault, LayerBatch, Layers,
    MAX_LAYERS, Message, MessageError, Refusal, Refused, SCHEMA_HASH, SensorReadings, State, Status,
};
use growbot_core::robot::Robot;

pub use self::clock::ClockDrift;
use self::clock::{ClockWatch, Reading};
pub use self::emergency::{EMERGENCY_LIMIT, EMERGENCY_PAUSE};
pub use self::error::ClientError;
use self::patience::{FIRST_REPEAT, MOST_TRIES, REPEAT_OF_PLAN, SILENCE_OF_PLAN, SLOWEST_REPEAT, Wait};
use crate::port::Port;

/// A host that holds the board and is not heard for 10 s has lost it (PROTOCOL.md): it is waited for in so many looks,
const HELD_LOOKS: u32 = 24;
/// with such pauses.
const HELD_LOOK: Duration = Duration::from_millis(500);
/// A board whose host says nothing for 10 s holds: in long waits it is told so often that its host lives.
const SIGN_OF_LIFE: Duration = Duration::from_secs(3);
/// The kind of a refusal.
const REFUSED: u8 = 0x44;
/// Messages with layers that may be on their way at a time: less than what boards can keep before they look at it.
const WINDOW: usize = 8;
/// A board that has just started tests itself for two seconds at most; it is looked at so often,
const MOST_LOOKS_AT_SELF_TEST: u32 = 60;
/// with such pauses.
const SELF_TEST_LOOK: Duration = Duration::from_millis(50);

/// An emergency stop by the link counts as released within 20 ms; it is looked so often whether it is,
const MOST_LOOKS_AT_RELEASE: u32 = 6;
/// with such pauses.
const LOOK_AT_RELEASE: Duration = Duration::from_millis(50);

/// How a board was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// By a request: its body can be resumed.
    ByRequest,
    /// The request was not answered, and the emergency stop was.
    AtOnce,
}

impl Stopped {
    /// In words.
    #[must_use]
    pub fn in_words(self, is_simulated: bool) -> String {
        let kind = if is_simulated { "simulated " } else { "" };
        match self {
            Self::ByRequest => format!("stopped: heater and steppers of the {kind}robot are off"),
            Self::AtOnce => format!(
                "emergency stop, as the request to stop was not answered: heater and steppers of the {kind}robot are off, until it is cleared (`clear` in `growbot console`)"
            ),
        }
    }
}

/// The host's end of the link to one board.
///
/// Dropped, it says goodbye, so that the board knows that it is alone.
pub struct Client {
    port: Box<dyn Port>,
    name: String,
    receiver: Receiver,
    arrived: VecDeque<u8>,
    session: u32,
    /// Whether the board knows the session.
    open: bool,
    /// Number of the latest request.
    seq: u16,
    /// Number of the latest event, and whether the board has been told that it arrived.
    heard: u16,
    acknowledged: bool,
    events: VecDeque<Message>,
    /// Requests that had to be sent again.
    repeated: u64,
    /// Another host that holds the board loses it.
    takes_over: bool,
    clocks: ClockWatch,
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
            open: false,
            seq: 0,
            heard: 0,
            acknowledged: true,
            events: VecDeque::new(),
            repeated: 0,
            takes_over: false,
            clocks: ClockWatch::default(),
        }
    }

    /// Takes the board from another host that holds it, when it opens its session.
    #[must_use]
    pub fn taking_over(mut self, takes_over: bool) -> Self {
        self.takes_over = takes_over;
        self
    }

    /// The port.
    pub fn port(&mut self) -> &mut dyn Port {
        self.port.as_mut()
    }

    /// Requests that had to be sent again, because they or their answers were lost.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Is gone without a goodbye, as a program that is killed.
    pub fn vanish(mut self) {
        self.open = false;
    }

    /// Opens the session: both sides say who they are. A host that has gone without a goodbye is waited for.
    ///
    /// # Errors
    /// A board that is silent, garbled, of another version, or held by another host.
    pub fn hello(&mut self) -> Result<BoardHello, ClientError> {
        let mut silent_before = 0;
        for _ in 0..HELD_LOOKS {
            match self.open_session(self.takes_over) {
                Err(ClientError::Refused { refusal: Refusal::Owned { .. }, .. })
                    if self.board()?.owner == Some(host_name()) =>
                {
                    // It is this program, which the line had lost.
                    return self.open_session(true);
                }
                // As long as it is not heard it may be gone.
                Err(ClientError::Refused { refusal: Refusal::Owned { silent_ms }, .. })
                    if silent_ms >= silent_before =>
                {
                    silent_before = silent_ms;
                    self.pass(HELD_LOOK)?;
                }
                other => return other.or_else(|error| self.told_holder(error)),
            }
        }
        self.open_session(false).or_else(|error| self.told_holder(error))
    }

    fn open_session(&mut self, take_over: bool) -> Result<BoardHello, ClientError> {
        if self.open {
            // Another one: the board may have restarted, or forgotten us.
            self.session = new_session();
            (self.seq, self.heard, self.acknowledged, self.open) = (0, 0, true, false);
            self.events.clear();
        }
        let request = Message::Hello(HostHello { schema: SCHEMA_HASH, host: host_name(), take_over });
        match self.request("hello", &request) {
            Ok(Message::BoardHello(hello)) => {
                self.open = true;
                self.after_self_test(same_schema(hello)?)
            }
            Err(ClientError::Refused { refusal: Refusal::OtherSchema { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            Ok(other) => Err(ClientError::Unexpected { request: "hello", kind: other.kind() }),
            Err(error) => Err(error),
        }
    }

    /// The board is held: by whom.
    fn told_holder(&mut self, error: ClientError) -> Result<BoardHello, ClientError> {
        let ClientError::Refused { refusal: Refusal::Owned { silent_ms }, .. } = error else { return Err(error) };
        let owner = self.board()?.owner.unwrap_or_default();
        Err(ClientError::Held {
            port: self.name.clone(),
            host: String::from_utf8_lossy(&owner).into_owned(),
            silent_s: f64::from(silent_ms) / 1000.0,
        })
    }

    /// Who the board is and what it is doing, without a session: whoever holds the board keeps it.
    ///
    /// # Errors
    /// A board that is silent, garbled or of another version.
    pub fn board(&mut self) -> Result<BoardHello, ClientError> {
        let what = "the question who it is";
        match self.request(what, &Message::AskBoard(Empty {})) {
            Ok(Message::BoardHello(hello)) => self.after_self_test(same_schema(hello)?),
            Ok(other) => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
            Err(ClientError::Refused { refusal: Refusal::OtherSchema { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            // Another release, which does not know the question.
            Err(ClientError::Refused { refusal: Refusal::NotUnderstood, .. }) => {
                Err(ClientError::Unexpected { request: what, kind: REFUSED })
            }
            Err(error) => Err(error),
        }
    }

    /// Waits until a board that has just started has tested itself: until then it takes no job.
    fn after_self_test(&mut self, mut hello: BoardHello) -> Result<BoardHello, ClientError> {
        for _ in 0..MOST_LOOKS_AT_SELF_TEST {
            if hello.status.state != State::SelfTest {
                break;
            }
            self.pass(SELF_TEST_LOOK)?;
            hello.status = self.status()?;
        }
        Ok(hello)
    }

    /// Lets time pass on the robot's clock. Events that come meanwhile are kept.
    ///
    /// # Errors
    /// If the line is gone.
    pub fn pass(&mut self, time: Duration) -> Result<(), ClientError> {
        let step = Duration::from_millis(50);
        for _ in 0..time.as_millis().div_ceil(step.as_millis()) {
            if let Some(Ok(frame)) = self.next_frame(step)? {
                self.take_event(&frame);
            }
        }
        Ok(())
    }

    /// Fails unless the board belongs to this robot.
    ///
    /// # Errors
    /// [`ClientError::OtherRobot`].
    pub fn belongs_to(hello: &BoardHello, robot: &Robot) -> Result<(), ClientError> {
        if hello.robot == robot.hash() {
            return Ok(());
        }
        Err(ClientError::OtherRobot {
            board_name: hello.robot_name.to_string(),
            board: hello.robot,
            host_name: robot.name().to_string(),
            host: robot.hash(),
        })
    }

    /// Opens the session with a board that must belong to this robot.
    ///
    /// # Errors
    /// As [`Client::hello`], or a board of another robot.
    pub fn hello_robot(&mut self, robot: &Robot) -> Result<BoardHello, ClientError> {
        let hello = self.hello()?;
        Self::belongs_to(&hello, robot)?;
        Ok(hello)
    }

    /// What the board is doing.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn status(&mut self) -> Result<Status, ClientError> {
        let what = "for its status";
        let sent = self.port.now();
        match self.request(what, &Message::AskStatus(Empty {}))? {
            Message::Status(status) => {
                if self.port.compares_clocks() {
                    self.clocks.take(&Reading { board_ms: status.uptime_ms, sent, received: self.port.now() });
                }
                Ok(status)
            }
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Stops the board: by a request, after which its body can be resumed, or by the emergency stop where that is not
    /// answered.
    ///
    /// # Errors
    /// A refusal; [`ClientError::NotStopped`]: nobody knows whether it has stopped, and the power must be cut.
    pub fn stop(&mut self) -> Result<Stopped, ClientError> {
        match self.request("to stop", &Message::Stop(Empty {})) {
            Ok(_) => Ok(Stopped::ByRequest),
            Err(error @ ClientError::Refused { .. }) => Err(error),
            Err(_) => self.emergency_stop().map(|()| Stopped::AtOnce),
        }
    }

    /// Leaves a fault or an emergency stop. The board refuses that for some milliseconds after a stop by the link, as
    /// while the button is pressed: it is asked again for a while.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn clear_fault(&mut self) -> Result<(), ClientError> {
        let (what, request) = ("to clear the fault", Message::ClearFault(Empty {}));
        for _ in 0..MOST_LOOKS_AT_RELEASE {
            match self.request(what, &request) {
                Err(ClientError::Refused { refusal: Refusal::EmergencyStop, .. }) => self.pass(LOOK_AT_RELEASE)?,
                done => return done.map(drop),
            }
        }
        self.request(what, &request).map(drop)
    }

    /// Stops a board whose clock has gone from the port's, as the answers to [`Client::status`] tell: by a request, after which its body can
    /// be resumed, or else at once. Gives how far it has; none while the clocks agree, or cannot be compared.
    ///
    /// # Errors
    /// [`ClientError::NotStopped`]: nobody knows whether it has stopped, and the power must be cut.
    pub fn stop_if_clock_drifts(&mut self) -> Result<Option<ClockDrift>, ClientError> {
        let Some(drift) = self.clocks.drift() else { return Ok(None) };
        if self.request("to stop", &Message::Stop(Empty {})).is_err() {
            self.emergency_stop()?;
        }
        // Whoever starts it all the same has it compared again.
        self.clocks = ClockWatch::default();
        Ok(Some(drift))
    }

    /// Whether it is time to ask for the status again for the sake of the clocks.
    #[must_use]
    pub fn wants_clock(&self) -> bool {
        self.port.compares_clocks() && self.clocks.wants(self.port.now())
    }

    /// The same line for the emergency stop of another thread; none where the robot ends with this program. From its first use on, this
    /// client waits for the end of the program.
    pub fn emergency_line(&mut self) -> Option<Box<dyn Port + Send>> {
        self.port.emergency_line()
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

    /// How the board came up: whether its image is sound, and the latest crash.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn boot(&mut self) -> Result<BootReport, ClientError> {
        let what = "how it came up";
        match self.request(what, &Message::AskBoot(Empty {}))? {
            Message::BootReport(report) => Ok(report),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Asks and waits for the answer, repeating the request where none comes. `what` is what errors call it.
    ///
    /// # Errors
    /// No answer, or a refusal.
    pub fn request(&mut self, what: &'static str, request: &Message) -> Result<Message, ClientError> {
        let plans = matches!(request, Message::Plan(_));
        let mut repeat = if plans { REPEAT_OF_PLAN } else { FIRST_REPEAT };
        self.seq = next(self.seq);
        let seq = self.seq;
        let mut wait = Wait::default();
        for attempt in 0..MOST_TRIES {
            self.repeated += u64::from(attempt > 0);
            self.post(seq, request)?;
            if let Some(frame) = self.answer_to(|ack| ack == seq, repeat, &mut wait)? {
                return answer(what, &frame);
            }
            if wait.is_hopeless(if plans { SILENCE_OF_PLAN } else { Duration::ZERO }, self.open) {
                break;
            }
            repeat = (repeat * 5 / 4).min(SLOWEST_REPEAT.max(repeat));
        }
        Err(self.given_up(&wait))
    }

    /// Sends a frame, with what has been heard of the board's events.
    fn post(&mut self, seq: u16, message: &Message) -> Result<(), ClientError> {
        let mut buffer = [0; LONGEST_BODY];
        let too_long = ClientError::Unexpected { request: "a message", kind: message.kind() };
        let Ok(body) = message.encode(&mut buffer) else { return Err(too_long) };
        let header = Header { kind: message.kind(), session: self.session, seq, ack: self.heard };
        let Ok(bytes) = frame::encode(&header, body) else { return Err(too_long) };
        self.acknowledged = true;
        Ok(self.port.send(&bytes)?)
    }

    /// Waits for so long for an answer to one of some requests; takes the events that come meanwhile.
    fn answer_to(
        &mut self,
        is_asked: impl Fn(u16) -> bool,
        patience: Duration,
        wait: &mut Wait,
    ) -> Result<Option<Frame>, ClientError> {
        let step = patience.min(Duration::from_millis(100));
        let mut waited = Duration::ZERO;
        // Frames that arrive take time too, if little: a babbling board must not hold us for ever.
        let passing = Duration::from_millis(2);
        while waited < patience {
            match self.next_frame(step)? {
                None => {
                    waited += step;
                    wait.quiet += step;
                }
                Some(Ok(frame)) => {
                    (wait.quiet, wait.pieces) = (Duration::ZERO, 0);
                    waited += passing;
                    let header = frame.header;
                    if header.session == self.session && header.ack != 0 {
                        if is_asked(header.ack) {
                            return Ok(Some(frame));
                        }
                    } else {
                        self.take_event(&frame);
                    }
                }
                Some(Err(error)) => {
                    waited += passing;
                    wait.quiet += passing;
                    wait.pieces += 1;
                    wait.heard = Some(error);
                }
            }
        }
        Ok(None)
    }

    /// Why nothing more is to be hoped for.
    fn given_up(&self, wait: &Wait) -> ClientError {
        let port = self.name.clone();
        match wait.heard {
            None => ClientError::Silent { port },
            Some(source @ FrameError::Version { .. }) => ClientError::Version { port, source },
            Some(_) => ClientError::Garbage { port },
        }
    }

    /// Hands layers over, several messages at a time, as far as the board has room: the layers of a plan, from `accepted` on. Where
    /// the line garbles much, messages get shorter.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn hand_over(
        &mut self,
        plan_id: u64,
        layers: &[LayerBytes],
        mut accepted: Accepted,
    ) -> Result<Accepted, ClientError> {
        let what = "to take layers";
        // Numbers of the messages on their way.
        let mut flying: VecDeque<u16> = VecDeque::new();
        let (mut sent, mut batch, mut fruitless) = (accepted.next, MAX_LAYERS, 0);
        // The furthest that the board has come: one that accepts the same layers for ever gets nowhere.
        let mut furthest = accepted.next;
        let mut wait = Wait::default();
        loop {
            let end = (layers.len() as u32).min(accepted.next.saturating_add(accepted.room));
            while flying.len() < WINDOW && sent < end {
                let rest = layers.get(sent as usize..end as usize).unwrap_or_default();
                let some: LayerBatch = rest.iter().take(batch).copied().collect();
                let first = sent;
                sent += some.len() as u32;
                self.seq = next(self.seq);
                flying.push_back(self.seq);
                self.post(self.seq, &Message::Layers(Layers { plan_id, first, layers: some }))?;
            }
            if flying.is_empty() {
                return Ok(accepted);
            }
            let answered = self.answer_to(|ack| flying.contains(&ack), SLOWEST_REPEAT, &mut wait)?;
            let Some(frame) = answered else {
                if wait.is_hopeless(Duration::ZERO, self.open) || fruitless >= MOST_TRIES {
                    return Err(self.given_up(&wait));
                }
                (fruitless, batch) = (fruitless + 1, (batch / 2).max(1));
                self.repeated += flying.len() as u64;
                flying.clear();
                sent = accepted.next;
                continue;
            };
            // The board takes requests in the order of their numbers: what was sent before is settled or lost.
            while flying.pop_front().is_some_and(|seq| seq != frame.header.ack) {}
            match answer(what, &frame) {
                Ok(Message::Accepted(now)) => {
                    if now.next > furthest {
                        (fruitless, furthest) = (0, now.next);
                    } else if flying.is_empty() {
                        fruitless += 1;
                    }
                    if fruitless > MOST_TRIES {
                        return Err(ClientError::Unexpected { request: what, kind: frame.header.kind });
                    }
                    accepted = now;
                    sent = sent.max(accepted.next);
                    if flying.is_empty() {
                        sent = accepted.next;
                    }
                }
                // One before it was lost.
                Err(ClientError::Refused { refusal: Refusal::OutOfOrder { expected }, .. }) => {
                    (fruitless, batch) = (fruitless + 1, (batch * 3 / 4).max(1));
                    self.repeated += flying.len() as u64 + 1;
                    flying.clear();
                    accepted.next = expected;
                    sent = expected;
                }
                // Layers that had room when they were sent.
                Err(ClientError::Refused { refusal: Refusal::Full, .. }) => return Ok(accepted),
                Err(error) => return Err(error),
                Ok(other) => return Err(ClientError::Unexpected { request: what, kind: other.kind() }),
            }
        }
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

    /// Takes an event if it is the next one: the board sends those after it again.
    fn take_event(&mut self, frame: &Frame) {
        let Header { session, seq, ack, .. } = frame.header;
        // Somebody has stopped the board at once, this host or another.
        if let (0, 0, 0, Ok(stopped @ Message::StoppedAtOnce(_))) =
            (session, seq, ack, Message::decode(frame.header.kind, &frame.body))
        {
            if !self.events.contains(&stopped) {
                self.events.push_back(stopped);
            }
            return;
        }
        // An answer that came too late, or a frame of another session, is not for us.
        if session != self.session || ack != 0 || seq == 0 {
            return;
        }
        self.acknowledged = false;
        if seq == next(self.heard)
            && let Ok(message) = Message::decode(frame.header.kind, &frame.body)
        {
            self.heard = seq;
            self.events.push_back(message);
        }
    }

    /// The next frame, or why bytes were none; nothing if the line is quiet for as long as the timeout.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Result<Frame, FrameError>>, ClientError> {
        let mut taken = 0;
        // What trickles in without ever being a frame must not hold us for ever.
        while taken < 2 * frame::LONGEST_FRAME {
            if self.arrived.is_empty() {
                if !self.acknowledged {
                    self.post(0, &Message::Ack(Empty {}))?;
                }
                self.receive(timeout)?;
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

impl Client {
    /// Waits for bytes, and tells the board meanwhile that its host lives.
    fn receive(&mut self, timeout: Duration) -> Result<(), ClientError> {
        let mut left = timeout;
        loop {
            let slice = if self.open { left.min(SIGN_OF_LIFE) } else { left };
            let mut buffer = [0; 256];
            let count = self.port.receive(&mut buffer, slice)?;
            self.arrived.extend(&buffer[..count]);
            left = left.saturating_sub(slice);
            if count > 0 || left.is_zero() {
                return Ok(());
            }
            self.post(0, &Message::Ack(Empty {}))?;
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.open {
            self.seq = next(self.seq);
            // Where it is lost, the board finds out after some seconds.
            let _ = self.post(self.seq, &Message::Goodbye(Empty {}));
        }
    }
}

fn same_schema(hello: BoardHello) -> Result<BoardHello, ClientError> {
    if hello.schema == SCHEMA_HASH {
        Ok(hello)
    } else {
        Err(ClientError::Schema { board: hello.schema, host: SCHEMA_HASH })
    }
}

/// Who this host is: what another one is told.
fn host_name() -> HostName {
    let program =
        std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_else(|| "growbot".to_string());
    let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = format!("{program} {} on {}", std::process::id(), machine.trim());
    name.bytes().take(HostName::new().capacity()).collect()
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
