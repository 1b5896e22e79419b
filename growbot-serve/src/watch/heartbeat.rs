//! Heartbeats on the streams of events for pages, and the check of the age of orders.
//!
//! Each heartbeat contains the time of the service's clock. With an order, the page sends the time of the service's
//! clock at which a person gave the order, so the clocks of the two machines need not agree. A heartbeat that comes
//! late makes an order look older, never younger.

use std::time::Duration;

use axum::http::HeaderMap;
use growbot_client::port::time_since_boot;
use schemars::JsonSchema;
use serde::Serialize;

/// Maximum age of an order that does not stop or pause the robot.
pub const MAX_ORDER_AGE: Duration = Duration::from_secs(5);
/// Maximum time by which an order may seem to come from the future, because two clocks do not run at the same speed.
pub const MAX_AHEAD: Duration = Duration::from_secs(1);
/// Name of the HTTP header with the time at which an order was given, ms since the start of the service's machine.
pub const HEADER: &str = "growbot-order-time";

/// Content of a heartbeat.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Heartbeat<T> {
    /// Time of the service's machine, ms since its start.
    time_ms: u64,
    /// Time since the board's latest status, s. On the stream of all robots, a map of robot names to these times.
    status_age_s: T,
}

impl<T> Heartbeat<T> {
    /// Returns the heartbeat of this moment.
    pub fn now(status_age_s: T) -> Self {
        Self { time_ms: time_since_boot().as_millis() as u64, status_age_s }
    }
}

/// Returns the age of a status that was received at this time since the machine's start, s. For a simulated robot that
/// is slower than real time, the age is measured on the robot's clock.
pub fn status_age_s(received: Duration, pace: Option<f64>) -> f64 {
    let age = time_since_boot().saturating_sub(received).as_millis() as f64 / 1000.0;
    age * pace.unwrap_or(1.0).min(1.0)
}

/// Reason why an order is not carried out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OrderAgeError {
    /// The header with the time is not a number.
    #[error("{HEADER} is {time:?}: send `time_ms` of a heartbeat, a number of ms")]
    NotANumber {
        /// Value of the header.
        time: String,
    },
    /// The order is too old.
    #[error(
        "the order arrived {age_s:.1} s after it was given (limit {:.0} s), so the order was not carried out: check \
         the robot's state, and give the order again", MAX_ORDER_AGE.as_secs_f64()
    )]
    Late {
        /// Age of the order, s.
        age_s: f64,
    },
    /// The order was given in the future.
    #[error(
        "the time of the order is {ahead_s:.1} s ahead of the service's clock (limit {:.0} s): reload the page, and \
         give the order again", MAX_AHEAD.as_secs_f64()
    )]
    Ahead {
        /// Time by which the order is ahead of this machine's clock, s.
        ahead_s: f64,
    },
}

/// Result of the check of an order's age, at the moment at which the order arrived.
#[derive(Debug, Clone)]
pub struct OrderAge(Result<(), OrderAgeError>);

impl Default for OrderAge {
    /// Accepts an order whose client does not send the time at which the order was given, such as growbot's commands.
    fn default() -> Self {
        Self(Ok(()))
    }
}

impl OrderAge {
    /// Checks the age of an order that arrives now with these headers.
    pub fn of_request(headers: &HeaderMap) -> Self {
        let Some(time) = headers.get(HEADER).map(|time| time.to_str().unwrap_or_default()) else {
            return Self::default();
        };
        let invalid = |_| OrderAgeError::NotANumber { time: time.to_owned() };
        Self(time.parse().map_err(invalid).and_then(|given_ms| check_age(given_ms, time_since_boot())))
    }

    /// Checks the age of an order that arrives now and was given at this time, ms since the machine's start.
    pub fn of_time(given_ms: u64) -> Self {
        Self(check_age(given_ms, time_since_boot()))
    }

    /// Returns an error if the order is too old to be carried out. Orders that stop or pause the robot do not need this
    /// check.
    ///
    /// # Errors
    /// [`OrderAgeError`].
    pub fn check(&self) -> Result<(), OrderAgeError> {
        self.0.clone()
    }
}

fn check_age(given_ms: u64, now: Duration) -> Result<(), OrderAgeError> {
    let given = Duration::from_millis(given_ms);
    let seconds = |time: Duration| time.as_millis() as f64 / 1000.0;
    let age = now.saturating_sub(given);
    if age > MAX_ORDER_AGE {
        return Err(OrderAgeError::Late { age_s: seconds(age) });
    }
    let ahead = given.saturating_sub(now);
    if ahead > MAX_AHEAD {
        return Err(OrderAgeError::Ahead { ahead_s: seconds(ahead) });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_and_early_orders_are_refused_with_their_age_and_the_limit() {
        let now = Duration::from_secs(100);
        for given_ms in [100_000, 95_000, 95_001, 101_000] {
            assert_eq!(check_age(given_ms, now), Ok(()), "{given_ms}");
        }
        for (given_ms, cause) in [
            (94_999, "arrived 5.0 s after it was given (limit 5 s)"),
            (0, "arrived 100.0 s after it was given (limit 5 s)"),
            (101_001, "1.0 s ahead of the service's clock (limit 1 s)"),
            (u64::MAX, "ahead of the service's clock"),
        ] {
            let error = check_age(given_ms, now).unwrap_err();
            assert!(error.to_string().contains(cause), "{given_ms}: {error}");
        }
    }

    #[test]
    fn only_orders_with_a_time_are_checked() {
        assert_eq!(OrderAge::of_request(&HeaderMap::new()).check(), Ok(()));
        for (time, cause) in [
            ("0", "s after it was given (limit 5 s)"),
            ("18446744073709551616", "growbot-order-time is \"18446744073709551616\""),
            ("-1", "send `time_ms` of a heartbeat"),
            ("", "send `time_ms` of a heartbeat"),
        ] {
            let mut headers = HeaderMap::new();
            headers.insert(HEADER, time.parse().unwrap());
            let error = OrderAge::of_request(&headers).check().unwrap_err();
            assert!(matches!(error, OrderAgeError::NotANumber { .. } | OrderAgeError::Late { .. }), "{error:?}");
            assert!(error.to_string().contains(cause), "{time}: {error}");
        }
    }

    #[test]
    fn the_age_of_a_slow_robot_is_measured_on_its_clock() {
        let received = time_since_boot().saturating_sub(Duration::from_secs(20));
        for (pace, min_s) in [(None, 20.0), (Some(100.0), 20.0), (Some(0.1), 2.0)] {
            let age = status_age_s(received, pace);
            assert!(age >= min_s && age < min_s * 5.0, "{pace:?}: {age}");
        }
    }
}
