//! Time since the begin of a growth, computed from a run log or from live reports.
//!
//! A run log contains the time of day of each line, which is not the time of the growth if a simulated robot grows in a
//! second. This module uses the time on the board's clock, which each status contains. The time is 0 at the first
//! status, and continues when a reset sets the board's clock to 0. Between two statuses, each layer adds at least the
//! time that the robot needs to lay it.

use growbot_core::layer::Layer;

use crate::plan::Plan;
use crate::run_log::{BoardStatus, Events, RunEvent};

/// Clock of a growth: the time since its first status, ms.
#[derive(Debug, Default)]
pub struct RunClock {
    now: u64,
    /// Offset of this clock from the board's clock, and the board's time in the previous status, both in ms. `None`
    /// before the first status.
    board: Option<(i64, u64)>,
    /// Time at which the previous layer was reported, ms. `None` before the first layer.
    laid: Option<u64>,
}

impl RunClock {
    /// Returns the time since the first status, ms.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Updates the clock from a status of the board.
    pub fn status(&mut self, status: &BoardStatus) {
        if let Some(uptime_ms) = status.uptime_ms {
            self.set_uptime(uptime_ms);
        }
    }

    /// Updates the clock from the time since the board's start, ms.
    pub fn set_uptime(&mut self, uptime_ms: u64) {
        let ahead = match self.board {
            Some((ahead, before)) if before <= uptime_ms => ahead,
            _ => (self.now as i64).saturating_sub_unsigned(uptime_ms),
        };
        self.board = Some((ahead, uptime_ms));
        self.now = self.now.max(ahead.saturating_add_unsigned(uptime_ms).max(0) as u64);
    }

    /// Updates the clock for a laid layer. `duration` is the time that the robot needs for the layer, ms.
    pub fn add_layer(&mut self, duration: u64) {
        self.now = self.laid.map_or(self.now, |laid| self.now.max(laid.saturating_add(duration)));
        self.laid = Some(self.now);
    }
}

/// Returns the time that the robot needs for a layer, ms: the fraction of the plan's duration that corresponds to the
/// layer's height.
pub fn time_for(layer: &Layer, plan: &Plan) -> u64 {
    let share = if plan.requirements.length > 0.0 { layer.height / plan.requirements.length } else { 0.0 };
    (1000.0 * share * plan.requirements.duration).round() as u64
}

/// Returns the events of a log after its header.
pub fn events(log: &[u8]) -> impl Iterator<Item = RunEvent> {
    Events::after_header(log)
}
