//! The controller: what the robot does, and when.
//!
//! Duties: answer the host, hold the job's layers, heat, home, hand one layer after the other to the step engine,
//! report each as it is laid, and switch everything off when told to, when done, and when anything is wrong.
//!
//! Where each event leads is the table in [`crate::safety::transitions`]. Heating comes before any motion of the head,
//! since cold plastic may hold the nozzle. A reset never heats or moves by itself.
//!
//! - `requests`: what the host asks for;
//! - `job`: the plan under way, its layers, and what the journal knows of them;
//! - `supervising`: ten times a second: temperature, sensors, watchdog; and what happens when something is wrong;
//! - `growing`: the orders to the step engine: homing, layers, filament pulled back round holds.
//!
//! The controller never waits: [`Controller::poll`] is called at least every 20 ms with a clock in us, and returns.

mod growing;
mod job;
mod requests;
mod supervising;
#[cfg(test)]
mod tests;

use core::ops::{Deref, DerefMut};

use growbot_core::link::crash::CrashWords;
use growbot_core::link::message::{
    Empty, Fault, ImageCheck, Message, ResetCause, SensorReadings, State, StateChanged, Status,
};
use growbot_core::robot::Robot;

use crate::hal::{Adc, Board, Parts};
use crate::heater::{self, Heater, Sampler};
use crate::layer_store::LayerStore;
use crate::link::{self, Link};
use crate::safety::inputs::Inputs;
use crate::safety::proof_of_life::ProofOfLife;
use crate::safety::retained::{Copies, Retained, UnderWay};
use crate::safety::transitions::{Event, after, may_heat};
use crate::stepping::Handover;

/// What a board knows about its own start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Another number at each start.
    pub boot_id: u32,
    /// Why it started.
    pub reset_cause: ResetCause,
    /// What the check of its firmware's image has found.
    pub image: ImageCheck,
    /// The latest crash of its firmware, as far as that is still known.
    pub crash: Option<CrashWords>,
    /// The crystal did not start: the board runs on an oscillator that is too inexact to heat by.
    pub without_crystal: bool,
}

impl Identity {
    /// Whether the image is known to be another one than was meant.
    pub(crate) fn is_corrupt(&self) -> bool {
        matches!(self.image, ImageCheck::Corrupt { .. })
    }
}

/// The controller of one robot.
pub struct Controller<B: Board> {
    robot: Robot,
    identity: Identity,
    parts: Parts<B>,
    link: Link,
    state: State,
    fault: Option<Fault>,
    retained: Retained,
    copies: Copies,
    job: job::Job,
    motion: growing::Motion,
    heater: Heater,
    /// Duty of the fan, 0 to 1.
    fan: f64,
    thermistor: Sampler,
    supply: Sampler,
    inputs: Inputs,
    readings: SensorReadings,
    proof: ProofOfLife,
    /// Ticks of the step interrupt at the latest look, and looks since they stood still.
    ticks: (u32, u8),
    /// The step interrupt stopped while it may have held motors.
    holds_motors: bool,
    /// Emergency stops by the link that have been obeyed.
    calls: u32,
    /// Sectors made of the layer under way, as last retained.
    sectors: u8,
    /// When the state was entered, us.
    since: u64,
    next_update: u64,
    now: u64,
}

impl<B: Board> Controller<B> {
    /// A controller with everything off: about to test itself, or with the fault of the boot before.
    pub fn new(robot: Robot, identity: Identity, mut parts: Parts<B>, handover: &Handover) -> Self {
        let (copies, retained) = Copies::find(&mut parts.retained);
        let unknown = retained.err();
        let mut controller = Self {
            robot,
            identity,
            parts,
            link: Link::default(),
            state: State::SelfTest,
            fault: None,
            retained: retained.unwrap_or_default(),
            copies,
            job: job::Job::default(),
            motion: growing::Motion::default(),
            heater: Heater::default(),
            fan: 0.0,
            thermistor: Sampler::default(),
            supply: Sampler::default(),
            inputs: Inputs::default(),
            readings: SensorReadings::default(),
            proof: ProofOfLife::default(),
            ticks: (0, 0),
            holds_motors: false,
            calls: handover.calls(),
            sectors: 0,
            since: 0,
            next_update: 0,
            now: 0,
        };
        controller.switch_off(handover);
        controller.restore_job();
        controller.restore_fault(unknown);
        controller
    }

    /// Takes a byte from the host. (An emergency stop among them is recognised before, where the byte arrives.)
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

    /// Layers of the job that are laid.
    #[must_use]
    pub fn laid(&self) -> u32 {
        self.job.laid
    }

    /// What the nozzle is regulated to, degrees Celsius; none with the heater off.
    #[must_use]
    pub fn target_c(&self) -> Option<f64> {
        self.heater.target()
    }

    /// Does what is due at this time (us since the start).
    pub fn poll(&mut self, now: u64, handover: &Handover) {
        self.now = now;
        if let Some(raw) = self.parts.thermistor.sample() {
            self.thermistor.add(raw);
        }
        if let Some(raw) = self.parts.supply.sample() {
            self.supply.add(raw);
        }
        self.proof.sampler = true;
        self.obey_emergency_stop(handover);
        if self.heater.is_blind(now) {
            self.fail(Fault::ThermistorSilent, handover);
        }
        if now >= self.next_update {
            self.next_update = now.saturating_add(heater::PERIOD_US);
            self.supervise(handover);
        }
        if let Some(report) = handover.take_report() {
            self.handle_report(report, handover);
        }
        self.proceed(handover);
        self.tell_layers();
        self.link.send_events(now);
    }

    /// Whatever else there is to do, this comes first.
    fn obey_emergency_stop(&mut self, handover: &Handover) {
        let calls = handover.calls();
        if handover.emergency_stop() || calls != self.calls {
            self.stop_at_once(handover);
        }
        if calls != self.calls {
            self.calls = calls;
            self.link.call_out(&Message::StoppedAtOnce(Empty {}));
        }
    }

    /// Goes where the table says. False where the event means nothing in this state.
    fn happens(&mut self, event: Event) -> bool {
        let Some(state) = after(self.state, event) else { return false };
        if self.state != state {
            self.state = state;
            self.since = self.now;
            self.retain();
            self.link.tell(link::Event::State(StateChanged { state, fault: self.fault }));
        }
        true
    }

    /// Since when the state has been what it is, us.
    fn in_state_us(&self) -> u64 {
        self.now.saturating_sub(self.since)
    }

    /// Writes what a start must know into the memory that survives a reset.
    fn retain(&mut self) {
        let job::Job { plan_id, laid, given, .. } = self.job;
        let under_way = UnderWay { state: self.state, plan_id, laid, begun: given, sectors: self.sectors };
        self.retained.under_way = (may_heat(self.state) || self.state == State::Parked).then_some(under_way);
        self.copies.write(&mut self.parts.retained, &self.retained);
    }

    /// What the host is told about all this.
    fn status(&self) -> Status {
        Status {
            state: self.state,
            fault: self.fault,
            temperature_centi_c: self.heater.temperature(self.now).map(centi),
            target_centi_c: self.heater.target().map(centi),
            duty: self.duty(),
            plan_id: self.job.plan_id,
            layers: self.job.layers,
            next: self.store().next_index(),
            laid: self.job.laid,
            interrupted: self.job.interrupted,
            pause_cause: self.pause_cause(),
            journal: !self.job.unwritten,
            uptime_ms: self.now / 1000,
        }
    }

    /// Duty of the heater, 0 to 65,535.
    fn duty(&self) -> u16 {
        (self.heater.duty() * f64::from(u16::MAX)) as u16
    }

    fn store(&self) -> &LayerStore {
        self.parts.store.deref()
    }

    fn store_mut(&mut self) -> &mut LayerStore {
        self.parts.store.deref_mut()
    }
}

/// Degrees Celsius to hundredths of them.
fn centi(celsius: f64) -> i32 {
    libm::rint(celsius * 100.0) as i32
}
