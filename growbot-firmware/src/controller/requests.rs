//! The requests of the host. Every request gets a response. A refused request changes nothing.
//!
//! A host may repeat a request, because its response may be lost. Each request names what it concerns (a plan, an
//! index), so that a repetition is recognised and gets the same response as the first time.

use growbot_core::job::job_layers_with_keep_alive;
use growbot_core::link::frame::{FrameHeader, LinkFrame};
use growbot_core::link::message::{
    Accepted, BoardInfo, BootReport, Fault, Hello, LatestFault, LayerBatch, MAX_LAYERS_PER_MESSAGE, Message,
    PauseCause, PlanRequest, Planned, Refusal, RefusalResponse, SCHEMA_HASH, State, StoredLayers, Tune,
};
use growbot_core::plan::plan_with_keep_alive;
use growbot_core::pose::Pose;
use heapless::String;

use super::{BootInfo, Controller, centi};
use crate::hal::{Board, Watchdog};
use crate::layer_store::CAPACITY;
use crate::link::FrameAction;
use crate::safety::transitions::{Event, next_state};
use crate::stepping::Mailbox;

/// Message kind of a stop request. The board carries out a stop whatever the body of the message contains.
const STOP: u8 = 0x06;
/// Min target temperature of tuning and of preheating, degrees Celsius. A nozzle that is colder than this needs no
/// tuning.
const MIN_TUNING_C: f64 = 50.0;
/// Min distance of the target below the robot's max temperature while tuning, degrees, because the nozzle's temperature
/// swings. In `heater::tests::regulating` the nozzle temperature swings by 15 C at most.
const TUNING_MARGIN_C: f64 = 20.0;

impl<B: Board> Controller<B> {
    /// Carries out a request of the host and sends the response.
    pub(super) fn handle_frame(&mut self, frame: &LinkFrame, handover: &Mailbox) {
        let header = frame.header;
        let arrival = self.link.process_header(&header, self.now_us);
        if arrival == FrameAction::Ignore {
            return;
        }
        let answer = match Message::decode_request(header.kind, &frame.body) {
            _ if header.kind == STOP => Ok(self.stop(handover)),
            Ok(Message::Ack(_)) => return,
            Ok(Message::Goodbye(_)) if arrival == FrameAction::Handle => return self.link.close(),
            Ok(message) => self.dispatch(message, &header, arrival, handover),
            Err(_) => Err(Refusal::UnknownRequest),
        };
        let answer = answer.unwrap_or_else(|refusal| Message::Refused(RefusalResponse { kind: header.kind, refusal }));
        self.link.respond(&header, answer);
    }

    fn dispatch(
        &mut self,
        request: Message,
        header: &FrameHeader,
        arrival: FrameAction,
        handover: &Mailbox,
    ) -> Result<Message, Refusal> {
        // These requests need no session.
        match request {
            Message::Hello(hello) => return self.hello(hello, header),
            Message::GetBoardInfo(_) => return Ok(self.board_hello()),
            Message::GetStatus(_) => return Ok(Message::Status(self.status())),
            Message::GetLatestFault(_) => {
                return Ok(Message::LatestFault(LatestFault { record: self.retained.record }));
            }
            Message::GetBootReport(_) => {
                let BootInfo { image, crash, .. } = self.identity;
                return Ok(Message::BootReport(BootReport { image, crash }));
            }
            Message::GetSensorReadings(_) => return Ok(Message::SensorReadings(self.readings)),
            _ => {}
        }
        if arrival != FrameAction::Handle {
            return Err(Refusal::NoSession);
        }
        match request {
            Message::Configure(part) => return self.configure(&part),
            // The session ends with the restart.
            _ if self.configuring.is_restart_pending() => return Err(Refusal::NoSession),
            _ if !self.identity.configured => return Err(Refusal::NotConfigured),
            _ => {}
        }
        match request {
            Message::BeginJob(begin) => self.begin(&begin),
            Message::Resume(resume) => self.resume(&resume),
            Message::AppendLayers(layers) => self.store_layers(&layers),
            Message::Amend(amend) => self.amend(&amend),
            Message::Start(start) => self.start(&start),
            Message::Pause(_) => self.pause(),
            Message::Cancel(cancel) => self.cancel(&cancel, handover),
            Message::Tune(tune) => self.tune(&tune),
            Message::Maintain(maintain) => self.maintain(maintain.task, handover),
            Message::ClearFault(_) => self.clear_fault(handover),
            Message::Plan(request) => self.plan_on_board(&request),
            Message::ReadLayers(read) => Ok(self.read_layers(read.first)),
            _ => Err(Refusal::UnknownRequest),
        }
    }

    fn hello(&mut self, hello: Hello, header: &FrameHeader) -> Result<Message, Refusal> {
        if hello.schema != SCHEMA_HASH {
            return Err(Refusal::SchemaMismatch { board: SCHEMA_HASH });
        }
        // A closed session stays closed. This frame is a delayed one.
        if header.session == 0 || self.link.is_closed(header.session) {
            return Err(Refusal::NoSession);
        }
        if !self.link.is_open(header.session) {
            if let Some((_, silent)) = self.link.owner(self.now_us).filter(|_| !hello.take_over) {
                return Err(Refusal::OwnedByOtherHost { silent_ms: (silent / 1000) as u32 });
            }
            self.link.open(header, hello.host, self.now_us);
            self.job.layers_reported = self.job.layers_laid;
        }
        Ok(self.board_hello())
    }

    fn board_hello(&self) -> Message {
        let configured = self.identity.configured;
        Message::BoardInfo(BoardInfo {
            schema_hash: SCHEMA_HASH,
            boot_id: self.identity.boot_id,
            reset_cause: self.identity.reset_cause,
            firmware: FIRMWARE,
            robot_name: if configured { self.robot.description().name.clone() } else { String::new() },
            robot_hash: if configured { self.robot.hash() } else { 0 },
            layer_capacity: CAPACITY as u32,
            status: self.status(),
            owner: self.link.owner(self.now_us).map(|(host, _)| host.clone()),
        })
    }

    pub(super) fn accepted(&self) -> Message {
        let store = self.store();
        Message::Accepted(Accepted { plan_id: self.job.plan_id, next: store.next_index(), free_layers: store.room() })
    }

    fn stop(&mut self, handover: &Mailbox) -> Message {
        self.abort_layer(handover);
        self.apply_event(Event::Stop);
        self.accepted()
    }

    /// Refuses an event that the current state does not allow.
    pub(super) fn check_event(&self, event: Event) -> Result<(), Refusal> {
        match next_state(self.state, event) {
            Some(_) => Ok(()),
            None => Err(Refusal::WrongState { state: self.state }),
        }
    }

    fn pause(&mut self) -> Result<Message, Refusal> {
        self.check_event(Event::Pause)?;
        if self.pause_cause() != PauseCause::FilamentOut {
            self.set_pause(Some(PauseCause::Requested));
        }
        Ok(self.accepted())
    }

    fn tune(&mut self, tune: &Tune) -> Result<Message, Refusal> {
        self.check_event(Event::Tune)?;
        let target = f64::from(tune.target_centi_c) / 100.0;
        let max = self.robot.description().heater.max_c - TUNING_MARGIN_C;
        if !(MIN_TUNING_C..=max).contains(&target) {
            return Err(Refusal::TemperatureOutOfRange { min: centi(MIN_TUNING_C), max: centi(max) });
        }
        if self.may_be_halted() {
            return Err(Refusal::DebugProbe);
        }
        self.heater.tune(target, self.now_us);
        self.apply_event(Event::Tune);
        Ok(self.accepted())
    }

    /// Leaves `Fault` or `EmergencyStop` if no remaining cause is detectable at rest. A cause that is not detectable at
    /// rest will be found again during operation.
    fn clear_fault(&mut self, handover: &Mailbox) -> Result<Message, Refusal> {
        self.check_event(Event::Clear)?;
        match self.state {
            State::EmergencyStop if handover.is_emergency_stopped() => return Err(Refusal::EmergencyStop),
            State::Fault | State::EmergencyStop => {}
            // The robot has no fault to clear.
            _ => return Ok(self.accepted()),
        }
        if let Some(fault) = self.fault.filter(|fault| self.is_cause_present(*fault)) {
            return Err(Refusal::FaultRemains { fault });
        }
        self.fault = None;
        if let Some(record) = &mut self.retained.record {
            record.cleared = true;
        }
        self.apply_event(Event::Clear);
        Ok(self.accepted())
    }

    /// Returns whether the cause of a fault is known to remain.
    fn is_cause_present(&self, fault: Fault) -> bool {
        let description = self.robot.description();
        let temperature = self.heater.temperature(self.now_us);
        // If a newer description has no such sensor, the cause cannot be checked.
        let measured = description.sensors.supply;
        let volts = self.readings.supply_mv.map(|millivolts| f64::from(millivolts) / 1000.0);
        match fault {
            Fault::OverTemperature => temperature.is_none_or(|temperature| temperature > description.heater.max_c),
            Fault::ThermistorOpen | Fault::ThermistorShort | Fault::ThermistorSilent => temperature.is_none(),
            Fault::FilamentOut => self.readings.filament_present == Some(false),
            Fault::DriverFault => self.readings.driver_fault == Some(true),
            Fault::SupplyLow => measured && volts.is_none_or(|volts| volts < description.supply.min_v),
            Fault::SupplyHigh => measured && volts.is_none_or(|volts| volts > description.supply.max_v),
            Fault::ImageCorrupt => self.identity.is_corrupt(),
            Fault::ClockFailed => self.identity.crystal_failed,
            Fault::DebugProbe => self.may_be_halted(),
            _ => false,
        }
    }

    /// Plans a growth on the board and stores its layers as a new job. The board plans with the same code as the host,
    /// so that the layers are the same, bit for bit.
    fn plan_on_board(&mut self, request: &PlanRequest) -> Result<Message, Refusal> {
        self.check_event(Event::Plan)?;
        let start = Pose::try_from(request.start).map_err(|_| Refusal::PlanningFailed)?;
        let goal = Pose::try_from(request.goal).map_err(|_| Refusal::PlanningFailed)?;
        // A near goal takes some ten seconds, or up to a minute. The heater is off, so only the watchdog needs the
        // controller in this time. The keep-alive callback feeds it.
        let robot = self.robot.clone();
        let watchdog = &mut self.parts.watchdog;
        let path =
            plan_with_keep_alive(&robot, &start, &goal, request.radius, request.planner, &mut || watchdog.feed())
                .map_err(|_| Refusal::PlanningFailed)?
                .path;
        let layers = job_layers_with_keep_alive(&path, &robot, &mut || watchdog.feed());
        let count = layers.size_hint().0;
        if count > CAPACITY {
            let layers = u32::try_from(count).unwrap_or(u32::MAX);
            return Err(Refusal::PlanTooLong { layers, capacity: CAPACITY as u32 });
        }
        let summary = layers.summary_with_keep_alive(&mut || watchdog.feed());
        // A curve with a radius below the robot's planning radius may need steps that its motors cannot make.
        for (index, bytes) in (0..).zip(layers.clone()) {
            self.parts.watchdog.feed();
            self.check_layer(index, &bytes)?;
        }
        self.new_job(summary.plan_id, summary.layers)?;
        self.apply_event(Event::Plan);
        for bytes in layers {
            self.parts.watchdog.feed();
            self.store_layer(bytes)?;
        }
        Ok(Message::Planned(Planned {
            plan_id: summary.plan_id,
            exact_hash: summary.exact_hash,
            layers: summary.layers,
            length: growbot_core::path::length(&path),
        }))
    }

    fn read_layers(&self, first: u32) -> Message {
        let end = first.saturating_add(MAX_LAYERS_PER_MESSAGE as u32);
        let mut layers = LayerBatch::new();
        for layer in (first..end).map_while(|index| self.store().get(index)) {
            // The vector is not full, because the range has at most the length of a batch.
            let _ = layers.push(layer);
        }
        Message::StoredLayers(StoredLayers { first, layers })
    }
}

/// Major, minor and patch version of this firmware, from the package.
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
