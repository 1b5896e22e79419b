//! Filter of requests: only requests of the page itself or of a program are handled, and only under a name of this
//! machine or of a configured proxy.
//!
//! Any page in a browser can send requests to addresses of this machine. So the address contains a secret. A host name
//! that only resolves to this machine (DNS rebinding) and requests of other pages are rejected. The response to a
//! rejected request is the same as for an unknown path, so it reveals nothing.

use axum::extract::{Request, State};
use axum::http::header::{HOST, HeaderMap, HeaderValue, ORIGIN};
use axum::http::{HeaderName, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::allowed_origins::AllowedOrigins;

/// Host names of the loopback interface.
const OURSELVES: [&str; 3] = ["127.0.0.1", "localhost", "[::1]"];

/// HTTP headers that are added to the response to every allowed request.
const HEADERS: [(&str, &str); 5] = [
    ("cache-control", "no-store"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "SAMEORIGIN"),
    ("cross-origin-resource-policy", "same-origin"),
];

/// Handles a request if it comes from a page of the loopback interface, or from a page that one of these proxies shows.
/// Otherwise responds as for an unknown path.
pub async fn require_allowed_origin(State(proxies): State<AllowedOrigins>, request: Request, next: Next) -> Response {
    if !may_ask(request.headers(), &proxies) {
        return not_found().await;
    }
    let mut response = next.run(request).await;
    for (name, value) in HEADERS {
        response.headers_mut().insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

/// Returns the response to rejected requests and to unknown paths.
pub async fn not_found() -> Response {
    StatusCode::NOT_FOUND.into_response()
}

/// Returns true if a request with these headers may be handled. Its host must be a name of the loopback interface, with
/// any port because the port may be forwarded, or the host of a proxy. A request that another page has sent is
/// rejected.
fn may_ask(headers: &HeaderMap, proxies: &AllowedOrigins) -> bool {
    let text = |name: &HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let Some(host) = text(&HOST) else { return false };
    let name = host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()));
    let is_ours = OURSELVES.contains(&name.map_or(host, |(name, _)| name));
    let is_own = |origin: &str| (is_ours && origin.strip_prefix("http://") == Some(host)) || proxies.contains(origin);
    let same_origin = text(&ORIGIN).is_none_or(is_own);
    let fetched_by = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
    (is_ours || proxies.has_host(host)) && same_origin && !matches!(fetched_by, Some(b"cross-site" | b"same-site"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_requests_of_the_page_itself_are_allowed() {
        let is_allowed = |headers: &[(&'static str, &'static str)]| {
            let pair = |&(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value));
            may_ask(&headers.iter().map(pair).collect(), &AllowedOrigins::default())
        };
        for host in ["127.0.0.1:8080", "localhost:1", "localhost", "[::1]:80"] {
            assert!(is_allowed(&[("host", host)]), "{host}");
        }
        for host in ["evil.example:8080", "127.0.0.1.evil.example", "192.168.0.7:8080", "", "[::1", "localhost:x"] {
            assert!(!is_allowed(&[("host", host)]), "{host}");
        }
        assert!(!is_allowed(&[]));
        let host = ("host", "127.0.0.1:8080");
        assert!(is_allowed(&[host, ("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "same-origin")]));
        assert!(is_allowed(&[host, ("sec-fetch-site", "none")]));
        for other in ["http://evil.example", "http://127.0.0.1:8081", "https://127.0.0.1:8080", "null", ""] {
            assert!(!is_allowed(&[host, ("origin", other)]), "{other}");
        }
        assert!(!is_allowed(&[host, ("sec-fetch-site", "cross-site")]));
        assert!(!is_allowed(&[host, ("sec-fetch-site", "same-site")]));
    }

    #[test]
    fn pages_of_the_configured_proxies_are_allowed() {
        let origins = ["https://robots.example", "http://lab.example:8080"].map(|of| of.to_owned().try_into().unwrap());
        let proxies = AllowedOrigins::new(&origins);
        let is_allowed = |host: &'static str, origin: &'static str| {
            let pairs = [(HOST, HeaderValue::from_static(host)), (ORIGIN, HeaderValue::from_static(origin))];
            may_ask(&pairs.into_iter().collect(), &proxies)
        };
        for (host, origin) in [
            ("robots.example", "https://robots.example"),
            ("lab.example:8080", "http://lab.example:8080"),
            // A proxy may pass its own name for the service.
            ("127.0.0.1:8017", "https://robots.example"),
            ("localhost", "https://robots.example"),
        ] {
            assert!(is_allowed(host, origin), "{host} {origin}");
        }
        for (host, origin) in [
            ("robots.example", "http://robots.example"),
            ("robots.example", "https://evil.example"),
            ("robots.example:8080", "https://robots.example"),
            ("evil.example", "https://robots.example"),
            ("robots.example.evil.example", "https://robots.example"),
            ("127.0.0.1:8017", "https://evil.example"),
            ("robots.example", "null"),
        ] {
            assert!(!is_allowed(host, origin), "{host} {origin}");
        }
    }
}
