//! Client of the running service, through the service's Unix socket.

use std::io;
use std::path::{Path, PathBuf};

use axum::body::{Body, Bytes};
use axum::http::{Method, Request, StatusCode};
use growbot_client::status::RobotStatus;
use growbot_plan::ownership::{OwnershipError, check_private, trusts_user};
use http_body_util::BodyExt;
use hyper::body::Incoming;
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::net::UnixStream;
use tokio::runtime::Runtime;
use tokio::time::{Duration, timeout};

use super::PREFIX;
use super::commands::LeaseRequest;
use super::socket::{runtime_dir, socket_in};

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
    },
}

impl ServiceError {
    fn silent(error: impl Into<ResponseError>) -> Self {
        Self::Unreachable(error.into())
    }
}

/// Reason why the service has not sent a valid response.
#[derive(Debug, thiserror::Error)]
pub enum ResponseError {
    /// The socket cannot be used.
    #[error("{0}")]
    Socket(#[from] io::Error),
    /// The connection or the response does not follow HTTP.
    #[error("{0}")]
    Http(#[from] hyper::Error),
    /// The request is not valid in HTTP.
    #[error("{0}")]
    Request(#[from] axum::http::Error),
    /// The body of the response or the request is not valid.
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    /// The response did not arrive within this time.
    #[error("no response within {:.1} s", .0.as_secs_f64())]
    Late(Duration),
}

/// A lease of a robot's port. The lease ends when this value is dropped, when its [`ServiceClient`] is dropped, or when
/// the program ends.
pub struct LeasedPort(#[expect(dead_code, reason = "it is held")] Incoming);

/// Default timeout of a request. It is long because a command to a robot may wait for its board.
pub const RESPONSE_TIMEOUT: Duration = Duration::from_secs(30);

/// Connection to a running service of this user.
pub struct ServiceClient {
    runtime: Runtime,
    socket: PathBuf,
}

impl ServiceClient {
    /// Connects to the service of this user. Returns `None` if no service is running.
    ///
    /// # Errors
    /// [`ServiceError`] if another user can answer in place of the service.
    pub fn find() -> Result<Option<Self>, ServiceError> {
        let Some(directory) = runtime_dir() else { return Ok(None) };
        let socket = socket_in(&directory);
        if !socket.exists() {
            return Ok(None);
        }
        check_private(&directory)?;
        match Self::at(&socket) {
            Err(ServiceError::Unreachable(_)) => Ok(None),
            found => found.map(Some),
        }
    }

    /// Connects to the service that listens on this socket.
    ///
    /// # Errors
    /// No service of this user listens on the socket.
    fn at(socket: &Path) -> Result<Self, ServiceError> {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ServiceError::silent)?;
        let client = Self { runtime, socket: socket.to_path_buf() };
        client.runtime.block_on(client.connect())?;
        Ok(client)
    }

    /// Connects to the socket, and checks that the program that listens on it belongs to this user or root.
    async fn connect(&self) -> Result<UnixStream, ServiceError> {
        let stream = UnixStream::connect(&self.socket).await.map_err(ServiceError::silent)?;
        let owner = stream.peer_cred().map_err(ServiceError::silent)?.uid();
        if trusts_user(owner) {
            return Ok(stream);
        }
        Err(ServiceError::ForeignPeer { socket: self.socket.display().to_string(), owner })
    }

    /// Requests the status of all robots of the service. `limit` is the timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn robots(&self, limit: Duration) -> Result<Vec<RobotStatus>, ServiceError> {
        self.runtime.block_on(self.request(Method::GET, "/robots", Body::empty(), limit))
    }

    /// Requests the status of the robot with this port. Returns `None` if the service has no robot with this port.
    /// `limit` is the timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn robot_at(&self, port: &str, limit: Duration) -> Result<Option<RobotStatus>, ServiceError> {
        let real = |name: &str| std::fs::canonicalize(name).ok();
        let robots = self.robots(limit)?;
        let is_there =
            |robot: &RobotStatus| robot.port == port || real(port).is_some_and(|at| real(&robot.port) == Some(at));
        Ok(robots.into_iter().find(is_there))
    }

    /// Requests the JSON value at this path of the API.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ServiceError> {
        self.runtime.block_on(self.request(Method::GET, path, Body::empty(), RESPONSE_TIMEOUT))
    }

    /// Requests the bytes at this path of the API.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn bytes(&self, path: &str) -> Result<Vec<u8>, ServiceError> {
        self.runtime.block_on(async {
            let (status, incoming) = self.send(Method::GET, path, Body::empty()).await?;
            let bytes = incoming.collect().await.map_err(ServiceError::silent)?.to_bytes();
            if status.is_success() { Ok(bytes.to_vec()) } else { Err(rejection(status, &bytes)) }
        })
    }

    /// Sends `what` as JSON to this path of the API, and returns the value in the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn post<T: DeserializeOwned>(&self, path: &str, what: &impl Serialize) -> Result<T, ServiceError> {
        self.post_within(path, what, RESPONSE_TIMEOUT)
    }

    /// Like [`ServiceClient::post`], but with `limit` as the timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn post_within<T: DeserializeOwned>(
        &self,
        path: &str,
        what: &impl Serialize,
        limit: Duration,
    ) -> Result<T, ServiceError> {
        let body = serde_json::to_vec(what).map_err(ServiceError::silent)?;
        self.runtime.block_on(self.request(Method::POST, path, body.into(), limit))
    }

    async fn request<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: Body,
        limit: Duration,
    ) -> Result<T, ServiceError> {
        let response = async {
            let (status, incoming) = self.send(method, path, body).await?;
            let bytes = incoming.collect().await.map_err(ServiceError::silent)?.to_bytes();
            if !status.is_success() {
                return Err(rejection(status, &bytes));
            }
            serde_json::from_slice(&bytes).map_err(ServiceError::silent)
        };
        let late = |_| ServiceError::silent(ResponseError::Late(limit));
        timeout(limit, response).await.map_err(late)?
    }

    async fn send(&self, method: Method, path: &str, body: Body) -> Result<(StatusCode, Incoming), ServiceError> {
        let stream = self.connect().await?;
        let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(ServiceError::silent)?;
        tokio::spawn(connection);
        let request = Request::builder()
            .method(method)
            .uri(format!("{PREFIX}{path}"))
            .header("host", "localhost")
            .header("content-type", "application/json")
            .body(body)
            .map_err(ServiceError::silent)?;
        let response = sender.send_request(request).await.map_err(ServiceError::silent)?;
        Ok((response.status(), response.into_body()))
    }

    /// Leases the port of the robot with this name. `to` is the name of the command that requests the lease. The
    /// service closes the port and keeps it closed until the returned value is dropped.
    ///
    /// # Errors
    /// [`ServiceError`], for example if the robot has a job.
    pub fn lease_port(&self, robot: &str, to: &str) -> Result<LeasedPort, ServiceError> {
        let body = serde_json::to_vec(&LeaseRequest { holder: to.to_owned() }).map_err(ServiceError::silent)?;
        let begun = async {
            let (status, incoming) =
                self.send(Method::POST, &format!("/robots/{robot}/port-lease"), body.into()).await?;
            if status.is_success() {
                return Ok(LeasedPort(incoming));
            }
            let bytes = incoming.collect().await.map_err(ServiceError::silent)?.to_bytes();
            Err(rejection(status, &bytes))
        };
        let late = |_| ServiceError::silent(ResponseError::Late(RESPONSE_TIMEOUT));
        self.runtime.block_on(async { timeout(RESPONSE_TIMEOUT, begun).await.map_err(late)? })
    }

    /// Passes the lines of a job's run log after line `after` to `take` as they arrive, until the job has ended or
    /// `take` returns false.
    ///
    /// # Errors
    /// [`ServiceError`], mostly because the service has ended. `after` is then the number of the latest line, from
    /// which the caller can resume.
    pub fn follow(&self, job: &str, after: &mut u64, mut take: impl FnMut(&str) -> bool) -> Result<(), ServiceError> {
        self.runtime.block_on(async {
            let path = format!("/jobs/{job}/events?after={after}");
            let (status, mut incoming) = self.send(Method::GET, &path, Body::empty()).await?;
            if !status.is_success() {
                let bytes = incoming.collect().await.map_err(ServiceError::silent)?.to_bytes();
                return Err(rejection(status, &bytes));
            }
            let mut text = Vec::new();
            while let Some(frame) = incoming.frame().await {
                text.extend_from_slice(frame.map_err(ServiceError::silent)?.data_ref().unwrap_or(&Bytes::new()));
                while let Some(end) = text.windows(2).position(|pair| pair == b"\n\n") {
                    let event: Vec<u8> = text.drain(..end + 2).collect();
                    let event = String::from_utf8_lossy(&event);
                    let field =
                        |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).map(str::trim_start);
                    let Some(data) = field("data:") else { continue };
                    *after = field("id:").and_then(|id| id.parse().ok()).unwrap_or(*after);
                    if !take(data) {
                        return Ok(());
                    }
                }
            }
            Ok(())
        })
    }
}

fn rejection(status: StatusCode, bytes: &[u8]) -> ServiceError {
    let problem: Value = serde_json::from_slice(bytes).unwrap_or_default();
    let detail = problem.get("detail").and_then(Value::as_str);
    let detail = detail.map_or_else(|| String::from_utf8_lossy(bytes).into_owned(), str::to_owned);
    ServiceError::Rejected { status: status.as_u16(), detail }
}
