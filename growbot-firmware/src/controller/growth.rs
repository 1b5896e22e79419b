//! The moves for the step engine: homing, layers, and the filament that is pulled back for a pause and pushed forward
//! again after it.

use growbot_core::layer_bytes::{self, LayerBytes, LayerEncoder, RawLayer};
use growbot_core::link::message::{Fault, PauseCause, State};
use growbot_core::robot::HeadRotation;

use super::Controller;
use super::move_tracker::MaintenanceMove;
use crate::hal::{Board, StepperDrivers};
use crate::journal;
use crate::safety::transitions::Event;
use crate::stepping::{AxisMove, HomingMove, Mailbox, MotorDirection, Move, Report, TurnReport, as_built};

/// Time for which the heater already gets the power for the first layer after homing or a pause before the plastic of
/// that layer flows, s. Power takes seconds from the heater to the nozzle (docs/decisions/0022-heater-regulation.md;
/// `tests/no_false_alarms.rs` bounds the value).
const LEAD_S: f64 = 1.5;
/// Upper limit of the time [`LEAD_S`], as a share of a layer's period (decision 0022).
const MAX_LEAD_SHARE: f64 = 1.0 / 12.0;

/// Min time for which a paused robot without filament waits for new filament before it parks, s. 3D printers wait for
/// an hour too.
const WAITS_FOR_FILAMENT_S: f64 = 3600.0;

impl<B: Board> Controller<B> {
    /// Handles a report of the step engine.
    pub(super) fn handle_report(&mut self, report: Report, handover: &Mailbox) {
        let fault = match report {
            Report::IndexNotFound => Fault::IndexNotFound,
            Report::IndexMissing => Fault::IndexMissing,
            Report::IndexStuck => Fault::IndexStuck,
            Report::HeadStepsLost => Fault::HeadStepsLost,
            Report::FilamentJam => Fault::FilamentJam,
            Report::Hardware => Fault::Hardware,
            Report::Homed | Report::Laid(_) | Report::Fed | Report::Rotated => {
                return self.handle_ended_move(report, handover);
            }
        };
        self.latch_fault(fault, handover);
    }

    /// Handles the report of a move that has ended. The function latches no fault, so the caller can call it while a
    /// fault is latched.
    pub(super) fn handle_ended_move(&mut self, report: Report, handover: &Mailbox) {
        let growing = matches!(self.state, State::Growing | State::Paused);
        match report {
            Report::Homed | Report::Fed | Report::Rotated if self.motion.finish_maintenance(self.now_us) => {
                self.retain();
            }
            Report::Homed if self.state == State::Homing => {
                self.motion.on_reported(self.now_us);
                self.motion.next_turn = MotorDirection::Forward;
                self.apply_event(Event::Homed);
            }
            Report::Laid(turn) if growing => {
                self.motion.on_reported(self.now_us);
                self.record_turn(&turn, handover);
            }
            Report::Fed if growing => {
                self.motion.on_reported(self.now_us);
                if self.motion.feeding.take() == Some(MotorDirection::Forward) {
                    self.motion.retracted_steps = 0;
                    self.retain();
                }
            }
            // All other reports are late: they belong to moves from before everything was switched off.
            _ => {}
        }
    }

    /// Records a laid layer in the journal. After the last layer of the job, also switches everything off and ends the
    /// job. [`Self::report_layers`] later reports the layer to the host.
    pub(super) fn record_turn(&mut self, turn: &TurnReport, handover: &Mailbox) {
        let measured = self.measure(handover);
        self.commit(LayerEncoder::default().encode(&as_built(&turn.feed, &self.robot)), measured);
        self.sectors = 0;
        self.retain();
        if self.job.layers_laid == self.job.layer_count {
            self.switch_off(handover);
            self.end_job();
            self.apply_event(Event::Finished);
        }
    }

    /// Starts the next move of the growth if its conditions are met: homes the head once the nozzle is hot, submits the
    /// next layer to the step engine, or begins or ends a pause.
    pub(super) fn advance_growth(&mut self, handover: &Mailbox) {
        match self.state {
            State::Heating if self.heater.is_steady(self.now_us) && self.parts.drivers.are_configured() => {
                self.home(handover);
            }
            State::Growing if handover.can_accept_move() && self.motion.feeding.is_none() => {
                self.lay_or_pause(handover);
            }
            State::Paused if self.motion.feeding.is_none() && self.motion.maintained.is_none() => {
                self.pause_or_continue(handover);
            }
            _ => {}
        }
    }

    fn home(&mut self, handover: &Mailbox) {
        let homing = self.homing();
        let seconds = self.homing_s(&homing);
        handover.submit(Move::Home(homing));
        self.motion.on_submitted(seconds, self.now_us);
        self.apply_event(Event::TemperatureReached);
    }

    /// Returns the max duration of a homing move, s.
    pub(super) fn homing_s(&self, homing: &HomingMove) -> f64 {
        let steps = f64::from(homing.max_steps) + f64::from(homing.steps_to_zero);
        steps * f64::from(homing.ticks_per_step) / f64::from(self.robot.description().motion.tick_hz)
    }

    /// Returns the homing move of this robot.
    pub(super) fn homing(&self) -> HomingMove {
        let description = self.robot.description();
        let head = &description.head;
        let steps = f64::from(head.steps_per_turn);
        let steps_a_second = steps * head.homing_turns_per_s;
        let index = growbot_core::angle::wrap_positive(growbot_core::angle::radians(head.index_angle_deg));
        let index_steps = libm::rint(index / core::f64::consts::TAU * steps) as u32;
        HomingMove {
            ticks_per_step: (f64::from(description.motion.tick_hz) / steps_a_second).max(2.0) as u32,
            // A turn to pass the mark, and half a turn in case the head starts within the mark.
            max_steps: head.steps_per_turn + head.steps_per_turn / 2,
            steps_to_zero: if index_steps == 0 { 0 } else { head.steps_per_turn.saturating_sub(index_steps) },
        }
    }

    /// Submits the next layer to the step engine. Pauses instead if no layer is stored or if a pause is requested.
    fn lay_or_pause(&mut self, handover: &Mailbox) {
        if self.job.layers_begun == self.job.layer_count {
            return;
        }
        let next = self.store().get(self.job.layers_begun).filter(|_| self.motion.pause.is_none());
        let Some(bytes) = next else {
            // The current layer is finished first.
            if self.job.layers_laid == self.job.layers_begun {
                self.apply_event(Event::LayersExhausted);
                self.feed(MotorDirection::Backward, handover);
            }
            return;
        };
        if self.motion.retracted_steps > 0 {
            self.feed(MotorDirection::Forward, handover);
            return;
        }
        if self.is_in_power_lead() {
            return;
        }
        let alternates = self.robot.description().motion.turning == HeadRotation::Alternate;
        let direction = if alternates { self.motion.next_turn } else { MotorDirection::Forward };
        match self.job.material.next_turn(&bytes, &self.robot, direction) {
            Ok(turn) => {
                let period_s = self.robot.description().layer.period_s;
                self.note_begun();
                handover.submit(Move::Lay(turn));
                self.motion.on_submitted(period_s, self.now_us);
                self.motion.next_turn = direction.opposite();
                self.job.layers_begun += 1;
                // The queue is not full, because no more than two turns are outstanding.
                let _ = self.job.carries.push_back(journal::LayerRecord {
                    as_built: LayerBytes::default(),
                    height_units: RawLayer::from_bytes(&bytes).height,
                    residual_lean: self.job.material.carry().residual_lean,
                });
                self.retain();
            }
            Err(_) => self.latch_fault(Fault::StepRate, handover),
        }
    }

    /// Returns the number of feed steps by which filament is pulled back for a pause.
    pub(super) fn retract_steps(&self) -> u32 {
        let feed = &self.robot.description().feed;
        libm::rint(feed.retract_mm * feed.steps_per_mm) as u32
    }

    /// Starts the filament move that pulls filament back for a pause, or pushes it forward to the nozzle after a pause.
    fn feed(&mut self, direction: MotorDirection, handover: &Mailbox) {
        let description = self.robot.description();
        let feed = &description.feed;
        // Filament that maintenance has pulled back already counts.
        let steps = match direction {
            MotorDirection::Forward => self.motion.retracted_steps,
            MotorDirection::Backward => self.retract_steps().saturating_sub(self.motion.retracted_steps),
        };
        if steps == 0 {
            return;
        }
        let steps_a_second = feed.retract_mm_per_s * feed.steps_per_mm;
        let ticks_per_step = (f64::from(description.motion.tick_hz) / steps_a_second).max(2.0) as u32;
        handover.submit(Move::Feed(AxisMove { steps, direction, ticks_per_step, changes_filament: false }));
        self.motion.on_submitted(f64::from(steps) / steps_a_second, self.now_us);
        self.motion.feeding = Some(direction);
        if direction == MotorDirection::Backward {
            // As in maintenance, a move that is cut off counts with its full length.
            self.motion.retracted_steps += steps;
            self.retain();
        }
    }

    /// Handles a pause. The growth continues as soon as a layer is stored and the nozzle is hot. Otherwise the nozzle
    /// first cools to standby and the robot later parks, each after its own timeout.
    fn pause_or_continue(&mut self, handover: &Mailbox) {
        let description = self.robot.description();
        let (heater, pause) = (&description.heater, &description.pause);
        let continues = self.motion.pause.is_none() && self.store().get(self.job.layers_begun).is_some();
        let paused_s = self.in_state_us() as f64 * 1e-6;
        let target = if continues || paused_s < pause.standby_after_s {
            heater.target_c
        } else {
            pause.standby_c.min(heater.target_c)
        };
        let off_after_s = match self.motion.pause {
            Some(PauseCause::FilamentOut) => pause.off_after_s.max(WAITS_FOR_FILAMENT_S),
            _ => pause.off_after_s,
        };
        if !continues && paused_s >= off_after_s {
            let cause = self.motion.pause;
            self.switch_off(handover);
            self.motion.pause = cause;
            self.apply_event(Event::PauseTimeout);
            return;
        }
        if self.heater.target() != Some(target) {
            self.heater.set_target(target, self.now_us);
        } else if continues && self.heater.is_steady(self.now_us) {
            self.apply_event(Event::LayersAvailable);
        }
    }

    /// Makes the current pause last until the host requests that the growth continue.
    pub(super) fn wait_for_start(&mut self) {
        self.motion.pause.get_or_insert(PauseCause::Requested);
    }

    /// Sets the reason for a pause after the current layer. `None` cancels the pause.
    pub(super) fn set_pause(&mut self, pause: Option<PauseCause>) {
        self.motion.pause = pause;
    }

    /// Returns the reason for which the robot waits, or will wait once the current layer is laid.
    pub(super) fn pause_cause(&self) -> PauseCause {
        self.motion.pause.unwrap_or_default()
    }

    /// Returns whether the heater already gets the power for the first layer after homing or a pause while that layer
    /// waits, for up to 1.5 s.
    fn is_in_power_lead(&self) -> bool {
        let lead_s = LEAD_S.min(MAX_LEAD_SHARE * self.robot.description().layer.period_s);
        let waits = self.state == State::Growing && self.motion.outstanding == 0;
        waits && (self.in_state_us() as f64) < lead_s * 1e6
    }

    /// Returns the flow of plastic that the heater must melt now, mm^3/s. While the step engine feeds, the flow follows
    /// from the engine's feed rate, which varies in a bend and from layer to layer. Before the first layer begins, the
    /// flow is the mean flow of that layer.
    pub(super) fn plastic_flow_mm3_per_s(&self, handover: &Mailbox) -> f64 {
        if let Some(MaintenanceMove::Filament { flow, .. }) = self.motion.maintained {
            return flow;
        }
        if self.state != State::Growing {
            return 0.0;
        }
        let description = self.robot.description();
        if self.is_in_power_lead() {
            let next = self.store().get(self.job.layers_begun);
            let height = next.map_or(0.0, |bytes| layer_bytes::decode(&bytes).height);
            return height * self.robot.wall_area() / description.layer.period_s;
        }
        let mm_per_s =
            handover.feed_steps_per_tick() * f64::from(description.motion.tick_hz) / description.feed.steps_per_mm;
        mm_per_s * self.robot.filament_area()
    }
}
