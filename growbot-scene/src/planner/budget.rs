//! The work of a search and its limits.

use std::time::Instant;

use crate::clearance::DistanceQueries;

/// Number of distance queries between two checks of the clock.
const BETWEEN_LOOKS: u64 = 512;

/// Budget of a search: distance queries made and allowed, and the deadline.
#[derive(Debug)]
pub(super) struct BudgetTracker {
    pub(super) work: DistanceQueries,
    limit: u64,
    deadline: Option<Instant>,
    next_look: u64,
    late: bool,
}

impl BudgetTracker {
    pub(super) fn new(limit: u64, deadline: Option<Instant>) -> Self {
        Self { work: DistanceQueries(0), limit, deadline, next_look: 0, late: false }
    }

    /// Returns true if the search has to stop. The clock is checked only every [`BETWEEN_LOOKS`] distance queries.
    pub(super) fn check_exhausted(&mut self) -> bool {
        if self.work.0 >= self.next_look {
            self.next_look = self.work.0 + BETWEEN_LOOKS;
            self.late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        }
        self.late || self.work.0 >= self.limit
    }

    /// Returns true if a part of the search has to stop, because the number of distance queries has reached `until` or
    /// the whole search has to stop.
    pub(super) fn check_exhausted_or_at(&mut self, until: u64) -> bool {
        self.work.0 >= until || self.check_exhausted()
    }
}
