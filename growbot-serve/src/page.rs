//! Routes of the files of the web page that shows all robots of the service.

use axum::Router;
use axum::http::header::CONTENT_TYPE;
use axum::response::Html;
use axum::routing::get;
use growbot_page::{PAGE, SCRIPTS, STYLE};

/// Content security policy of the page. It lets the page load content only from the service.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; \
                      frame-ancestors 'none'";

/// Returns the routes of the page and its files.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = Router::new()
        .route("/", get(|| async { ([("content-security-policy", POLICY)], Html(PAGE)) }))
        .route("/robots.css", get(|| async { ([(CONTENT_TYPE, "text/css")], STYLE) }));
    SCRIPTS.into_iter().fold(page, |page, (name, script)| {
        page.route(&format!("/{name}"), get(move || async move { ([(CONTENT_TYPE, "text/javascript")], script) }))
    })
}
