//! The time of a growth, from a run log or from live reports.
//!
//! A run log has the time of day of each line, which means little if a simulated robot grows in a second. It also has
//! the board's time in each status, which this module uses. Time begins at 0 with the first status, and after a reset
//! the board's time continues where it was. Between two statuses, a layer is reported no earlier after the previous one
//! than the robot needs for it.

use growbot_core::layer::Layer;

use crate::plan::Plan;
use crate::run_log::{BoardStatus, Events, RunEvent};

/// The time of a growth, ms.
#[derive(Debug, Default)]
pub struct RunClock {
    now: u64,
    /// Offset of this clock from the board's, and the board's time in the previous status.
    board: Option<(i64, u64)>,
    /// Time of the report of the previous layer.
    laid: Option<u64>,
}

impl RunClock {
    /// Returns the time, ms.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Updates the clock from a status.
    pub fn status(&mut self, status: &BoardStatus) {
        if let Some(uptime_ms) = status.uptime_ms {
            self.set_uptime(uptime_ms);
        }
    }

    /// Updates the clock from the board's time since its start, ms.
    pub fn set_uptime(&mut self, uptime_ms: u64) {
        let ahead = match self.board {
            Some((ahead, before)) if before <= uptime_ms => ahead,
            _ => (self.now as i64).saturating_sub_unsigned(uptime_ms),
        };
        self.board = Some((ahead, uptime_ms));
        self.now = self.now.max(ahead.saturating_add_unsigned(uptime_ms).max(0) as u64);
    }

    /// Records a layer whose duration is given, ms.
    pub fn add_layer(&mut self, duration: u64) {
        self.now = self.laid.map_or(self.now, |laid| self.now.max(laid.saturating_add(duration)));
        self.laid = Some(self.now);
    }
}

/// Returns the time that the robot needs for a layer, ms: its fraction of the plan's duration.
#[must_use]
pub fn time_for(layer: &Layer, plan: &Plan) -> u64 {
    let share = if plan.requirements.length > 0.0 { layer.height / plan.requirements.length } else { 0.0 };
    (1000.0 * share * plan.requirements.duration).round() as u64
}

/// Returns the events of a log after its header.
pub fn events(log: &[u8]) -> impl Iterator<Item = RunEvent> {
    Events::after_header(log)
}
