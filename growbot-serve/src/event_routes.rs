//! Routes of the API for streams of events, as server-sent events and on WebSockets.

use axum::Extension;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, Query, State};
use axum::http::HeaderMap;
use axum::response::Response;
use futures_util::stream::Stream;
use serde::Deserialize;

use super::event_stream::{self, StreamEvent};
use super::handler::{ServiceState, found_job};
use super::limits::StreamPermit;
use super::problem::Problem;

/// Maximum length of a client's message on a WebSocket, bytes. The messages of clients are ignored.
const MAX_HEARD: usize = 1024;
/// Length of the buffer for messages of a client, bytes.
const READ_BUFFER: usize = 4096;

/// Query of a request for the events of a job. `after` is the number of the log line after which the stream starts.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventQuery {
    after: Option<u64>,
}

/// Returns the number of the log line after which the stream starts: from the header `Last-Event-ID`, otherwise from
/// the query, otherwise 0.
fn start_line(headers: &HeaderMap, EventQuery { after }: EventQuery) -> u64 {
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse().ok());
    last.or(after).unwrap_or(0)
}

pub async fn job_stream(
    State(service): ServiceState,
    Path(id): Path<String>,
    Query(query): Query<EventQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    Ok(event_stream::sse_response(event_stream::job_events(service, job.id, start_line(&headers, query))))
}

pub async fn job_socket(
    State(service): ServiceState,
    Extension(permit): Extension<StreamPermit>,
    Path(id): Path<String>,
    Query(query): Query<EventQuery>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Problem> {
    let job = found_job(&service, &id)?;
    let events = event_stream::job_events(service, job.id, start_line(&headers, query));
    Ok(socket(upgrade, permit, events))
}

pub async fn robot_stream(State(service): ServiceState) -> Response {
    event_stream::sse_response(event_stream::robot_events(service))
}

pub async fn robot_socket(
    State(service): ServiceState,
    Extension(permit): Extension<StreamPermit>,
    upgrade: WebSocketUpgrade,
) -> Response {
    socket(upgrade, permit, event_stream::robot_events(service))
}

fn socket(
    upgrade: WebSocketUpgrade,
    permit: StreamPermit,
    events: impl Stream<Item = StreamEvent> + Send + 'static,
) -> Response {
    let upgrade = upgrade.max_message_size(MAX_HEARD).max_frame_size(MAX_HEARD).read_buffer_size(READ_BUFFER);
    upgrade.on_upgrade(|socket| async move {
        event_stream::on_socket(socket, events).await;
        drop(permit);
    })
}
