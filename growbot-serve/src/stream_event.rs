//! Events of a stream, and the streams of a state that changes.

use std::ops::ControlFlow;
use std::time::Duration;

use axum::response::sse::Event;
use futures_util::stream::{Stream, unfold};
use growbot_plan::sanitize::json_line;
use serde::Serialize;
use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};

use crate::watch::heartbeat::Heartbeat;

/// Version of the messages on a WebSocket.
const VERSION: u32 = 1;
/// Name of the event that is a heartbeat.
const HEARTBEAT: &str = "heartbeat";
/// Interval between two heartbeats of a stream.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(2);
/// Maximum time after which the state is read even if no change was reported.
const POLL_INTERVAL: Duration = Duration::from_secs(1);

/// An event of a stream.
pub struct StreamEvent {
    /// Name of the event.
    pub event: &'static str,
    /// Number of the log line, after which a client can resume the stream. `None` for other events.
    pub id: Option<u64>,
    /// Content of the event, a line of JSON.
    pub data: String,
}

impl StreamEvent {
    /// Returns an event with this content, a line of JSON.
    pub fn new(event: &'static str, data: &str) -> Self {
        Self { event, id: None, data: data.trim_end().to_owned() }
    }

    /// Returns a heartbeat.
    pub fn heartbeat(content: &Heartbeat<impl Serialize>) -> Self {
        Self::new(HEARTBEAT, &json_line(content))
    }

    /// Converts the event to a server-sent event.
    pub fn into_sse(self) -> Event {
        let event = Event::default().event(self.event).data(self.data);
        match self.id {
            Some(id) => event.id(id.to_string()),
            None => event,
        }
    }

    /// Returns the event as a message on a WebSocket, with the version of the messages.
    pub fn message(&self) -> String {
        let Self { event, id, data } = self;
        let id = id.map_or_else(String::new, |id| format!(r#""id":{id},"#));
        format!(r#"{{"version":{VERSION},"event":"{event}",{id}"data":{data}}}"#)
    }
}

/// Returns a stream of the state that `changes` counts. At most once in each `interval`, `next` returns the next event,
/// or `None` if the state has not changed. It ends the stream by `Break`. Its argument is true if a heartbeat is due.
pub fn state_events<F>(changes: watch::Receiver<u64>, interval: Duration, next: F) -> impl Stream<Item = StreamEvent>
where
    F: FnMut(bool) -> ControlFlow<(), Option<StreamEvent>>,
{
    let start = (changes, next, Instant::now(), Duration::ZERO);
    unfold(start, move |(mut changes, mut next, mut heartbeat_at, mut pause)| async move {
        loop {
            sleep(pause).await;
            pause = interval;
            changes.mark_unchanged();
            let is_due = Instant::now() >= heartbeat_at;
            if let Some(event) = next(is_due).continue_value()? {
                if event.event == HEARTBEAT {
                    heartbeat_at = Instant::now() + HEARTBEAT_INTERVAL;
                }
                return Some((event, (changes, next, heartbeat_at, pause)));
            }
            let until_heartbeat = heartbeat_at.saturating_duration_since(Instant::now());
            let _ = timeout(POLL_INTERVAL.min(until_heartbeat), changes.changed()).await;
        }
    })
}
