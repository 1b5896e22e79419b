//! Who gets an answer: a client that knows the token, on this machine, from the page itself.
//!
//! Any page in a browser can have it ask this machine's own addresses. So an address is a secret, a name that only
//! points here (DNS rebinding) is none of ours, and what other pages ask for is refused. Those who are refused are told
//! nothing.

use axum::extract::Request;
use axum::http::header::{HOST, HeaderMap, HeaderValue, ORIGIN};
use axum::http::{HeaderName, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Names of this machine's own interface.
const OURSELVES: [&str; 3] = ["127.0.0.1", "localhost", "[::1]"];

/// What every answer says.
const HEADERS: [(&str, &str); 5] = [
    ("cache-control", "no-store"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "SAMEORIGIN"),
    ("cross-origin-resource-policy", "same-origin"),
];

/// Lets a request through, or not.
pub async fn guard(request: Request, next: Next) -> Response {
    if !may_ask(request.headers()) {
        return nothing().await;
    }
    let mut response = next.run(request).await;
    for (name, value) in HEADERS {
        response.headers_mut().insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

/// What those get who ask for what there is not.
pub async fn nothing() -> Response {
    StatusCode::NOT_FOUND.into_response()
}

/// Whether a request comes from where the page may be: asked by one of our own names, through whatever port that is
/// forwarded, and by no other page.
fn may_ask(headers: &HeaderMap) -> bool {
    let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let Some(host) = text(&HOST) else { return false };
    let name = host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()));
    let is_ours = OURSELVES.contains(&name.map_or(host, |(name, _)| name));
    let same_origin = text(&ORIGIN).is_none_or(|origin| origin.strip_prefix("http://") == Some(host));
    let fetched_by = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
    is_ours && same_origin && !matches!(fetched_by, Some(b"cross-site" | b"same-site"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_page_itself_may_ask() {
        let asked = |headers: &[(&'static str, &'static str)]| {
            let pair = |&(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value));
            may_ask(&headers.iter().map(pair).collect())
        };
        for host in ["127.0.0.1:8080", "localhost:1", "localhost", "[::1]:80"] {
            assert!(asked(&[("host", host)]), "{host}");
        }
        for host in ["evil.example:8080", "127.0.0.1.evil.example", "192.168.0.7:8080", "", "[::1", "localhost:x"] {
            assert!(!asked(&[("host", host)]), "{host}");
        }
        assert!(!asked(&[]));
        let host = ("host", "127.0.0.1:8080");
        assert!(asked(&[host, ("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "same-origin")]));
        assert!(asked(&[host, ("sec-fetch-site", "none")]));
        for other in ["http://evil.example", "http://127.0.0.1:8081", "https://127.0.0.1:8080", "null", ""] {
            assert!(!asked(&[host, ("origin", other)]), "{other}");
        }
        assert!(!asked(&[host, ("sec-fetch-site", "cross-site")]));
        assert!(!asked(&[host, ("sec-fetch-site", "same-site")]));
    }
}
