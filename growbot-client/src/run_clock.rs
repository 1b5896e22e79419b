//! The time of a growth, from its reports: of a run log, or live.
//!
//! A run log has the time of day of each line, which says little where a simulated robot grows in a second, and the
//! board's time in each status, which this goes by. Time begins at 0 with the first status; the board's time continues
//! where it was after a reset; between them a layer is reported no sooner after the one before than the robot needs for
//! it.

use growbot_core::layer::Layer;

use crate::plan::Plan;
use crate::run_log::{BoardStatus, Events, RunEvent};

/// The time of a growth, ms.
#[derive(Debug, Default)]
pub struct Clock {
    now: u64,
    /// Time less that of the board, and the board's time in the status before.
    board: Option<(i64, u64)>,
    /// When the layer before was told.
    laid: Option<u64>,
}

impl Clock {
    /// The time.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.now
    }

    /// A status has the board's time.
    pub fn status(&mut self, status: &BoardStatus) {
        if let Some(uptime_ms) = status.uptime_ms {
            self.board_says(uptime_ms);
        }
    }

    /// The board has said how long ago it started, ms.
    pub fn board_says(&mut self, uptime_ms: u64) {
        let ahead = match self.board {
            Some((ahead, before)) if before <= uptime_ms => ahead,
            _ => (self.now as i64).saturating_sub_unsigned(uptime_ms),
        };
        self.board = Some((ahead, uptime_ms));
        self.now = self.now.max(ahead.saturating_add_unsigned(uptime_ms).max(0) as u64);
    }

    /// A layer that takes so long, ms, has been laid.
    pub fn layer_took(&mut self, duration: u64) {
        self.now = self.laid.map_or(self.now, |laid| self.now.max(laid.saturating_add(duration)));
        self.laid = Some(self.now);
    }
}

/// How long the robot needs for a layer, ms: its share of the plan's time.
#[must_use]
pub fn time_for(layer: &Layer, plan: &Plan) -> u64 {
    let share = if plan.needs.length > 0.0 { layer.height / plan.needs.length } else { 0.0 };
    (1000.0 * share * plan.needs.duration).round() as u64
}

/// The events of a log of these bytes after its header.
pub fn events(log: &[u8]) -> impl Iterator<Item = RunEvent> {
    Events::after_header(log)
}
