//! Streams of events and WebSockets of pages: for events, and for commands. Browsers do not count WebSockets among
//! their few connections to a host, so events and commands do not wait for other requests.

use std::convert::Infallible;
use std::future::Future;
use std::pin::pin;
use std::time::Duration;

use aide::OperationInput;
use axum::body::{Bytes, to_bytes};
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Extension, FromRequestParts};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::sse::{KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream::{Stream, StreamExt};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};

use super::heartbeat::OrderAge;
use crate::access::{Access, require_control};
use crate::limits::StreamPermit;
use crate::problem::Problem;
use crate::stream_event::StreamEvent;

/// Maximum length of a client's message on a WebSocket, bytes.
const MAX_MESSAGE: usize = 4096;
/// Maximum length of the reply to a command, bytes.
const MAX_REPLY: usize = 64 << 10;
/// Maximum number of commands of one client that are carried out at a time.
const MAX_CONCURRENT_COMMANDS: usize = 64;
/// Interval of pings to a silent client. It is also the timeout for sending a message.
const PING_INTERVAL: Duration = Duration::from_secs(15);
/// Number of unanswered pings after which the connection is closed.
const MAX_UNANSWERED_PINGS: u32 = 2;

/// Sets the maximum length of the messages that a client sends on this WebSocket.
fn limited(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    upgrade.max_message_size(MAX_MESSAGE).max_frame_size(MAX_MESSAGE).read_buffer_size(MAX_MESSAGE)
}

/// A command that a page sends on its WebSocket for commands.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandMessage {
    /// Number of the command, which its reply repeats.
    id: u64,
    /// Name of the robot. Empty on the page of a growth.
    #[serde(default)]
    pub robot: String,
    /// Name of the command.
    pub command: String,
    /// Time at which the command was given, on the clock of the heartbeats, ms. `None` if the client does not know this
    /// time.
    #[serde(default)]
    pub time_ms: Option<u64>,
}

impl CommandMessage {
    /// Checks the age of the command, which arrives now.
    pub fn age(&self) -> OrderAge {
        self.time_ms.map_or_else(OrderAge::default, OrderAge::of_time)
    }
}

/// Reply to a command on a WebSocket.
#[derive(Debug, Serialize)]
struct CommandReply {
    /// Number of the command. 0 if the command could not be parsed.
    id: u64,
    /// HTTP status that the response has if the command is sent by HTTP.
    status: u16,
    /// Body that the response has if the command is sent by HTTP.
    body: Value,
}

impl CommandReply {
    async fn of(id: u64, response: Response) -> Self {
        let status = response.status().as_u16();
        let bytes = to_bytes(response.into_body(), MAX_REPLY).await.unwrap_or_default();
        let text = || Value::String(String::from_utf8_lossy(&bytes).into_owned());
        Self { id, status, body: serde_json::from_slice(&bytes).unwrap_or_else(|_| text()) }
    }

    fn rejection(id: u64, status: StatusCode, detail: &str) -> Self {
        Self { id, status: status.as_u16(), body: json!({ "detail": detail }) }
    }

    fn message(&self) -> Message {
        Message::text(serde_json::to_string(self).unwrap_or_default())
    }
}

/// Way in which a client receives a stream of events: on a WebSocket if its path ends with `/ws`, otherwise as
/// server-sent events.
pub enum EventSink {
    /// Server-sent events.
    ServerSent,
    /// A WebSocket, with the permit that is held until it is closed.
    Socket(WebSocketUpgrade, StreamPermit),
}

impl OperationInput for EventSink {}

impl<S: Send + Sync> FromRequestParts<S> for EventSink {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Response> {
        if !parts.uri.path().ends_with("/ws") {
            return Ok(Self::ServerSent);
        }
        let extracted = <(WebSocketUpgrade, Extension<StreamPermit>)>::from_request_parts(parts, state).await;
        extracted.map(|(upgrade, Extension(permit))| Self::Socket(upgrade, permit))
    }
}

impl EventSink {
    /// Returns the response that sends these events to the client.
    pub fn send(self, events: impl Stream<Item = StreamEvent> + Send + 'static) -> Response {
        match self {
            Self::ServerSent => {
                let events = events.map(|event| Ok::<_, Infallible>(event.into_sse()));
                Sse::new(events).keep_alive(KeepAlive::default()).into_response()
            }
            Self::Socket(upgrade, permit) => limited(upgrade).on_upgrade(|socket| async move {
                send_events(socket, events).await;
                drop(permit);
            }),
        }
    }
}

/// Opens a WebSocket, and carries out the commands that arrive on it.
///
/// # Errors
/// The client can only read.
pub fn command_socket<R>(
    upgrade: WebSocketUpgrade,
    access: Access,
    carry_out: impl Fn(CommandMessage) -> R + Send + Sync + 'static,
) -> Result<Response, Problem>
where
    R: Future<Output = Response> + Send + 'static,
{
    require_control(access)?;
    Ok(limited(upgrade).on_upgrade(|socket| serve_commands(socket, carry_out)))
}

/// Sends the events of a stream until the stream ends or the client closes the connection. Messages of the client are
/// ignored.
async fn send_events(mut socket: WebSocket, events: impl Stream<Item = StreamEvent> + Send) {
    let mut events = pin!(events);
    let mut unanswered = 0;
    loop {
        let is_open = tokio::select! {
            next = events.next() => match next {
                Some(event) => send(&mut socket, Message::text(event.message())).await,
                None => break,
            },
            heard = socket.recv() => {
                unanswered = 0;
                matches!(heard, Some(Ok(_)))
            }
            () = sleep(PING_INTERVAL) => {
                unanswered += 1;
                unanswered <= MAX_UNANSWERED_PINGS && send(&mut socket, Message::Ping(Bytes::new())).await
            }
        };
        if !is_open {
            return;
        }
    }
    // The client may be gone and not receive this.
    let _ = send(&mut socket, Message::Close(None)).await;
}

/// Carries out the commands of a client until it closes the connection. Each command is started at once, in parallel
/// with earlier commands, and is carried out even if the client disconnects. Its reply is sent as soon as the command
/// has ended.
async fn serve_commands<R>(mut socket: WebSocket, carry_out: impl Fn(CommandMessage) -> R)
where
    R: Future<Output = Response> + Send + 'static,
{
    let (replies, mut done) = mpsc::channel(MAX_CONCURRENT_COMMANDS);
    let mut unanswered = 0;
    loop {
        let message = tokio::select! {
            heard = socket.recv() => {
                let Some(Ok(heard)) = heard else { return };
                unanswered = 0;
                let Message::Text(text) = heard else { continue };
                match (serde_json::from_str::<CommandMessage>(&text), replies.clone().try_reserve_owned()) {
                    (Ok(command), Ok(place)) => {
                        let (id, response) = (command.id, carry_out(command));
                        tokio::spawn(async move { place.send(CommandReply::of(id, response.await).await) });
                        continue;
                    }
                    (Err(error), _) => {
                        CommandReply::rejection(0, StatusCode::BAD_REQUEST, &format!(
                            "the message is invalid ({error}): correct the message"))
                    }
                    (Ok(command), Err(_)) => {
                        let detail =
                            format!(
                                "{MAX_CONCURRENT_COMMANDS} commands of this connection are still being carried out: \
                                 wait for their replies");
                        CommandReply::rejection(command.id, StatusCode::SERVICE_UNAVAILABLE, &detail)
                    }
                }
            }
            Some(reply) = done.recv() => reply,
            () = sleep(PING_INTERVAL) => {
                unanswered += 1;
                if unanswered > MAX_UNANSWERED_PINGS || !send(&mut socket, Message::Ping(Bytes::new())).await {
                    return;
                }
                continue;
            }
        };
        if !send(&mut socket, message.message()).await {
            return;
        }
    }
}

/// Sends a message. Returns false if the client does not accept it in time.
async fn send(socket: &mut WebSocket, message: Message) -> bool {
    timeout(PING_INTERVAL, socket.send(message)).await.is_ok_and(|sent| sent.is_ok())
}
