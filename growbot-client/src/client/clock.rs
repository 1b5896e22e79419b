//! Comparison of the board's clock with the host's clock.
//!
//! A board whose crystal has failed, or whose clocks are set up wrongly, heats and steps at the wrong speed. All its
//! time limits are off by the same factor. The field `uptime_ms` of its status shows this. The board reads its clock
//! after the request was sent and before the response arrives. Two responses therefore give a lower and an upper bound
//! of the rate of the board's clock, and delays on the line only widen the bounds. The clock counts as wrong if both
//! bounds are beyond the limit in two successive windows of half a minute. One window is not enough, because the
//! program may have been halted or the machine may have slept.

use std::time::Duration;

use growbot_plan::clock_drift::{ClockDrift, MAX_DRIFT};

/// Minimum length of a window over which the clocks are compared.
const WINDOW: Duration = Duration::from_secs(30);
/// Maximum uncertainty of a window's length, from the delays of the responses, as a fraction of the length. With a
/// larger uncertainty, the clocks do not count as equal, and the window is extended.
const MAX_UNCERTAINTY: f64 = 0.01;
/// Maximum time between a request and its response for which the response is used.
const SLOWEST_ANSWER: Duration = Duration::from_secs(2);
/// Interval at which the board's clock is sampled.
const SAMPLE_INTERVAL: Duration = Duration::from_secs(10);
/// Number of successive windows with the same error after which a clock counts as wrong.
const WINDOWS: u32 = 2;
/// Ratio of the clocks' rates above which the clocks count as equal. No failed clock is this fast, so it is the virtual
/// clock of a simulated board in another process.
const VIRTUAL: f64 = 2.0;

/// A reading of the board's clock from a response.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClockSample {
    /// Time on the board's clock, ms.
    pub board_ms: u64,
    /// Time at which the request was first sent, on the port's clock.
    pub sent: Duration,
    /// Time at which the response arrived, on the port's clock.
    pub received: Duration,
}

/// State of the comparison of the board's clock with the port's clock.
#[derive(Debug, Default)]
pub(super) struct ClockWatch {
    /// First reading of the current window. `None` before it.
    first: Option<ClockSample>,
    latest: Option<ClockSample>,
    /// Number of successive windows in which the board's clock was too fast, or minus the number of windows in which it
    /// was too slow.
    wrong: i32,
    drift: Option<ClockDrift>,
}

impl ClockWatch {
    /// Returns the error of the board's clock. `None` unless the clock counts as wrong.
    pub fn drift(&self) -> Option<ClockDrift> {
        self.drift
    }

    /// Reports whether the board's clock should be read again, because the latest reading is too old.
    pub fn wants(&self, now: Duration) -> bool {
        self.latest.is_none_or(|latest| now.saturating_sub(latest.received) >= SAMPLE_INTERVAL)
    }

    /// Adds a reading of the board's clock, and evaluates the window if it is long enough.
    pub fn take(&mut self, reading: &ClockSample) {
        let latest = self.latest.replace(*reading);
        if latest.is_some_and(|latest| reading.board_ms < latest.board_ms) {
            // The board has restarted.
            *self = Self { latest: Some(*reading), ..Self::default() };
        }
        if reading.received.saturating_sub(reading.sent) > SLOWEST_ANSWER {
            return;
        }
        let Some(first) = self.first else {
            self.first = Some(*reading);
            return;
        };
        let shortest = reading.sent.saturating_sub(first.received);
        let longest = reading.received.saturating_sub(first.sent);
        if shortest < WINDOW {
            return;
        }
        let board = (reading.board_ms - first.board_ms) as f64 / 1000.0;
        let way = if board < (1.0 - MAX_DRIFT) * shortest.as_secs_f64() {
            -1
        } else if board > VIRTUAL * longest.as_secs_f64() {
            0
        } else if board > (1.0 + MAX_DRIFT) * longest.as_secs_f64() {
            1
        } else if (longest - shortest).as_secs_f64() > MAX_UNCERTAINTY * shortest.as_secs_f64() {
            // The delays are too long for this window, so it must get longer.
            return;
        } else {
            0
        };
        self.wrong = if way * self.wrong >= 0 { way * (self.wrong.abs() + 1) } else { way };
        self.first = Some(*reading);
        if self.wrong.unsigned_abs() >= WINDOWS {
            let host_ms = [shortest, longest].map(|time| time.as_millis() as u64);
            self.drift = Some(ClockDrift { board_ms: reading.board_ms - first.board_ms, host_ms });
        }
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::random::Rng;
    use serde_json::json;

    use super::*;

    /// Returns the time after which a clock of this rate counts as wrong, s, over a line with random delays of up to
    /// `jitter` s. The clock is read at intervals of `every` s. `None` if it does not count as wrong within `seconds`.
    fn found(rate: f64, jitter: f64, seconds: f64, every: f64) -> Option<f64> {
        let mut random = Rng::new(&[7]);
        let mut watch = ClockWatch::default();
        let mut now = 1000.0;
        while now < 1000.0 + seconds {
            let [there, back] = [(); 2].map(|()| random.uniform_between(0.0, jitter));
            let board_ms = ((now + there) * rate * 1000.0) as u64;
            let [sent, received] = [now, now + there + back].map(Duration::from_secs_f64);
            watch.take(&ClockSample { board_ms, sent, received });
            if let Some(drift) = watch.drift() {
                println!("rate {rate}, jitter {jitter} s: after {:.0} s: {drift}", now - 1000.0);
                return Some(now - 1000.0);
            }
            now += every;
        }
        None
    }

    #[test]
    fn drift_above_the_limit_is_detected() {
        for rate in [0.5, 0.95, 0.97, 1.03, 1.05, 1.9] {
            for jitter in [0.0, 0.02, 0.2] {
                assert!(found(rate, jitter, 120.0, 2.0).is_some(), "{rate}, jitter {jitter}");
            }
            // If responses take seconds, it takes longer.
            assert!(found(rate, 1.0, 600.0, 2.0).is_some(), "{rate}, seconds of jitter");
        }
    }

    #[test]
    fn link_delays_are_not_mistaken_for_drift() {
        for rate in [0.995, 1.0, 1.005, 0.99, 1.01] {
            for jitter in [0.0, 0.1, 0.9, 5.0] {
                assert_eq!(found(rate, jitter, 20_000.0, 2.0), None, "{rate}, jitter {jitter}");
            }
        }
    }

    #[test]
    fn a_halt_a_sleep_and_a_restart_are_not_drift() {
        let mut watch = ClockWatch::default();
        let mut take = |host: f64, board: f64| {
            let [sent, received] = [host, host + 0.01].map(Duration::from_secs_f64);
            watch.take(&ClockSample { board_ms: (board * 1000.0) as u64, sent, received });
            watch.drift()
        };
        for second in 0..40 {
            assert_eq!(take(f64::from(second), f64::from(second)), None);
        }
        // The board is halted for 20 s; the host sleeps for an hour; the board restarts.
        for (host, board) in [(20.0, 0.0), (20.0, 3600.0), (20.0, -40.0)] {
            for second in 40..140 {
                assert_eq!(
                    take(host + f64::from(second), board + f64::from(second)),
                    None,
                    "{host}, {board}, {second}"
                );
            }
        }
    }

    #[test]
    fn a_drift_is_formatted_with_its_limit_and_parsed_back() {
        let drift = ClockDrift { board_ms: 28_500, host_ms: [30_000, 30_100] };
        let written = serde_json::to_value(drift).unwrap();
        assert!((written["percent"].as_f64().unwrap() + 5.0).abs() < 1e-9, "{written}");
        assert_eq!(written["limit_percent"], 2.0);
        assert_eq!(serde_json::from_value::<ClockDrift>(written).unwrap(), drift);
        for other in [json!(null), json!({ "board_ms": 1 }), json!({ "board_ms": 1, "host_ms": [-1, 2] })] {
            assert!(serde_json::from_value::<ClockDrift>(other.clone()).is_err(), "{other}");
        }
    }

    #[test]
    fn a_virtual_clock_is_not_compared() {
        assert_eq!(found(100.0, 0.01, 2000.0, 2.0), None);
    }
}
