//! The error of a board's clock.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Maximum relative error of the rate of a board's clock. Crystals are within 0.01 %, a UART tolerates 3 %, and the
/// supervision of the heater has margins of 10 %.
pub const MAX_DRIFT: f64 = 0.02;

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

    /// Returns by how many percent the board's clock runs faster than the host's clock, negative if slower: the bound
    /// nearer to 0.
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
    /// Limit of the absolute percentage above which the clock counts as wrong.
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
