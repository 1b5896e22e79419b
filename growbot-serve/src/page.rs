//! Files of the web page that shows all robots of the service.

use axum::Router;
use axum::http::header::CONTENT_TYPE;
use axum::response::Html;
use axum::routing::get;
use growbot_pictures::view::page::CONNECTION_SCRIPT;

const PAGE: &str = include_str!("page/robots.html");
const STYLE: &str = include_str!("page/robots.css");
/// Scripts of the page: file name and content.
const SCRIPTS: [(&str, &str); 7] = [
    ("robots.js", include_str!("page/robots.js")),
    ("card.js", include_str!("page/card.js")),
    ("orders.js", include_str!("page/orders.js")),
    ("question.js", include_str!("page/question.js")),
    ("service.js", include_str!("page/service.js")),
    ("events-worker.js", include_str!("page/events-worker.js")),
    ("connection.js", CONNECTION_SCRIPT),
];
/// Content security policy of the page. It lets the page load content only from the service.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; frame-src 'self'; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// Returns the routes of the page and its files.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let page = Router::new()
        .route("/", get(|| async { ([("content-security-policy", POLICY)], Html(PAGE)) }))
        .route("/robots.css", get(|| async { ([(CONTENT_TYPE, "text/css")], STYLE) }));
    SCRIPTS.into_iter().fold(page, |page, (name, script)| {
        page.route(&format!("/{name}"), get(move || async move { ([(CONTENT_TYPE, "text/javascript")], script) }))
    })
}
