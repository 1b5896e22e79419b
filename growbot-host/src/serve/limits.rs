//! Limits of a client's use of the service, so that no client blocks another one or delays a command to a robot.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::serve::Listener;
use http_body_util::{BodyExt, LengthLimitError};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncWriteExt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::AbortHandle;
use tokio::time::timeout;
use tokio_io_timeout::TimeoutStream;

use super::problem::Problem;

/// Maximum number of open connections, for pages and for growbot's commands separately.
pub const CONNECTIONS: usize = 256;
/// Maximum number of open streams of events, for pages and for growbot's commands separately.
pub const STREAMS: usize = 64;
/// Maximum length of a request's body, bytes.
pub const MAX_BODY: usize = 16 << 20;
/// Length up to which the number of bodies that are read at a time is not limited, bytes.
const SHORT_BODY: u64 = 64 << 10;
const LONG_BODIES: usize = 2;
/// Maximum number of plans and pages that are computed at a time, because they load the processor.
const MAX_CONCURRENT_RENDERS: usize = 4;
/// Time after which a connection is closed if the client does not read a response.
const WRITE_TIMEOUT: Duration = Duration::from_secs(30);

/// Returns the HTTP response to a connection beyond the limit.
fn too_many() -> Vec<u8> {
    let problem = Problem::busy(&format!("{CONNECTIONS} connections are already open"));
    let body = serde_json::to_string(&problem).unwrap_or_default();
    format!(
        "HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\nretry-after: 1\r\ncontent-type: \
         application/problem+json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .into_bytes()
}

/// The connections of one listener.
pub struct ConnectionLimiter {
    open: Mutex<BTreeMap<u64, OpenConnection>>,
    streams: Arc<Semaphore>,
    long_bodies: Arc<Semaphore>,
    computed: Arc<Semaphore>,
    /// Timeout of a request's body. Its head, and the pause before the next request, have half of it.
    request: Duration,
}

/// An open connection.
struct OpenConnection {
    /// True if the connection has sent an authenticated request.
    authenticated: bool,
    task: Option<AbortHandle>,
}

/// Reference to a connection, which its requests carry.
#[derive(Clone)]
pub struct ConnectionHandle {
    door: Arc<ConnectionLimiter>,
    number: u64,
}

impl ConnectionHandle {
    /// Marks the connection as authenticated. New connections never replace it.
    pub fn mark_authenticated(&self) {
        if let Some(open) = self.door.open().get_mut(&self.number) {
            open.authenticated = true;
        }
    }
}

/// Removes the connection from its listener when dropped.
struct ConnectionGuard(ConnectionHandle);

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.0.door.open().remove(&self.0.number);
    }
}

/// Permit for a stream of events. It is released when its last clone is dropped.
#[derive(Clone)]
pub struct StreamPermit(#[expect(dead_code, reason = "it is held")] Arc<OwnedSemaphorePermit>);

impl ConnectionLimiter {
    /// Creates the limits of two listeners, for pages and for growbot's commands, so that one being full does not close
    /// the other. They share the limit of computations.
    pub fn two(request: Duration) -> [Arc<Self>; 2] {
        let computed = Arc::new(Semaphore::new(MAX_CONCURRENT_RENDERS));
        [(); 2].map(|()| {
            Arc::new(Self {
                open: Mutex::default(),
                streams: Arc::new(Semaphore::new(STREAMS)),
                long_bodies: Arc::new(Semaphore::new(LONG_BODIES)),
                computed: Arc::clone(&computed),
                request,
            })
        })
    }

    fn open(&self) -> MutexGuard<'_, BTreeMap<u64, OpenConnection>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a connection. If the limit is reached, it replaces the oldest connection that has not authenticated. `None`
    /// if all have.
    fn admit(self: &Arc<Self>, number: u64) -> Option<ConnectionGuard> {
        let mut open = self.open();
        if open.len() >= CONNECTIONS {
            let (&eldest, _) = open.iter().find(|(_, open)| !open.authenticated)?;
            if let Some(task) = open.remove(&eldest).and_then(|open| open.task) {
                task.abort();
            }
        }
        open.insert(number, OpenConnection { authenticated: false, task: None });
        Some(ConnectionGuard(ConnectionHandle { door: Arc::clone(self), number }))
    }

    /// Accepts and serves connections until the process ends.
    pub async fn serve<L>(self: Arc<Self>, mut listener: L, router: Router) -> io::Result<()>
    where
        L: Listener<Io: Unpin>,
    {
        let too_many = too_many();
        let mut number = 0;
        loop {
            let (mut stream, _) = listener.accept().await;
            number += 1;
            let Some(inside) = self.admit(number) else {
                // The response is short. If the socket does not take it at once, it is dropped.
                let _ = timeout(Duration::from_millis(10), stream.write_all(&too_many)).await;
                continue;
            };
            let task = tokio::spawn(attend(stream, inside, router.clone()));
            if let Some(open) = self.open().get_mut(&number) {
                open.task = Some(task.abort_handle());
            }
        }
    }
}

/// Serves one connection until it is closed.
async fn attend<S>(stream: S, inside: ConnectionGuard, router: Router)
where
    S: tokio::io::AsyncRead + tokio::io::AsyncWrite + Unpin + Send + 'static,
{
    let service = TowerToHyperService::new(router);
    let service = service_fn(|mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(inside.0.clone());
        service.call(request)
    });
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(WRITE_TIMEOUT));
    let mut server = http1::Builder::new();
    server.timer(TokioTimer::new()).header_read_timeout(inside.0.door.request / 2);
    // A client that disconnects or sends invalid HTTP has received an error if that was possible.
    let _ = server.serve_connection(TokioIo::new(Box::pin(stream)), service).with_upgrades().await;
}

/// Reads the whole body of a request before it is handled. Rejects a body that is too long or too slow.
pub async fn buffer_body(State(door): State<Arc<ConnectionLimiter>>, request: Request, next: Next) -> Response {
    let (parts, body) = request.into_parts();
    let length = HttpBody::size_hint(&body);
    if length.exact() == Some(0) {
        return next.run(Request::from_parts(parts, Body::empty())).await;
    }
    if length.lower() > MAX_BODY as u64 {
        return Problem::too_long(MAX_BODY).into_response();
    }
    let mut _place = None;
    if length.upper().is_none_or(|length| length > SHORT_BODY) {
        match Arc::clone(&door.long_bodies).try_acquire_owned() {
            Ok(place) => _place = Some(place),
            Err(_) => {
                return Problem::busy(&format!("{LONG_BODIES} long requests are already being read")).into_response();
            }
        }
    }
    match timeout(door.request, to_bytes(body, MAX_BODY)).await {
        Ok(Ok(bytes)) => next.run(Request::from_parts(parts, bytes.into())).await,
        Ok(Err(error)) if is_too_long(&error) => Problem::too_long(MAX_BODY).into_response(),
        Ok(Err(error)) => Problem::bad(format!("the request was interrupted: {error}")).into_response(),
        Err(_) => Problem::too_slow(door.request).into_response(),
    }
}

fn is_too_long(error: &axum::Error) -> bool {
    std::error::Error::source(error).is_some_and(<dyn std::error::Error>::is::<LengthLimitError>)
}

/// Queues requests that load the processor. Gives each stream of events a permit, or rejects it.
pub async fn limit_concurrency(
    State(door): State<Arc<ConnectionLimiter>>,
    mut request: Request,
    next: Next,
) -> Response {
    let path = request.uri().path();
    let is = |ends: &[&str]| ends.iter().any(|end| path.ends_with(end));
    if is(&["/events", "/events/ws", "/updates", "/updates/ws"]) {
        let Ok(place) = Arc::clone(&door.streams).try_acquire_owned() else {
            return Problem::busy(&format!("{STREAMS} event streams are already open")).into_response();
        };
        let permit = StreamPermit(Arc::new(place));
        request.extensions_mut().insert(permit.clone());
        return next.run(request).await.map(|body| {
            Body::new(body.map_frame(move |frame| {
                let _held = &permit;
                frame
            }))
        });
    }
    let computes = match *request.method() {
        Method::POST => is(&["/plans", "/jobs"]),
        _ => is(&["/view", "/live/"]),
    };
    if !computes {
        return next.run(request).await;
    }
    let turn = Arc::clone(&door.computed).acquire_owned().await;
    // The client may disconnect, but the computation keeps its permit until it has ended.
    let computed = tokio::spawn(async move {
        let _turn = turn;
        next.run(request).await
    });
    computed.await.unwrap_or_else(|error| Problem::internal(error).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unauthenticated_connections_are_dropped_first() {
        let [door, other] = ConnectionLimiter::two(Duration::from_secs(1));
        let all: Vec<_> = (0..CONNECTIONS as u64).map(|number| door.admit(number).unwrap()).collect();
        all[0].0.mark_authenticated();
        let one_more = door.admit(1000).unwrap();
        let is_open = |number: u64| door.open().contains_key(&number);
        assert_eq!((is_open(0), is_open(1), is_open(1000), door.open().len()), (true, false, true, CONNECTIONS));
        all.iter().chain([&one_more]).for_each(|inside| inside.0.mark_authenticated());
        assert!(door.admit(1001).is_none() && other.admit(1001).is_some());
        drop(all);
        assert!(door.admit(1002).is_some());
    }
}
