//! State of the service that the threads of all robots and the server share.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::body::Bytes;
use tokio::sync::watch;

use super::alert::Alert;
use super::audit::Audit;
use super::camera::Cameras;
use super::job_store::JobStore;
use super::library_store::LibraryStore;
use super::notification::{NotificationContext, NotificationEvent};
use super::notifier::Notifier;
use super::queue_store::QueueStore;

/// Maximum number of previews (pages of plans) that are kept.
const MAX_PREVIEWS: usize = 8;

/// HTML pages of the latest plans, with their numbers.
#[derive(Default)]
pub(super) struct Previews {
    latest: u64,
    pages: VecDeque<(u64, Bytes)>,
}

/// State that the threads of all robots and the server share.
pub(super) struct ServiceContext {
    pub(super) job_writer: Arc<Mutex<JobStore>>,
    /// A second, read-only connection to the list of jobs. With it the server does not wait for a robot's thread that
    /// writes to the disk.
    pub(super) job_reader: Mutex<JobStore>,
    pub(super) audit: Audit,
    pub(super) notifier: Notifier,
    pub(super) cameras: Cameras,
    pub(super) previews: Mutex<Previews>,
    pub(super) queue: QueueStore,
    pub(super) library: LibraryStore,
    /// Counter of changes of the service's state. Each open stream of events waits until the counter changes.
    pub(super) changes: watch::Sender<u64>,
}

impl ServiceContext {
    /// Keeps the page of a plan. Drops the oldest page if there are more than [`MAX_PREVIEWS`] pages. Returns the
    /// number of the new page.
    pub(super) fn keep_preview(&self, page: Bytes) -> u64 {
        let mut previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.latest += 1;
        let number = previews.latest;
        previews.pages.push_back((number, page));
        if previews.pages.len() > MAX_PREVIEWS {
            previews.pages.pop_front();
        }
        number
    }

    pub(super) fn preview(&self, number: u64) -> Option<Bytes> {
        let previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.pages.iter().find(|(of, _)| *of == number).map(|(_, page)| page.clone())
    }

    pub(super) fn jobs(&self) -> MutexGuard<'_, JobStore> {
        self.job_writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn jobs_to_read(&self) -> MutexGuard<'_, JobStore> {
        self.job_reader.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Increments the counter of changes, which wakes all streams of events that wait for a change.
    pub(super) fn signal_change(&self) {
        self.changes.send_modify(|changes| *changes = changes.wrapping_add(1));
    }

    /// Queues a notice about a robot if a channel is configured.
    pub fn notify_event(&self, about: &NotificationContext, event: NotificationEvent, why: Option<&str>) {
        if let Some(update) = self.notifier.event_update(about, event, why) {
            self.jobs().write(update);
        }
    }

    /// Records conditions of a robot, and queues a notice for each condition that is new.
    pub fn notify_alerts(&self, about: &NotificationContext, alerts: impl IntoIterator<Item = Alert>) {
        for update in self.notifier.alert_updates(about, alerts) {
            self.jobs().write(update);
        }
    }
}
