//! Access to the pages by a token. A browser that opens the address `/TOKEN/` receives a cookie with the token, and is
//! redirected to an address without it. Programs send the token as `Authorization: Bearer TOKEN`, or as the first part
//! of the path.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{ACCEPT, AUTHORIZATION, COOKIE, HOST, HeaderMap, LOCATION, SET_COOKIE};
use axum::http::{HeaderName, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::digest::{SHA256, digest};

use super::access::Access;
use super::problem::Problem;
use crate::watch::allowed_origins::AllowedOrigins;

/// Number of bytes of a token's hash that are part of the name of the token's cookie.
const NAME_BYTES: usize = 6;

/// A token, with the cookie that contains it and the path of the pages that it opens.
pub struct TokenAccess {
    token: String,
    /// First part of the path of these pages in addresses without the token.
    path: &'static str,
    /// Name of the cookie. Browsers send cookies to all ports of a machine, so each token has a name of its own.
    cookie: String,
    origins: AllowedOrigins,
}

impl TokenAccess {
    /// Creates the access by this token to the pages for clients with these rights.
    pub fn new(token: &str, access: Access, origins: &AllowedOrigins) -> Arc<Self> {
        let hash = digest(&SHA256, token.as_bytes());
        let cookie = format!("growbot-{}", URL_SAFE_NO_PAD.encode(&hash.as_ref()[..NAME_BYTES]));
        Arc::new(Self { token: token.to_owned(), path: access.path(), cookie, origins: origins.clone() })
    }

    /// Returns true if the headers of a request contain the token, as a cookie or as a bearer token.
    fn is_in(&self, headers: &HeaderMap) -> bool {
        let texts = |name: HeaderName| headers.get_all(name).into_iter().filter_map(|value| value.to_str().ok());
        let by_cookie = |text: &str| {
            let pairs = text.split(';').filter_map(|pair| pair.trim().split_once('='));
            { pairs }.any(|(name, value)| name == self.cookie && value == self.token)
        };
        let by_bearer = |text: &str| text.strip_prefix("Bearer ").is_some_and(|token| token.trim() == self.token);
        texts(COOKIE).any(by_cookie) || texts(AUTHORIZATION).any(by_bearer)
    }

    /// Returns the `Set-Cookie` header for the browser that sent a request with these headers. If the page was
    /// requested over HTTPS, the cookie is marked `Secure`, so that the browser never sends it over plain HTTP.
    fn set_cookie(&self, headers: &HeaderMap) -> String {
        let host = headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
        let secure = if self.origins.is_https(host) { "; Secure" } else { "" };
        format!("{}={}; Path=/; HttpOnly; SameSite=Strict{secure}", self.cookie, self.token)
    }
}

/// Handles a request whose address does not contain the token. Rejects the request if no header contains the token.
pub async fn require_token(State(access): State<Arc<TokenAccess>>, request: Request, next: Next) -> Response {
    if access.is_in(request.headers()) {
        return next.run(request).await;
    }
    let detail = "this request has no access token, or the token of an earlier program: open the address that growbot \
                  prints, or send the token in that address as `Authorization: Bearer TOKEN`";
    Problem::from_status(StatusCode::UNAUTHORIZED, detail).into_response()
}

/// Handles a request whose address contains the token. A browser that opens a page is redirected to the address without
/// the token, and receives the token as a cookie.
pub async fn leave_address(State(access): State<Arc<TokenAccess>>, request: Request, next: Next) -> Response {
    let accepted = request.headers().get(ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or_default();
    if request.method() != Method::GET || !accepted.contains("text/html") {
        return next.run(request).await;
    }
    let rest = request.uri().path_and_query().map_or("/", |rest| rest.as_str());
    // A relative address also holds behind a proxy that serves the pages below another path.
    let depth = request.uri().path().matches('/').count();
    let location = format!("{}{}{rest}", "../".repeat(depth), access.path);
    let headers = [(LOCATION, location), (SET_COOKIE, access.set_cookie(request.headers()))];
    (StatusCode::SEE_OTHER, headers).into_response()
}
