//! Supervision of temperature, sensors and watchdog ten times a second, and the reaction to a fault.

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use growbot_core::link::message::{
    DriverProblem, Fault, FaultRecord, HostSilencePolicy, LayerReadings, PauseCause, ResetCause, SensorReadings, State,
};

use super::{Controller, StepTickMonitor, centi};
use crate::hal::{Board, DebugPort, GravitySensor, StepperDrivers, Watchdog};
use crate::heater::{self, Demand, HeaterOutput};
use crate::link;
use crate::safety::input_monitor::{InputSample, MissingFilament, volts};
use crate::safety::retained::{RetainedError, fault_for_reset};
use crate::safety::transitions::{Event, may_feed, may_heat};
use crate::stepping::Mailbox;

/// Min duration of the self-test, us. This time is long enough to detect a problem that counts only if it persists, and
/// an ADC that stops right after the start.
const SELF_TEST_MIN_US: u64 = 600_000;
/// Max time of the self-test, in which every sensor must be found healthy, us. The derivation of this value is not
/// recorded.
const SELF_TEST_MAX_US: u64 = 2_000_000;
/// Time in which the fan accelerates from standstill to full speed, s (docs/decisions/0022-heater-regulation.md;
/// `tests/no_false_alarms.rs` bounds it).
const FAN_RAMP_S: f64 = 10.0;
/// Number of consecutive checks, ten a second, without a step interrupt that raise a fault (SAFETY.md,
/// `steps-stalled`).
const MAX_STALLED_CHECKS: u8 = 3;

impl<B: Board> Controller<B> {
    /// Runs all checks of the supervision once, and feeds the watchdog if the liveness check passes.
    pub(super) fn supervise(&mut self, handover: &Mailbox) {
        self.supervise_board(handover);
        if self.identity.configured {
            self.supervise_tip(handover);
        } else {
            // Nothing heats or moves, and the readings of the tip's sensors have no known meaning without a
            // description.
            (self.proof.regulator, self.proof.steps) = (true, true);
        }
        self.proof.supervisor = true;
        if self.proof.take_if_complete() {
            self.parts.watchdog.feed();
        }
    }

    /// Reads the tip's sensors once, raises the faults that they show, and updates heater, fan and everything else that
    /// depends on them.
    fn supervise_tip(&mut self, handover: &Mailbox) {
        let look = self.read_sensors(handover);
        let grows = matches!(self.state, State::Heating | State::Homing | State::Growing | State::Paused);
        let needs_filament = (grows && self.pause_cause() != PauseCause::FilamentOut)
            || (self.state == State::Maintenance && self.motion.is_loading());
        let missing_filament = if needs_filament { MissingFilament::Fault } else { MissingFilament::Ignored };
        let found = self.inputs.update(&look, self.robot.description(), missing_filament);
        if found == Some(Fault::FilamentOut) && matches!(self.state, State::Growing | State::Paused) {
            // The current layer is finished, unless the filament jams before.
            self.set_pause(Some(PauseCause::FilamentOut));
        } else if let Some(fault) = found
            && (may_heat(self.state) || self.state == State::SelfTest)
        {
            self.latch_fault(fault, handover);
        }
        self.regulate(look.supply_v, handover);
        self.update_fan(handover);
        self.check_step_interrupt(handover);
        if self.state == State::SelfTest {
            self.run_self_test(&look, handover);
        }
        self.pause_on_silence();
        self.check_maintenance_timeout(handover);
        if self.state == State::Growing {
            let sectors = handover.sectors_done().unwrap_or_default();
            // A waiting report may be that of the current layer, and the progress that of the next one.
            if !handover.has_report() {
                self.sectors = sectors as u8;
                self.retain();
            }
        }
    }

    /// Raises a fault if the board itself is unreliable: without its crystal, or if a debug probe may halt it.
    fn supervise_board(&mut self, handover: &Mailbox) {
        let latched = matches!(self.state, State::Fault | State::EmergencyStop);
        if self.identity.crystal_failed && !latched {
            self.latch_fault(Fault::ClockFailed, handover);
        } else if may_heat(self.state) && self.may_be_halted() {
            self.latch_fault(Fault::DebugProbe, handover);
        }
    }

    /// Returns whether a debug probe may halt the processor with the heater on, which would leave the heater
    /// unsupervised.
    pub(super) fn may_be_halted(&self) -> bool {
        self.parts.debug_port.is_on() && !self.robot.description().test_bench
    }

    /// Reads the pulse count of the filament encoder and the direction of gravity at the tip. A value is `None` without
    /// its sensor.
    pub(super) fn measure(&mut self, handover: &Mailbox) -> LayerReadings {
        let sensors = &self.robot.description().sensors;
        LayerReadings {
            filament_pulses: sensors.filament_motion.map(|_| handover.filament_pulses()),
            gravity_milli_g: if sensors.orientation { self.parts.orientation.gravity() } else { None },
        }
    }

    /// Reads every sensor except the thermistor. Publishes all readings, and returns those that can indicate danger.
    fn read_sensors(&mut self, handover: &Mailbox) -> InputSample {
        let description = self.robot.description();
        let sensors = &description.sensors;
        let raw = self.supply.pop_mean();
        // If the pin cannot be read, a fault is assumed.
        let driver_fault = sensors.driver_fault.map(|_| self.parts.driver_fault.is_high().unwrap_or(true));
        let driver_problem = self.parts.drivers.problem();
        let counts = driver_problem.is_some_and(|trouble| self.is_driver_problem_relevant(trouble.problem));
        let look = InputSample {
            supply_v: raw.filter(|_| sensors.supply).map(|raw| volts(raw, &description.supply)),
            // If the pin cannot be read, missing filament is assumed.
            filament_present: sensors
                .filament_presence
                .map(|_| self.parts.filament_presence.is_high().unwrap_or(false)),
            driver_fault: if counts { Some(true) } else { driver_fault },
        };
        let emergency_stop = sensors.emergency_stop.map(|_| handover.is_emergency_stopped());
        let LayerReadings { filament_pulses, gravity_milli_g } = self.measure(handover);
        self.readings = SensorReadings {
            supply_mv: look.supply_v.map(|volts| libm::rint(volts * 1000.0) as u32),
            on_index: handover.on_index(),
            filament_present: look.filament_present,
            filament_pulses,
            driver_fault: if driver_problem.is_some() { Some(true) } else { driver_fault },
            driver_problem,
            emergency_stop,
            gravity_milli_g,
        };
        look
    }

    /// Returns whether a driver's problem is to be treated as a fault now. The self-test ignores a driver that cannot
    /// be configured, because the motors' supply may be switched on later than the board's.
    fn is_driver_problem_relevant(&self, problem: DriverProblem) -> bool {
        self.state != State::SelfTest || !matches!(problem, DriverProblem::Silent | DriverProblem::NotConfigured)
    }

    /// Reads the nozzle's temperature, sets the heater, and latches a fault that the heater or the temperature shows.
    fn regulate(&mut self, supply_v: Option<f64>, handover: &Mailbox) {
        let demand = Demand { flow_mm3_per_s: self.plastic_flow_mm3_per_s(handover), fan: self.fan, supply_v };
        let raw = self.thermistor.pop_mean();
        match self.heater.update(raw, &demand, self.robot.description(), self.now_us) {
            Ok(output) => self.apply_heater_output(output, handover),
            Err(fault) => self.latch_fault(fault, handover),
        }
        self.proof.regulator = true;
        let min_c = self.robot.description().heater.extrusion_min_c;
        let feeds = may_feed(self.state) || (self.motion.feeds_for_maintenance() && !self.is_dry_run());
        if feeds && self.heater.temperature(self.now_us).is_some_and(|temperature| temperature < min_c) {
            self.latch_fault(Fault::UnderTemperature, handover);
        }
        if let Some(tuned) = self.heater.take_tuning_result() {
            self.switch_off(handover);
            self.apply_event(Event::Tuned);
            self.link.push_event(link::HostEvent::Tuned(tuned));
        }
    }

    /// Sets the duty of the heater's power stage and its second switch. Latches a fault if a pin cannot be set.
    fn apply_heater_output(&mut self, output: HeaterOutput, handover: &Mailbox) {
        let duty = (output.duty * f64::from(self.parts.heater_power.max_duty_cycle())) as u16;
        let enabled = if output.enable {
            self.parts.heater_enable.set_high().is_ok()
        } else {
            self.parts.heater_enable.set_low().is_ok()
        };
        if !enabled || self.parts.heater_power.set_duty_cycle(duty).is_err() {
            self.latch_fault(Fault::Hardware, handover);
        }
        // An emergency stop may have arrived over the link while this function switched the heater on.
        self.handle_emergency_stop(handover);
    }

    /// Pauses if the host is silent, unless the host requested at the start of the job that the growth continue in that
    /// case.
    fn pause_on_silence(&mut self) {
        let works = matches!(self.state, State::Heating | State::Homing | State::Growing | State::Paused);
        if works
            && self.job.silence == HostSilencePolicy::Pause
            && self.pause_cause() == PauseCause::LayersExhausted
            && self.link.owner(self.now_us).is_none()
        {
            self.set_pause(Some(PauseCause::HostSilent));
        }
    }

    /// Sets the fan's duty. The fan's speed rises and falls slowly, because power takes seconds from the heater to the
    /// nozzle.
    fn update_fan(&mut self, handover: &Mailbox) {
        let growing = if self.state == State::Growing { self.robot.description().fan.growing_duty } else { 0.0 };
        let step = heater::PERIOD_US as f64 * 1e-6 / FAN_RAMP_S;
        self.fan = if may_heat(self.state) { growing.max(self.fan - step).min(self.fan + step) } else { 0.0 };
        let duty = (self.fan * f64::from(self.parts.fan.max_duty_cycle())) as u16;
        if self.parts.fan.set_duty_cycle(duty).is_err() {
            self.latch_fault(Fault::Hardware, handover);
        }
    }

    /// Raises a fault if the step interrupt does not run, or if a move takes too long.
    fn check_step_interrupt(&mut self, handover: &Mailbox) {
        let StepTickMonitor { ticks: before, looks_without } = self.ticks;
        let ticks = handover.ticks();
        let looks_without = if ticks == before { looks_without.saturating_add(1) } else { 0 };
        self.ticks = StepTickMonitor { ticks, looks_without };
        let works = may_heat(self.state);
        // If a stalled interrupt has left motors energised, only a reset releases them. The watchdog is therefore no
        // longer fed.
        self.proof.steps = ticks != before || !(works || self.motors_energised);
        if looks_without >= MAX_STALLED_CHECKS && (works || self.state == State::SelfTest) {
            self.latch_fault(Fault::StepsStalled, handover);
            self.motors_energised = works;
        }
        if self.motion.is_overdue(self.now_us) {
            self.latch_fault(Fault::MotionOverdue, handover);
        }
    }

    /// Runs the self-test: the robot leaves it once the thermistor and the supply sensor give readings, or with a fault
    /// if they do not in time.
    fn run_self_test(&mut self, look: &InputSample, handover: &Mailbox) {
        let measures = self.heater.temperature(self.now_us).is_some();
        let powered = !self.robot.description().sensors.supply || look.supply_v.is_some();
        if self.in_state_us() < SELF_TEST_MIN_US {
            return;
        }
        if measures && powered {
            self.apply_event(Event::SelfTestPassed);
        } else if self.in_state_us() > SELF_TEST_MAX_US {
            let fault = if measures { Fault::SupplyLow } else { self.heater.sensor_fault() };
            self.latch_fault(fault, handover);
        }
    }

    /// Switches heater, fan and steppers off, and forgets all moves.
    pub(super) fn switch_off(&mut self, handover: &Mailbox) {
        self.switch_outputs_off(handover);
        handover.discard_ended_moves();
        self.motion.halt();
    }

    /// Switches heater, fan and steppers off. Each output is switched even if switching another one fails.
    pub(super) fn switch_outputs_off(&mut self, handover: &Mailbox) {
        self.heater.switch_off();
        let _ = self.parts.heater_enable.set_low();
        let _ = self.parts.heater_power.set_duty_cycle_fully_off();
        let _ = self.parts.fan.set_duty_cycle_fully_off();
        self.fan = 0.0;
        handover.halt();
    }

    /// Switches everything off. Latches the fault, unless an earlier fault or an emergency stop is latched.
    pub(super) fn latch_fault(&mut self, fault: Fault, handover: &Mailbox) {
        let mut record = self.record(Some(fault));
        self.abort_layer(handover);
        record.laid = self.job.layers_laid;
        if !matches!(self.state, State::Fault | State::EmergencyStop) {
            self.fault = Some(fault);
            self.retained.record = Some(record);
            self.apply_event(Event::Fault);
        }
    }

    /// Switches everything off. Latches the emergency stop, unless an earlier fault or emergency stop is latched.
    pub(super) fn latch_emergency_stop(&mut self, handover: &Mailbox) {
        let mut record = self.record(None);
        self.abort_layer(handover);
        record.laid = self.job.layers_laid;
        if !matches!(self.state, State::Fault | State::EmergencyStop) {
            self.retained.record = Some(record);
            self.apply_event(Event::EmergencyStop);
        }
    }

    /// Returns a fault record with the present state of the board. `fault` is `None` for an emergency stop.
    fn record(&self, fault: Option<Fault>) -> FaultRecord {
        FaultRecord {
            fault,
            cleared: false,
            state: self.state,
            uptime_ms: self.now_us / 1000,
            temperature_centi_c: self.heater.temperature(self.now_us).map(centi),
            target_centi_c: self.heater.target().map(centi),
            duty: self.duty(),
            sensors: self.readings,
            plan_id: self.job.plan_id,
            laid: self.job.layers_laid,
            layers_begun: self.job.layers_begun,
        }
    }

    /// Restores the fault after a start. A fault that was never cleared is latched again, and a reset during work is a
    /// fault. A reset is also a fault if the activity before it is unknown although the memory has kept its power.
    pub(super) fn restore_fault(&mut self, unknown: Option<RetainedError>) {
        let cause = self.identity.reset_cause;
        let latched = self.retained.record.is_some_and(|record| !record.cleared);
        if let Some(under_way) = self.retained.under_way {
            let record = FaultRecord {
                fault: Some(fault_for_reset(cause)),
                state: under_way.state,
                plan_id: under_way.plan_id,
                laid: under_way.layers_laid,
                layers_begun: under_way.layers_begun,
                ..self.record(None)
            };
            self.retained.record = Some(record);
        } else if !latched
            && (cause == ResetCause::ClockFailed || unknown.is_some_and(|unknown| unknown.is_fault(cause)))
        {
            self.retained.record = Some(self.record(Some(fault_for_reset(cause))));
        }
        if self.identity.is_corrupt() {
            // With a corrupt image nothing is reliable, so this fault comes first.
            self.retained.record = Some(self.record(Some(Fault::ImageCorrupt)));
        }
        if let Some(FaultRecord { fault, cleared: false, .. }) = self.retained.record {
            self.fault = fault;
            self.apply_event(if fault.is_some() { Event::Fault } else { Event::EmergencyStop });
        }
        self.retain();
    }
}
