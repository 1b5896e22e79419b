//! Maintenance: heating, feeding and turning without a job, and changing filament in a pause. The board chooses the
//! speeds. All actions are limited in time: each move has a max duration, and the heater switches off if no request for
//! maintenance arrives for ten minutes.

use growbot_core::link::message::{Fault, MaintenanceTask, Message, Refusal, State};

use super::move_tracker::MaintenanceMove;
use super::{Controller, centi};
use crate::hal::{Board, StepperDrivers};
use crate::safety::transitions::Event;
use crate::stepping::{AxisMove, Mailbox, MotorDirection, Move};

/// Time without a maintenance request after which heater and motors are switched off, us: ten minutes.
pub const UNATTENDED_US: u64 = 600_000_000;
/// Max duration of one maintenance move, s. The duration is well below [`UNATTENDED_US`].
const MAX_MOVE_S: f64 = 300.0;
/// Angle of a whole turn of the head, hundredths of a degree. One request may turn the head by at most this angle.
const TURN_CENTI_DEG: u32 = 36_000;

impl<B: Board> Controller<B> {
    /// Carries out a maintenance task that the host requests.
    pub(super) fn maintain(&mut self, task: MaintenanceTask, handover: &Mailbox) -> Result<Message, Refusal> {
        match task {
            MaintenanceTask::Preheat { target_centi_c } => self.preheat(f64::from(target_centi_c) / 100.0)?,
            MaintenanceTask::CoolDown => {
                self.check_event(Event::CoolDown)?;
                if self.state == State::Maintenance {
                    self.switch_off(handover);
                }
                self.apply_event(Event::CoolDown);
            }
            MaintenanceTask::Home => {
                self.check_maintenance_move(Event::MoveHead, handover)?;
                let homing = self.homing();
                let seconds = self.homing_s(&homing);
                handover.submit(Move::Home(homing));
                self.motion.start_maintenance(MaintenanceMove::Head, seconds, self.now_us);
            }
            MaintenanceTask::Rotate { centi_deg } => self.rotate(centi_deg, handover)?,
            MaintenanceTask::Feed { um } => self.feed_by(um, handover)?,
            MaintenanceTask::DryRun => self.dry_run()?,
        }
        // The operator is present.
        if matches!(self.state, State::Maintenance | State::Paused) {
            self.state_entered_us = self.now_us;
        }
        Ok(self.accepted())
    }

    fn preheat(&mut self, target_c: f64) -> Result<(), Refusal> {
        self.check_event(Event::Preheat)?;
        let allowed = self.robot.description().heater.preheat_range_c();
        if !allowed.contains(&target_c) {
            return Err(Refusal::TemperatureOutOfRange { min: centi(*allowed.start()), max: centi(*allowed.end()) });
        }
        if self.may_be_halted() {
            return Err(Refusal::DebugProbe);
        }
        if self.motion.is_under_way() {
            return Err(Refusal::StillMoving);
        }
        let growth_c = self.robot.description().heater.target_c;
        if self.state == State::Paused && target_c != growth_c {
            return Err(Refusal::TemperatureOutOfRange { min: centi(growth_c), max: centi(growth_c) });
        }
        match self.state {
            // The pause starts again, and with it the time at the temperature of growth.
            State::Paused => {}
            State::Maintenance if !self.is_dry_run() => self.heater.set_target(target_c, self.now_us),
            _ => self.heater.switch_on(target_c, self.now_us),
        }
        self.apply_event(Event::Preheat);
        Ok(())
    }

    /// Enters maintenance with the heater off, so that head and feed move cold.
    fn dry_run(&mut self) -> Result<(), Refusal> {
        self.check_event(Event::Preheat)?;
        if self.state == State::Paused || self.heater.target().is_some() {
            return Err(Refusal::WrongState { state: self.state });
        }
        if self.may_be_halted() {
            return Err(Refusal::DebugProbe);
        }
        self.apply_event(Event::Preheat);
        Ok(())
    }

    /// Returns whether head and feed may move although the nozzle is cold. Maintenance with the heater off is always
    /// such a dry run.
    pub(super) fn is_dry_run(&self) -> bool {
        self.state == State::Maintenance && self.heater.target().is_none()
    }

    fn rotate(&mut self, centi_deg: i32, handover: &Mailbox) -> Result<(), Refusal> {
        self.check_maintenance_move(Event::MoveHead, handover)?;
        if centi_deg.unsigned_abs() > TURN_CENTI_DEG {
            return Err(Refusal::MoveTooLong { max: TURN_CENTI_DEG });
        }
        let head = &self.robot.description().head;
        let turns = f64::from(centi_deg.unsigned_abs()) / f64::from(TURN_CENTI_DEG);
        let per_s = f64::from(head.steps_per_turn) * head.homing_turns_per_s;
        let steps = turns * f64::from(head.steps_per_turn);
        let (order, seconds) = self.axis_move(steps, per_s, MotorDirection::of(centi_deg), false);
        handover.submit(Move::Rotate(order));
        self.motion.start_maintenance(MaintenanceMove::Head, seconds, self.now_us);
        Ok(())
    }

    /// Feeds filament by a distance in um, in reverse if the distance is negative. The speed forward is the mean speed
    /// of the robot's growth, which its heater can melt. The speed in reverse is the speed at which filament is
    /// retracted before a pause.
    fn feed_by(&mut self, um: i32, handover: &Mailbox) -> Result<(), Refusal> {
        self.check_maintenance_move(Event::MoveFilament, handover)?;
        let direction = MotorDirection::of(um);
        if direction == MotorDirection::Forward && !self.has_filament() {
            return Err(Refusal::NoFilament);
        }
        let (mm, mm_per_s) = (f64::from(um.unsigned_abs()) / 1000.0, self.feed_mm_per_s(direction));
        if mm > mm_per_s * MAX_MOVE_S {
            return Err(Refusal::MoveTooLong { max: (mm_per_s * MAX_MOVE_S * 1000.0) as u32 });
        }
        let steps_per_mm = self.robot.description().feed.steps_per_mm;
        let (order, seconds) = self.axis_move(mm * steps_per_mm, mm_per_s * steps_per_mm, direction, true);
        handover.submit(Move::Feed(order));
        let (flow, forward, back) = match direction {
            MotorDirection::Forward => (mm_per_s * self.robot.filament_area(), order.steps, 0),
            MotorDirection::Backward => (0.0, 0, order.steps),
        };
        self.motion.start_maintenance(MaintenanceMove::Filament { flow, forward, back }, seconds, self.now_us);
        self.retain();
        if self.state == State::Paused {
            // The operator is working at the nozzle and decides when the growth continues.
            self.wait_for_start();
        }
        Ok(())
    }

    fn feed_mm_per_s(&self, direction: MotorDirection) -> f64 {
        let description = self.robot.description();
        let grows = description.layer.height_mm * self.robot.wall_area() / self.robot.filament_area();
        let grows = grows / description.layer.period_s;
        let feed = &description.feed;
        // The move has no ramp, so its speed is limited to the speed at which the motor can start. The engine makes at
        // most one step every two ticks.
        let fastest = f64::from(description.motion.tick_hz) / (2.0 * feed.steps_per_mm);
        let back = feed.retract_mm_per_s.min(feed.speed_jump_mm_per_s).min(fastest);
        if direction == MotorDirection::Forward { grows.min(back) } else { back }
    }

    /// Returns a move of one axis, and the duration of the move, s.
    fn axis_move(
        &self,
        steps: f64,
        steps_per_s: f64,
        direction: MotorDirection,
        changes_filament: bool,
    ) -> (AxisMove, f64) {
        let tick_hz = f64::from(self.robot.description().motion.tick_hz);
        let steps = libm::rint(steps) as u32;
        let ticks_per_step = (tick_hz / steps_per_s).max(2.0) as u32;
        let seconds = f64::from(steps) * f64::from(ticks_per_step) / tick_hz;
        (AxisMove { steps, direction, ticks_per_step, changes_filament }, seconds)
    }

    /// Refuses a maintenance move if the robot's state does not allow it, while another move is in progress, if the
    /// stepper drivers are not configured, or, except in a dry run, if the nozzle is not hot.
    fn check_maintenance_move(&self, event: Event, handover: &Mailbox) -> Result<(), Refusal> {
        self.check_event(event)?;
        let min_c = self.robot.description().heater.extrusion_min_c;
        let now_c = self.heater.temperature(self.now_us).unwrap_or(0.0);
        // The temperature also counts as unsteady while the heater's switches are tested and while it approaches a new
        // target.
        let steady = self.heater.is_steady(self.now_us);
        if (now_c < min_c || !steady) && !self.is_dry_run() {
            let target_c = self.heater.target().unwrap_or(min_c);
            return Err(Refusal::NozzleTooCold {
                now: centi(now_c),
                min: centi(if now_c < min_c { min_c } else { target_c }),
            });
        }
        if self.motion.is_under_way() || !handover.can_accept_move() {
            return Err(Refusal::StillMoving);
        }
        if !self.parts.drivers.are_configured() {
            return Err(Refusal::FaultRemains { fault: Fault::DriverFault });
        }
        Ok(())
    }

    /// Returns whether the presence switch detects filament. Returns `true` if the robot has no such switch.
    pub(super) fn has_filament(&self) -> bool {
        self.readings.filament_present != Some(false)
    }

    /// Switches heater and motors off once no request for maintenance has arrived for [`UNATTENDED_US`].
    pub(super) fn check_maintenance_timeout(&mut self, handover: &Mailbox) {
        if self.state == State::Maintenance && self.in_state_us() >= UNATTENDED_US {
            self.switch_off(handover);
            self.apply_event(Event::MaintenanceTimeout);
        }
    }
}
