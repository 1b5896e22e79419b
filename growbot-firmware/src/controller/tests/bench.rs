//! Test bench: the controller, its step engine and a simulated tip in lock step, and a host at the other end of the
//! link.
//!
//! Conditions that must always hold are asserted in [`Bench::check`], after each poll and each tick.

use std::boxed::Box;
use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, MAX_BODY_LEN, next_seq};
use growbot_core::link::message::{
    Accepted, Empty, Fault, LayerLaid, MAX_LAYERS_PER_MESSAGE, Message, Refusal, RefusalResponse, ResetCause,
    SCHEMA_HASH, State, Status,
};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;

use super::requests::{PLAN, batch_of, begin, bends, feed, feed_steps_of, hello, preheat, start, stop, tune};
use super::tip::{
    DRIVER_FAULT, EMERGENCY_STOP, FEED, FILAMENT_MOTION, FILAMENT_PRESENCE, FakeDebugPort, FakeDrivers,
    FakeOrientation, FakeOutputs, FakeRetained, FakeSupply, FakeThermistor, FakeWatchdog, HEAD, HEATER_ENABLE,
    HeaterWires, INDEX, Motors, Wire, World,
};
use crate::controller::{BootInfo, Controller};
use crate::description_store::DescriptionStore;
use crate::hal::{Board, BoardResources};
use crate::journal::Journal;
use crate::layer_store::LayerStore;
use crate::safety::transitions::may_heat;
use crate::stepping::{Engine, EngineConfig, EngineInputs, Mailbox, StepperPins};
use crate::testing::flash::Flash;
use crate::testing::{FakePin, FakePins, FakePower, preemption};

/// Identifier before the first session of the bench's host. Each `hello` uses the next one.
const SESSION: u32 = 7;
/// Time between two polls of the controller, us.
const POLL_US: u64 = 10_000;
/// Max time between two polls of the controller if they are late, us.
const MAX_POLL_US: u64 = 20_000;
/// Temperature of a nozzle that is hot within seconds after the heater is switched on, degrees Celsius.
pub const WARM: f64 = 190.0;

pub struct Bench {
    pub robot: Robot,
    pub controller: Controller<TestBoard>,
    pub world: Rc<World>,
    pub motors: Motors,
    pub heater: HeaterWires,
    pub fed: FakeWatchdog,
    pub fan: FakePower,
    /// Events of the board in the order of their arrival. None are read while `reads` is false.
    pub events: Vec<Message>,
    /// True if each request is sent twice. Both responses must then be equal.
    pub stutters: bool,
    pub reads: bool,
    /// Identifier of the host's session.
    pub session: u32,
    /// True if the step interrupt runs.
    pub interrupt_runs: bool,
    /// True if the main loop runs. If false, the main loop hangs, and the controller is not polled.
    pub main_loop_runs: bool,
    engine: Rc<RefCell<TestEngine>>,
    handover: Rc<Mailbox>,
    /// Random source of the time between two polls. If `None`, polls are on time, and the board also polls at once
    /// after each report.
    lateness: Option<Rng>,
    tick: u64,
    next_poll: u64,
    /// Tick after which the host next shows that it is alive.
    greets_at: u64,
    receiver: FrameDecoder,
    seq: u16,
    /// Sequence number of the latest event that the host has received.
    latest_event: u16,
    /// Number of emergency stops that the board has acknowledged since they were last counted.
    stops_acknowledged: u32,
}

type TestEngine = Engine<FakePin, FakePin, FakePin, FakePin, FakePin, FakePin, FakePin, FakePin, FakePin, FakeOutputs>;

pub struct TestBoard;

impl Board for TestBoard {
    type HeaterPower = FakePower;
    type HeaterEnable = FakePin;
    type FanPwm = FakePower;
    type ThermistorAdc = FakeThermistor;
    type SupplyAdc = FakeSupply;
    type FilamentPresence = FakePin;
    type DriverFault = FakePin;
    type Drivers = FakeDrivers;
    type Orientation = FakeOrientation;
    type Watchdog = FakeWatchdog;
    type DebugPort = FakeDebugPort;
    type Retained = FakeRetained;
    type Flash = Flash;
    type Store = Box<LayerStore>;
}

/// Returns whether nothing may be warm or move in this state.
pub fn at_rest(state: State) -> bool {
    !may_heat(state)
}

impl Bench {
    /// Creates a bench whose board has just been switched on, with its nozzle at this temperature, degrees Celsius.
    pub fn new(robot: Robot, nozzle_c: f64) -> Self {
        let world = World::new(&robot, nozzle_c);
        Self::boot(robot, world, ResetCause::PowerOn)
    }

    /// Resets the board and opens a session. The retained memory and the flash of the board are kept.
    pub fn reset(self, cause: ResetCause) -> Self {
        let mut bench = Self::boot(self.robot, self.world, cause);
        bench.run(0.7);
        bench.hello();
        bench
    }

    /// Creates a bench in an existing world whose board has just started.
    pub fn boot(robot: Robot, world: Rc<World>, reset_cause: ResetCause) -> Self {
        let (pins, power, fed) = (FakePins::default(), FakePower::default(), FakeWatchdog::default());
        let fan = FakePower::default();
        let axis =
            |at: usize| StepperPins { step: pins.pin(at), direction: pins.pin(at + 1), enable: pins.pin(at + 2) };
        let inputs = EngineInputs {
            index: pins.pin(INDEX),
            filament_motion: pins.pin(FILAMENT_MOTION),
            emergency_stop: pins.pin(EMERGENCY_STOP),
        };
        let outputs = FakeOutputs { power: power.clone(), fan: fan.clone(), pins: pins.clone() };
        let engine = Engine::new(axis(HEAD), axis(FEED), inputs, outputs, EngineConfig::for_robot(&robot));
        let handover = Rc::new(Mailbox::new());
        let parts = BoardResources {
            heater_power: power.clone(),
            heater_enable: pins.pin(HEATER_ENABLE),
            fan: fan.clone(),
            thermistor: FakeThermistor(Rc::clone(&world)),
            supply: FakeSupply(Rc::clone(&world)),
            filament_presence: pins.pin(FILAMENT_PRESENCE),
            driver_fault: pins.pin(DRIVER_FAULT),
            drivers: FakeDrivers(Rc::clone(&world)),
            orientation: FakeOrientation,
            watchdog: fed.clone(),
            debug_port: FakeDebugPort(Rc::clone(&world)),
            retained: FakeRetained(Rc::clone(&world)),
            journal: Journal::open(world.flash.clone()),
            descriptions: DescriptionStore::open(world.descriptions.clone()),
            store: Box::new(LayerStore::new()),
        };
        pins.set(FILAMENT_PRESENCE, true);
        let identity = BootInfo {
            boot_id: 5,
            reset_cause,
            image: world.image.get(),
            crash: None,
            crystal_failed: world.without_crystal.get(),
            configured: world.configured.get(),
        };
        Self {
            controller: Controller::new(robot.clone(), identity, parts, &handover),
            motors: Motors::new(pins.clone(), &robot, 17),
            heater: HeaterWires { power, pins },
            robot,
            world,
            fed,
            fan,
            events: Vec::new(),
            stutters: false,
            reads: true,
            session: SESSION,
            interrupt_runs: true,
            main_loop_runs: true,
            engine: Rc::new(RefCell::new(engine)),
            handover,
            lateness: None,
            tick: 0,
            next_poll: 0,
            greets_at: 0,
            receiver: FrameDecoder::default(),
            seq: 0,
            latest_event: 0,
            stops_acknowledged: 0,
        }
    }

    /// Creates a bench whose board is idle and has an open session.
    pub fn greeted(robot: Robot, nozzle_c: f64) -> Self {
        let mut bench = Self::new(robot, nozzle_c);
        bench.run_to(State::Idle, 1.0);
        bench.hello();
        bench
    }

    fn tick_hz(&self) -> u64 {
        u64::from(self.robot.description().motion.tick_hz)
    }

    /// Advances the simulation by some seconds.
    pub fn run(&mut self, seconds: f64) {
        let until = self.tick + (seconds * self.tick_hz() as f64) as u64;
        while self.tick < until {
            self.advance(until);
        }
    }

    /// Advances the simulation until a condition holds. Panics if that takes longer than `seconds`.
    pub fn run_until(&mut self, seconds: f64, is_so: impl Fn(&Self) -> bool) {
        let until = self.tick + (seconds * self.tick_hz() as f64) as u64;
        while !is_so(self) {
            assert!(self.tick < until, "still {:?} after {seconds} s", self.controller.state());
            self.advance(until);
        }
    }

    pub fn run_to(&mut self, state: State, seconds: f64) {
        self.run_until(seconds, |bench| bench.controller.state() == state);
    }

    /// Runs one tick in which something happens, or all ticks up to the next poll if nothing happens before.
    fn advance(&mut self, until: u64) {
        let quiet = u32::try_from(self.next_poll.min(until).saturating_sub(self.tick).max(1)).unwrap_or(u32::MAX);
        let quiet = if self.main_loop_runs { quiet } else { 1 };
        let event = if self.interrupt_runs { self.engine.borrow().ticks_to_event(&self.handover) } else { u32::MAX };
        let ticks = event.min(quiet);
        if self.interrupt_runs {
            self.engine.borrow_mut().skip(ticks - 1);
        }
        self.tick_once(u64::from(ticks));
        let polls_at_once = self.lateness.is_none() && self.handover.has_report();
        if self.main_loop_runs && (self.tick >= self.next_poll || polls_at_once) {
            self.poll();
        }
    }

    fn tick_once(&mut self, ticks: u64) {
        if self.interrupt_runs {
            self.engine.borrow_mut().tick(&self.handover);
        }
        self.tick += ticks;
        let seconds = ticks as f64 / self.tick_hz() as f64;
        self.world.heat(self.heater.share(), seconds);
        self.world.now.set(self.now_us());
        let (feed, risen) = (self.motors.moved.feed, self.motors.watch());
        let state = self.controller.state();
        assert!(!(at_rest(state) && risen), "a step in {state:?}");
        let energised = self.interrupt_runs && self.motors.enabled();
        assert!(!(at_rest(state) && energised), "motors are energised in {state:?}");
        assert!(!(state == State::Heating && risen), "a step while cold");
        let min_c = self.robot.description().heater.extrusion_min_c;
        if self.motors.moved.feed > feed && self.world.wire.get() == Wire::Whole && !self.controller.is_dry_run() {
            // The reading may be up to a period of the regulation old, and has a limited resolution.
            assert!(self.world.nozzle_c.get() > min_c - 5.0, "feed at {} C", self.world.nozzle_c.get());
        }
        self.check();
    }

    fn now_us(&self) -> u64 {
        self.tick * 1_000_000 / self.tick_hz()
    }

    /// Polls the controller and reads the bytes that the board sends.
    pub fn poll(&mut self) {
        self.controller.poll(self.now_us(), &self.handover);
        let us = self.lateness.as_mut().map_or(POLL_US, |random| random.below(MAX_POLL_US + 1));
        self.next_poll = self.tick + us * self.tick_hz() / 1_000_000;
        self.check();
        if self.reads {
            if self.tick > self.greets_at {
                self.greets_at = self.tick + 2 * self.tick_hz();
                self.acknowledge();
            }
            let events = self.read(None).0;
            self.events.extend(events);
        }
    }

    /// Asserts the conditions that must always hold.
    fn check(&self) {
        let state = self.controller.state();
        if at_rest(state) {
            assert!(self.heater.off(), "the heater is on in {state:?}");
        }
        assert_eq!(state == State::Fault, self.controller.fault().is_some(), "{state:?}");
        assert!(self.fan.share() == 0.0 || may_heat(state), "the fan turns in {state:?}");
        if self.main_loop_runs && self.heater.share() > 0.0 {
            let age = self.now_us() - self.world.sampled_at.get();
            assert!(age <= 500_000 + MAX_POLL_US, "power on a reading {age} us old");
        }
    }

    /// Sends raw bytes from the host to the board.
    pub fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.controller.receive(*byte, &self.handover);
            self.check();
        }
    }

    /// Reads all bytes that the board has sent. Returns the events, which are then acknowledged, and the responses to
    /// the request with the sequence number `ack`.
    pub fn read(&mut self, ack: Option<u16>) -> (Vec<Message>, Vec<Message>) {
        let (mut events, mut answers) = (Vec::new(), Vec::new());
        while let Some(byte) = self.controller.next_tx_byte() {
            let Some(frame) = self.receiver.push(byte) else { continue };
            let frame = frame.expect("the board sends whole frames");
            let message = Message::decode(frame.header.kind, &frame.body).expect("the board sends messages");
            match frame.header.ack {
                0 if frame.header.seq == next_seq(self.latest_event) => {
                    self.latest_event = frame.header.seq;
                    events.push(message);
                }
                0 if matches!(message, Message::EmergencyStopAck(_)) => self.stops_acknowledged += 1,
                // This event is a repetition.
                0 => {}
                other if Some(other) == ack => answers.push(message),
                _ => {}
            }
        }
        if !events.is_empty() {
            self.acknowledge();
        }
        (events, answers)
    }

    /// Acknowledges the received events, which also shows that the host is alive.
    fn acknowledge(&mut self) {
        let header = FrameHeader { kind: 0x0E, session: self.session, seq: 0, ack: self.latest_event };
        self.send(&frame::encode(&header, &[]).unwrap());
    }

    /// Sends a request of any kind and body, in any session, and returns the board's response.
    pub fn ask_raw(&mut self, session: u32, kind: u8, body: &[u8]) -> Message {
        self.seq = next_seq(self.seq);
        let header = FrameHeader { kind, session, seq: self.seq, ack: self.latest_event };
        let bytes = frame::encode(&header, body).unwrap();
        let mut answer = None;
        for _ in 0..if self.stutters { 2 } else { 1 } {
            self.send(&bytes);
            let (events, mut answers) = self.read(Some(self.seq));
            self.events.extend(events);
            assert_eq!(answers.len(), 1, "a request has an answer");
            let this = answers.remove(0);
            assert!(answer.is_none() || answer.as_ref() == Some(&this), "{answer:?}, then {this:?}");
            answer = Some(this);
        }
        answer.unwrap()
    }

    pub fn ask_in(&mut self, session: u32, message: &Message) -> Message {
        let mut buffer = [0; MAX_BODY_LEN];
        let body = message.encode(&mut buffer).unwrap();
        self.ask_raw(session, message.kind(), body)
    }

    pub fn ask(&mut self, message: &Message) -> Message {
        self.ask_in(self.session, message)
    }

    /// Sends a request that the board must accept.
    pub fn accepted(&mut self, message: &Message) -> Accepted {
        match self.ask(message) {
            Message::Accepted(accepted) => accepted,
            other => panic!("{message:?} was answered by {other:?}"),
        }
    }

    /// Sends a request that the board must refuse, and returns the reason. The board's state and status must not
    /// change.
    pub fn refused(&mut self, message: &Message) -> Refusal {
        let before = self.status();
        let answer = self.ask(message);
        assert_eq!(self.status(), before, "{message:?} was refused and changed something");
        match answer {
            Message::Refused(RefusalResponse { kind, refusal }) if kind == message.kind() => refusal,
            other => panic!("{message:?} was answered by {other:?}"),
        }
    }

    pub fn hello(&mut self) {
        self.session += 1;
        self.latest_event = 0;
        let answer = self.ask(&hello(SCHEMA_HASH));
        assert!(matches!(answer, Message::BoardInfo(_)), "{answer:?}");
    }

    pub fn status(&mut self) -> Status {
        match self.ask(&Message::GetStatus(Empty {})) {
            Message::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    pub fn begin(&mut self, layers: usize) {
        self.accepted(&begin(&self.robot, PLAN, layers as u32));
    }

    /// Sends layers in batches. `first` is the index of the first one.
    pub fn hand_over(&mut self, first: usize, layers: &[LayerBytes]) {
        for (batch, bytes) in layers.chunks(MAX_LAYERS_PER_MESSAGE).enumerate() {
            self.accepted(&batch_of(first + batch * MAX_LAYERS_PER_MESSAGE, bytes));
        }
    }

    pub fn start(&mut self) {
        self.accepted(&start());
    }

    /// Sends a job of these layers to the board and starts it.
    pub fn grow(&mut self, layers: &[LayerBytes]) {
        self.begin(layers.len());
        self.hand_over(0, layers);
        self.start();
    }

    /// Returns the reports of all laid layers, in the order of their arrival.
    pub fn laid(&self) -> Vec<LayerLaid> {
        let laid = |event: &Message| if let Message::LayerLaid(laid) = event { Some(laid.clone()) } else { None };
        self.events.iter().filter_map(laid).collect()
    }

    /// Returns the total number of feed steps of the layers that were reported as laid.
    pub fn fed(&self) -> u32 {
        self.laid().iter().map(|laid| feed_steps_of(laid, &self.robot)).sum()
    }

    /// Returns the states that the board has reported, in order.
    pub fn states(&self) -> Vec<State> {
        let state =
            |event: &Message| if let Message::StateChanged(changed) = event { Some(changed.state) } else { None };
        self.events.iter().filter_map(state).collect()
    }

    /// Waits until the board accepts a move of filament in maintenance, because the nozzle is hot enough.
    pub fn run_until_it_may_move(&mut self) {
        for _ in 0..400 {
            self.run(0.5);
            if matches!(self.ask(&feed(0.0)), Message::Accepted(_)) {
                self.run(0.1);
                return;
            }
        }
        panic!("it does not get hot: {:?}", self.status());
    }

    /// Creates a bench and brings its board into a state by the events that lead to that state. A warm nozzle saves the
    /// time of heating.
    pub fn in_state(state: State) -> Self {
        let robot = crate::testing::fast_robot();
        let cold = matches!(state, State::Heating | State::Tuning);
        let mut bench = Self::new(robot, if cold { 60.0 } else { WARM });
        if state == State::SelfTest {
            bench.hello();
            return bench;
        }
        bench.run_to(State::Idle, 1.0);
        bench.hello();
        bench.begin(40);
        let layers = bends(if state == State::Done { 40 } else { 30 });
        bench.hand_over(0, &layers);
        if !matches!(state, State::Idle | State::Tuning | State::Maintenance) {
            bench.start();
        }
        match state {
            State::Idle => {}
            State::Tuning => {
                bench.accepted(&tune(200.0));
            }
            State::Maintenance => {
                bench.accepted(&preheat(200.0));
                bench.run_until_it_may_move();
            }
            State::Stopped => {
                bench.run_to(State::Growing, 60.0);
                bench.accepted(&stop());
            }
            State::EmergencyStop => {
                bench.run_to(State::Growing, 60.0);
                bench.press_emergency_stop(true);
                bench.run_to(State::EmergencyStop, 0.1);
                bench.press_emergency_stop(false);
            }
            State::Fault => {
                bench.run_to(State::Growing, 60.0);
                bench.world.wire.set(Wire::Open);
                bench.run_to(State::Fault, 1.0);
                bench.world.wire.set(Wire::Whole);
                bench.run(0.5);
            }
            state => bench.run_to(state, 600.0),
        }
        // The moment within the state is arbitrary.
        bench.run(0.33);
        assert_eq!(bench.controller.state(), state);
        bench
    }

    /// Makes polls late from now on: 0 to 20 ms after each other, as drawn from this seed.
    pub fn poll_late(&mut self, seed: u64) {
        self.lateness = Some(Rng::new(&[seed]));
    }

    /// Runs some ticks of the step interrupt without polling the controller.
    pub fn run_ticks(&mut self, ticks: u64) {
        (0..ticks).for_each(|_| self.tick_once(1));
    }

    /// Returns the number of ticks since the bench was created.
    pub fn ticks(&self) -> u64 {
        self.tick
    }

    /// Returns whether a report of the step engine waits for the next poll.
    pub fn has_report(&self) -> bool {
        self.handover.has_report()
    }

    /// Calls `work`, a part of the main loop. The step interrupt occurs at each of the points (see [`preemption`]).
    /// `before_tick` changes the pins before and after each of these ticks. Returns the number of points in `work`.
    pub fn preempt(
        &mut self,
        points: &[usize],
        before_tick: impl Fn(&FakePins, bool) + 'static,
        work: impl FnOnce(&mut Self),
    ) -> usize {
        let motors = Rc::new(RefCell::new(self.motors.clone()));
        let (engine, handover, watch) = (Rc::clone(&self.engine), Rc::clone(&self.handover), Rc::clone(&motors));
        let interrupt = move || {
            let pins = watch.borrow().pins.clone();
            before_tick(&pins, true);
            engine.borrow_mut().tick(&handover);
            watch.borrow_mut().watch();
            before_tick(&pins, false);
        };
        let passed = preemption::preempt(points, interrupt, || work(self));
        self.motors.clone_from(&motors.borrow());
        passed
    }

    /// Reports an emergency stop to the mailbox, as the UART's interrupt does when it detects one.
    pub fn call_emergency_stop(&self) {
        self.handover.request_emergency_stop();
    }

    /// Returns and clears the number of emergency stops that the board has acknowledged.
    pub fn stops_acknowledged(&mut self) -> u32 {
        core::mem::take(&mut self.stops_acknowledged)
    }

    /// Latches a fault in the controller.
    pub fn fail(&mut self, fault: Fault) {
        self.controller.latch_fault(fault, &self.handover);
    }

    pub fn press_emergency_stop(&self, pressed: bool) {
        self.heater.pins.set(EMERGENCY_STOP, pressed);
    }
}
