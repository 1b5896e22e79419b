//! A board in memory, with a line that a test can cut, for tests of a robot's thread. The board carries out requests at
//! once and lays no layers, so nothing in it takes time. It records each request that makes it heat without a valid
//! order.

use std::collections::VecDeque;
use std::io;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use growbot_client::port::{Port, PortError};
use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, LinkFrame, MAX_BODY_LEN};
use growbot_core::link::message::{
    Accepted, BoardInfo, Empty, Fault, LayerBatch, MaintenanceTask, Message, PauseCause, Refusal, RefusalResponse,
    ResetCause, SCHEMA_HASH, State, Status, StoredLayers,
};
use growbot_core::robot::Robot;
use growbot_sim::port::{OpenError, OpenPort};

use super::connector::Connector;

/// Number of layers that the board can store.
const CAPACITY: u32 = 4096;
/// Real time that [`Port::receive`] waits if there are no bytes. The timeout passes on the port's own clock only.
const WAIT: Duration = Duration::from_micros(500);

/// State of the line to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineState {
    /// Bytes pass in both directions.
    Up,
    /// The port cannot be opened, and an open port reports an error.
    Missing,
    /// The port can be opened, but the board neither receives nor sends anything.
    Silent,
}

/// A simulated board in memory, as tests set and read its state.
pub struct FakeBoard {
    robot: Robot,
    pub line: LineState,
    pub state: State,
    pub pause: PauseCause,
    pub plan_id: u64,
    layers: u32,
    /// Number of layers that are laid according to the board's status. The board does not send these layers to the
    /// host.
    pub laid: u32,
    /// True if the board belongs to another robot.
    pub is_of_other_robot: bool,
    /// True if the board does not respond to a request to stop. It executes an emergency stop nevertheless.
    pub ignores_stop: bool,
    next: u32,
    boots: u32,
    session: u32,
    uptime_ms: u64,
    /// True while the last command of a person allows the board to heat.
    pub may_heat: bool,
    /// Requests that made the board heat without a valid command of a person.
    pub violations: Vec<String>,
    receiver: FrameDecoder,
    detector: EmergencyStopDetector,
    sent: VecDeque<u8>,
    /// Number of frames that the board has received.
    pub frames: u32,
}

impl FakeBoard {
    pub fn new(robot: Robot) -> Self {
        Self {
            robot,
            line: LineState::Up,
            state: State::Idle,
            pause: PauseCause::LayersExhausted,
            plan_id: 0,
            layers: 0,
            laid: 0,
            is_of_other_robot: false,
            ignores_stop: false,
            next: 0,
            boots: 1,
            session: 0,
            uptime_ms: 10_000,
            may_heat: false,
            violations: Vec::new(),
            receiver: FrameDecoder::default(),
            detector: EmergencyStopDetector::new(),
            sent: VecDeque::new(),
            frames: 0,
        }
    }

    /// Returns true if the heater may be on in the board's state.
    pub fn is_hot(&self) -> bool {
        matches!(
            self.state,
            State::Heating | State::Homing | State::Growing | State::Paused | State::Maintenance | State::Tuning
        )
    }

    /// Restarts the board, as a short loss of power does. The board keeps its job.
    pub fn lose_power(&mut self) {
        self.boots += 1;
        (self.session, self.uptime_ms, self.state) = (0, 10_000, State::Idle);
    }

    fn status(&self) -> Status {
        Status {
            state: self.state,
            fault: (self.state == State::Fault).then_some(Fault::TemperatureDrop),
            temperature_centi_c: Some(2_500),
            target_centi_c: self.is_hot().then_some(20_000),
            duty: 0,
            plan_id: self.plan_id,
            layer_count: self.layers,
            next_layer: self.next,
            layers_laid: self.laid,
            interrupted: None,
            pause_cause: self.pause,
            is_resumable: self.plan_id != 0,
            uptime_ms: self.uptime_ms,
        }
    }

    fn info(&self) -> Message {
        Message::BoardInfo(BoardInfo {
            schema_hash: SCHEMA_HASH,
            boot_id: self.boots,
            reset_cause: ResetCause::PowerOn,
            firmware: [0, 1, 0],
            robot_name: self.robot.description().name.clone(),
            robot_hash: self.robot.hash() ^ u64::from(self.is_of_other_robot),
            layer_capacity: CAPACITY,
            status: self.status(),
            owner: None,
        })
    }

    fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if self.detector.push(*byte) {
                self.state = State::EmergencyStop;
                let header = FrameHeader { kind: 0x53, session: 0, seq: 0, ack: 0 };
                self.transmit(&header, &Message::EmergencyStopAck(Empty {}));
            }
            if let Some(Ok(frame)) = self.receiver.push(*byte) {
                self.handle(&frame);
            }
        }
    }

    fn handle(&mut self, frame: &LinkFrame) {
        self.uptime_ms += 1;
        self.frames += 1;
        let request = Message::decode_request(frame.header.kind, &frame.body).unwrap();
        let answer = match request {
            Message::Ack(_) | Message::Goodbye(_) => return,
            Message::Hello(_) => {
                self.session = frame.header.session;
                Ok(self.info())
            }
            Message::GetBoardInfo(_) => Ok(self.info()),
            Message::GetStatus(_) => Ok(Message::Status(self.status())),
            Message::Stop(_) if self.ignores_stop => return,
            Message::Stop(_) => {
                if !matches!(self.state, State::Fault | State::EmergencyStop) {
                    self.state = State::Stopped;
                }
                Ok(self.accepted())
            }
            _ if frame.header.session != self.session => Err(Refusal::NoSession),
            request => self.carry_out(request),
        };
        let answer =
            answer.unwrap_or_else(|refusal| Message::Refused(RefusalResponse { kind: frame.header.kind, refusal }));
        let header = FrameHeader { kind: answer.kind(), session: frame.header.session, seq: 0, ack: frame.header.seq };
        self.transmit(&header, &answer);
    }

    fn carry_out(&mut self, request: Message) -> Result<Message, Refusal> {
        let refusal = Refusal::WrongState { state: self.state };
        match (request, self.state) {
            (Message::BeginJob(begin), State::Idle | State::Done | State::Stopped) => {
                (self.plan_id, self.layers, self.next, self.state) = (begin.plan_id, begin.layers, 0, State::Idle);
            }
            (Message::AppendLayers(layers), _) if layers.first == self.next => {
                self.next += layers.layers.len() as u32;
            }
            (Message::ReadLayers(read), _) => {
                return Ok(Message::StoredLayers(StoredLayers { first: read.first, layers: LayerBatch::new() }));
            }
            (Message::AppendLayers(_), _) => return Err(Refusal::OutOfOrder { expected: self.next }),
            (Message::Resume(resume), _) if resume.plan_id != self.plan_id => {
                return Err(Refusal::PlanMismatch { board: self.plan_id });
            }
            (Message::Resume(_), State::Stopped) => self.state = State::Idle,
            (Message::Resume(_), State::Fault | State::EmergencyStop) => return Err(refusal),
            (Message::Resume(_), _) => {}
            (Message::Start(start), state) if start.is_continuation && !self.pause.allows_continuation(state) => {
                return Err(refusal);
            }
            (
                Message::Start(_),
                State::Idle | State::Parked | State::Heating | State::Homing | State::Growing | State::Paused,
            ) if self.plan_id != 0 => {
                self.heat("start");
                (self.state, self.pause) = (State::Growing, PauseCause::LayersExhausted);
            }
            (Message::Start(_), State::Done) => {}
            (Message::Pause(_), State::Growing | State::Paused) => {
                (self.state, self.pause) = (State::Paused, PauseCause::Requested);
            }
            (Message::Pause(_), State::Parked) => {}
            (Message::Cancel(_), State::Fault | State::EmergencyStop) => self.plan_id = 0,
            (Message::Cancel(_), _) => (self.plan_id, self.state) = (0, State::Idle),
            (Message::ClearFault(_), State::Fault | State::EmergencyStop) => self.state = State::Idle,
            (Message::ClearFault(_), _) => {}
            (Message::Maintain(maintain), State::Idle | State::Done | State::Stopped | State::Maintenance) => {
                if maintain.task == MaintenanceTask::CoolDown {
                    self.state = State::Idle;
                } else {
                    self.heat("maintain");
                    self.state = State::Maintenance;
                }
            }
            (Message::Tune(_), State::Idle | State::Done | State::Stopped) => {
                self.heat("tune");
                self.state = State::Tuning;
            }
            _ => return Err(refusal),
        }
        Ok(self.accepted())
    }

    fn heat(&mut self, request: &str) {
        if !self.may_heat {
            self.violations.push(format!("{request} in {}", self.state.name()));
        }
    }

    fn accepted(&self) -> Message {
        Message::Accepted(Accepted { plan_id: self.plan_id, next: self.next, free_layers: CAPACITY - self.next })
    }

    fn transmit(&mut self, header: &FrameHeader, message: &Message) {
        let mut buffer = [0; MAX_BODY_LEN];
        let body = message.encode(&mut buffer).unwrap();
        self.sent.extend(frame::encode(header, body).unwrap());
    }
}

/// A line from one service to a [`FakeBoard`], with switches that end the service or the robot's thread.
#[derive(Clone)]
pub struct FakeLine {
    board: Arc<Mutex<FakeBoard>>,
    /// True once the service that uses this board has been killed.
    is_killed: Arc<AtomicBool>,
    /// True if the robot's thread must panic at its next use of the line.
    thread_ends: Arc<AtomicBool>,
    /// True once the robot's thread has panicked.
    thread_ended: Arc<AtomicBool>,
    /// Number of times that the robot's thread has waited for bytes.
    waits: Arc<AtomicU32>,
}

impl FakeLine {
    pub fn new(robot: Robot) -> Self {
        Self {
            board: Arc::new(Mutex::new(FakeBoard::new(robot))),
            is_killed: Arc::default(),
            thread_ends: Arc::default(),
            thread_ended: Arc::default(),
            waits: Arc::default(),
        }
    }

    /// Returns a line to the same board for another service.
    pub fn for_next_service(&self) -> Self {
        Self {
            board: Arc::clone(&self.board),
            is_killed: Arc::default(),
            thread_ends: Arc::default(),
            thread_ended: Arc::default(),
            waits: Arc::default(),
        }
    }

    pub fn board(&self) -> MutexGuard<'_, FakeBoard> {
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the service that uses this line as if it were killed: the robot's thread panics at its next use of the
    /// line, without a goodbye to the board.
    pub fn kill_service(&self) {
        self.is_killed.store(true, Ordering::SeqCst);
    }

    /// Lets the robot's thread panic at its next use of the line. The rest of the service continues to run.
    pub fn end_thread(&self) {
        self.thread_ends.store(true, Ordering::SeqCst);
    }

    /// Returns the number of times that the robot's thread has waited for bytes.
    pub fn waits(&self) -> u32 {
        self.waits.load(Ordering::SeqCst)
    }

    /// Returns true until the robot's thread has panicked.
    pub fn has_thread(&self) -> bool {
        !self.thread_ended.load(Ordering::SeqCst)
    }

    fn lost() -> PortError {
        PortError::Lost("fake".to_owned(), io::Error::other("cut"))
    }
}

/// An open port at the service's end of the line.
struct FakePort {
    line: FakeLine,
    /// True if this end of the line belongs to the thread of the emergency stop.
    is_for_emergency: bool,
    now: Duration,
}

impl FakePort {
    /// Returns the board, or `None` if the line is silent. Panics if the robot's thread or the service has to end.
    fn reach(&self) -> Result<Option<MutexGuard<'_, FakeBoard>>, PortError> {
        if self.line.thread_ends.load(Ordering::SeqCst) && !self.is_for_emergency && !std::thread::panicking() {
            self.line.thread_ended.store(true, Ordering::SeqCst);
            resume_unwind(Box::new("the thread ends"));
        }
        if self.line.is_killed.load(Ordering::SeqCst) {
            if !self.is_for_emergency && !std::thread::panicking() {
                resume_unwind(Box::new("the service was killed"));
            }
            return Err(FakeLine::lost());
        }
        let board = self.line.board();
        match board.line {
            LineState::Up => Ok(Some(board)),
            LineState::Silent => Ok(None),
            LineState::Missing => Err(FakeLine::lost()),
        }
    }
}

impl Port for FakePort {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        if let Some(mut board) = self.reach()? {
            board.receive(bytes);
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let count = match self.reach()? {
            Some(mut board) => {
                let count = buffer.len().min(board.sent.len());
                for (slot, byte) in buffer.iter_mut().zip(board.sent.drain(..count)) {
                    *slot = byte;
                }
                count
            }
            None => 0,
        };
        if !self.is_for_emergency {
            self.line.waits.fetch_add(1, Ordering::SeqCst);
        }
        if count == 0 {
            self.now += timeout;
            sleep(WAIT);
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn has_comparable_clock(&self) -> bool {
        false
    }

    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        Some(Box::new(Self { line: self.line.clone(), is_for_emergency: true, now: Duration::ZERO }))
    }
}

impl Connector for FakeLine {
    fn open(&self, _: &Robot) -> Result<OpenPort, OpenError> {
        let port = FakePort { line: self.clone(), is_for_emergency: false, now: Duration::ZERO };
        if self.is_killed.load(Ordering::SeqCst) {
            resume_unwind(Box::new("the service was killed"));
        }
        let mut board = self.board();
        // A new connection does not receive what was sent to an earlier one.
        board.sent.clear();
        match board.line {
            LineState::Missing => {
                let error = io::Error::from(io::ErrorKind::NotFound);
                Err(PortError::Missing("fake".to_owned(), format!(" ({error})")).into())
            }
            LineState::Up | LineState::Silent => Ok(OpenPort { port: Box::new(port), simulated_tip: None }),
        }
    }

    fn open_for_emergency_stop(&self, _: Duration) -> Result<Box<dyn Port>, OpenError> {
        match self.board().line {
            LineState::Missing => Err(FakeLine::lost().into()),
            LineState::Up | LineState::Silent => {
                Ok(Box::new(FakePort { line: self.clone(), is_for_emergency: true, now: Duration::ZERO }))
            }
        }
    }

    fn reconnect_interval(&self) -> Duration {
        Duration::from_millis(5)
    }

    fn emergency_limit(&self) -> Duration {
        Duration::from_millis(10)
    }
}
