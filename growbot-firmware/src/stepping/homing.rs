//! Homing: turns the head to the leading edge of the index mark, and on to the tip's x axis.

use embedded_hal::digital::{InputPin, OutputPin};

use super::index_monitor::{IndexWindow, read_index_sensor};
use super::mailbox::Mailbox;
use super::moves::{EngineFault, HomingMove};
use super::stepper::Stepper;

/// Progress of a homing move.
pub(super) struct HomingRun {
    homing: HomingMove,
    pub ticks_to_step: u32,
    steps_made: u32,
    /// Number of consecutive head steps at which the index mark was detected.
    on_mark_for: u32,
    /// True once the head has been outside the index mark, so that the next edge is the mark's leading edge.
    left_mark: bool,
    /// Number of head steps from the present position to the tip's x axis. `None` before the mark's leading edge.
    steps_to_zero: Option<u32>,
}

impl HomingRun {
    pub fn new(homing: HomingMove) -> Self {
        Self {
            homing,
            ticks_to_step: homing.ticks_per_step,
            steps_made: 0,
            on_mark_for: 0,
            left_mark: false,
            steps_to_zero: None,
        }
    }

    /// Runs one tick of the homing move. Returns whether the move is over.
    pub fn tick<S: OutputPin, D: OutputPin, E: OutputPin>(
        &mut self,
        head: &mut Stepper<S, D, E>,
        index: &mut impl InputPin,
        mark: &IndexWindow,
        handover: &Mailbox,
    ) -> Result<bool, EngineFault> {
        self.ticks_to_step = self.ticks_to_step.saturating_sub(1);
        if self.ticks_to_step > 0 {
            return Ok(false);
        }
        let on_mark = read_index_sensor(index, handover)?;
        self.on_mark_for = if on_mark { self.on_mark_for + 1 } else { 0 };
        if self.on_mark_for > mark.longest {
            return Err(EngineFault::IndexStuck);
        }
        if self.steps_to_zero.is_none() {
            if on_mark && self.left_mark {
                self.steps_to_zero = Some(self.homing.steps_to_zero);
            }
            self.left_mark |= !on_mark;
        }
        match &mut self.steps_to_zero {
            Some(0) => return Ok(true),
            Some(left) => *left -= 1,
            None if self.steps_made == self.homing.max_steps => return Err(EngineFault::IndexNotFound),
            None => self.steps_made += 1,
        }
        self.ticks_to_step = self.homing.ticks_per_step;
        head.raise()?;
        Ok(false)
    }
}
