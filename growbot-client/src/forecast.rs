//! When a growth is done: the layers to come, at the robot's period, on a clock. Nothing here reads a clock.

use growbot_core::link::message::{State, Status};
use time::{Duration, OffsetDateTime};

/// What a finish time is computed by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forecast {
    /// Time for a layer by the robot's clock, s.
    pub period_s: f64,
    /// How fast the robot's clock runs, in multiples of real time: 1 but on a simulated robot.
    pub pace: f64,
}

impl Forecast {
    /// The time of day at which the layers to come are laid. None where that is beyond every calendar.
    #[must_use]
    pub fn finish(&self, now: OffsetDateTime, layers_left: u64) -> Option<OffsetDateTime> {
        let seconds = layers_left as f64 * self.period_s / self.pace;
        now.checked_add(Duration::checked_seconds_f64(seconds)?)
    }

    /// The same of a board. None where it does not grow: how long a pause lasts is not known.
    #[must_use]
    pub fn finish_of(&self, now: OffsetDateTime, status: &Status) -> Option<OffsetDateTime> {
        let left = status.layers.saturating_sub(status.laid);
        (status.state == State::Growing).then(|| self.finish(now, left.into())).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finish_time_is_now_and_the_layers_to_come_at_their_pace() {
        let now = OffsetDateTime::UNIX_EPOCH;
        let finish = |pace, layers| Forecast { period_s: 18.0, pace }.finish(now, layers);
        assert_eq!(finish(1.0, 200), Some(now + Duration::hours(1)));
        assert_eq!(finish(60.0, 200), Some(now + Duration::minutes(1)));
        assert_eq!(finish(1.0, 0), Some(now));
        assert_eq!(finish(1.0, u64::MAX), None);
    }
}
