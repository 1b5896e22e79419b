//! The state of an active growth, which the live pages and the thread that follows the growth share.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use growbot_client::growth::CommandQueue;
use growbot_client::port::time_since_boot;
use growbot_core::layer_bytes::LayerBytes;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::run_log::GrowthResult;
use tokio::sync::watch;

use super::growth_tracker::GrowthTracker;
use super::heartbeat;

/// State of an active growth, which the live pages and the thread that follows the growth share.
pub struct LiveGrowth {
    /// Queue of commands to the growth. `None` if the pages are read-only.
    pub(super) orders: Option<Arc<CommandQueue>>,
    watched: Mutex<GrowthTracker>,
    /// Time of the board's latest report, since the start of this computer. `None` before the first report.
    reported: Mutex<Option<Duration>>,
    /// Counter of changes of the growth. The stream of each open page waits until the counter changes.
    pub(super) changes: watch::Sender<u64>,
    pub(super) is_left: AtomicBool,
}

impl LiveGrowth {
    /// Creates the state of a growth that is about to start, or to be resumed after the `known` layers. Pages can send
    /// commands only if `orders`, the queue of commands, is given.
    pub fn new(job: &Job, known: &[Option<LayerBytes>], orders: Option<Arc<CommandQueue>>) -> Arc<Self> {
        let watched = Mutex::new(GrowthTracker::new(job, known));
        let reported = Mutex::default();
        Arc::new(Self { orders, watched, reported, changes: watch::Sender::new(0), is_left: AtomicBool::new(false) })
    }

    pub(super) fn watched(&self) -> MutexGuard<'_, GrowthTracker> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the pace of the robot's clock, in multiples of real time, from which the expected end of the growth is
    /// computed. `None` if the pace is not known.
    pub fn set_pace(&self, pace: Option<f64>) {
        self.watched().set_pace(pace);
    }

    /// Updates the state of the growth with an event, and sends the change to the pages.
    pub fn ingest(&self, event: &JobEvent) {
        if matches!(event, JobEvent::Board(_) | JobEvent::Status(_) | JobEvent::State(_) | JobEvent::Laid { .. }) {
            *self.reported.lock().unwrap_or_else(PoisonError::into_inner) = Some(time_since_boot());
        }
        self.watched().ingest(event);
        self.signal_change();
    }

    /// Returns the time since the board's latest report, s. `None` before the first report.
    pub(super) fn status_age_s(&self) -> Option<f64> {
        let reported = *self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        Some(heartbeat::status_age_s(reported?, self.watched().pace()))
    }

    /// Shows a problem with this program's own files on the pages, or clears it.
    pub fn set_warning(&self, words: Option<String>) {
        self.watched().set_warning(words);
        self.signal_change();
    }

    /// Sends the result to the pages, in the format of `growbot grow --json`.
    pub fn end(&self, result: GrowthResult) {
        self.watched().end(result);
        self.signal_change();
    }

    /// Ends the streams of events of this growth, because another [`LiveGrowth`] will replace it. The pages then
    /// reconnect.
    pub fn supersede(&self) {
        self.is_left.store(true, Ordering::Release);
        self.signal_change();
    }

    fn signal_change(&self) {
        self.changes.send_modify(|changes| *changes += 1);
    }
}
