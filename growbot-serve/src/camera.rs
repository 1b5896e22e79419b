//! Cameras of robots: a thread of each camera requests one picture at a time, for all clients together, and stores one
//! of each layer.
//!
//! A camera is another device on the network. What it sends is bounded, and no message repeats what it sends or its
//! address.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use axum::http::header::{CONTENT_TYPE, HeaderMap, LOCATION};
use rustix::process::setpriority_process;
use tokio::sync::watch;
use ureq::Agent;

use super::config::RobotEntry;
use super::limits::NICENESS;
use super::picture::{Picture, PictureError};
use super::snapshot_store::{SnapshotError, SnapshotStore};
use super::web_address::WebAddress;

/// Time limit of a picture, with all redirects.
const PICTURE_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum number of redirects, which must stay on the camera.
const MAX_REDIRECTS: usize = 3;

/// The address of a camera is invalid. The message does not repeat it, because it may contain a secret.
#[derive(Debug, thiserror::Error)]
#[error("the camera of {robot} in [serve.cameras] cannot be used: give a URL with https:// or http:// and a host")]
pub struct CameraSettingsError {
    /// Name of the robot.
    pub robot: String,
}

/// Reasons why a request to a camera fails.
#[derive(Debug, Clone, thiserror::Error)]
pub enum CameraError {
    #[error(
        "the camera does not respond within {} s: check its power, its network and its address",
        PICTURE_TIMEOUT.as_secs()
    )]
    Late,
    #[error("the camera cannot be reached: check its power, its network and its address")]
    Unreachable,
    #[error("the certificate of the camera is not accepted: install it on this machine, or give an http:// address")]
    Certificate,
    #[error("the camera does not respond by HTTP: check its address and its port")]
    NoHttp,
    #[error("the camera responds with the HTTP status {0}: check its address, and the user and password in it")]
    Status(u16),
    #[error(
        "the camera redirects elsewhere, or more than {MAX_REDIRECTS} times: give the address to which it redirects"
    )]
    Redirect,
    #[error("the camera gives no picture: {0}")]
    Picture(Arc<PictureError>),
}

/// A camera, with the thread that requests its pictures.
pub struct RobotCamera {
    address: WebAddress,
    agent: Agent,
    wanted: Mutex<WantedPictures>,
    wakes: Condvar,
    latest: watch::Sender<Option<Result<Picture, CameraError>>>,
}

/// Pictures that the camera's thread has yet to request.
#[derive(Default)]
struct WantedPictures {
    /// True if a client waits for a picture.
    live: bool,
    /// The latest laid layer, if no picture of it was requested. Earlier ones have no picture, because the camera is
    /// slower than the robot.
    laid: Option<LaidLayer>,
}

impl RobotCamera {
    fn new(address: WebAddress) -> Self {
        let agent = Agent::config_builder()
            .max_redirects(0)
            .http_status_as_error(false)
            .proxy(None)
            .user_agent(concat!("growbot/", env!("CARGO_PKG_VERSION")))
            .build();
        let latest = watch::Sender::new(None);
        Self { address, agent: agent.into(), wanted: Mutex::default(), wakes: Condvar::new(), latest }
    }

    /// Returns the next picture that arrives. All that wait share one request, and occupy no thread.
    ///
    /// # Errors
    /// The camera gives no picture.
    pub async fn picture(&self) -> Result<Picture, CameraError> {
        let mut latest = self.latest.subscribe();
        self.want(|wanted| wanted.live = true);
        // The sender lives as long as the camera.
        let _ = latest.changed().await;
        latest.borrow().clone().unwrap_or(Err(CameraError::Unreachable))
    }

    fn want(&self, change: impl FnOnce(&mut WantedPictures)) {
        change(&mut self.wanted.lock().unwrap_or_else(PoisonError::into_inner));
        self.wakes.notify_one();
    }

    /// Waits until a picture is wanted. Returns the layer of which it is, if it is of one.
    fn next_wanted(&self) -> Option<LaidLayer> {
        let wanted = self.wanted.lock().unwrap_or_else(PoisonError::into_inner);
        let is_idle = |wanted: &mut WantedPictures| !wanted.live && wanted.laid.is_none();
        let mut wanted = self.wakes.wait_while(wanted, is_idle).unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *wanted).laid
    }

    /// Requests pictures for clients, and stores one of each layer. A warning is printed when these begin to fail.
    fn run(&self, robot: &str, store: &SnapshotStore) {
        // Threads that drive robots run first.
        let _ = setpriority_process(None, NICENESS);
        let mut fails = false;
        loop {
            let laid = self.next_wanted();
            let picture = self.request();
            self.latest.send_replace(Some(picture.clone()));
            let Some(LaidLayer { job, layer }) = laid else { continue };
            let stored =
                picture.map_err(LayerPictureError::from).and_then(|picture| Ok(store.add(&job, layer, &picture)?));
            if let (Err(error), false) = (&stored, fails) {
                log::warn!("no picture of {robot} is stored: {error}");
            }
            fails = stored.is_err();
        }
    }

    fn request(&self) -> Result<Picture, CameraError> {
        let deadline = Instant::now() + PICTURE_TIMEOUT;
        let mut address = self.address.clone();
        for _ in 0..=MAX_REDIRECTS {
            let left = deadline.saturating_duration_since(Instant::now());
            let request = self.agent.get(address.to_text()).config().timeout_global(Some(left)).build();
            let response = request.call().map_err(|error| match error {
                ureq::Error::Timeout(_) => CameraError::Late,
                ureq::Error::Tls(_) | ureq::Error::Rustls(_) => CameraError::Certificate,
                ureq::Error::Protocol(_) => CameraError::NoHttp,
                _ => CameraError::Unreachable,
            })?;
            let header = |name| text_of(response.headers(), name);
            match response.status().as_u16() {
                200 => {
                    let content_type = header(CONTENT_TYPE).unwrap_or_default();
                    let body = UntilDeadline { body: response.into_body().into_reader(), deadline };
                    return Picture::read(&content_type, body).map_err(|error| match error {
                        PictureError::Read(_) if Instant::now() >= deadline => CameraError::Late,
                        error => CameraError::Picture(Arc::new(error)),
                    });
                }
                301 | 302 | 303 | 307 | 308 => {
                    let location = header(LOCATION).and_then(|location| address.redirected(&location));
                    address = location.ok_or(CameraError::Redirect)?;
                }
                status => return Err(CameraError::Status(status)),
            }
        }
        Err(CameraError::Redirect)
    }
}

fn text_of(headers: &HeaderMap, name: impl axum::http::header::AsHeaderName) -> Option<String> {
    headers.get(name)?.to_str().ok().map(str::to_owned)
}

/// A body that may be read until a deadline. A camera that sends a byte now and then would otherwise never end.
struct UntilDeadline<R> {
    body: R,
    deadline: Instant,
}

impl<R: Read> Read for UntilDeadline<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if Instant::now() >= self.deadline {
            return Err(io::ErrorKind::TimedOut.into());
        }
        // The text of the error may come from the camera.
        self.body.read(buffer).map_err(|error| error.kind().into())
    }
}

/// A layer that was laid, and of which there should be a picture.
struct LaidLayer {
    job: String,
    layer: u32,
}

/// The cameras of all robots that have one.
pub struct Cameras {
    cameras: BTreeMap<String, Arc<RobotCamera>>,
    pub snapshots: Arc<SnapshotStore>,
}

impl Cameras {
    /// Starts a thread for each camera of the settings. A camera of a robot that the service does not have is not used,
    /// because the robots of a project may be others than those of the user's own settings.
    ///
    /// # Errors
    /// [`CameraSettingsError`] if an address is invalid.
    pub fn start(
        addresses: &BTreeMap<String, String>,
        robots: &BTreeMap<String, RobotEntry>,
        snapshots: SnapshotStore,
    ) -> Result<Self, CameraSettingsError> {
        let snapshots = Arc::new(snapshots);
        let mut cameras = BTreeMap::new();
        for (robot, address) in addresses {
            let invalid = || CameraSettingsError { robot: robot.clone() };
            let camera = Arc::new(RobotCamera::new(WebAddress::parse(address).ok_or_else(invalid)?));
            if !robots.contains_key(robot) {
                log::warn!("[serve.cameras] names {robot}, but the service has no such robot: its camera is not used");
                continue;
            }
            let (name, of_thread, store) = (robot.clone(), Arc::clone(&camera), Arc::clone(&snapshots));
            let thread = thread::Builder::new().name(format!("camera {robot}"));
            match thread.spawn(move || of_thread.run(&name, &store)) {
                Ok(_) => drop(cameras.insert(robot.clone(), camera)),
                Err(error) => {
                    log::warn!("the camera of {robot} is not used, because the service cannot start a thread: {error}");
                }
            }
        }
        Ok(Self { cameras, snapshots })
    }

    /// Returns the names of the robots with a camera.
    pub fn robots(&self) -> Vec<String> {
        self.cameras.keys().cloned().collect()
    }

    /// Returns the camera of a robot. `None` without one.
    pub fn camera(&self, robot: &str) -> Option<Arc<RobotCamera>> {
        self.cameras.get(robot).cloned()
    }

    /// Stores a picture of a layer that was just laid, without waiting for it.
    pub fn on_laid(&self, robot: &str, job: &str, layer: u32) {
        if let Some(camera) = self.cameras.get(robot) {
            camera.want(|wanted| wanted.laid = Some(LaidLayer { job: job.to_owned(), layer }));
        }
    }
}

/// Reasons why the picture of a layer is not stored.
#[derive(Debug, thiserror::Error)]
enum LayerPictureError {
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Store(#[from] SnapshotError),
}
