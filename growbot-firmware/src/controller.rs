//! The controller: what the robot does, and when.
//!
//! Duties: answer the host, hold the job's layers, heat, home, hand one layer after the other to the step engine, report
//! each as it is laid, and switch everything off when told to, when done, and when anything is wrong.
//!
//! ```text
//! Idle --Start--> Heating --hot--> Homing --at zero--> Growing <--no layer/more layers--> Hold
//!                                                      Growing --last layer laid--> Done
//! any --Stop--> Stopped       any --fault--> Fault --ClearFault, cause gone--> Idle
//! ```
//!
//! Heating comes before any motion of the head, since cold plastic may hold the nozzle. A reset leads to `Idle`: nothing
//! heats or moves without a host's `Start`. Heater and steppers are off in `Idle`, `Done`, `Stopped` and `Fault`.
//!
//! The controller never waits: [`Controller::poll`] is called at least every 20 ms with a clock in us, and returns.

mod requests;
#[cfg(test)]
mod tests;

use core::ops::{Deref, DerefMut};

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;
use growbot_core::layer_bytes::{Encoder, LayerBytes, decode_checked};
use growbot_core::link::message::{Fault, Laid, Message, Refusal, ResetCause, State, StateChanged, Status};
use growbot_core::robot::{Robot, Turning};
use heapless::Deque;

use crate::hal::{Board, Parts, Thermistor, Watchdog};
use crate::heater::{self, Heater};
use crate::layer_store::LayerStore;
use crate::link::Link;
use crate::stepping::{Handover, Homing, Material, Order, Report, TurnReport, as_built};

/// Events that wait for room on the link. Beyond that the oldest go; the status always tells how many layers are laid.
const EVENTS: usize = 16;

/// What a board knows about its own start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Another number at each start.
    pub boot_id: u32,
    /// Why it started.
    pub reset_cause: ResetCause,
}

/// The job: which plan, and how far it has come.
#[derive(Debug, Clone, Default)]
struct Job {
    /// 0 for none.
    plan_id: u64,
    /// Layers of the plan.
    layers: u32,
    /// Layers laid.
    laid: u32,
    /// Layers handed to the engine.
    given: u32,
    /// What those handed over amount to.
    material: Material,
    /// Rounding of the layers as built.
    encoder: Encoder,
}

/// The controller of one robot.
pub struct Controller<B: Board> {
    robot: Robot,
    identity: Identity,
    parts: Parts<B>,
    link: Link,
    heater: Heater,
    state: State,
    fault: Option<Fault>,
    job: Job,
    events: Deque<Message, EVENTS>,
    next_update: u64,
    now: u64,
}

impl<B: Board> Controller<B> {
    /// A controller in `Idle`, with everything off.
    pub fn new(robot: Robot, identity: Identity, parts: Parts<B>, handover: &Handover) -> Self {
        let mut controller = Self {
            robot,
            identity,
            parts,
            link: Link::default(),
            heater: Heater::default(),
            state: State::Idle,
            fault: None,
            job: Job::default(),
            events: Deque::new(),
            next_update: 0,
            now: 0,
        };
        controller.switch_off(handover);
        controller
    }

    /// Takes a byte from the host.
    pub fn receive(&mut self, byte: u8, handover: &Handover) {
        if let Some(Ok(frame)) = self.link.receive(byte) {
            self.serve(&frame, handover);
        }
    }

    /// The next byte for the host.
    pub fn transmit(&mut self) -> Option<u8> {
        self.link.transmit()
    }

    /// What the robot is doing.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// The fault that is latched.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Does what is due at this time (us since the start).
    pub fn poll(&mut self, now: u64, handover: &Handover) {
        self.now = now;
        if self.heater.is_blind(now) {
            self.fail(Fault::ThermistorSilent, handover);
        }
        if now >= self.next_update {
            self.next_update = now.saturating_add(heater::PERIOD_US);
            self.regulate(handover);
            self.parts.watchdog.feed();
        }
        if let Some(report) = handover.take_report() {
            self.take(report, handover);
        }
        self.proceed(handover);
        while self.link.takes_events() {
            let Some(event) = self.events.pop_front() else { break };
            self.link.event(&event);
        }
    }

    /// Reads the temperature and sets the heater.
    fn regulate(&mut self, handover: &Handover) {
        let raw = self.parts.thermistor.sample();
        match self.heater.update(raw, self.robot.description(), self.now) {
            Ok(duty) => self.power(duty, handover),
            Err(fault) => self.fail(fault, handover),
        }
        if matches!(self.state, State::Homing | State::Growing | State::Hold) {
            let least = self.robot.description().heater.extrusion_min_c;
            if self.heater.temperature(self.now).is_some_and(|temperature| temperature < least) {
                self.fail(Fault::UnderTemperature, handover);
            }
        }
    }

    /// Gives the heater this share (0 to 1) of its power.
    fn power(&mut self, share: f64, handover: &Handover) {
        let duty = (share * f64::from(self.parts.heater_power.max_duty_cycle())) as u16;
        let enabled = if self.heater.target().is_some() {
            self.parts.heater_enable.set_high().is_ok()
        } else {
            self.parts.heater_enable.set_low().is_ok()
        };
        if !enabled || self.parts.heater_power.set_duty_cycle(duty).is_err() {
            self.fail(Fault::Hardware, handover);
        }
    }

    /// Heater and steppers off. Tried in full even where a part has failed before.
    fn switch_off(&mut self, handover: &Handover) {
        self.heater.switch_off();
        let _ = self.parts.heater_enable.set_low();
        let _ = self.parts.heater_power.set_duty_cycle_fully_off();
        handover.halt();
    }

    /// Switches everything off and latches a fault, unless an earlier one is latched.
    fn fail(&mut self, fault: Fault, handover: &Handover) {
        self.switch_off(handover);
        if self.state != State::Fault {
            self.fault = Some(fault);
            self.enter(State::Fault);
        }
    }

    /// Goes to a state and tells the host.
    fn enter(&mut self, state: State) {
        if self.state == state {
            return;
        }
        self.state = state;
        self.tell(Message::StateChanged(StateChanged { state, fault: self.fault }));
    }

    /// Queues an event.
    fn tell(&mut self, event: Message) {
        if self.events.is_full() {
            self.events.pop_front();
        }
        // There is room now.
        let _ = self.events.push_back(event);
    }

    /// Takes what the step engine reports.
    fn take(&mut self, report: Report, handover: &Handover) {
        match report {
            Report::Homed if self.state == State::Homing => self.enter(State::Growing),
            Report::Laid(turn) if matches!(self.state, State::Growing | State::Hold) => self.count(&turn, handover),
            Report::IndexNotFound => self.fail(Fault::IndexNotFound, handover),
            Report::IndexMissing => self.fail(Fault::IndexMissing, handover),
            Report::IndexStuck => self.fail(Fault::IndexStuck, handover),
            Report::HeadStepsLost => self.fail(Fault::HeadStepsLost, handover),
            Report::Hardware => self.fail(Fault::Hardware, handover),
            // What was under way when everything was switched off.
            Report::Homed | Report::Laid(_) | Report::Fed => {}
        }
    }

    /// Counts a layer as laid and tells the host what was built.
    fn count(&mut self, turn: &TurnReport, handover: &Handover) {
        let index = self.job.laid;
        self.job.laid += 1;
        self.parts.store.drop_first();
        let built = as_built(&turn.feed, &self.robot);
        let laid = Laid {
            plan_id: self.job.plan_id,
            index,
            as_built: self.job.encoder.encode(&built),
            head_steps: turn.head,
            feed_steps: turn.feed.iter().sum(),
        };
        self.tell(Message::Laid(laid));
        if self.job.laid == self.job.layers {
            self.switch_off(handover);
            self.enter(State::Done);
        }
    }

    /// Moves on where nothing but time was missing.
    fn proceed(&mut self, handover: &Handover) {
        match self.state {
            State::Heating if self.heater.is_hot(self.now) => {
                handover.give(Order::Home(self.homing()));
                self.enter(State::Homing);
            }
            State::Growing | State::Hold if handover.takes_orders() => self.give_layer(handover),
            _ => {}
        }
    }

    /// How this robot homes.
    fn homing(&self) -> Homing {
        let description = self.robot.description();
        let head = &description.head;
        let steps = f64::from(head.steps_per_turn);
        let steps_a_second = steps * head.homing_turns_per_s;
        let index = growbot_core::angle::wrap_positive(growbot_core::angle::radians(head.index_angle_deg));
        let index_steps = libm::rint(index / core::f64::consts::TAU * steps) as u32;
        Homing {
            ticks_per_step: (f64::from(description.motion.tick_hz) / steps_a_second).max(2.0) as u32,
            // A turn to pass the mark, and half a turn for a start within it.
            most_steps: head.steps_per_turn + head.steps_per_turn / 2,
            steps_to_zero: if index_steps == 0 { 0 } else { head.steps_per_turn.saturating_sub(index_steps) },
        }
    }

    /// Hands the next layer to the engine, which lays it once it is done with the one before.
    fn give_layer(&mut self, handover: &Handover) {
        if self.job.given == self.job.layers {
            return;
        }
        let Some(bytes) = self.parts.store.get(self.job.given) else {
            if self.job.laid == self.job.given {
                self.enter(State::Hold);
            }
            return;
        };
        let alternate = self.robot.description().motion.turning == Turning::Alternate;
        let backwards = alternate && self.job.given % 2 == 1;
        match self.job.material.lay(&bytes, &self.robot, backwards) {
            Ok(turn) => {
                handover.give(Order::Lay(turn));
                self.job.given += 1;
                self.enter(State::Growing);
            }
            Err(_) => self.fail(Fault::StepRate, handover),
        }
    }

    /// What the host is told about all this.
    fn status(&self) -> Status {
        let centi = |celsius: f64| libm::rint(celsius * 100.0) as i32;
        Status {
            state: self.state,
            fault: self.fault,
            temperature_centi_c: self.heater.temperature(self.now).map(centi),
            target_centi_c: self.heater.target().map(centi),
            duty: (self.heater.duty() * f64::from(u16::MAX)) as u16,
            plan_id: self.job.plan_id,
            layers: self.job.layers,
            next: self.store().next_index(),
            laid: self.job.laid,
            uptime_ms: self.now / 1000,
        }
    }

    fn store(&self) -> &LayerStore {
        self.parts.store.deref()
    }

    fn store_mut(&mut self) -> &mut LayerStore {
        self.parts.store.deref_mut()
    }

    /// Whether a layer can be laid. The robot's limits are the board's own: nothing that a host sends lifts them.
    fn check_layer(&self, index: u32, bytes: &LayerBytes) -> Result<(), Refusal> {
        decode_checked(bytes, &self.robot).map(|_| ()).map_err(|_| Refusal::BadLayer { index })
    }

    /// Takes a layer into the store.
    fn hold_layer(&mut self, bytes: LayerBytes) -> Result<(), Refusal> {
        if self.store_mut().push(bytes) { Ok(()) } else { Err(Refusal::Full) }
    }
}
