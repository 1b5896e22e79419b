//! Moves of the head alone or of the feed alone.

use embedded_hal::digital::OutputPin;

use super::direction::MotorDirection;
use super::moves::{AxisMove, EngineFault};
use super::stepper::Stepper;

/// Progress of a move of one axis, head or feed.
pub(super) struct AxisMoveRun {
    ticks_per_step: u32,
    pub ticks_to_step: u32,
    steps_left: u32,
    pub changes_filament: bool,
    /// True if the move's steps are monitored for a filament jam.
    watched: bool,
}

impl AxisMoveRun {
    pub fn new(order: AxisMove) -> Self {
        let ticks_per_step = order.ticks_per_step.max(2);
        Self {
            ticks_per_step,
            ticks_to_step: ticks_per_step,
            steps_left: order.steps,
            changes_filament: order.changes_filament,
            watched: order.changes_filament && order.direction == MotorDirection::Forward,
        }
    }

    /// Returns whether the next tick makes a step that is monitored for a filament jam.
    pub fn is_watched_step(&self) -> bool {
        self.watched && self.ticks_to_step <= 1 && self.steps_left > 0
    }

    /// Runs one tick. Returns whether the move is over.
    pub fn tick<S: OutputPin, D: OutputPin, E: OutputPin>(
        &mut self,
        feed: &mut Stepper<S, D, E>,
    ) -> Result<bool, EngineFault> {
        self.ticks_to_step = self.ticks_to_step.saturating_sub(1);
        if self.ticks_to_step > 0 {
            return Ok(false);
        }
        // The last step lasts as long as the others, so that the next move does not follow too fast.
        if self.steps_left == 0 {
            return Ok(true);
        }
        self.steps_left -= 1;
        self.ticks_to_step = self.ticks_per_step;
        feed.raise()?;
        Ok(false)
    }
}
