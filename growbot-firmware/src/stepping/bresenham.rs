//! Even distribution of a sector's steps over its ticks, by additions and comparisons.
//!
//! With `n` steps in `t` ticks, `n` is added in each tick to an accumulator that starts at `t / 2`. Each time the
//! accumulator reaches `t`, a step is due and `t` is subtracted. Steps therefore fall where the straight line of the
//! position crosses half steps, and after `t` ticks there are exactly `n` steps.

/// Even distribution of steps over ticks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bresenham {
    steps: u32,
    ticks: u32,
    accumulator: u32,
}

impl Bresenham {
    pub const NONE: Self = Self { steps: 0, ticks: 1, accumulator: 0 };

    pub fn new(steps: u32, ticks: u32) -> Self {
        Self { steps, ticks, accumulator: ticks / 2 }
    }

    /// Advances by a tick. Returns whether a step is due.
    pub fn tick(&mut self) -> bool {
        self.accumulator += self.steps;
        let due = self.accumulator >= self.ticks;
        if due {
            self.accumulator -= self.ticks;
        }
        due
    }

    /// Returns the number of ticks until a step is due, including the tick of the step.
    pub fn ticks_to_step(&self) -> u32 {
        if self.steps == 0 { u32::MAX } else { (self.ticks - self.accumulator).div_ceil(self.steps) }
    }

    /// Skips a number of ticks in which no step is due.
    pub fn skip(&mut self, ticks: u32) {
        self.accumulator += self.steps * ticks;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn steps_stay_within_the_ticks_with_room_for_the_pulse() {
        for ticks in 2..60 {
            for steps in 0..=ticks / 2 {
                // The two sectors are equal and follow each other.
                let mut due = Vec::new();
                for sector in 0..2 {
                    let mut spread = Bresenham::new(steps, ticks);
                    for tick in 0..ticks {
                        if spread.tick() {
                            due.push(sector * ticks + tick);
                        }
                    }
                }
                assert_eq!(due.len() as u32, 2 * steps);
                assert!(due.windows(2).all(|pair| pair[1] - pair[0] >= 2), "{steps} in {ticks}: {due:?}");
            }
        }
    }
}
