//! What the host asks for: every request is answered, and one that is refused changes nothing.
//!
//! Requests may be repeated, since an answer may be lost: each says what it is about (a plan, an index), so that doing it
//! a second time is recognised and answered like the first.

use growbot_core::job::job_layers_meanwhile;
use growbot_core::link::frame::Frame;
use growbot_core::link::message::{
    Accepted, Begin, BoardHello, Fault, HeldLayers, HostHello, LayerBatch, Layers, MOST_LAYERS, Message, PlanRequest,
    Planned, Refusal, Refused, SCHEMA_HASH, Start, State,
};
use growbot_core::plan::plan_meanwhile;
use growbot_core::pose::Pose;

use super::{Controller, Job};
use crate::hal::{Board, Watchdog};
use crate::layer_store::CAPACITY;
use crate::stepping::Handover;

impl<B: Board> Controller<B> {
    /// Carries out a request and answers it.
    pub(super) fn serve(&mut self, frame: &Frame, handover: &Handover) {
        let header = frame.header;
        let answer = match Message::decode(header.kind, &frame.body) {
            Ok(message) => self.carry_out(message, header.session, handover),
            Err(_) => Err(Refusal::NotUnderstood),
        };
        let answer = answer.unwrap_or_else(|refusal| Message::Refused(Refused { kind: header.kind, refusal }));
        self.link.answer(&header, &answer);
    }

    fn carry_out(&mut self, request: Message, session: u32, handover: &Handover) -> Result<Message, Refusal> {
        // These three are answered whoever asks.
        match request {
            Message::Hello(hello) => return self.hello(&hello, session),
            Message::AskStatus(_) => return Ok(Message::Status(self.status())),
            Message::Stop(_) => return Ok(self.stop(handover)),
            _ => {}
        }
        if !self.link.is_open(session) {
            return Err(Refusal::NoSession);
        }
        match request {
            Message::Begin(begin) => self.begin(&begin),
            Message::Layers(layers) => self.hold_layers(&layers),
            Message::Start(start) => self.start(&start),
            Message::ClearFault(_) => self.clear_fault(),
            Message::Plan(request) => self.plan_by_itself(&request),
            Message::ReadLayers(read) => Ok(self.read_layers(read.first)),
            _ => Err(Refusal::NotUnderstood),
        }
    }

    fn hello(&mut self, hello: &HostHello, session: u32) -> Result<Message, Refusal> {
        if hello.schema != SCHEMA_HASH {
            return Err(Refusal::OtherSchema { board: SCHEMA_HASH });
        }
        if !self.link.is_open(session) {
            self.link.open(session);
            // What happened before is told by the status below.
            self.events.clear();
        }
        Ok(Message::BoardHello(BoardHello {
            schema: SCHEMA_HASH,
            boot_id: self.identity.boot_id,
            reset_cause: self.identity.reset_cause,
            firmware: FIRMWARE,
            robot_name: self.robot.description().name.clone(),
            robot: self.robot.hash(),
            capacity: CAPACITY as u32,
            status: self.status(),
        }))
    }

    fn accepted(&self) -> Message {
        let store = self.store();
        Message::Accepted(Accepted { plan_id: self.job.plan_id, next: store.next_index(), room: store.room() })
    }

    fn stop(&mut self, handover: &Handover) -> Message {
        self.switch_off(handover);
        if self.state != State::Fault {
            self.enter(State::Stopped);
        }
        self.accepted()
    }

    fn begin(&mut self, begin: &Begin) -> Result<Message, Refusal> {
        if begin.robot != self.robot.hash() {
            return Err(Refusal::OtherRobot { board: self.robot.hash() });
        }
        if begin.plan_id == 0 {
            return Err(Refusal::NotUnderstood);
        }
        let repeated = (begin.plan_id, begin.layers) == (self.job.plan_id, self.job.layers);
        // After an end it is the wish for another growth of the same plan.
        if repeated && !matches!(self.state, State::Done | State::Stopped | State::Fault) {
            return Ok(self.accepted());
        }
        self.only_at_rest()?;
        self.set_job(begin.plan_id, begin.layers);
        Ok(self.accepted())
    }

    /// Forgets the job before and holds another.
    fn set_job(&mut self, plan_id: u64, layers: u32) {
        self.store_mut().clear();
        self.job = Job { plan_id, layers, ..Job::default() };
        self.enter(State::Idle);
    }

    fn only_at_rest(&self) -> Result<(), Refusal> {
        match self.state {
            State::Idle | State::Done | State::Stopped => Ok(()),
            state => Err(Refusal::WrongState { state }),
        }
    }

    fn this_plan(&self, plan_id: u64) -> Result<(), Refusal> {
        if plan_id == 0 || plan_id != self.job.plan_id {
            return Err(Refusal::OtherPlan { board: self.job.plan_id });
        }
        Ok(())
    }

    fn hold_layers(&mut self, batch: &Layers) -> Result<Message, Refusal> {
        self.this_plan(batch.plan_id)?;
        if matches!(self.state, State::Stopped | State::Fault) {
            return Err(Refusal::WrongState { state: self.state });
        }
        let expected = self.store().next_index();
        if batch.first > expected {
            return Err(Refusal::OutOfOrder { expected });
        }
        let already_held = (expected - batch.first) as usize;
        let new = batch.layers.get(already_held..).unwrap_or_default();
        // All are checked before any is taken: a batch is held as a whole or not at all.
        for (index, bytes) in (expected..self.job.layers).zip(new) {
            self.check_layer(index, bytes)?;
        }
        if new.len() > self.job.layers.saturating_sub(expected) as usize {
            return Err(Refusal::BadLayer { index: self.job.layers });
        }
        if new.len() > self.store().room() as usize {
            return Err(Refusal::Full);
        }
        for bytes in new {
            self.hold_layer(*bytes)?;
        }
        Ok(self.accepted())
    }

    fn start(&mut self, start: &Start) -> Result<Message, Refusal> {
        self.this_plan(start.plan_id)?;
        match self.state {
            State::Idle if self.job.layers > 0 => {
                self.heater.switch_on(self.robot.description().heater.target_c, self.now);
                self.enter(State::Heating);
                Ok(self.accepted())
            }
            // A body of no length is grown at once.
            State::Idle => {
                self.enter(State::Done);
                Ok(self.accepted())
            }
            // Repeated.
            State::Heating | State::Homing | State::Growing | State::Hold | State::Done => Ok(self.accepted()),
            state => Err(Refusal::WrongState { state }),
        }
    }

    /// Leaves `Fault` if nothing that can be seen at rest is still wrong; what cannot be seen will show again.
    fn clear_fault(&mut self) -> Result<Message, Refusal> {
        let Some(fault) = self.fault else { return Ok(self.accepted()) };
        let remains = match fault {
            Fault::OverTemperature => {
                let limit = self.robot.description().heater.max_c;
                self.heater.temperature(self.now).is_none_or(|temperature| temperature > limit)
            }
            Fault::ThermistorOpen | Fault::ThermistorShort | Fault::ThermistorSilent => {
                self.heater.temperature(self.now).is_none()
            }
            _ => false,
        };
        if remains {
            return Err(Refusal::FaultRemains { fault });
        }
        self.fault = None;
        self.set_job(0, 0);
        Ok(self.accepted())
    }

    /// Plans on the board: the same code as on the host, so the same layers, bit for bit.
    fn plan_by_itself(&mut self, request: &PlanRequest) -> Result<Message, Refusal> {
        self.only_at_rest()?;
        let start = Pose::try_from(request.start).map_err(|_| Refusal::NoPlan)?;
        let goal = Pose::try_from(request.goal).map_err(|_| Refusal::NoPlan)?;
        // A near goal takes a second or two. The heater is off, so nothing needs the controller meanwhile but the watchdog.
        let robot = self.robot.clone();
        let watchdog = &mut self.parts.watchdog;
        let path = plan_meanwhile(&robot, &start, &goal, request.radius, request.planner, &mut || watchdog.feed())
            .map_err(|_| Refusal::NoPlan)?
            .path;
        let layers = job_layers_meanwhile(&path, &robot, &mut || watchdog.feed());
        let count = layers.size_hint().0;
        if count > CAPACITY {
            let layers = u32::try_from(count).unwrap_or(u32::MAX);
            return Err(Refusal::PlanTooLong { layers, capacity: CAPACITY as u32 });
        }
        let summary = layers.summary_meanwhile(&mut || watchdog.feed());
        // A radius below the robot's planning radius may ask for steps that its motors do not make.
        for (index, bytes) in (0..).zip(layers.clone()) {
            self.parts.watchdog.feed();
            self.check_layer(index, &bytes)?;
        }
        self.set_job(summary.plan_id, summary.layers);
        for bytes in layers {
            self.parts.watchdog.feed();
            self.hold_layer(bytes)?;
        }
        Ok(Message::Planned(Planned {
            plan_id: summary.plan_id,
            exact_hash: summary.exact_hash,
            layers: summary.layers,
            length: growbot_core::path::length(&path),
        }))
    }

    fn read_layers(&self, first: u32) -> Message {
        let end = first.saturating_add(MOST_LAYERS as u32);
        let mut layers = LayerBatch::new();
        for layer in (first..end).map_while(|index| self.store().get(index)) {
            // There is room: the range is no longer than a batch.
            let _ = layers.push(layer);
        }
        Message::HeldLayers(HeldLayers { first, layers })
    }
}

/// Major, minor and patch of this firmware, from the package.
const FIRMWARE: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn number(text: &str) -> u8 {
    match u8::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => 255,
    }
}
