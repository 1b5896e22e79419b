//! HTTP server of a live page: it serves the page and its updates, as server-sent events or on a WebSocket, and
//! receives commands.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::from_fn;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::{Stream, StreamExt, unfold};
use growbot_plan::job::Command;
use growbot_plan::sanitize::json_line;
use tokio::net::TcpListener;
use tokio::sync::{oneshot, watch};
use tokio::time::{sleep, timeout};

use super::growth_tracker::UpdateCursor;
use super::heartbeat::{Heartbeat, HeartbeatTimer, OrderAge};
use super::live_growth::LiveGrowth;
use super::origin_check::{not_found, require_same_origin};
use super::sockets::{CommandMessage, limited, send_texts, serve_commands};

/// Minimum time between two updates of a page.
const BETWEEN_UPDATES: Duration = Duration::from_millis(200);
/// Maximum time in which open connections can close by themselves when the server stops.
const TO_CLOSE: Duration = Duration::from_millis(500);

/// State that the handlers of the server share: the page, its token and the growth.
pub struct WatchState {
    pub(super) page: String,
    /// Secret token, with which every path of the server begins.
    pub(super) token: String,
    pub(super) live: Arc<LiveGrowth>,
}

/// Serves the live page until `stopped` is signalled.
pub async fn serve(listener: TcpListener, shared: Arc<WatchState>, stopped: oneshot::Receiver<()>) {
    let (closing, closed) = oneshot::channel();
    let stop = async move {
        let _ = stopped.await;
        let _ = closing.send(());
    };
    let server = axum::serve(listener, routes(shared)).with_graceful_shutdown(stop).into_future();
    let too_late = async move {
        let _ = closed.await;
        sleep(TO_CLOSE).await;
    };
    tokio::select! { _ = server => {}, () = too_late => {} }
}

fn routes(shared: Arc<WatchState>) -> Router {
    let token = &shared.token;
    Router::new()
        .route(&format!("/{token}/"), get(page))
        .route(&format!("/{token}/updates"), get(updates))
        .route(&format!("/{token}/updates/ws"), get(update_socket))
        .route(&format!("/{token}/commands/ws"), get(command_socket))
        .route(&format!("/{token}/commands/{{command}}"), post(order))
        .fallback(not_found)
        .method_not_allowed_fallback(not_found)
        .with_state(shared)
        .layer(from_fn(require_same_origin))
}

async fn page(State(shared): State<Arc<WatchState>>) -> Html<String> {
    Html(shared.page.clone())
}

async fn updates(State(shared): State<Arc<WatchState>>) -> Response {
    sse_response(updates_of(Arc::clone(&shared.live)))
}

async fn update_socket(State(shared): State<Arc<WatchState>>, upgrade: WebSocketUpgrade) -> Response {
    let updates = updates_of(Arc::clone(&shared.live));
    limited(upgrade).on_upgrade(|socket| send_texts(socket, updates.map(|event| event.text())))
}

/// An event of the stream for a live page.
pub struct LiveEvent {
    name: &'static str,
    /// Content of the event, a line of JSON.
    data: String,
}

impl LiveEvent {
    /// Returns a heartbeat with the age of the board's latest status, s.
    pub fn heartbeat(status_age_s: Option<f64>) -> Self {
        Self { name: "heartbeat", data: Heartbeat::json(status_age_s) }
    }

    /// Returns the event that ends the stream of a growth that is not active any more.
    pub fn end(detail: &str) -> Self {
        Self { name: "end", data: serde_json::json!({ "detail": detail }).to_string() }
    }

    /// Returns the event as a message on a WebSocket.
    pub fn text(&self) -> String {
        format!(r#"{{"event":"{}","data":{}}}"#, self.name, self.data)
    }
}

/// Sends a stream as server-sent events.
pub fn sse_response(events: impl Stream<Item = LiveEvent> + Send + 'static) -> Response {
    let events = events.map(|event| Ok::<_, Infallible>(Event::default().event(event.name).data(event.data)));
    Sse::new(events).keep_alive(KeepAlive::default()).into_response()
}

/// Returns the stream of events for a page that shows this growth: updates and heartbeats.
pub fn updates_of(live: Arc<LiveGrowth>) -> impl Stream<Item = LiveEvent> + Send {
    let listener = Listener {
        changes: live.changes.subscribe(),
        live,
        seen: UpdateCursor::default(),
        heartbeats: HeartbeatTimer::new(),
        is_first_sent: false,
    };
    unfold(listener, Listener::next)
}

/// State of the stream of events for one open page.
struct Listener {
    live: Arc<LiveGrowth>,
    changes: watch::Receiver<u64>,
    seen: UpdateCursor,
    heartbeats: HeartbeatTimer,
    /// True if the page has been sent an update.
    is_first_sent: bool,
}

impl Listener {
    /// Returns the next event: the first update at once, further updates after a change, and a heartbeat when one is
    /// due. `None` after the result of the growth was sent, or after the growth was superseded.
    async fn next(mut self) -> Option<(LiveEvent, Self)> {
        if self.seen.ended || self.live.is_left.load(Ordering::Acquire) {
            return None;
        }
        if self.is_first_sent {
            let change = async {
                sleep(BETWEEN_UPDATES).await;
                self.changes.changed().await
            };
            match timeout(self.heartbeats.remaining(), change).await {
                Ok(changed) => changed.ok()?,
                Err(_) => {
                    self.heartbeats.restart();
                    return Some((LiveEvent::heartbeat(self.live.status_age_s()), self));
                }
            }
            if self.live.is_left.load(Ordering::Acquire) {
                return None;
            }
        }
        self.changes.mark_unchanged();
        let update = json_line(&self.live.watched().update_for(&mut self.seen));
        self.is_first_sent = true;
        Some((LiveEvent { name: "update", data: update.trim_end().to_owned() }, self))
    }
}

async fn order(State(shared): State<Arc<WatchState>>, Path(name): Path<String>, headers: HeaderMap) -> Response {
    send_command(&shared.live, &name, &OrderAge::of_request(&headers)).await
}

async fn command_socket(State(shared): State<Arc<WatchState>>, upgrade: WebSocketUpgrade) -> Response {
    limited(upgrade).on_upgrade(|socket| {
        serve_commands(socket, move |message: CommandMessage| {
            let shared = Arc::clone(&shared);
            let age = message.age();
            async move { send_command(&shared.live, &message.command, &age).await }
        })
    })
}

/// Queues the command with this name, which a page has sent. Rejects a command that is too old, unless it stops or
/// pauses the robot.
pub async fn send_command(live: &LiveGrowth, name: &str, age: &OrderAge) -> Response {
    let Some(orders) = &live.orders else {
        return (StatusCode::FORBIDDEN, "this page is read-only: start growbot so that its page may control the robot")
            .into_response();
    };
    let Ok(order) = name.parse::<Command>() else { return not_found().await };
    let stops_or_pauses = matches!(order, Command::Pause | Command::Stop | Command::EmergencyStop);
    if let Err(late) = age.check()
        && !stops_or_pauses
    {
        return (StatusCode::CONFLICT, late.to_string()).into_response();
    }
    orders.push(order);
    StatusCode::ACCEPTED.into_response()
}
