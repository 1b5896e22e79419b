//! The pages and the API that a server offers to its clients, behind the checks of all requests: origin, access token,
//! limits of connections, and limits of the resources of each role.

use std::sync::Arc;

use aide::axum::ApiRouter;
use axum::body::to_bytes;
use axum::extract::{DefaultBodyLimit, Request};
use axum::http::header::{ALLOW, CONTENT_TYPE};
use axum::http::{HeaderValue, Method, Uri};
use axum::middleware::{from_fn, from_fn_with_state, map_request, map_response};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use growbot_remote::PREFIX;
use serde_json::Value;
use tokio::runtime::Handle;

use super::access::Access;
use super::connections::{ConnectionLimiter, require_place};
use super::limits::{RoleLimits, buffer_body, limit_concurrency};
use super::openapi::documented;
use super::page_access::{TokenAccess, leave_address, require_token};
use super::page_source::PageSource;
use super::problem::Problem;
use super::request_kind::MAX_BODY;
use super::workers::handle_request;
use crate::watch::allowed_origins::AllowedOrigins;
use crate::watch::heartbeat::OrderAge;
use crate::watch::origin_check::{not_found, require_allowed_origin};

/// Maximum length of the reason in a response that is converted to problem details, bytes.
const MAX_REASON: usize = 4096;

/// The pages and the API of a server.
pub struct Site<S> {
    source: Arc<S>,
    router: Router<Arc<S>>,
}

impl<S: PageSource> Site<S> {
    /// Creates a site from the files of its page and the routes of its API. `source` has the robots and growths that
    /// the site shows. Requests other than commands are handled on the runtime `workers`.
    pub fn new(source: Arc<S>, page: Router<Arc<S>>, api: ApiRouter<Arc<S>>, workers: Handle) -> Self {
        let (api, document) = documented(api);
        let document = Arc::new(document);
        let openapi = move || async move { Json(Value::clone(&document)) };
        let router = page
            .route(&format!("{PREFIX}/openapi.json"), get(openapi))
            .nest(PREFIX, api.layer(DefaultBodyLimit::max(MAX_BODY)))
            .fallback(unknown_route)
            .layer(from_fn_with_state(workers, handle_request));
        Self { source, router }
    }

    /// Returns the router for clients with these rights, whose connections this limiter accepts.
    pub fn for_clients(&self, access: Access, door: &Arc<ConnectionLimiter>) -> Router {
        let (source, limits) = (Arc::clone(&self.source), RoleLimits::new(access));
        let insert = move |mut request: Request| {
            let permits = source.permits(OrderAge::of_request(request.headers()));
            let limits = Arc::clone(&limits);
            async move {
                request.extensions_mut().insert(permits);
                request.extensions_mut().insert(limits);
                request.extensions_mut().insert(access);
                request
            }
        };
        self.router
            .clone()
            .layer(from_fn(limit_concurrency))
            .layer(from_fn_with_state(Arc::clone(door), buffer_body))
            .layer(from_fn(require_place))
            .layer(map_request(insert))
            .layer(map_response(as_problem))
            .with_state(Arc::clone(&self.source))
    }

    /// Returns the router for clients on the loopback interface and behind these proxies. Each token has rights of its
    /// own. This limiter accepts all connections.
    pub fn for_tokens(
        &self,
        tokens: &[(&str, Access)],
        door: &Arc<ConnectionLimiter>,
        proxies: AllowedOrigins,
    ) -> Router {
        let of_token = |pages: Router, &(token, access): &(&str, Access)| {
            let site = self.for_clients(access, door);
            let token_access = TokenAccess::new(token, access, &proxies);
            let path = format!("/{}/", access.path());
            let with_header = site.clone().layer(from_fn_with_state(Arc::clone(&token_access), require_token));
            let with_address = site.layer(from_fn_with_state(token_access, leave_address));
            pages.nest(&path, with_header).nest(&format!("/{token}/"), with_address)
        };
        let pages = tokens.iter().fold(Router::new(), of_token).fallback(not_found);
        pages.layer(from_fn_with_state(proxies, require_allowed_origin))
    }
}

/// Rejects a request for a path that this release does not have.
async fn unknown_route(method: Method, uri: Uri) -> Problem {
    Problem::unknown_route(&method, uri.path())
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
