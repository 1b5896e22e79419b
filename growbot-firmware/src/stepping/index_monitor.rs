//! Monitor of the index mark. In every turn it checks that the head is at the position that its steps give.
//!
//! The head's position is known since homing. At each step of the head the sensor must detect the mark if the head is
//! on it, and must not detect it elsewhere. Within a tolerance around both edges of the mark either is allowed. Only
//! two consecutive samples that contradict the head's position count, so that a single disturbed sample raises no
//! alarm. The check is the same in both directions of turning.
//!
//! The mark must be detected from its beginning to its end, less `index_tolerance_deg` on both sides. It must not be
//! detected outside the mark and the tolerance. If a contradiction persists, the engine releases the motors by itself
//! and reports:
//!
//! | detected | report |
//! |---|---|
//! | not at its position, nor elsewhere by the end of the turn | `IndexMissing` |
//! | elsewhere, or late, or not through its whole width, then off | `HeadStepsLost` |
//! | elsewhere, and on for a quarter of a turn longer than mark and tolerances | `IndexStuck` |
//! | in homing, for longer than mark and tolerance | `IndexStuck` |
//! | in homing, never | `IndexNotFound` |
//!
//! An edge may be off by a step more than the tolerance. A mark narrower than its tolerances must be detected once
//! within them. If steps are lost so late in a turn that the mark comes only after the turn's end, the report is
//! `IndexMissing`.

use embedded_hal::digital::InputPin;
use growbot_core::angle::{radians, wrap_positive};
use growbot_core::robot::Robot;

use super::direction::MotorDirection;
use super::mailbox::Mailbox;
use super::moves::EngineFault;

/// Number of consecutive samples of the index sensor that must contradict the head's position before an alarm is
/// raised.
const MIN_CONTRADICTING_SAMPLES: u32 = 2;

/// Position and tolerances of the index mark, in head steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct IndexWindow {
    steps_per_turn: u32,
    /// Position of the tip's x axis, in head steps from the beginning of the tolerance before the index mark.
    zero: u32,
    /// Width of the index mark with the tolerance on both sides. A working sensor detects the mark only within this
    /// width.
    reach: u32,
    /// Beginning of the range in which the index mark must be detected, in head steps from the beginning of the
    /// tolerance before the mark.
    certain_from: u32,
    /// End of the range in which the index mark must be detected. The range is empty if the mark is narrower than the
    /// tolerances.
    certain_to: u32,
    /// Max number of consecutive head steps at which the sensor may detect the index mark during homing.
    pub longest: u32,
    /// Number of consecutive head steps with a detected index mark beyond which the sensor counts as stuck, because
    /// lost steps cannot be the reason.
    stuck: u32,
}

impl IndexWindow {
    pub fn of(robot: &Robot) -> Self {
        let head = &robot.description().head;
        let steps_per_turn = head.steps_per_turn.max(1);
        let steps = |degrees: f64| libm::rint(degrees / 360.0 * f64::from(steps_per_turn)) as u32;
        let begin = libm::rint(
            wrap_positive(radians(head.index_angle_deg)) / core::f64::consts::TAU * f64::from(steps_per_turn),
        ) as u32;
        let (width, tolerance) = (steps(head.index_width_deg), steps(head.index_tolerance_deg));
        let zero = (steps_per_turn + tolerance).saturating_sub(begin);
        Self {
            steps_per_turn,
            zero: if zero >= steps_per_turn { zero - steps_per_turn } else { zero },
            reach: width + 2 * tolerance,
            certain_from: 2 * tolerance,
            certain_to: width,
            longest: width + tolerance,
            stuck: width + 2 * tolerance + steps_per_turn / 4,
        }
    }
}

/// State of the monitor of the index mark: the head's position, and the samples of the index sensor in the current
/// turn.
pub(super) struct IndexMonitor {
    /// Position of the head, in head steps from the beginning of the tolerance before the index mark. `None` unless the
    /// head has homed since its motor was last energised.
    place: Option<u32>,
    direction: MotorDirection,
    /// Number of consecutive samples in which the index mark was detected.
    seen_for: u32,
    /// Number of consecutive samples in which the index mark was detected outside its position. `absent_for` is the
    /// number of consecutive samples in which it was missing at its position.
    stray_for: u32,
    absent_for: u32,
    /// True if the index mark was detected at its position in the current turn.
    seen: bool,
    /// True if the index mark was not detected at its position in the current turn.
    absent: bool,
    /// True once [`MIN_CONTRADICTING_SAMPLES`] consecutive samples have detected the index mark outside its position.
    stray: bool,
}

impl IndexMonitor {
    pub const LOST: Self = Self {
        place: None,
        direction: MotorDirection::Forward,
        seen_for: 0,
        stray_for: 0,
        absent_for: 0,
        seen: false,
        absent: false,
        stray: false,
    };

    /// Records that homing is finished: the head stands at the tip's x axis.
    pub fn homed(&mut self, mark: &IndexWindow) {
        *self = Self { place: Some(mark.zero), ..Self::LOST };
    }

    pub fn begin_turn(&mut self, direction: MotorDirection) {
        let turned = self.direction != direction;
        let seen_for = if turned { 0 } else { self.seen_for };
        *self = Self { place: self.place, direction, seen_for, stray: self.stray, ..Self::LOST };
    }

    /// Checks the reading of the index sensor at a step of the head. `on` is true if the sensor detects the mark.
    #[inline]
    pub fn step(&mut self, on: bool, mark: &IndexWindow) -> Result<(), EngineFault> {
        let Some(place) = self.place else { return Ok(()) };
        self.place = Some(match (self.direction, place) {
            (MotorDirection::Forward, place) if place + 1 == mark.steps_per_turn => 0,
            (MotorDirection::Forward, place) => place + 1,
            (MotorDirection::Backward, 0) => mark.steps_per_turn - 1,
            (MotorDirection::Backward, place) => place - 1,
        });
        if on { self.on_mark_seen(place, mark) } else { self.on_mark_absent(place, mark) }
    }

    fn on_mark_seen(&mut self, place: u32, mark: &IndexWindow) -> Result<(), EngineFault> {
        self.seen_for += 1;
        self.absent_for = 0;
        // A mark that is detected late is also detected outside its position, even if it is still within its tolerance.
        if place >= mark.reach || self.absent {
            self.stray_for += 1;
            self.stray |= self.stray_for >= MIN_CONTRADICTING_SAMPLES;
        } else {
            self.stray_for = 0;
            self.seen = true;
        }
        if self.stray && self.seen_for > mark.stuck { Err(EngineFault::IndexStuck) } else { Ok(()) }
    }

    fn on_mark_absent(&mut self, place: u32, mark: &IndexWindow) -> Result<(), EngineFault> {
        self.seen_for = 0;
        self.stray_for = 0;
        if self.stray {
            return Err(EngineFault::HeadStepsLost);
        }
        if (mark.certain_from..mark.certain_to).contains(&place) {
            self.absent_for += 1;
            if self.absent_for >= MIN_CONTRADICTING_SAMPLES {
                self.absent = true;
                if self.seen {
                    return Err(EngineFault::HeadStepsLost);
                }
            }
        } else {
            self.absent_for = 0;
        }
        Ok(())
    }

    /// Checks for an index mark that was not detected in the turn. Call it at the end of a turn, after the head has
    /// passed all positions.
    pub fn end_turn(&self) -> Result<(), EngineFault> {
        let missing = self.place.is_some() && !self.seen && !self.stray;
        if missing { Err(EngineFault::IndexMissing) } else { Ok(()) }
    }
}

/// Reads the index sensor and publishes its level in the mailbox. Returns whether the sensor detects the mark.
pub(super) fn read_index_sensor(index: &mut impl InputPin, handover: &Mailbox) -> Result<bool, EngineFault> {
    let on = index.is_high().map_err(|_| EngineFault::Hardware)?;
    handover.set_on_index(on);
    Ok(on)
}
