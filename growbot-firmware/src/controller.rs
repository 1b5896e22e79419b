//! The controller: answers the host, stores the job's layers, heats, homes, hands one layer after the other to the step
//! engine, reports each as it is laid, and switches everything off on request, when done, and when anything is wrong.
//!
//! The table in [`crate::safety::transitions`] says where each event leads. Heating comes before any motion of the
//! head, since the nozzle may stick in cold plastic. A reset never heats or moves by itself.
//!
//! - `requests`: the requests of the host;
//! - `configuring`: another robot description;
//! - `job`: the plan under way, its layers, and their records in the journal;
//! - `supervising`: temperature, sensors and watchdog, ten times a second, and the reaction to a fault;
//! - `maintaining`: heat and moves without a job;
//! - `growing`: the orders to the step engine: homing, layers, filament pulled back for a pause.
//!
//! The controller never waits: [`Controller::poll`] is called at least every 20 ms with a clock in us, and returns.

mod configuring;
mod growing;
mod job;
mod maintaining;
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

use crate::hal::{Adc, Board, Drivers, Parts};
use crate::heater::{self, Heater, Sampler};
use crate::layer_store::LayerStore;
use crate::link::{self, Link};
use crate::safety::inputs::Inputs;
use crate::safety::proof_of_life::ProofOfLife;
use crate::safety::retained::{Copies, Retained, UnderWay};
use crate::safety::transitions::{Event, after, may_heat};
use crate::stepping::Handover;

/// Facts about the start of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// A number that differs at each start.
    pub boot_id: u32,
    /// The cause of the start.
    pub reset_cause: ResetCause,
    /// The result of the check of its firmware's image.
    pub image: ImageCheck,
    /// The latest crash of its firmware, if its record is whole.
    pub crash: Option<CrashWords>,
    /// The crystal did not start: the board runs on an oscillator that is too inexact to heat by.
    pub without_crystal: bool,
    /// There is a description of the board's robot. Without one the board only communicates.
    pub configured: bool,
}

impl Identity {
    /// Whether the image is known to differ from what was sealed.
    pub(crate) fn is_corrupt(&self) -> bool {
        matches!(self.image, ImageCheck::Corrupt { .. })
    }
}

/// Watches that the step interrupt runs.
#[derive(Debug, Clone, Copy, Default)]
struct TickWatch {
    /// Ticks of the step interrupt at the latest look.
    ticks: u32,
    /// Looks in a row at which they had not changed.
    looks_without: u8,
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
    configuring: configuring::Configuring,
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
    ticks: TickWatch,
    /// The step interrupt stopped while motors may have been energised.
    motors_energised: bool,
    /// Emergency stops by the link that have been obeyed.
    calls: u32,
    /// Sectors made of the layer under way, as last retained.
    sectors: u8,
    /// The time at which the state was entered, us.
    since: u64,
    next_update: u64,
    now: u64,
}

impl<B: Board> Controller<B> {
    /// A controller with everything off, in its self-test or with the fault of the boot before. A board that is not
    /// configured stays so, whatever robot it is given.
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
            configuring: configuring::Configuring::default(),
            job: job::Job::default(),
            motion: growing::Motion::default(),
            heater: Heater::default(),
            fan: 0.0,
            thermistor: Sampler::default(),
            supply: Sampler::default(),
            inputs: Inputs::default(),
            readings: SensorReadings::default(),
            proof: ProofOfLife::default(),
            ticks: TickWatch::default(),
            motors_energised: false,
            calls: handover.calls(),
            sectors: 0,
            since: 0,
            next_update: 0,
            now: 0,
        };
        controller.switch_off(handover);
        if identity.configured {
            controller.restore_job();
        }
        controller.restore_fault(unknown);
        controller
    }

    /// Ingests a byte from the host. (An emergency stop is recognised before, where the byte arrives.)
    pub fn receive(&mut self, byte: u8, handover: &Handover) {
        if let Some(Ok(frame)) = self.link.receive(byte) {
            self.serve(&frame, handover);
        }
    }

    /// Pops the next byte for the host.
    pub fn transmit(&mut self) -> Option<u8> {
        self.link.transmit()
    }

    /// The state of the robot.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// The latched fault.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Number of layers of the job that are laid.
    #[must_use]
    pub fn laid(&self) -> u32 {
        self.job.laid
    }

    /// The target of the nozzle's temperature, degrees Celsius; none with the heater off.
    #[must_use]
    pub fn target_c(&self) -> Option<f64> {
        self.heater.target()
    }

    /// Does everything that is due at a time, us since the start.
    pub fn poll(&mut self, now: u64, handover: &Handover) {
        self.now = now;
        if let Some(raw) = self.parts.thermistor.sample() {
            self.thermistor.add(raw);
        }
        if let Some(raw) = self.parts.supply.sample() {
            self.supply.add(raw);
        }
        self.proof.sampler = true;
        self.parts.drivers.poll(now, may_heat(self.state));
        self.obey_emergency_stop(handover);
        if self.heater.is_blind(now) {
            self.fail(Fault::ThermistorSilent, handover);
        }
        if now >= self.next_update {
            self.next_update = now.saturating_add(heater::PERIOD_US);
            self.supervise(handover);
        }
        if let Some(report) = handover.pop_report() {
            self.handle_report(report, handover);
        }
        self.proceed(handover);
        self.report_layers();
        self.link.send_events(now);
    }

    /// Switches everything off after an emergency stop. It comes before everything else.
    fn obey_emergency_stop(&mut self, handover: &Handover) {
        let calls = handover.calls();
        if handover.emergency_stop() || calls != self.calls {
            self.latch_emergency_stop(handover);
        }
        if calls != self.calls {
            self.calls = calls;
            self.link.broadcast(&Message::StoppedAtOnce(Empty {}));
        }
    }

    /// Enters the state that the table says. False where the event means nothing in this state.
    fn happens(&mut self, event: Event) -> bool {
        let Some(state) = after(self.state, event) else { return false };
        if self.state != state {
            self.state = state;
            self.since = self.now;
            self.retain();
            self.link.push_event(link::Event::State(StateChanged { state, fault: self.fault }));
        }
        true
    }

    /// The time since the state was entered, us.
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

    /// The status for the host.
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
