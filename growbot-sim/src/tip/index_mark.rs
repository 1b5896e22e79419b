//! The mark that the head's index sensor detects once per turn.

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::robot::Robot;

/// The mark that the head's index sensor detects once per turn. Its position and width are in head steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IndexMark {
    /// Number of head steps per turn.
    pub steps_per_turn: u32,
    /// Position of the beginning of the mark, head steps from the tip's x axis.
    pub position: u32,
    /// Width of the mark, head steps.
    pub width: u32,
}

impl IndexMark {
    /// Returns the index mark of a robot, rounded to the nearest head step.
    pub fn of(robot: &Robot) -> Self {
        let head = &robot.description().head;
        let per_degree = f64::from(head.steps_per_turn) / 360.0;
        let angle = wrap_positive(radians(head.index_angle_deg)) / std::f64::consts::TAU * 360.0;
        Self {
            steps_per_turn: head.steps_per_turn,
            position: libm::rint(angle * per_degree) as u32 % head.steps_per_turn,
            width: (libm::rint(head.index_width_deg * per_degree) as u32).max(1),
        }
    }

    /// Returns true if the mark covers the head position `head`, in steps from the tip's x axis.
    pub fn covers(&self, head: i64) -> bool {
        (head - i64::from(self.position)).rem_euclid(i64::from(self.steps_per_turn)) < i64::from(self.width)
    }
    /// Returns the smallest number of head steps, in either direction, from a position of the head to a change of the
    /// index sensor's level.
    pub(super) fn steps_to_edge(&self, head: i64) -> u32 {
        let turn = i64::from(self.steps_per_turn);
        let width = i64::from(self.width);
        let from_begin = (head - i64::from(self.position)).rem_euclid(turn);
        let nearest = if from_begin < width {
            (width - from_begin).min(from_begin + 1)
        } else {
            (turn - from_begin).min(from_begin - width + 1)
        };
        nearest.max(1) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_to_the_mark_edge_is_correct() {
        let mark = IndexMark { steps_per_turn: 20, position: 18, width: 4 };
        for head in -40..40 {
            let steps = i64::from(mark.steps_to_edge(head));
            let level = |at: i64| mark.covers(at);
            assert!((1..steps).all(|step| level(head + step) == level(head) && level(head - step) == level(head)));
            assert!(level(head + steps) != level(head) || level(head - steps) != level(head), "{head}");
        }
    }
}
