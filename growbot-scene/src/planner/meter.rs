//! What a search has spent, and when it has to stop.

use std::time::Instant;

use crate::clear::Work;

/// The clock is looked at after this many distances.
const BETWEEN_LOOKS: u64 = 512;

/// A search's account: work done, work allowed, and the time of day at which it ends whatever is done.
#[derive(Debug)]
pub(super) struct Meter {
    pub(super) work: Work,
    limit: u64,
    deadline: Option<Instant>,
    next_look: u64,
    late: bool,
}

impl Meter {
    pub(super) fn new(limit: u64, deadline: Option<Instant>) -> Self {
        Self { work: Work(0), limit, deadline, next_look: 0, late: false }
    }

    /// Whether the search has to stop.
    pub(super) fn is_over(&mut self) -> bool {
        if self.work.0 >= self.next_look {
            self.next_look = self.work.0 + BETWEEN_LOOKS;
            self.late = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        }
        self.late || self.work.0 >= self.limit
    }

    /// Whether a part of the search that may work until here has to stop.
    pub(super) fn is_over_or_at(&mut self, until: u64) -> bool {
        self.work.0 >= until || self.is_over()
    }
}
