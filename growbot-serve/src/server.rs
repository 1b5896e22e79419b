//! The server of the pages and the API: on the loopback interface, where requests need a token, and on a Unix socket of
//! the user.

use std::net::TcpListener as StdTcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::{fs, io};

use axum::body::to_bytes;
use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::{ALLOW, CONTENT_TYPE};
use axum::middleware::{from_fn, from_fn_with_state, map_request, map_response};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use growbot_remote::api::PageUrls;
use serde_json::Value;
use tokio::net::{TcpListener, UnixListener};
use tokio::runtime::Handle;

use super::access::Access;
use super::audit::CommandSource;
use super::config::ServeEntry;
use super::connections::{ConnectionLimiter, require_place};
use super::limits::{RoleLimits, buffer_body, limit_concurrency};
use super::page_access::{TokenAccess, leave_address, require_token};
use super::page_listener::listen;
use super::paths::ServicePaths;
use super::problem::Problem;
pub use super::server_error::{HandOverError, ServerError};
use super::service::Service;
use super::state_lock::StateLock;
use super::tokens::Tokens;
use super::workers::{self, handle_request};
use super::{api, page};
use crate::watch::allowed_origins::AllowedOrigins;
use crate::watch::heartbeat::OrderAge;
use crate::watch::origin_check::{not_found, require_allowed_origin};

/// Maximum length of the reason in a response that is converted to problem details, bytes.
const MAX_REASON: usize = 4096;

/// The bound listeners, before they are served.
pub struct Server {
    tcp: TcpListener,
    unix: UnixListener,
    tokens: Tokens,
    /// Lock of the data folder, held as long as the service runs.
    _lock: StateLock,
}

impl Server {
    /// Locks the data folder, and binds the Unix socket and the TCP socket of the pages. A handed-over socket is used
    /// for the pages. Without one, this port is bound. 0 stands for any free port.
    ///
    /// # Errors
    /// [`ServerError`].
    pub async fn bind(
        places: &ServicePaths,
        handed_over: Option<StdTcpListener>,
        port: u16,
    ) -> Result<Self, ServerError> {
        let file = |path: &Path| {
            let path = path.to_path_buf();
            move |error| ServerError::File { path, error }
        };
        places.check()?;
        let lock = StateLock::acquire(places)?;
        let socket = places.socket();
        // A service that was killed leaves its socket behind.
        let _ = fs::remove_file(&socket);
        let unix = UnixListener::bind(&socket).map_err(file(&socket))?;
        fs::set_permissions(&socket, fs::Permissions::from_mode(0o600)).map_err(file(&socket))?;
        let tcp = listen(handed_over, port).await?;
        let tokens = Tokens::load_or_create(&places.tokens(), &tcp).map_err(file(&places.tokens()))?;
        Ok(Self { tcp, unix, tokens, _lock: lock })
    }

    /// Returns the URLs of the page: first the URL that allows commands, then the read-only URL.
    ///
    /// # Errors
    /// The local address cannot be read.
    pub fn page_urls(&self) -> io::Result<[String; 2]> {
        let bound = self.tcp.local_addr()?;
        Ok([&self.tokens.control, &self.tokens.view].map(|token| format!("http://{bound}/{token}/")))
    }

    /// Serves until a listener fails, with the allowed origins and the request timeout of these settings.
    ///
    /// # Errors
    /// A listener has failed.
    pub async fn serve(self, service: Arc<Service>, settings: &ServeEntry) -> io::Result<()> {
        let [operate, look] = self.page_urls()?;
        // The addresses are set once, because a server is served once.
        let _ = service.addresses.set(PageUrls { control_url: operate, view_url: look });
        let (router, document) = api::routes();
        let document = Arc::new(document);
        let workers = workers::start()?;
        let site = |access, door: &Arc<ConnectionLimiter>| {
            let site = site(router.clone(), Arc::clone(&document), access, door, &service, &workers);
            site.with_state(Arc::clone(&service))
        };
        let [page_door, command_door] = [(); 2].map(|()| ConnectionLimiter::new(settings.request()));
        let origins = AllowedOrigins::new(&settings.origins);
        let pages = |token: &str, path: &'static str, access: Access| {
            let site = site(access, &page_door);
            let token_access = TokenAccess::new(token, path, &origins);
            let with_header = site.clone().layer(from_fn_with_state(Arc::clone(&token_access), require_token));
            let with_address = site.layer(from_fn_with_state(token_access, leave_address));
            Router::new().nest(&format!("/{path}/"), with_header).nest(&format!("/{token}/"), with_address)
        };
        let pages = pages(&self.tokens.control, "control", Access::Control(CommandSource::Web))
            .merge(pages(&self.tokens.view, "view", Access::View))
            .fallback(not_found)
            .layer(from_fn_with_state(origins, require_allowed_origin));
        let commands = site(Access::Control(CommandSource::Socket), &command_door);
        let tcp = page_door.serve(self.tcp, pages);
        let unix = command_door.serve(self.unix, commands);
        tokio::select! { ended = tcp => ended, ended = unix => ended }
    }
}

/// Returns the router of the page and the API for clients with these rights.
fn site(
    router: Router<Arc<Service>>,
    document: Arc<Value>,
    access: Access,
    door: &Arc<ConnectionLimiter>,
    service: &Arc<Service>,
    workers: &Handle,
) -> Router<Arc<Service>> {
    let openapi = move || {
        let document = Arc::clone(&document);
        async move { Json(Value::clone(&document)) }
    };
    let (service, limits) = (Arc::clone(service), RoleLimits::new(access));
    let insert = move |mut request: Request| {
        let permits = service.permits().with_age(OrderAge::of_request(request.headers()));
        let limits = Arc::clone(&limits);
        async move {
            request.extensions_mut().insert(permits);
            request.extensions_mut().insert(limits);
            request.extensions_mut().insert(access);
            request
        }
    };
    Router::new()
        .merge(page::routes())
        .route(&format!("{}/openapi.json", growbot_remote::PREFIX), get(openapi))
        .nest(growbot_remote::PREFIX, router)
        .fallback(api::unknown_route)
        .layer(from_fn_with_state(workers.clone(), handle_request))
        .layer(from_fn(limit_concurrency))
        .layer(from_fn_with_state(Arc::clone(door), buffer_body))
        .layer(from_fn(require_place))
        .layer(map_request(insert))
        .layer(map_response(as_problem))
}

/// Converts an error response with plain text or without a content type to problem details. Returns other responses
/// unchanged.
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
