//! Moves filament while the head stands.

use embedded_hal::digital::OutputPin;

use super::axis::Driver;
use super::orders::{Alarm, FeedMove};

/// A move of the filament under way.
pub(super) struct FeedRun {
    ticks_per_step: u32,
    pub ticks_to_step: u32,
    steps_left: u32,
}

impl FeedRun {
    pub fn new(order: FeedMove) -> Self {
        let ticks_per_step = order.ticks_per_step.max(2);
        Self { ticks_per_step, ticks_to_step: ticks_per_step, steps_left: order.steps }
    }

    /// One tick. Returns whether the move is over.
    pub fn tick<S: OutputPin, D: OutputPin, E: OutputPin>(
        &mut self,
        feed: &mut Driver<S, D, E>,
    ) -> Result<bool, Alarm> {
        self.ticks_to_step = self.ticks_to_step.saturating_sub(1);
        if self.ticks_to_step > 0 {
            return Ok(false);
        }
        // The last step gets its time too, so that the next move does not follow too fast.
        if self.steps_left == 0 {
            return Ok(true);
        }
        self.steps_left -= 1;
        self.ticks_to_step = self.ticks_per_step;
        feed.raise()?;
        Ok(false)
    }
}
