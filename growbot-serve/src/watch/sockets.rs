//! WebSockets of a live page: one for updates, one for commands. Browsers do not count WebSockets among their few
//! connections to a host, so updates and commands do not wait for other requests.

use std::future::Future;
use std::pin::pin;
use std::time::Duration;

use axum::body::{Bytes, to_bytes};
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::Response;
use futures_util::stream::{Stream, StreamExt};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};

use super::heartbeat::OrderAge;

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
pub fn limited(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
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

/// Sends the texts of a stream until the stream ends or the client closes the connection. Messages of the client are
/// ignored.
pub async fn send_texts(mut socket: WebSocket, texts: impl Stream<Item = String> + Send) {
    let mut texts = pin!(texts);
    loop {
        tokio::select! {
            next = texts.next() => match next {
                Some(text) => if !send(&mut socket, Message::text(text)).await {
                    return;
                },
                None => break,
            },
            heard = socket.recv() => if !matches!(heard, Some(Ok(_))) {
                return;
            },
        }
    }
    // The client may be gone and not receive this.
    let _ = send(&mut socket, Message::Close(None)).await;
}

/// Carries out the commands of a client until it closes the connection. Each command is started at once, in parallel
/// with earlier commands, and is carried out even if the client disconnects. Its reply is sent as soon as the command
/// has ended.
pub async fn serve_commands<R>(mut socket: WebSocket, carry_out: impl Fn(CommandMessage) -> R)
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
