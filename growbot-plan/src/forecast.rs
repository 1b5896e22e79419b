//! Forecast of the finish time of a growth, from the number of remaining layers and the time per layer.

use growbot_core::link::message::{State, Status};
use time::{Duration, OffsetDateTime};

/// Forecast of the finish time of a growth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forecast {
    /// Time to lay one layer on the robot's clock, s.
    pub period_s: f64,
    /// Speed of the robot's clock, in multiples of real time. It is 1 except for a simulated robot.
    pub pace: f64,
}

impl Forecast {
    /// Returns the date and time at which the remaining layers will be laid. `now` is the current date and time. `None`
    /// if the result is beyond the range of the calendar.
    pub fn finish(&self, now: OffsetDateTime, layers_left: u64) -> Option<OffsetDateTime> {
        let seconds = layers_left as f64 * self.period_s / self.pace;
        now.checked_add(Duration::checked_seconds_f64(seconds)?)
    }

    /// Returns the date and time at which a board with this status will finish its job. `None` if the board is not
    /// growing, because the length of a pause is unknown.
    pub fn finish_of(&self, now: OffsetDateTime, status: &Status) -> Option<OffsetDateTime> {
        let left = status.layer_count.saturating_sub(status.layers_laid);
        (status.state == State::Growing).then(|| self.finish(now, left.into())).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finish_time_is_now_plus_remaining_layers_at_the_current_pace() {
        let now = OffsetDateTime::UNIX_EPOCH;
        let finish = |pace, layers| Forecast { period_s: 18.0, pace }.finish(now, layers);
        assert_eq!(finish(1.0, 200), Some(now + Duration::hours(1)));
        assert_eq!(finish(60.0, 200), Some(now + Duration::minutes(1)));
        assert_eq!(finish(1.0, 0), Some(now));
        assert_eq!(finish(1.0, u64::MAX), None);
    }
}
