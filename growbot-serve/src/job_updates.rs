//! Changes of the list of jobs. A change that cannot be written, for example because the disk is full, is kept in
//! memory until it can be written.

use std::collections::VecDeque;

use growbot_remote::api::JobState;
use rusqlite::{Connection, named_params};

use super::alert::AlertUpdate;
use super::notification::{MAX_QUEUED_PER_CHANNEL, NotificationChannel};

/// A change of the database.
#[derive(Debug, Clone)]
pub(super) enum JobUpdate {
    /// Number of laid layers of a job, and number of all its layers.
    Progress { id: String, laid: u32, layers: u32 },
    /// State of a job.
    State { id: String, state: JobState, reason: Option<String>, ended_utc: Option<String> },
    /// The idempotency key of a job can be used again.
    ReleasedKey { id: String },
    /// New notice, which is added to the queues of these channels.
    Notice { text: String, channels: Vec<NotificationChannel>, created_ms: i64 },
    /// Condition of a robot, with the notice that is queued if the condition is new.
    Alert(AlertUpdate),
}

impl JobUpdate {
    /// Returns true if this change makes the `earlier` change superfluous.
    pub fn replaces(&self, earlier: &Self) -> bool {
        match (self, earlier) {
            (Self::Progress { id, .. }, Self::Progress { id: earlier, .. })
            | (Self::State { id, .. }, Self::State { id: earlier, .. }) => id == earlier,
            _ => false,
        }
    }

    pub fn apply(&self, database: &Connection) -> rusqlite::Result<()> {
        match self {
            Self::Progress { id, laid, layers } => {
                // It does not wait for the disk, because the run log has the number if a loss of power loses it.
                database.pragma_update(None, "synchronous", "NORMAL")?;
                let update = "UPDATE job SET laid = ?2, layers = ?3 WHERE id = ?1";
                let updated = database.execute(update, (id, laid, layers));
                database.pragma_update(None, "synchronous", "FULL")?;
                updated?;
            }
            Self::State { id, state, reason, ended_utc } => {
                let update = "UPDATE job SET state = ?2, why = ?3, ended_utc = ?4 WHERE id = ?1";
                database.execute(update, (id, state.name(), reason, ended_utc))?;
            }
            Self::ReleasedKey { id } => {
                database.execute("UPDATE job SET idempotency_key = NULL WHERE id = ?1", [id])?;
            }
            Self::Notice { text, channels, created_ms } => {
                let transaction = database.unchecked_transaction()?;
                enqueue(&transaction, text, channels, *created_ms)?;
                transaction.commit()?;
            }
            Self::Alert(alert) => {
                // A condition and its notice are recorded together, so that each event has exactly one notice.
                let transaction = database.unchecked_transaction()?;
                if alert.record(&transaction)?
                    && let Some(text) = &alert.notice
                {
                    enqueue(&transaction, text, &alert.channels, alert.created_ms)?;
                }
                transaction.commit()?;
            }
        }
        Ok(())
    }
}

/// Adds a notice to the queue of each of these channels, and drops the oldest notices of a full queue.
fn enqueue(
    database: &Connection,
    text: &str,
    channels: &[NotificationChannel],
    created_ms: i64,
) -> rusqlite::Result<()> {
    for channel in channels {
        database.execute(
            "INSERT INTO notice (channel, notice, created_ms, due_ms) VALUES (:channel, :notice, :now, :now)",
            named_params! { ":channel": channel.name(), ":notice": text, ":now": created_ms },
        )?;
        database.execute(
            "DELETE FROM notice WHERE channel = ?1 AND id NOT IN \
             (SELECT id FROM notice WHERE channel = ?1 ORDER BY id DESC LIMIT ?2)",
            (channel.name(), MAX_QUEUED_PER_CHANNEL),
        )?;
    }
    Ok(())
}

/// Changes of the database that are not written yet, the oldest first.
pub(super) type KeptUpdates = VecDeque<JobUpdate>;
