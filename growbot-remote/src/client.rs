//! Client of the running service, through the service's Unix socket.

use std::io::{self, BufRead, BufReader};
use std::net::Shutdown;
use std::ops::ControlFlow;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::sleep;
use std::time::Duration;

use growbot_client::status::RobotStatus;
use growbot_plan::ownership::{OwnershipError, check_private, trusts_user};
use rustix::net::sockopt::socket_peercred;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use ureq::Body;

use crate::PREFIX;
use crate::api::{Job, JobState, PageUrls};
use crate::socket::{SOCKET, runtime_dir};
use crate::transport::{agent_on, connect_unix};

/// Errors of a request to the service.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The service does not respond.
    #[error(
        "no valid response from the growbot service ({0}): check that the service runs and has the release of this \
         command"
    )]
    Unreachable(#[from] ResponseError),
    /// Another user may have replaced the service's socket, because that user can write to a directory of its path.
    #[error(
        "the growbot service of this user is not used, because another user can answer in place of the service: {0}"
    )]
    Ownership(#[from] OwnershipError),
    /// Another user listens on the service's socket.
    #[error(
        "the program that listens on {socket} belongs to user {owner}, so it is not the growbot service of this user: \
         remove the socket, and start the service again"
    )]
    ForeignPeer {
        /// Path of the socket.
        socket: String,
        /// Numeric user identifier of the program that listens on the socket.
        owner: u32,
    },
    /// The service has rejected the request.
    #[error("{detail}")]
    Rejected {
        /// HTTP status of the response.
        status: u16,
        /// Reason of the rejection.
        detail: String,
        /// Code of the reason, for programs. `None` if the reason has none.
        code: Option<String>,
    },
}

impl ServiceError {
    /// Returns true if the request itself is invalid, or for a robot or job that does not exist.
    pub fn is_invalid_request(&self) -> bool {
        matches!(self, Self::Rejected { status: 404 | 422, .. })
    }

    pub(crate) fn silent(error: impl Into<ResponseError>) -> Self {
        Self::Unreachable(error.into())
    }

    /// Returns the error of a request with this time limit.
    pub(crate) fn of_http(error: impl Into<ureq::Error>, limit: Duration) -> Self {
        Self::Unreachable(match error.into() {
            ureq::Error::Timeout(_) => ResponseError::Late(limit),
            ureq::Error::Io(error) => ResponseError::Socket(error),
            error => ResponseError::Http(error),
        })
    }
}

/// Reason why the service has not sent a valid response.
#[derive(Debug, thiserror::Error)]
pub enum ResponseError {
    /// The socket cannot be used.
    #[error("{0}")]
    Socket(#[from] io::Error),
    /// The request or the response does not follow HTTP.
    #[error("{0}")]
    Http(#[from] ureq::Error),
    /// The body of the request or of the response is not valid.
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    /// The response did not arrive within this time.
    #[error("no response within {:.1} s", .0.as_secs_f64())]
    Late(Duration),
}

/// Default timeout of a request. It is long because a command to a robot may wait for its board.
pub const RESPONSE_TIMEOUT: Duration = Duration::from_secs(30);

/// Time between two attempts to reach a service that does not respond.
const RECONNECT_DELAY: Duration = Duration::from_millis(500);

/// Handle by which another thread gives a request up. The service withdraws an order whose client is gone before the
/// order begins.
#[derive(Debug, Clone, Default)]
pub struct RequestHandle(Arc<Mutex<RequestState>>);

#[derive(Debug, Default)]
enum RequestState {
    #[default]
    NotSent,
    /// The request is sent on this connection.
    Sent(UnixStream),
    GivenUp,
}

impl RequestHandle {
    /// Closes the connection of the request, or prevents the request if it is not sent yet.
    pub fn give_up(&self) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let RequestState::Sent(stream) = &*state {
            // If the service has ended, so has the request.
            let _ = stream.shutdown(Shutdown::Both);
        }
        *state = RequestState::GivenUp;
    }

    /// Connects the request by `connect`. Returns an error if the request is given up.
    fn send_on(&self, connect: impl FnOnce() -> Result<UnixStream, ServiceError>) -> Result<UnixStream, ServiceError> {
        let stream = connect()?;
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*state, RequestState::GivenUp) {
            return Err(ServiceError::silent(io::Error::from(io::ErrorKind::Interrupted)));
        }
        *state = RequestState::Sent(stream.try_clone().map_err(ServiceError::silent)?);
        Ok(stream)
    }
}

/// Client of the running service of this user. Each request has a connection of its own.
#[derive(Debug, Clone)]
pub struct ServiceClient {
    pub(crate) socket: PathBuf,
}

impl ServiceClient {
    /// Finds the service of this user. Returns `None` if no service is running.
    ///
    /// # Errors
    /// [`ServiceError`] if another user can answer in place of the service.
    pub fn find() -> Result<Option<Self>, ServiceError> {
        let Some(directory) = runtime_dir().filter(|directory| directory.join(SOCKET).exists()) else {
            return Ok(None);
        };
        check_private(&directory)?;
        let client = Self { socket: directory.join(SOCKET) };
        match client.connect() {
            Err(ServiceError::Unreachable(_)) => Ok(None),
            connected => connected.map(|_| Some(client)),
        }
    }

    /// Connects to the socket, and checks that the program that listens on it belongs to this user or root.
    fn connect(&self) -> Result<UnixStream, ServiceError> {
        let stream = connect_unix(&self.socket).map_err(ServiceError::silent)?;
        let peer = socket_peercred(&stream).map_err(io::Error::from).map_err(ServiceError::silent)?;
        let owner = peer.uid.as_raw();
        let foreign = || ServiceError::ForeignPeer { socket: self.socket.display().to_string(), owner };
        trusts_user(owner).then_some(stream).ok_or_else(foreign)
    }

    /// Requests the status of all robots of the service. `limit` is the timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn robots(&self, limit: Duration) -> Result<Vec<RobotStatus>, ServiceError> {
        self.request("/robots", None::<()>, Some(limit))?.json()
    }

    /// Requests a job.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn job(&self, id: &str) -> Result<Job, ServiceError> {
        self.get(&format!("/jobs/{id}"))
    }

    /// Requests the latest jobs, newest first, at most 1,000.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn jobs(&self) -> Result<Vec<Job>, ServiceError> {
        self.get("/jobs?limit=1000")
    }

    /// Requests the run log of a job.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn job_log(&self, id: &str) -> Result<Vec<u8>, ServiceError> {
        self.request(&format!("/jobs/{id}/log"), None::<()>, None)?.bytes()
    }

    /// Requests the URLs of the service's page.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn page_urls(&self) -> Result<PageUrls, ServiceError> {
        self.get("/page-urls")
    }

    /// Requests the JSON value at this path of the API.
    pub(crate) fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ServiceError> {
        self.request(path, None::<()>, Some(RESPONSE_TIMEOUT))?.json()
    }

    /// Requests the response at this path of the API, whose body is not read yet. `body` is sent as JSON by POST.
    /// Without a limit of the whole request, each wait for a part of the response has the default timeout. Returns an
    /// error if the service rejects the request.
    pub(crate) fn request(
        &self,
        path: &str,
        body: Option<impl Serialize>,
        limit: Option<Duration>,
    ) -> Result<Response, ServiceError> {
        self.request_by(&RequestHandle::default(), path, body, limit)
    }

    /// Like [`Self::request`], but the request can be given up by a handle.
    pub(crate) fn request_by(
        &self,
        handle: &RequestHandle,
        path: &str,
        body: Option<impl Serialize>,
        limit: Option<Duration>,
    ) -> Result<Response, ServiceError> {
        let body = body.map(|body| serde_json::to_vec(&body)).transpose().map_err(ServiceError::silent)?;
        let stream = handle.send_on(|| self.connect())?;
        let agent = agent_on(stream.try_clone().map_err(ServiceError::silent)?, limit, RESPONSE_TIMEOUT);
        let limit = limit.unwrap_or(RESPONSE_TIMEOUT);
        let url = format!("http://localhost{PREFIX}{path}");
        let response = match body {
            None => agent.get(url).call(),
            Some(body) => agent.post(url).header("content-type", "application/json").send(&body),
        };
        let (head, body) = response.map_err(|error| ServiceError::of_http(error, limit))?.into_parts();
        let response = Response { body, stream, limit };
        if head.status.is_success() {
            return Ok(response);
        }
        let bytes = response.bytes()?;
        let problem: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        let text = |key| problem.get(key).and_then(Value::as_str).map(str::to_owned);
        let detail = text("detail").unwrap_or_else(|| String::from_utf8_lossy(&bytes).into_owned());
        Err(ServiceError::Rejected { status: head.status.as_u16(), detail, code: text("code") })
    }
}

/// Update of a job that a program follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobLogUpdate<'a> {
    /// The next line of the job's run log.
    Line(&'a str),
    /// The service responds, but the log has no new line.
    NoChange,
    /// The service does not respond. It is tried again, because it resumes its jobs when it runs again.
    NoResponse,
}

impl ServiceClient {
    /// Passes the lines of a job's run log to `take` as they are written, each once and in order, and other updates
    /// from time to time. Returns the job when it has ended, or `None` if `take` breaks off before.
    ///
    /// # Errors
    /// [`ServiceError`], but not for a service that does not respond.
    pub fn follow_job(
        &self,
        id: &str,
        mut take: impl FnMut(JobLogUpdate) -> ControlFlow<()>,
    ) -> Result<Option<Job>, ServiceError> {
        let mut after = 0;
        loop {
            let job = match self.read_events(id, &mut after, &mut take) {
                Ok(ControlFlow::Break(())) => return Ok(None),
                // The events end with the job. A service that ends closes the connection, too.
                Ok(ControlFlow::Continue(())) => self.job(id),
                Err(error) => Err(error),
            };
            match job {
                Ok(job) if job.state != JobState::Active => return Ok(Some(job)),
                Ok(_) => {}
                Err(ServiceError::Unreachable(_)) if take(JobLogUpdate::NoResponse).is_continue() => {}
                Err(ServiceError::Unreachable(_)) => return Ok(None),
                Err(error) => return Err(error),
            }
            sleep(RECONNECT_DELAY);
        }
    }

    /// Passes the lines after line `after` to `take` until the service ends the response. `after` is then the number of
    /// the latest line.
    fn read_events(
        &self,
        id: &str,
        after: &mut u64,
        take: &mut impl FnMut(JobLogUpdate) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>, ServiceError> {
        // The service sends a comment after 15 s without an event.
        let Response { body, limit, .. } =
            self.request(&format!("/jobs/{id}/events?after={after}"), None::<()>, None)?;
        let (mut number, mut data) = (None, None);
        for line in BufReader::new(body.into_reader()).split(b'\n') {
            let line = line.map_err(|error| ServiceError::of_http(error, limit))?;
            let line = String::from_utf8_lossy(&line);
            let line = line.trim_end_matches('\r');
            match line.split_once(':') {
                Some(("id", text)) => number = text.trim_start().parse().ok(),
                Some(("data", text)) => data = Some(text.trim_start().to_owned()),
                // An empty line ends an event. A comment has no data.
                None if line.is_empty() => {
                    *after = number.take().unwrap_or(*after);
                    let data = data.take();
                    let update = data.as_deref().map_or(JobLogUpdate::NoChange, JobLogUpdate::Line);
                    if take(update).is_break() {
                        return Ok(ControlFlow::Break(()));
                    }
                }
                _ => {}
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}

/// A response whose body is not read yet.
pub(crate) struct Response {
    pub body: Body,
    /// Connection on which the response arrives.
    pub stream: UnixStream,
    /// Time limit of the request, or of each wait for a part of the response.
    pub limit: Duration,
}

impl Response {
    fn bytes(mut self) -> Result<Vec<u8>, ServiceError> {
        self.body.with_config().read_to_vec().map_err(|error| ServiceError::of_http(error, self.limit))
    }

    /// Reads the JSON value in the body.
    pub fn json<T: DeserializeOwned>(self) -> Result<T, ServiceError> {
        serde_json::from_slice(&self.bytes()?).map_err(ServiceError::silent)
    }
}
