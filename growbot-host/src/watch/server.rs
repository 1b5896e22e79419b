//! HTTP server of the page: the page, its updates as server-sent events, and commands.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::Router;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::middleware::from_fn;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::{Stream, unfold};
use growbot_client::growth::Command;
use growbot_client::sanitize::json_line;
use tokio::net::TcpListener;
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

use super::growth_tracker::UpdateCursor;
use super::origin_check::{not_found, require_same_origin};
use super::{LiveGrowth, WatchState};

/// Minimum time between two updates of a page.
const BETWEEN_UPDATES: Duration = Duration::from_millis(200);
/// Time that connections have to close by themselves.
const TO_CLOSE: Duration = Duration::from_millis(500);

/// Serves until `stopped` is signalled.
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
        .route(&format!("/{token}/commands/{{command}}"), post(order))
        .fallback(not_found)
        .method_not_allowed_fallback(not_found)
        .with_state(shared)
        .layer(from_fn(require_same_origin))
}

async fn page(State(shared): State<Arc<WatchState>>) -> Html<String> {
    Html(shared.page.clone())
}

async fn updates(State(shared): State<Arc<WatchState>>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    updates_of(Arc::clone(&shared.live))
}

/// Returns the stream of a page's updates.
pub fn updates_of(live: Arc<LiveGrowth>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let listener =
        Listener { changes: live.changes.subscribe(), live, seen: UpdateCursor::default(), is_first_sent: false };
    Sse::new(unfold(listener, Listener::next)).keep_alive(KeepAlive::default())
}

/// One open page.
struct Listener {
    live: Arc<LiveGrowth>,
    changes: watch::Receiver<u64>,
    seen: UpdateCursor,
    /// True if the page has been sent an update.
    is_first_sent: bool,
}

impl Listener {
    /// Returns the next update: the first one at once, the others after a change. `None` after the end.
    async fn next(mut self) -> Option<(Result<Event, Infallible>, Self)> {
        if self.seen.ended || self.live.is_left.load(Ordering::Acquire) {
            return None;
        }
        if self.is_first_sent {
            sleep(BETWEEN_UPDATES).await;
            self.changes.changed().await.ok()?;
            if self.live.is_left.load(Ordering::Acquire) {
                return None;
            }
        }
        self.changes.mark_unchanged();
        let update = json_line(&self.live.watched().update_for(&mut self.seen));
        self.is_first_sent = true;
        Some((Ok(Event::default().data(update.trim_end())), self))
    }
}

async fn order(State(shared): State<Arc<WatchState>>, Path(name): Path<String>) -> Response {
    send_command(&shared.live, &name).await
}

/// Queues a command with this name, which a page has sent.
pub async fn send_command(live: &LiveGrowth, name: &str) -> Response {
    let Some(orders) = &live.orders else {
        return (StatusCode::FORBIDDEN, "this page is read-only: start growbot with --control").into_response();
    };
    let Some(order) = Command::ALL.into_iter().find(|order| order.name() == name) else { return not_found().await };
    orders.push(order);
    StatusCode::ACCEPTED.into_response()
}
