//! Changes of the list of jobs. A change that cannot be written, for example because the disk is full, is kept in
//! memory until it can be written.

use std::collections::VecDeque;
use std::time::Duration;

use growbot_client::run_log::utc_now;
use rusqlite::{Connection, named_params};

use super::job_store::{BUSY_TIMEOUT, JobState, JobStore};
use super::notification::{AlertUpdate, MAX_QUEUED_PER_CHANNEL, NotificationChannel};

/// Maximum number of changes that are kept until they can be written. If there are more, the oldest changes are
/// dropped.
const MAX_KEPT: usize = 1000;

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
    fn replaces(&self, earlier: &Self) -> bool {
        match (self, earlier) {
            (Self::Progress { id, .. }, Self::Progress { id: earlier, .. })
            | (Self::State { id, .. }, Self::State { id: earlier, .. }) => id == earlier,
            _ => false,
        }
    }

    fn apply(&self, database: &Connection) -> rusqlite::Result<()> {
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

impl JobStore {
    /// Records the number of laid layers of a job, and the number of all its layers.
    pub(super) fn set_laid(&mut self, id: &str, laid: u32, layers: u32) {
        self.write(JobUpdate::Progress { id: id.to_owned(), laid, layers });
    }

    /// Changes the state of a job.
    pub(super) fn set_state(&mut self, id: &str, state: JobState, reason: Option<&str>) {
        let ended_utc = (state != JobState::Active).then(utc_now);
        self.write(JobUpdate::State { id: id.to_owned(), state, reason: reason.map(str::to_owned), ended_utc });
    }

    /// Ends a job that the robot has rejected. Its idempotency key can be used again.
    pub(super) fn mark_rejected(&mut self, id: &str, reason: &str) {
        self.set_state(id, JobState::Failed, Some(reason));
        self.write(JobUpdate::ReleasedKey { id: id.to_owned() });
    }

    /// Writes all changes that are kept in memory, then this change. Keeps this change in memory if the database cannot
    /// be written.
    pub(super) fn write(&mut self, update: JobUpdate) {
        let fails_already = self.has_kept();
        self.kept.retain(|earlier| !update.replaces(earlier));
        self.kept.push_back(update);
        if self.kept.len() > MAX_KEPT {
            self.kept.pop_front();
        }
        if let Err(error) = self.write_kept()
            && !fails_already
        {
            crate::warning!(
                "cannot write the list of jobs ({error}): its changes are kept in memory, and written once that is \
                 possible; if the disk is full, free space"
            );
        }
    }

    /// Writes all changes that are kept in memory, the oldest first.
    pub(super) fn write_kept(&mut self) -> rusqlite::Result<()> {
        while let Some(update) = self.kept.front() {
            update.apply(&self.database)?;
            if matches!(update, JobUpdate::Notice { .. } | JobUpdate::Alert(_)) {
                // The thread of a channel runs as long as the service.
                self.wakers.iter().for_each(|waker| _ = waker.send(()));
            }
            self.kept.pop_front();
        }
        Ok(())
    }

    /// Like [`Self::write_kept`], but does not wait for other users of the database.
    pub(super) fn try_write_kept(&mut self) -> rusqlite::Result<()> {
        self.database.busy_timeout(Duration::ZERO)?;
        let written = self.write_kept();
        self.database.busy_timeout(BUSY_TIMEOUT)?;
        written
    }

    /// Returns true if changes are kept in memory because they could not be written yet.
    pub(super) fn has_kept(&self) -> bool {
        !self.kept.is_empty()
    }

    /// Returns the state that a change in memory gives this job. `None` without such a change.
    pub(super) fn kept_state(&self, id: &str) -> Option<JobState> {
        self.kept.iter().find_map(|update| match update {
            JobUpdate::State { id: of, state, .. } if of == id => Some(*state),
            _ => None,
        })
    }

    /// Returns the identifiers of the jobs that a change in memory makes active.
    pub(super) fn kept_active(&self) -> Vec<&str> {
        let active = self.kept.iter().filter_map(|update| match update {
            JobUpdate::State { id, state: JobState::Active, .. } => Some(id.as_str()),
            _ => None,
        });
        active.collect()
    }
}
