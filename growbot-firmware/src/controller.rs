//! The controller of a robot: it answers the host's requests, stores the layers of the job, heats, homes, and hands one
//! layer after the other to the step engine. It reports each layer once it is laid. It switches everything off on
//! request, when the job is done, and when a fault is found.
//!
//! The table in [`crate::safety::transitions`] defines which state each event leads to. The head moves only after the
//! nozzle is hot, because the nozzle may stick in cold plastic. A reset never starts heat or motion by itself.
//!
//! - `requests`: the requests of the host;
//! - `configuration`: a new robot description, which `config_upload` receives part by part;
//! - `job`: the current plan, its layers, and their records in the journal; `active_job` has the progress;
//! - `supervision`: temperature, sensors and watchdog, ten times a second, and the reaction to a fault;
//! - `maintenance`: heat and moves without a job;
//! - `growth`: the moves for the step engine: homing, layers, and filament that is pulled back for a pause;
//! - `move_tracker`: the moves that the step engine has received.
//!
//! The controller never blocks. Call [`Controller::poll`] at least every 20 ms, with the time since the board's start
//! in us.

mod active_job;
mod config_upload;
mod configuration;
mod growth;
mod job;
mod maintenance;
mod move_tracker;
mod requests;
mod supervision;
#[cfg(test)]
mod tests;

use core::ops::{Deref, DerefMut};

use growbot_core::link::crash::CrashWords;
use growbot_core::link::message::{
    Empty, Fault, ImageCheck, Message, ResetCause, SensorReadings, State, StateChanged, Status,
};
use growbot_core::robot::Robot;

use self::active_job::ActiveJob;
use self::config_upload::ConfigUpload;
use self::move_tracker::MoveTracker;
use crate::hal::{Adc, Board, BoardResources, StepperDrivers};
use crate::heater::{self, HeaterController};
use crate::layer_store::LayerStore;
use crate::link::{self, Link};
use crate::oversampler::Oversampler;
use crate::safety::input_monitor::InputMonitor;
use crate::safety::liveness::LivenessCheck;
use crate::safety::retained::{ActiveWork, RetainedState, RetainedStore};
use crate::safety::transitions::{Event, may_heat, next_state};
use crate::stepping::Mailbox;

/// Facts about the start of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BootInfo {
    /// Identifier of this boot, which differs at each start.
    pub boot_id: u32,
    /// Cause of the board's start.
    pub reset_cause: ResetCause,
    /// Result of the check of the firmware's image.
    pub image: ImageCheck,
    /// Record of the firmware's latest crash. `None` if the board has no valid record.
    pub crash: Option<CrashWords>,
    /// True if the crystal did not start. The board then runs on an oscillator that is too inexact for heating.
    pub crystal_failed: bool,
    /// True if the board has the description of its robot. A board without a description only communicates.
    pub configured: bool,
}

impl BootInfo {
    /// Returns whether the firmware's image is known to differ from the image that was built.
    pub(crate) fn is_corrupt(&self) -> bool {
        matches!(self.image, ImageCheck::Corrupt { .. })
    }
}

/// Detector of a stalled step interrupt: compares the interrupt's count of ticks from check to check.
#[derive(Debug, Clone, Copy, Default)]
struct StepTickMonitor {
    /// Number of step interrupts since the board's start, as read at the latest check.
    ticks: u32,
    /// Number of consecutive checks at which `ticks` had not changed.
    looks_without: u8,
}

/// Controller of one robot: it answers the host's requests, lays the layers of the job, and supervises the robot.
pub struct Controller<B: Board> {
    robot: Robot,
    identity: BootInfo,
    parts: BoardResources<B>,
    link: Link,
    state: State,
    fault: Option<Fault>,
    retained: RetainedState,
    copies: RetainedStore,
    configuring: ConfigUpload,
    job: ActiveJob,
    motion: MoveTracker,
    heater: HeaterController,
    /// Duty of the fan, 0 to 1.
    fan: f64,
    thermistor: Oversampler,
    supply: Oversampler,
    inputs: InputMonitor,
    readings: SensorReadings,
    proof: LivenessCheck,
    ticks: StepTickMonitor,
    /// True if the step interrupt stopped while motors may have been energised.
    motors_energised: bool,
    /// Number of emergency stops received over the link that have been carried out.
    calls: u32,
    /// Number of presses of the emergency stop that have been carried out.
    presses: u32,
    /// Number of finished sectors (equal parts of the head's turn) of the current layer, as last stored in the retained
    /// state.
    sectors: u8,
    /// Time at which the robot's current state was entered, us.
    state_entered_us: u64,
    next_supervision_us: u64,
    now_us: u64,
}

impl<B: Board> Controller<B> {
    /// Creates a controller with everything off. It starts in the self-test, or in the fault that was latched before
    /// the reset. A board that is not configured stays unconfigured, whatever `robot` is.
    pub fn new(robot: Robot, identity: BootInfo, mut parts: BoardResources<B>, handover: &Mailbox) -> Self {
        let (copies, retained) = RetainedStore::find(&mut parts.retained);
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
            configuring: ConfigUpload::default(),
            job: ActiveJob::default(),
            motion: MoveTracker::default(),
            heater: HeaterController::default(),
            fan: 0.0,
            thermistor: Oversampler::default(),
            supply: Oversampler::default(),
            inputs: InputMonitor::default(),
            readings: SensorReadings::default(),
            proof: LivenessCheck::default(),
            ticks: StepTickMonitor::default(),
            motors_energised: false,
            calls: handover.link_emergency_stops(),
            presses: 0,
            sectors: 0,
            state_entered_us: 0,
            next_supervision_us: 0,
            now_us: 0,
        };
        controller.switch_off(handover);
        controller.motion.set_retracted_steps(controller.retained.retracted_steps);
        if identity.configured {
            controller.restore_job(unknown.is_some());
        }
        controller.restore_fault(unknown);
        controller
    }

    /// Processes a byte from the host. An emergency stop is recognised earlier, where the byte arrives.
    pub fn receive(&mut self, byte: u8, handover: &Mailbox) {
        if let Some(Ok(frame)) = self.link.receive(byte) {
            self.handle_frame(&frame, handover);
        }
    }

    /// Removes and returns the next byte to send to the host. `None` if there is nothing to send.
    pub fn next_tx_byte(&mut self) -> Option<u8> {
        self.link.next_tx_byte()
    }

    /// Returns the state of the robot.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the latched fault. `None` if no fault is latched.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Returns the number of layers of the job that are laid.
    pub fn layers_laid(&self) -> u32 {
        self.job.layers_laid
    }

    /// Returns the target of the nozzle's temperature, degrees Celsius. `None` if the heater is off.
    pub fn target_c(&self) -> Option<f64> {
        self.heater.target()
    }

    /// Does everything that is due at time `now`, us since the board's start.
    pub fn poll(&mut self, now: u64, handover: &Mailbox) {
        self.now_us = now;
        if let Some(raw) = self.parts.thermistor.sample() {
            self.thermistor.add(raw);
        }
        if let Some(raw) = self.parts.supply.sample() {
            self.supply.add(raw);
        }
        self.proof.sampler = true;
        self.parts.drivers.poll(now, may_heat(self.state));
        self.handle_emergency_stop(handover);
        if self.heater.is_powered_without_reading(now) {
            self.latch_fault(Fault::ThermistorSilent, handover);
        }
        if now >= self.next_supervision_us {
            self.next_supervision_us = now.saturating_add(heater::PERIOD_US);
            self.supervise(handover);
        }
        while let Some(report) = handover.pop_ended_move() {
            self.handle_report(report, handover);
        }
        if let Some(alarm) = handover.pop_report() {
            self.handle_report(alarm, handover);
        }
        self.advance_growth(handover);
        self.report_layers();
        self.link.send_events(now);
    }

    /// Switches everything off if an emergency stop has occurred since the last call. Acknowledges an emergency stop
    /// that was received over the link.
    fn handle_emergency_stop(&mut self, handover: &Mailbox) {
        let (calls, presses) = (handover.link_emergency_stops(), handover.emergency_stop_presses());
        if handover.is_emergency_stopped() || calls != self.calls || presses != self.presses {
            self.latch_emergency_stop(handover);
        }
        self.presses = presses;
        if calls != self.calls {
            self.calls = calls;
            self.link.broadcast(&Message::EmergencyStopAck(Empty {}));
        }
    }

    /// Applies an event to the state machine. Returns `false` if the current state ignores the event.
    fn apply_event(&mut self, event: Event) -> bool {
        let Some(state) = next_state(self.state, event) else { return false };
        if self.state != state {
            self.state = state;
            self.state_entered_us = self.now_us;
            self.retain();
            self.link.push_event(link::HostEvent::State(StateChanged { state, fault: self.fault }));
        }
        true
    }

    /// Returns the time since the robot's current state was entered, us.
    fn in_state_us(&self) -> u64 {
        self.now_us.saturating_sub(self.state_entered_us)
    }

    /// Writes the state that the next start needs into the memory that survives a reset.
    fn retain(&mut self) {
        self.retained.retracted_steps = self.motion.behind();
        let ActiveJob { plan_id, layers_laid: laid, layers_begun: given, .. } = self.job;
        let under_way = ActiveWork {
            state: self.state,
            plan_id,
            layers_laid: laid,
            layers_begun: given,
            sectors_done: self.sectors,
        };
        self.retained.under_way = (may_heat(self.state) || self.state == State::Parked).then_some(under_way);
        self.copies.write(&mut self.parts.retained, &self.retained);
    }

    /// Returns the status that the board reports to the host.
    fn status(&self) -> Status {
        Status {
            state: self.state,
            fault: self.fault,
            temperature_centi_c: self.heater.temperature(self.now_us).map(centi),
            target_centi_c: self.heater.target().map(centi),
            duty: self.duty(),
            plan_id: self.job.plan_id,
            layer_count: self.job.layer_count,
            next_layer: self.store().next_index(),
            layers_laid: self.job.layers_laid,
            interrupted: self.job.interrupted,
            pause_cause: self.pause_cause(),
            is_resumable: !self.job.journal_failed,
            uptime_ms: self.now_us / 1000,
        }
    }

    /// Returns the duty of the heater, 0 to 65,535.
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

/// Converts degrees Celsius to hundredths of a degree, rounded.
fn centi(celsius: f64) -> i32 {
    libm::rint(celsius * 100.0) as i32
}
