//! Comparison of the board's clock with the host's.
//!
//! A board whose crystal has failed, or whose clocks are set up wrongly, heats and steps at the wrong speed. All its
//! time limits are off by the same factor. Its `uptime_ms` shows this. A response is made between the moment at which
//! its request was sent and the moment at which it arrived. Two responses therefore bound the rate of the board's clock
//! from both sides, and delays on the line only widen the bounds. The clock is wrong if even the cautious bound is
//! beyond the limit in two successive windows of half a minute. One window is not enough, because the program may have
//! been halted or the machine may have slept.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Maximum relative error of a clock. Crystals are within 0.01 %, a UART needs 3 %, and the heater is supervised with
/// margins of 10 %.
const MAX_DRIFT: f64 = 0.02;
/// Minimum length of the window over which the clocks are compared.
const WINDOW: Duration = Duration::from_secs(30);
/// Maximum ratio of the delays to the window at which the clocks may count as equal.
const MAX_UNCERTAINTY: f64 = 0.01;
/// Maximum delay of a response that is used as a reading.
const SLOWEST_ANSWER: Duration = Duration::from_secs(2);
/// Interval at which the board's clock is sampled.
const SAMPLE_INTERVAL: Duration = Duration::from_secs(10);
/// Number of successive windows after which a clock counts as wrong.
const WINDOWS: u32 = 2;
/// Factor above which a faster clock is not compared. No failed clock is that fast, so this is the virtual clock of a
/// simulated board that another process serves.
const VIRTUAL: f64 = 2.0;

/// A board's clock that runs at the wrong rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(into = "ClockDriftJson", from = "ClockDriftJson")]
pub struct ClockDrift {
    /// Time that has passed on the board's clock, ms.
    pub board_ms: u64,
    /// Bounds of the time that passed meanwhile on the host's clock: shortest and longest, ms.
    pub host_ms: [u64; 2],
}

impl ClockDrift {
    /// Advice for the user.
    pub const REMEDY: &str = "check the board's crystal and its solder joints; heating, speeds and time limits are \
                              wrong by the same percentage";

    /// Returns by how much the board's clock runs faster than the host's, percent: the bound nearer to 0.
    #[must_use]
    pub fn percent(&self) -> f64 {
        let [shortest, longest] = self.host_ms;
        let host = if self.board_ms < shortest { shortest } else { longest };
        100.0 * (self.board_ms as f64 / host.max(1) as f64 - 1.0)
    }
}

/// A wrong clock in the form that scripts, run logs and pages read.
#[derive(Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct ClockDriftJson {
    /// Excess of the board's clock over the host's, percent: the bound nearer to 0.
    #[serde(default)]
    percent: f64,
    /// The limit, percent.
    #[serde(default)]
    limit_percent: f64,
    /// Time that has passed on the board's clock, ms.
    board_ms: u64,
    /// Bounds of the time that passed on the host's clock, ms: shortest and longest.
    host_ms: [u64; 2],
    /// The error as a message.
    #[serde(default)]
    message: String,
    /// Advice for the user.
    #[serde(default)]
    remedy: String,
}

impl From<ClockDrift> for ClockDriftJson {
    fn from(drift: ClockDrift) -> Self {
        Self {
            percent: drift.percent(),
            limit_percent: 100.0 * MAX_DRIFT,
            board_ms: drift.board_ms,
            host_ms: drift.host_ms,
            message: drift.to_string(),
            remedy: ClockDrift::REMEDY.to_owned(),
        }
    }
}

impl From<ClockDriftJson> for ClockDrift {
    fn from(written: ClockDriftJson) -> Self {
        Self { board_ms: written.board_ms, host_ms: written.host_ms }
    }
}

impl fmt::Display for ClockDrift {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [_, longest] = self.host_ms;
        let way = if self.percent() < 0.0 { "slow" } else { "fast" };
        write!(
            f,
            "the board's clock is {:.1} % {way}: it counted {:.1} s in {:.1} s (limit {} %)",
            self.percent().abs(),
            self.board_ms as f64 / 1000.0,
            longest as f64 / 1000.0,
            100.0 * MAX_DRIFT
        )
    }
}

/// A response that contains the board's clock.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClockSample {
    /// The board's clock, ms.
    pub board_ms: u64,
    /// Time at which the request was first sent, on the port's clock.
    pub sent: Duration,
    /// Time at which the response arrived, on the port's clock.
    pub received: Duration,
}

/// Compares the clocks.
#[derive(Debug, Default)]
pub(super) struct ClockWatch {
    /// First reading of the window.
    first: Option<ClockSample>,
    latest: Option<ClockSample>,
    /// Number of successive windows in which the clock was fast; negative if it was slow.
    wrong: i32,
    drift: Option<ClockDrift>,
}

impl ClockWatch {
    /// Returns the error of the board's clock, if it was found wrong.
    pub fn drift(&self) -> Option<ClockDrift> {
        self.drift
    }

    /// Reports whether the latest reading is so old that another one is due.
    pub fn wants(&self, now: Duration) -> bool {
        self.latest.is_none_or(|latest| now.saturating_sub(latest.received) >= SAMPLE_INTERVAL)
    }

    /// Adds a reading.
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
    use super::*;
    use growbot_core::random::Rng;
    use serde_json::json;

    /// Returns the time, s, after which a clock of this rate is found wrong, over a line that delays by up to `jitter`,
    /// s. `None` if it is not found within `seconds`.
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
