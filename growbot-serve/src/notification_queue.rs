//! Queues of notices in the database, one for each channel.

use rusqlite::OptionalExtension;

use super::job_store::{JobStore, JobStoreError};
use super::notification::NotificationChannel;

/// A notice in the queue of a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct QueuedNotification {
    pub id: i64,
    pub notice: String,
    pub created_ms: i64,
    pub due_ms: i64,
    pub attempts: u32,
}

impl JobStore {
    /// Returns the queued notice of a channel that is due first. `None` if the channel's queue is empty.
    pub(super) fn next_notification(
        &self,
        channel: NotificationChannel,
    ) -> Result<Option<QueuedNotification>, JobStoreError> {
        let query = "SELECT id, notice, created_ms, due_ms, attempts FROM notice WHERE channel = ?1 \
                     ORDER BY due_ms, id LIMIT 1";
        let row = self.database.query_row(query, [channel.name()], |row| {
            Ok(QueuedNotification {
                id: row.get(0)?,
                notice: row.get(1)?,
                created_ms: row.get(2)?,
                due_ms: row.get(3)?,
                attempts: row.get(4)?,
            })
        });
        Ok(row.optional()?)
    }

    /// Removes a notice that was sent or given up from its queue.
    pub(super) fn remove_notification(&self, id: i64) -> Result<(), JobStoreError> {
        self.database.execute("DELETE FROM notice WHERE id = ?1", [id])?;
        Ok(())
    }

    /// Schedules another attempt to send a notice at the time `due_ms`, ms since 1970.
    pub(super) fn reschedule_notification(&self, id: i64, due_ms: i64) -> Result<(), JobStoreError> {
        self.database.execute("UPDATE notice SET attempts = attempts + 1, due_ms = ?2 WHERE id = ?1", (id, due_ms))?;
        Ok(())
    }
}
