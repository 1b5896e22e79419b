//! Errors of requests, as problem details of RFC 9457.

use std::time::Duration;

use aide::OperationOutput;
use aide::generate::GenContext;
use aide::openapi::{Operation, Response as Described};
use axum::http::header::CONTENT_TYPE;
use axum::http::{Method, StatusCode};
use axum::response::{IntoResponse, Response};
use growbot_core::plan::PlanError;
use growbot_plan::scene_planning::ScenePlanError;
use growbot_remote::PREFIX;
use schemars::JsonSchema;
use serde::Serialize;

use super::robot_error::RobotRequestError;

/// Remedy for a request that the service does not know. A page that was open during an update sends such requests.
const RELOAD: &str = "reload the page, or update the program that sent the request";

/// Reason why a request failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema, thiserror::Error)]
#[error("{detail}")]
pub struct Problem {
    /// Kind of the problem.
    pub title: &'static str,
    /// HTTP status of the response.
    pub status: u16,
    /// Explanation: what failed, the value, the limit and the remedy.
    pub detail: String,
    /// Code of the reason why a growth was refused. Omitted for other problems.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub code: Option<&'static str>,
}

impl Problem {
    #[expect(clippy::needless_pass_by_value, reason = "errors are mapped by its callers")]
    fn new(status: StatusCode, title: &'static str, detail: impl ToString) -> Self {
        Self { title, status: status.as_u16(), detail: detail.to_string(), code: None }
    }

    /// Returns the error 404: the requested object does not exist.
    pub fn not_found(what: &str, name: &str) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not found", format!("no {what} {name:?}"))
    }

    /// Returns the error 404: the API of this release does not have this route.
    pub fn unknown_route(method: &Method, path: &str) -> Self {
        let detail =
            format!("this release has no route {method} {path}: {RELOAD}; GET {PREFIX}/openapi.json lists the routes");
        Self::new(StatusCode::NOT_FOUND, "not found", detail)
    }

    /// Returns the error 422: the request is invalid.
    pub fn bad(detail: impl ToString) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid request", detail)
    }

    /// Returns the error 409: the request cannot be carried out in the current state.
    pub fn conflict(detail: impl ToString) -> Self {
        Self::new(StatusCode::CONFLICT, "conflict", detail)
    }

    /// Returns the error 403: the client has read-only access.
    pub fn read_only() -> Self {
        Self::new(
            StatusCode::FORBIDDEN,
            "read-only",
            "this URL is read-only: use the URL for control that growbot prints",
        )
    }

    /// Returns the error 403: the client is not allowed to send this request.
    pub fn forbidden(detail: impl ToString) -> Self {
        Self::new(StatusCode::FORBIDDEN, "forbidden", detail)
    }

    /// Returns the error 413: the body of the request is longer than `max` bytes.
    pub fn too_long(max: usize) -> Self {
        let detail = format!("the request is longer than {max} bytes: send a shorter one");
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too long", detail)
    }

    /// Returns the error 408: the request did not arrive within the time `max`.
    pub fn too_slow(max: Duration) -> Self {
        let detail = format!("the request was not complete within {} s: send it faster", max.as_secs());
        Self::new(StatusCode::REQUEST_TIMEOUT, "too slow", detail)
    }

    /// Returns the error 503: a limit of the service is reached.
    pub fn busy(why: &str) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", format!("{why}: try again when one of them has ended"))
    }

    /// Returns the error with this HTTP status and text, for a request that was rejected before a handler ran.
    pub fn from_status(status: StatusCode, text: &str) -> Self {
        let reason = status.canonical_reason().unwrap_or("refused");
        match status {
            _ if text.is_empty() => Self::new(status, reason, reason),
            // The body or the query has other fields than this release.
            StatusCode::BAD_REQUEST | StatusCode::UNPROCESSABLE_ENTITY => {
                Self::new(status, reason, format!("{text}: correct the request, or {RELOAD}"))
            }
            _ => Self::new(status, reason, text),
        }
    }

    /// Returns the error 502: another device, such as a camera, gives no usable response.
    pub fn bad_gateway(detail: impl ToString) -> Self {
        Self::new(StatusCode::BAD_GATEWAY, "bad gateway", detail)
    }

    /// Returns the error 500: the service has failed.
    pub fn internal(detail: impl ToString) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error", detail)
    }
}

impl From<PlanError> for Problem {
    fn from(error: PlanError) -> Self {
        Self::bad(error)
    }
}

impl From<RobotRequestError> for Problem {
    fn from(error: RobotRequestError) -> Self {
        Self::conflict(error)
    }
}

impl From<ScenePlanError> for Problem {
    fn from(error: ScenePlanError) -> Self {
        Self::bad(error)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self).unwrap_or_default();
        (status, [(CONTENT_TYPE, "application/problem+json")], body).into_response()
    }
}

impl OperationOutput for Problem {
    type Inner = Self;

    fn operation_response(context: &mut GenContext, operation: &mut Operation) -> Option<Described> {
        axum::Json::<Self>::operation_response(context, operation)
    }
}
