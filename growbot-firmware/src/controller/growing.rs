//! The orders to the step engine: homing, layers, and filament that is pulled back for a pause and pushed forward again
//! after it.

use growbot_core::layer_bytes::{self, Encoder, Fields, LayerBytes};
use growbot_core::link::message::{Fault, PauseCause, State};
use growbot_core::robot::Turning;

use super::Controller;
use crate::hal::{Board, Drivers};
use crate::journal;
use crate::safety::transitions::Event;
use crate::stepping::{AxisMove, Handover, Homing, Order, Report, TurnReport, as_built};

/// The share of its time that an order may take longer.
const ALLOWANCE: f64 = 0.2;
/// The time that any order may take longer on top of that, us.
const ALLOWANCE_US: u64 = 2_000_000;

/// Time by which the power for a first layer leads its plastic, s, since power takes seconds from the heater to the
/// nozzle (docs/decisions/0022-heater-regulation.md; `tests/normal_growth.rs` bounds it).
const LEAD_S: f64 = 1.5;
/// The max lead as a share of a layer's period (decision 0022).
const MAX_LEAD_SHARE: f64 = 1.0 / 12.0;

/// The min time for which a robot waits for filament before it parks, s: an hour, as 3D printers do.
const WAITS_FOR_FILAMENT_S: f64 = 3600.0;

/// The orders given to the step engine, and where they left head and filament.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    /// Number of orders given and not yet reported.
    outstanding: u8,
    /// The latest time at which the first of them must be reported, us.
    due: Option<u64>,
    /// The time that the order given last may take, us.
    latest_us: u64,
    /// The direction in which filament is moved without a layer.
    feeding: Option<Feeding>,
    /// What maintenance moves.
    maintained: Option<Maintained>,
    /// Steps that the filament is behind the nozzle: it was pulled back for a pause, or by maintenance.
    behind: u32,
    /// The next turn goes back to where the one before came from.
    backwards: bool,
    /// The reason for a pause after the layer under way, if one was asked for.
    pause: Option<PauseCause>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Feeding {
    Back,
    Forward,
}

/// A move of maintenance under way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Maintained {
    /// The head.
    Head,
    /// Filament.
    Filament {
        /// Flow through the nozzle, mm^3/s; 0 backwards.
        flow: f64,
        /// Steps forwards.
        forward: u32,
        /// Steps backwards.
        back: u32,
    },
}

impl Motion {
    /// Whether an order is under way.
    pub fn is_under_way(&self) -> bool {
        self.outstanding > 0
    }

    /// Whether maintenance moves something.
    pub fn maintains_something(&self) -> bool {
        self.maintained.is_some()
    }

    /// Notes a move of maintenance that should take this time.
    pub fn maintains(&mut self, what: Maintained, seconds: f64, now: u64) {
        if let Maintained::Filament { back, .. } = what {
            // One that is cut off has perhaps pulled as much: too much is asked back rather than too little.
            self.behind = self.behind.saturating_add(back);
        }
        self.maintained = Some(what);
        self.given(seconds, now);
    }

    /// Whether maintenance moves filament.
    pub fn feeds_for_maintenance(&self) -> bool {
        matches!(self.maintained, Some(Maintained::Filament { .. }))
    }

    /// Notes the end of a move of maintenance. False where there was none.
    fn maintained(&mut self, now: u64) -> bool {
        let Some(what) = self.maintained.take() else { return false };
        self.reported(now);
        if let Maintained::Filament { forward, .. } = what {
            self.behind = self.behind.saturating_sub(forward);
        }
        true
    }

    /// Forgets the orders under way. Where the filament is stays known.
    pub fn halt(&mut self) {
        *self = Self { behind: self.behind, ..Self::default() };
    }

    /// Sets how many steps the filament is behind the nozzle, after a start of the board.
    pub fn assume_behind(&mut self, steps: u32) {
        self.behind = steps;
    }

    /// Steps that the filament is behind the nozzle.
    pub fn behind(&self) -> u32 {
        self.behind
    }

    /// Whether filament is pushed for maintenance.
    pub fn loads(&self) -> bool {
        matches!(self.maintained, Some(Maintained::Filament { forward: 1.., .. }))
    }

    /// Whether the engine has failed to report in time.
    pub fn is_overdue(&self, now: u64) -> bool {
        self.due.is_some_and(|due| now > due)
    }

    /// Notes an order that should take this time.
    fn given(&mut self, seconds: f64, now: u64) {
        self.latest_us = (seconds * (1.0 + ALLOWANCE) * 1e6) as u64 + ALLOWANCE_US;
        if self.outstanding == 0 {
            self.due = Some(now.saturating_add(self.latest_us));
        }
        self.outstanding = self.outstanding.saturating_add(1);
    }

    /// Notes the report of an order.
    fn reported(&mut self, now: u64) {
        self.outstanding = self.outstanding.saturating_sub(1);
        self.due = (self.outstanding > 0).then_some(now.saturating_add(self.latest_us));
    }
}

impl<B: Board> Controller<B> {
    /// Handles a report of the step engine.
    pub(super) fn handle_report(&mut self, report: Report, handover: &Handover) {
        let growing = matches!(self.state, State::Growing | State::Paused);
        match report {
            Report::Homed | Report::Fed | Report::Rotated if self.motion.maintained(self.now) => {}
            Report::Homed if self.state == State::Homing => {
                self.motion.reported(self.now);
                self.motion.backwards = false;
                self.happens(Event::Homed);
            }
            Report::Laid(turn) if growing => {
                self.motion.reported(self.now);
                self.count(&turn, handover);
            }
            Report::Fed if growing => {
                self.motion.reported(self.now);
                let back = self.motion.feeding.take() == Some(Feeding::Back);
                self.motion.behind = if back { self.retract_steps() } else { 0 };
            }
            Report::IndexNotFound => self.fail(Fault::IndexNotFound, handover),
            Report::IndexMissing => self.fail(Fault::IndexMissing, handover),
            Report::IndexStuck => self.fail(Fault::IndexStuck, handover),
            Report::HeadStepsLost => self.fail(Fault::HeadStepsLost, handover),
            Report::FilamentJam => self.fail(Fault::FilamentJam, handover),
            Report::Hardware => self.fail(Fault::Hardware, handover),
            // Reports of orders that were under way when everything was switched off.
            Report::Homed | Report::Laid(_) | Report::Fed | Report::Rotated => {}
        }
    }

    /// Counts a layer as laid, in the journal and then for the host.
    pub(super) fn count(&mut self, turn: &TurnReport, handover: &Handover) {
        let measured = self.measure(handover);
        self.commit(Encoder::default().encode(&as_built(&turn.feed, &self.robot)), measured);
        self.sectors = 0;
        self.retain();
        if self.job.laid == self.job.layers {
            self.switch_off(handover);
            self.end_job();
            self.happens(Event::Finished);
        }
    }

    /// Takes the next step of the growth if everything is there for it.
    pub(super) fn proceed(&mut self, handover: &Handover) {
        match self.state {
            State::Heating if self.heater.is_steady(self.now) && self.parts.drivers.are_configured() => {
                self.home(handover);
            }
            State::Growing if handover.accepts_orders() && self.motion.feeding.is_none() => self.lay_or_pause(handover),
            State::Paused if self.motion.feeding.is_none() && self.motion.maintained.is_none() => {
                self.pause_or_continue(handover);
            }
            _ => {}
        }
    }

    fn home(&mut self, handover: &Handover) {
        let homing = self.homing();
        let seconds = self.homing_s(&homing);
        handover.give(Order::Home(homing));
        self.motion.given(seconds, self.now);
        self.happens(Event::Hot);
    }

    /// The max time of a homing, s.
    pub(super) fn homing_s(&self, homing: &Homing) -> f64 {
        let steps = f64::from(homing.max_steps) + f64::from(homing.steps_to_zero);
        steps * f64::from(homing.ticks_per_step) / f64::from(self.robot.description().motion.tick_hz)
    }

    /// The homing of this robot.
    pub(super) fn homing(&self) -> Homing {
        let description = self.robot.description();
        let head = &description.head;
        let steps = f64::from(head.steps_per_turn);
        let steps_a_second = steps * head.homing_turns_per_s;
        let index = growbot_core::angle::wrap_positive(growbot_core::angle::radians(head.index_angle_deg));
        let index_steps = libm::rint(index / core::f64::consts::TAU * steps) as u32;
        Homing {
            ticks_per_step: (f64::from(description.motion.tick_hz) / steps_a_second).max(2.0) as u32,
            // A turn to pass the mark, and half a turn for a start within it.
            max_steps: head.steps_per_turn + head.steps_per_turn / 2,
            steps_to_zero: if index_steps == 0 { 0 } else { head.steps_per_turn.saturating_sub(index_steps) },
        }
    }

    /// While growing: lays the next layer, or pauses.
    fn lay_or_pause(&mut self, handover: &Handover) {
        if self.job.given == self.job.layers {
            return;
        }
        let next = self.store().get(self.job.given).filter(|_| self.motion.pause.is_none());
        let Some(bytes) = next else {
            // The layer under way is finished first.
            if self.job.laid == self.job.given {
                self.happens(Event::LayersExhausted);
                self.feed(Feeding::Back, handover);
            }
            return;
        };
        if self.motion.behind > 0 {
            self.feed(Feeding::Forward, handover);
            return;
        }
        if self.leads() {
            return;
        }
        let backwards = self.robot.description().motion.turning == Turning::Alternate && self.motion.backwards;
        match self.job.material.lay(&bytes, &self.robot, backwards) {
            Ok(turn) => {
                let period_s = self.robot.description().layer.period_s;
                self.note_begun();
                handover.give(Order::Lay(turn));
                self.motion.given(period_s, self.now);
                self.motion.backwards = !backwards;
                self.job.given += 1;
                // There is room: no more than two turns are under way.
                let _ = self.job.carries.push_back(journal::Laid {
                    as_built: LayerBytes::default(),
                    height_units: Fields::of(&bytes).height,
                    lean_owed: self.job.material.carry().lean_owed,
                });
                self.retain();
            }
            Err(_) => self.fail(Fault::StepRate, handover),
        }
    }

    /// Steps that filament is pulled back for a pause.
    pub(super) fn retract_steps(&self) -> u32 {
        let feed = &self.robot.description().feed;
        libm::rint(feed.retract_mm * feed.steps_per_mm) as u32
    }

    /// Pulls filament back for a pause, or pushes it forward to the nozzle again.
    fn feed(&mut self, feeding: Feeding, handover: &Handover) {
        let description = self.robot.description();
        let feed = &description.feed;
        let backwards = feeding == Feeding::Back;
        // What maintenance has pulled back counts.
        let steps =
            if backwards { self.retract_steps().saturating_sub(self.motion.behind) } else { self.motion.behind };
        if steps == 0 {
            return;
        }
        let steps_a_second = feed.retract_mm_per_s * feed.steps_per_mm;
        let ticks_per_step = (f64::from(description.motion.tick_hz) / steps_a_second).max(2.0) as u32;
        handover.give(Order::Feed(AxisMove { steps, backwards, ticks_per_step, changes_filament: false }));
        self.motion.given(f64::from(steps) / steps_a_second, self.now);
        self.motion.feeding = Some(feeding);
    }

    /// While paused: continues as soon as there is a layer and the nozzle is hot; otherwise lets the nozzle cool to
    /// standby and parks, each after its time.
    fn pause_or_continue(&mut self, handover: &Handover) {
        let description = self.robot.description();
        let (heater, pause) = (&description.heater, &description.pause);
        let continues = self.motion.pause.is_none() && self.store().get(self.job.given).is_some();
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
            self.happens(Event::PausedTooLong);
            return;
        }
        if self.heater.target() != Some(target) {
            self.heater.set_target(target, self.now);
        } else if continues && self.heater.is_steady(self.now) {
            self.happens(Event::LayersAvailable);
        }
    }

    /// A pause lasts until somebody orders the growth to continue.
    pub(super) fn wait_for_start(&mut self) {
        self.motion.pause.get_or_insert(PauseCause::Requested);
    }

    /// Sets or clears the reason for a pause after the layer under way.
    pub(super) fn set_pause(&mut self, pause: Option<PauseCause>) {
        self.motion.pause = pause;
    }

    /// The reason for which the robot waits, or will wait once the layer under way is laid.
    pub(super) fn pause_cause(&self) -> PauseCause {
        self.motion.pause.unwrap_or_default()
    }

    /// Whether the power for a first layer leads it at this moment.
    fn leads(&self) -> bool {
        let lead_s = LEAD_S.min(MAX_LEAD_SHARE * self.robot.description().layer.period_s);
        let waits = self.state == State::Growing && self.motion.outstanding == 0;
        waits && (self.in_state_us() as f64) < lead_s * 1e6
    }

    /// The flow that the heater must melt now, mm^3/s: what the step engine feeds, which varies in a bend and from
    /// layer to layer; or the mean of the first layer, before that begins.
    pub(super) fn flow(&self, handover: &Handover) -> f64 {
        if let Some(Maintained::Filament { flow, .. }) = self.motion.maintained {
            return flow;
        }
        if self.state != State::Growing {
            return 0.0;
        }
        let description = self.robot.description();
        if self.leads() {
            let next = self.store().get(self.job.given);
            let height = next.map_or(0.0, |bytes| layer_bytes::decode(&bytes).height);
            return height * self.robot.wall_area() / description.layer.period_s;
        }
        let mm_per_s = handover.feed_rate() * f64::from(description.motion.tick_hz) / description.feed.steps_per_mm;
        mm_per_s * self.robot.filament_area()
    }
}
