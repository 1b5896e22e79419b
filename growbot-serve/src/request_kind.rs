//! Kinds of requests, which determine the limits that apply to a request.

use axum::extract::Request;
use axum::http::Method;

use super::access::Access;

/// Maximum length of the body of an upload of a scene, bytes.
pub const MAX_BODY: usize = 16 << 20;
/// Maximum length of the body of any other request, bytes.
const MAX_JSON: usize = 1 << 20;
/// Maximum length of the body of a command to a robot, bytes.
const MAX_COMMAND: usize = 4 << 10;
/// Maximum length of the body of a request by a read-only client, bytes. The number of requests with bodies up to this
/// length, and of responses with such bodies, is not limited.
pub(super) const SHORT: usize = 64 << 10;

/// Kind of a request, which determines the limits that apply to the request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestKind {
    /// A stop or an emergency stop. It needs no HTTP body, and no limit on the number of requests applies to it.
    Stop,
    /// A command to a robot, for example a stop that the HTTP body contains.
    Command,
    /// A stream of events.
    Stream,
    /// Any other request.
    Other,
}

impl RequestKind {
    /// Returns the kind of a request.
    pub fn of(request: &Request) -> Self {
        let last = request.uri().path().rsplit('/').next();
        match (request.method(), last) {
            (&Method::POST, Some("stop" | "emergency-stop")) => Self::Stop,
            (&Method::POST, Some("commands")) => Self::Command,
            (&Method::GET, Some("events" | "ws" | "updates")) => Self::Stream,
            _ => Self::Other,
        }
    }

    /// Returns true if the request may be a stop. Such a request is handled without waiting for any other.
    pub fn is_urgent(self) -> bool {
        matches!(self, Self::Stop | Self::Command)
    }

    /// Returns the maximum length of the body, bytes.
    pub fn max_body(self, access: Access, path: &str) -> usize {
        match (self, access) {
            (Self::Stop, _) => 0,
            (Self::Command, _) => MAX_COMMAND,
            (_, Access::View) => SHORT,
            _ if path.ends_with("/scenes") => MAX_BODY,
            _ => MAX_JSON,
        }
    }
}
