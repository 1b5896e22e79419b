//! The index mark, looked for in every turn: whether the head still is where its steps say.
//!
//! The head's position is known since homing. At each of its steps the sensor must see the mark where the mark is, must
//! not see it elsewhere, and may do either within a tolerance round both edges. Two samples in a row that contradict
//! this are needed, so that a single disturbed one is no alarm. It is the same in both directions of turning.
//!
//! The mark must be seen from its beginning to its end, less `index_tolerance_deg` on both sides. It must not be seen
//! outside the mark and the tolerance. On a contradiction the engine releases the motors by itself and reports:
//!
//! | seen | report |
//! |---|---|
//! | not in its place, nor elsewhere by the end of the turn | `IndexMissing` |
//! | elsewhere, or late, or not all through its place, then off | `HeadStepsLost` |
//! | elsewhere, and on for a quarter of a turn longer than mark and tolerances | `IndexStuck` |
//! | in homing, for longer than mark and tolerance | `IndexStuck` |
//! | in homing, never | `IndexNotFound` |
//!
//! An edge may be a step more than the tolerance off. A mark narrower than its tolerances must be seen once within
//! them. Steps lost so late in a turn that the mark comes only after the turn's end are reported as `IndexMissing`.

use embedded_hal::digital::InputPin;
use growbot_core::angle::{radians, wrap_positive};
use growbot_core::robot::Robot;

use super::handover::Handover;
use super::orders::Alarm;

/// Samples in a row that must contradict.
const CONTRADICTIONS: u32 = 2;

/// Where the mark is, in head steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Mark {
    steps_per_turn: u32,
    /// The tip's x axis, counted from where the tolerance before the mark begins.
    zero: u32,
    /// The mark and the tolerance on both sides: it is never seen beyond.
    reach: u32,
    /// Counted from where the tolerance begins, the mark is certainly seen from here ...
    certain_from: u32,
    /// ... up to here. With a mark narrower than the tolerances there is no such place.
    certain_to: u32,
    /// The longest that homing may see it.
    pub longest: u32,
    /// Seen for longer than this, steps lost on the mark cannot be the reason: the sensor sees it everywhere.
    stuck: u32,
}

impl Mark {
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

/// What the sensor has seen of the mark.
pub(super) struct IndexWatch {
    /// Where the head is, counted like [`Mark::zero`]; none unless it has homed since its motor was last energised.
    place: Option<u32>,
    backwards: bool,
    /// Samples in a row that saw a mark.
    seen_for: u32,
    /// Samples in a row that saw one where none is, and none where one is.
    stray_for: u32,
    absent_for: u32,
    /// The mark was seen in its place in this turn.
    seen: bool,
    /// It was not seen in its place.
    absent: bool,
    /// It is seen where it should not be.
    stray: bool,
}

impl IndexWatch {
    pub const LOST: Self = Self {
        place: None,
        backwards: false,
        seen_for: 0,
        stray_for: 0,
        absent_for: 0,
        seen: false,
        absent: false,
        stray: false,
    };

    /// The head stands at the tip's x axis.
    pub fn homed(&mut self, mark: &Mark) {
        *self = Self { place: Some(mark.zero), ..Self::LOST };
    }

    pub fn begin_turn(&mut self, backwards: bool) {
        let turned = self.backwards != backwards;
        let seen_for = if turned { 0 } else { self.seen_for };
        *self = Self { place: self.place, backwards, seen_for, stray: self.stray, ..Self::LOST };
    }

    /// What the sensor sees as the head makes a step.
    #[inline]
    pub fn step(&mut self, on: bool, mark: &Mark) -> Result<(), Alarm> {
        let Some(place) = self.place else { return Ok(()) };
        self.place = Some(match (self.backwards, place) {
            (false, place) if place + 1 == mark.steps_per_turn => 0,
            (false, place) => place + 1,
            (true, 0) => mark.steps_per_turn - 1,
            (true, place) => place - 1,
        });
        if on { self.sees_it(place, mark) } else { self.sees_nothing(place, mark) }
    }

    fn sees_it(&mut self, place: u32, mark: &Mark) -> Result<(), Alarm> {
        self.seen_for += 1;
        self.absent_for = 0;
        // A mark that is late is elsewhere too, though still within its tolerance.
        if place >= mark.reach || self.absent {
            self.stray_for += 1;
            self.stray |= self.stray_for >= CONTRADICTIONS;
        } else {
            self.stray_for = 0;
            self.seen = true;
        }
        if self.stray && self.seen_for > mark.stuck { Err(Alarm::IndexStuck) } else { Ok(()) }
    }

    fn sees_nothing(&mut self, place: u32, mark: &Mark) -> Result<(), Alarm> {
        self.seen_for = 0;
        self.stray_for = 0;
        if self.stray {
            return Err(Alarm::HeadStepsLost);
        }
        if (mark.certain_from..mark.certain_to).contains(&place) {
            self.absent_for += 1;
            if self.absent_for >= CONTRADICTIONS {
                self.absent = true;
                if self.seen {
                    return Err(Alarm::HeadStepsLost);
                }
            }
        } else {
            self.absent_for = 0;
        }
        Ok(())
    }

    /// All places have been passed.
    pub fn end_turn(&self) -> Result<(), Alarm> {
        let missing = self.place.is_some() && !self.seen && !self.stray;
        if missing { Err(Alarm::IndexMissing) } else { Ok(()) }
    }
}

/// Whether the index sensor sees its mark.
pub(super) fn see_index(index: &mut impl InputPin, handover: &Handover) -> Result<bool, Alarm> {
    let on = index.is_high().map_err(|_| Alarm::Hardware)?;
    handover.set_on_index(on);
    Ok(on)
}
