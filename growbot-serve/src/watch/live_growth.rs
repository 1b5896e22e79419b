//! The state of an active growth, which the live pages and the thread that follows the growth share, and the streams of
//! events that send the state to the pages.

use std::ops::ControlFlow::{Break, Continue};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use futures_util::stream::Stream;
use growbot_client::status::RobotStatus;
use growbot_core::layer_bytes::LayerBytes;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::run_log::GrowthResult;
use growbot_plan::sanitize::json_line;
use tokio::sync::watch;

use super::growth_tracker::{GrowthTracker, UpdateCursor};
use super::heartbeat::Heartbeat;
use crate::stream_event::{StreamEvent, state_events};

/// Minimum time between two updates of a page.
const BETWEEN_UPDATES: Duration = Duration::from_millis(200);

/// State of an active growth, which the live pages and the thread that follows the growth share.
pub struct LiveGrowth {
    watched: Mutex<GrowthTracker>,
    /// Counter of changes of the growth. The stream of each open page waits until the counter changes.
    changes: watch::Sender<u64>,
    is_left: AtomicBool,
}

impl LiveGrowth {
    /// Creates the state of a growth that is about to start, or to be resumed after the `known` layers. `robot` is the
    /// part of the robot's status that its board does not report.
    pub fn new(job: &Job, known: &[Option<LayerBytes>], robot: RobotStatus) -> Arc<Self> {
        let watched = Mutex::new(GrowthTracker::new(job, known, robot));
        Arc::new(Self { watched, changes: watch::Sender::new(0), is_left: AtomicBool::new(false) })
    }

    fn watched(&self) -> MutexGuard<'_, GrowthTracker> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Updates the state of the growth with an event, and sends the change to the pages.
    pub fn ingest(&self, event: &JobEvent) {
        self.watched().ingest(event);
        self.signal_change();
    }

    /// Returns the status of the robot.
    pub fn status(&self) -> RobotStatus {
        self.watched().status()
    }

    /// Returns a receiver of the counter of changes of the growth.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
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

    /// Returns true if a page has not received the result yet. Each of its streams holds the growth.
    pub(super) fn is_followed(self: &Arc<Self>) -> bool {
        Arc::strong_count(self) > 1
    }

    /// Returns the stream of events for a page that shows this growth: updates and heartbeats. It begins with an
    /// update, and ends after the result of the growth or when the growth is superseded.
    pub fn updates(self: Arc<Self>) -> impl Stream<Item = StreamEvent> + Send {
        let (mut seen, mut sent) = (UpdateCursor::default(), String::new());
        state_events(self.changes(), BETWEEN_UPDATES, move |is_heartbeat_due| {
            if seen.ended || self.is_left.load(Ordering::Acquire) {
                return Break(());
            }
            if is_heartbeat_due && !sent.is_empty() {
                return Continue(Some(StreamEvent::heartbeat(&Heartbeat::now(self.status().status_age_s))));
            }
            let update = json_line(&self.watched().update_for(&mut seen));
            let is_new = update != sent;
            sent = update;
            Continue(is_new.then(|| StreamEvent::new("update", &sent)))
        })
    }
}
