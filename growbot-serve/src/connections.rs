//! Limits the number of open connections of a listener, for each kind of client.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::extract::{Extension, Request};
use axum::http::HeaderValue;
use axum::http::header::CONNECTION;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::serve::Listener;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncWriteExt;
use tokio::task::AbortHandle;
use tokio::time::timeout;
use tokio_io_timeout::TimeoutStream;

use super::access::Access;
use super::problem::Problem;
use super::request_kind::RequestKind;

/// Maximum number of open connections, for pages and for growbot's commands separately.
pub const CONNECTIONS: usize = 256;
/// Maximum number of open connections of read-only clients. The other connections are for clients that can send
/// commands.
const VIEW_CONNECTIONS: usize = 128;
/// Number of connections that are accepted beyond [`CONNECTIONS`]. They serve only stops.
const STOP_CONNECTIONS: usize = 32;
/// Time after which a connection is closed if the client does not read a response.
const WRITE_TIMEOUT: Duration = Duration::from_secs(30);
/// Length of a connection's buffers, bytes. It limits the head of a request.
const BUFFER: usize = 64 << 10;

fn all_in_use() -> Problem {
    Problem::busy(&format!("{CONNECTIONS} connections to the service are already open"))
}

/// Returns the HTTP response to a connection that is refused because all connections are in use.
fn too_many() -> Vec<u8> {
    let body = serde_json::to_string(&all_in_use()).unwrap_or_default();
    format!(
        "HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\nretry-after: 1\r\ncontent-type: \
         application/problem+json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .into_bytes()
}

/// The open connections of one listener, with the limits on their number.
pub struct ConnectionLimiter {
    open: Mutex<BTreeMap<u64, OpenConnection>>,
    /// Timeout of a request's body. The head of a request, and the pause before the next request, have half of this
    /// time.
    request: Duration,
}

/// An open connection.
struct OpenConnection {
    /// Rights of the client. `None` until it has sent an authenticated request.
    access: Option<Access>,
    /// True for a connection beyond the limit, which serves stops only.
    is_for_stops: bool,
    task: Option<AbortHandle>,
}

/// Reference to an open connection. Each request of the connection carries it as an extension.
#[derive(Clone)]
pub struct ConnectionHandle {
    limiter: Arc<ConnectionLimiter>,
    number: u64,
}

impl ConnectionHandle {
    /// Marks the connection as authenticated by a client with these rights, so that new connections never replace it.
    /// Returns an error if the limits on connections allow the client only stops.
    fn authenticate(&self, access: Access) -> Result<(), Problem> {
        let mut open = self.limiter.open();
        let is_view = |connection: &OpenConnection| connection.access == Some(Access::View);
        let viewers = open.iter().filter(|(number, of)| **number != self.number && is_view(of)).count();
        let Some(own) = open.get_mut(&self.number) else { return Err(all_in_use()) };
        // A proxy sends requests of several clients on one connection. It has the most rights of them.
        if access != Access::View || own.access.is_none() {
            own.access = Some(access);
        }
        if own.is_for_stops {
            return Err(all_in_use());
        }
        if is_view(own) && viewers >= VIEW_CONNECTIONS {
            return Err(Problem::busy(&format!(
                "{VIEW_CONNECTIONS} connections to the service are already open for reading"
            )));
        }
        Ok(())
    }

    /// Returns true if the connection serves only stops.
    fn is_for_stops(&self) -> bool {
        self.limiter.open().get(&self.number).is_none_or(|connection| connection.is_for_stops)
    }
}

/// Removes the connection from its listener when dropped.
struct ConnectionGuard(ConnectionHandle);

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.0.limiter.open().remove(&self.0.number);
    }
}

impl ConnectionLimiter {
    /// Creates the limits of a listener without connections. `request` is the timeout of a request's body.
    pub fn new(request: Duration) -> Arc<Self> {
        Arc::new(Self { open: Mutex::default(), request })
    }

    /// Returns the timeout of a request's body.
    pub fn request_timeout(&self) -> Duration {
        self.request
    }

    /// Returns true if a connection is open.
    pub fn has_connections(&self) -> bool {
        !self.open().is_empty()
    }

    fn open(&self) -> MutexGuard<'_, BTreeMap<u64, OpenConnection>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a connection. If the limit is reached, the connection replaces the oldest one that has not authenticated.
    /// If all connections have authenticated, the new connection serves only stops. `None` if all connections for stops
    /// are in use too.
    fn admit(self: &Arc<Self>, number: u64) -> Option<ConnectionGuard> {
        let mut open = self.open();
        let mut is_for_stops = false;
        for (kind, limit) in [(false, CONNECTIONS), (true, STOP_CONNECTIONS)] {
            is_for_stops = kind;
            let of_kind = || open.iter().filter(|(_, connection)| connection.is_for_stops == kind);
            if of_kind().count() < limit {
                break;
            }
            let eldest = of_kind().find(|(_, connection)| connection.access.is_none()).map(|(number, _)| *number);
            if let Some(replaced) = eldest.and_then(|eldest| open.remove(&eldest)) {
                replaced.task.inspect(AbortHandle::abort);
                break;
            }
            if is_for_stops {
                return None;
            }
        }
        open.insert(number, OpenConnection { access: None, is_for_stops, task: None });
        Some(ConnectionGuard(ConnectionHandle { limiter: Arc::clone(self), number }))
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
    // With `writev`, a long response is not copied into the buffer of each connection.
    server.timer(TokioTimer::new()).header_read_timeout(inside.0.limiter.request / 2).max_buf_size(BUFFER).writev(true);
    // A client that disconnects or sends invalid HTTP has received an error if that was possible.
    let _ = server.serve_connection(TokioIo::new(Box::pin(stream)), service).with_upgrades().await;
}

/// Handles a request if the limits on connections allow it, or if it is a stop by a client that can send commands.
/// Otherwise rejects it.
pub async fn require_place(
    Extension(connection): Extension<ConnectionHandle>,
    Extension(access): Extension<Access>,
    request: Request,
    next: Next,
) -> Response {
    let is_stop = access != Access::View && RequestKind::of(&request) == RequestKind::Stop;
    let (mut response, closes) = match connection.authenticate(access) {
        Err(problem) if !is_stop => (problem.into_response(), true),
        _ => (next.run(request).await, connection.is_for_stops()),
    };
    if closes {
        response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::CommandSource;

    const CONTROL: Access = Access::Control(CommandSource::Web);

    fn limiter() -> Arc<ConnectionLimiter> {
        ConnectionLimiter::new(Duration::from_secs(1))
    }

    #[test]
    fn unauthenticated_connections_are_dropped_first() {
        let limiter = limiter();
        let all: Vec<_> = (0..CONNECTIONS as u64).map(|number| limiter.admit(number).unwrap()).collect();
        all[0].0.authenticate(CONTROL).unwrap();
        let one_more = limiter.admit(1000).unwrap();
        let is_open = |number: u64| limiter.open().contains_key(&number);
        assert_eq!((is_open(0), is_open(1), is_open(1000), limiter.open().len()), (true, false, true, CONNECTIONS));
        drop(all);
        assert!(!one_more.0.is_for_stops() && !limiter.admit(1002).unwrap().0.is_for_stops());
    }

    #[test]
    fn connections_beyond_the_limit_are_for_stops() {
        let limiter = limiter();
        let all: Vec<_> = (0..CONNECTIONS as u64).map(|number| limiter.admit(number).unwrap()).collect();
        all.iter().for_each(|inside| inside.0.authenticate(CONTROL).unwrap());
        let beyond: Vec<_> = (0..STOP_CONNECTIONS as u64).map(|number| limiter.admit(1000 + number).unwrap()).collect();
        assert!(beyond.iter().all(|inside| inside.0.is_for_stops()));
        // One that has sent nothing is replaced.
        beyond[1..].iter().for_each(|inside| assert!(inside.0.authenticate(CONTROL).is_err()));
        let next = limiter.admit(2000).unwrap();
        assert!(!limiter.open().contains_key(&1000) && next.0.authenticate(CONTROL).is_err());
        assert!(limiter.admit(2001).is_none());
        drop(all);
        assert!(!limiter.admit(2002).unwrap().0.is_for_stops());
    }

    #[test]
    fn read_only_clients_have_places_of_their_own() {
        let limiter = limiter();
        let viewers: Vec<_> = (0..VIEW_CONNECTIONS as u64).map(|number| limiter.admit(number).unwrap()).collect();
        viewers.iter().for_each(|inside| inside.0.authenticate(Access::View).unwrap());
        let next = limiter.admit(1000).unwrap();
        assert!(next.0.authenticate(Access::View).is_err());
        // A proxy's connection has the most rights of its clients.
        next.0.authenticate(CONTROL).unwrap();
        next.0.authenticate(Access::View).unwrap();
        viewers[0].0.authenticate(Access::View).unwrap();
    }
}
