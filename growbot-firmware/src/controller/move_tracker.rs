//! The moves that the step engine has received, and the filament's position after them.

use growbot_core::link::message::PauseCause;

use crate::stepping::MotorDirection;

/// Time by which a move may exceed its expected duration before it is overdue, as a share of that duration.
const ALLOWANCE: f64 = 0.2;
/// Time that is added to the max duration of every move, us, in addition to [`ALLOWANCE`].
const ALLOWANCE_US: u64 = 2_000_000;

/// Moves that the step engine has received, and the filament's position after them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MoveTracker {
    /// Number of moves that the step engine has received and has not yet reported as ended.
    pub outstanding: u8,
    /// Time by which the step engine must report the end of the oldest outstanding move, us. `None` if no move is
    /// outstanding.
    due: Option<u64>,
    /// Max duration of the most recently submitted move, us.
    latest_us: u64,
    /// Direction of the filament move at the beginning or end of a pause. `None` if no such move is in progress.
    pub feeding: Option<MotorDirection>,
    /// Maintenance move that is in progress. `None` if no maintenance move is in progress.
    pub maintained: Option<MaintenanceMove>,
    /// Number of feed steps by which the end of the filament is behind the nozzle. A pause or maintenance has retracted
    /// the filament, and it is pushed forward again before the next layer.
    pub retracted_steps: u32,
    /// Direction of the head's next turn. Used for heads that turn to and fro.
    pub next_turn: MotorDirection,
    /// Reason for a pause after the current layer. `None` if no pause was requested.
    pub pause: Option<PauseCause>,
}

/// Maintenance move that is in progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum MaintenanceMove {
    /// Homing or rotation of the head.
    Head,
    /// Feed or retraction of filament.
    Filament {
        /// Flow of plastic through the nozzle, mm^3/s; 0 if the filament is retracted.
        flow: f64,
        /// Number of feed steps forward; 0 if the filament is retracted.
        forward: u32,
        /// Number of feed steps in reverse; 0 if the filament is pushed forward.
        back: u32,
    },
}

impl MoveTracker {
    /// Returns whether the step engine has a move that it has not yet reported as ended.
    pub fn is_under_way(&self) -> bool {
        self.outstanding > 0
    }

    /// Returns whether a maintenance move is in progress.
    pub fn is_maintenance_active(&self) -> bool {
        self.maintained.is_some()
    }

    /// Records that a maintenance move has begun at time `now`, us. `seconds` is its expected duration.
    pub fn start_maintenance(&mut self, what: MaintenanceMove, seconds: f64, now: u64) {
        if let MaintenanceMove::Filament { back, .. } = what {
            // If the move is cut off, its full length counts as pulled back. Too much is then pushed forward again
            // rather than too little.
            self.retracted_steps = self.retracted_steps.saturating_add(back);
        }
        self.maintained = Some(what);
        self.on_submitted(seconds, now);
    }

    /// Returns whether a maintenance move of filament is in progress, forward or in reverse.
    pub fn feeds_for_maintenance(&self) -> bool {
        matches!(self.maintained, Some(MaintenanceMove::Filament { .. }))
    }

    /// Records the end of a maintenance move. Returns `false` if no such move was in progress.
    pub fn finish_maintenance(&mut self, now: u64) -> bool {
        let Some(what) = self.maintained.take() else { return false };
        self.on_reported(now);
        if let MaintenanceMove::Filament { forward, .. } = what {
            self.retracted_steps = self.retracted_steps.saturating_sub(forward);
        }
        true
    }

    /// Forgets all moves, but not the position of the filament.
    pub fn halt(&mut self) {
        *self = Self { retracted_steps: self.retracted_steps, ..Self::default() };
    }

    /// Sets the number of feed steps by which the filament is behind the nozzle. Called once after a start of the
    /// board.
    pub fn set_retracted_steps(&mut self, steps: u32) {
        self.retracted_steps = steps;
    }

    /// Returns the number of feed steps by which the filament is behind the nozzle.
    pub fn behind(&self) -> u32 {
        self.retracted_steps
    }

    /// Returns whether a maintenance move that pushes filament forward is in progress.
    pub fn is_loading(&self) -> bool {
        matches!(self.maintained, Some(MaintenanceMove::Filament { forward: 1.., .. }))
    }

    /// Returns whether the step engine has failed to report the end of a move in time.
    pub fn is_overdue(&self, now: u64) -> bool {
        self.due.is_some_and(|due| now > due)
    }

    /// Records that a move was submitted to the step engine at time `now`, us. `seconds` is its expected duration.
    pub fn on_submitted(&mut self, seconds: f64, now: u64) {
        self.latest_us = (seconds * (1.0 + ALLOWANCE) * 1e6) as u64 + ALLOWANCE_US;
        if self.outstanding == 0 {
            self.due = Some(now.saturating_add(self.latest_us));
        }
        self.outstanding = self.outstanding.saturating_add(1);
    }

    /// Records that the step engine has reported the end of a move.
    pub fn on_reported(&mut self, now: u64) {
        self.outstanding = self.outstanding.saturating_sub(1);
        self.due = (self.outstanding > 0).then_some(now.saturating_add(self.latest_us));
    }
}
