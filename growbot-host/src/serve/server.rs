//! The server of the interface: on the loopback interface, behind tokens, and on a socket of the user.

use std::fs;
use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::body::to_bytes;
use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::{ALLOW, CONTENT_TYPE};
use axum::middleware::{from_fn, from_fn_with_state, map_request, map_response};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use serde_json::Value;
use tokio::net::{TcpListener, UnixListener, UnixStream};

use super::api::{self, Access, PageUrls};
use super::audit::CommandSource;
use super::limits::{ConnectionHandle, ConnectionLimiter, buffer_body, limit_concurrency};
use super::problem::Problem;
use super::{Service, ServicePaths, page};
use crate::watch::heartbeat::OrderAge;
use crate::watch::origin_check::{not_found, require_same_origin};
use crate::watch::random_token;

/// Maximum length of the reason in a response that is converted to problem details, bytes.
const MAX_REASON: usize = 4096;

/// Errors that prevent the server from listening.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address cannot be bound.
    #[error("cannot serve pages at 127.0.0.1:{port} ({error}): choose another port with --page-port")]
    Address {
        /// Requested port, 0 for any.
        port: u16,
        /// Error of the operating system.
        error: io::Error,
    },
    /// Another service listens on the socket.
    #[error("this user already runs `growbot serve` (socket {0}): end it first")]
    Running(String),
    /// A file cannot be used.
    #[error("cannot use {path}: {error}")]
    File {
        /// Path of the file.
        path: String,
        /// Error of the operating system.
        error: io::Error,
    },
}

/// Tokens in the addresses. They are stored, so that open pages can reconnect after a restart.
pub struct Tokens {
    operate: String,
    read: String,
}

impl Tokens {
    /// Reads the tokens from a file. A missing or invalid file is replaced by new tokens.
    fn load_or_create(path: &Path) -> io::Result<Self> {
        let is_token = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
        if let Ok(text) = fs::read_to_string(path)
            && let [operate, read] = text.split_whitespace().filter(is_token).collect::<Vec<_>>()[..]
        {
            return Ok(Self { operate: operate.to_owned(), read: read.to_owned() });
        }
        let tokens = Self { operate: new_token()?, read: new_token()? };
        write_secret(path, &format!("{}\n{}\n", tokens.operate, tokens.read))?;
        Ok(tokens)
    }
}

/// Writes a file that only the user can read, completely or not at all.
pub(super) fn write_secret(path: &Path, text: &str) -> io::Result<()> {
    let aside = path.with_extension("new");
    let mut file = fs::File::options().write(true).create(true).truncate(true).mode(0o600).open(&aside)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    fs::rename(&aside, path)
}

fn new_token() -> io::Result<String> {
    random_token().map_err(|error| io::Error::other(error.to_string()))
}

/// The bound listeners, before they are served.
pub struct Server {
    tcp: TcpListener,
    unix: UnixListener,
    tokens: Tokens,
}

impl Server {
    /// Binds the address of the pages to this port (0 for any) and the socket.
    ///
    /// # Errors
    /// [`ServerError`].
    pub async fn bind(places: &ServicePaths, port: u16) -> Result<Self, ServerError> {
        let file = |path: &Path| {
            let path = path.display().to_string();
            move |error| ServerError::File { path, error }
        };
        let socket = places.socket();
        if UnixStream::connect(&socket).await.is_ok() {
            return Err(ServerError::Running(socket.display().to_string()));
        }
        // A service that was killed leaves its socket behind.
        let _ = fs::remove_file(&socket);
        let unix = UnixListener::bind(&socket).map_err(file(&socket))?;
        fs::set_permissions(&socket, fs::Permissions::from_mode(0o600)).map_err(file(&socket))?;
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let tcp = TcpListener::bind(address).await.map_err(|error| ServerError::Address { port, error })?;
        let tokens = Tokens::load_or_create(&places.tokens()).map_err(file(&places.tokens()))?;
        Ok(Self { tcp, unix, tokens })
    }

    /// Returns the page's addresses: the one for sending commands, then the read-only one.
    ///
    /// # Errors
    /// The local address cannot be read.
    pub fn page_urls(&self) -> io::Result<[String; 2]> {
        let bound = self.tcp.local_addr()?;
        Ok([&self.tokens.operate, &self.tokens.read].map(|token| format!("http://{bound}/{token}/")))
    }

    /// Serves until a listener fails. A request's body has to arrive within `request`, its head within half of that.
    ///
    /// # Errors
    /// A listener has failed.
    pub async fn serve(self, service: Arc<Service>, request: Duration) -> io::Result<()> {
        let [operate, look] = self.page_urls()?;
        // The addresses are set once, because a server is served once.
        let _ = service.addresses.set(PageUrls { control_url: operate, view_url: look });
        let (router, document) = api::routes();
        let document = Arc::new(document);
        let site = |access, door: &Arc<ConnectionLimiter>| {
            site(router.clone(), Arc::clone(&document), access, door, &service).with_state(Arc::clone(&service))
        };
        let [page_door, command_door] = ConnectionLimiter::two(request);
        let pages = Router::new()
            .nest(&format!("/{}/", self.tokens.operate), site(Access::Control(CommandSource::Web), &page_door))
            .nest(&format!("/{}/", self.tokens.read), site(Access::View, &page_door))
            .fallback(not_found)
            .layer(from_fn(require_same_origin));
        let commands = site(Access::Control(CommandSource::Socket), &command_door);
        let tcp = page_door.serve(self.tcp, pages);
        let unix = command_door.serve(self.unix, commands);
        tokio::select! { ended = tcp => ended, ended = unix => ended }
    }
}

/// Returns the router of the page and the interface for clients with these rights.
fn site(
    router: Router<Arc<Service>>,
    document: Arc<Value>,
    access: Access,
    door: &Arc<ConnectionLimiter>,
    service: &Arc<Service>,
) -> Router<Arc<Service>> {
    let openapi = move || {
        let document = Arc::clone(&document);
        async move { Json(Value::clone(&document)) }
    };
    let service = Arc::clone(service);
    let insert = move |mut request: Request| {
        let permits = service.permits().with_age(OrderAge::of_request(request.headers()));
        async move {
            request.extensions_mut().insert(permits);
            if let Some(visitor) = request.extensions().get::<ConnectionHandle>() {
                visitor.mark_authenticated();
            }
            request.extensions_mut().insert(access);
            request
        }
    };
    Router::new()
        .merge(page::routes())
        .route(&format!("{}/openapi.json", api::PREFIX), get(openapi))
        .nest(api::PREFIX, router)
        .fallback(api::unknown_route)
        .layer(from_fn_with_state(Arc::clone(door), limit_concurrency))
        .layer(from_fn_with_state(Arc::clone(door), buffer_body))
        .layer(map_request(insert))
        .layer(map_response(as_problem))
}

/// Converts the text of an error response to problem details.
async fn as_problem(response: Response) -> Response {
    let status = response.status();
    let is_text = |kind: &HeaderValue| kind.as_bytes().starts_with(b"text/plain");
    let is_typed = response.headers().get(CONTENT_TYPE).is_some_and(|kind| !is_text(kind));
    if is_typed || !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let allowed = response.headers().get(ALLOW).cloned();
    let text = to_bytes(response.into_body(), MAX_REASON).await.unwrap_or_default();
    let mut problem = Problem::from_status(status, &String::from_utf8_lossy(&text)).into_response();
    if let Some(allowed) = allowed {
        problem.headers_mut().insert(ALLOW, allowed);
    }
    problem
}
