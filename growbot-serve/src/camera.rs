//! Cameras of robots: one picture at a time is requested from each camera, for all clients together, and a thread of
//! each camera stores a picture of each layer.
//!
//! A camera is another device on the network. What it sends is bounded, and no message repeats what it sends or its
//! address.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use axum::http::header::{CONTENT_TYPE, HeaderMap, LOCATION};
use ureq::Agent;

use super::config::RobotEntry;
use super::picture::{Picture, PictureError};
use super::snapshot_store::{SnapshotError, SnapshotStore};
use super::web_address::WebAddress;

/// Time limit of a picture, with all redirects.
const PICTURE_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum number of redirects, which must stay on the camera.
const MAX_REDIRECTS: usize = 3;

/// Errors in the settings of cameras.
#[derive(Debug, thiserror::Error)]
pub enum CameraSettingsError {
    /// The camera's address is invalid. The message does not repeat it, because it may contain a secret.
    #[error("the camera of {robot} in [serve.cameras] cannot be used: give a URL with https:// or http:// and a host")]
    Address {
        /// Name of the robot.
        robot: String,
    },
    /// The service has no robot of this name.
    #[error("[serve.cameras] names {robot}, but the service has no such robot: give the name of one of [robots]")]
    UnknownRobot {
        /// Name in the settings.
        robot: String,
    },
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
    #[error("the camera responds with the HTTP status {0}: check its address and its password")]
    Status(u16),
    #[error(
        "the camera redirects elsewhere, or more than {MAX_REDIRECTS} times: give the address to which it redirects"
    )]
    Redirect,
    #[error("the camera gives no picture: {0}")]
    Picture(Arc<PictureError>),
}

/// A camera with its latest picture.
pub struct Camera {
    address: WebAddress,
    agent: Agent,
    latest: Mutex<Option<(Instant, Result<Picture, CameraError>)>>,
}

impl Camera {
    fn new(address: WebAddress) -> Self {
        let agent = Agent::config_builder()
            .timeout_global(Some(PICTURE_TIMEOUT))
            .max_redirects(0)
            .http_status_as_error(false)
            .proxy(None)
            .user_agent(concat!("growbot/", env!("CARGO_PKG_VERSION")))
            .build();
        Self { address, agent: agent.into(), latest: Mutex::default() }
    }

    /// Returns a picture that was requested after the call. All who wait share one request.
    ///
    /// # Errors
    /// The camera gives no picture.
    pub fn picture(&self) -> Result<Picture, CameraError> {
        let called = Instant::now();
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((requested, picture)) = &*latest
            && *requested >= called
        {
            return picture.clone();
        }
        let requested = Instant::now();
        let picture = self.request();
        *latest = Some((requested, picture.clone()));
        picture
    }

    fn request(&self) -> Result<Picture, CameraError> {
        let deadline = Instant::now() + PICTURE_TIMEOUT;
        let mut address = self.address.clone();
        for _ in 0..=MAX_REDIRECTS {
            let left = deadline.saturating_duration_since(Instant::now());
            let request = self.agent.get(address.to_text()).config().timeout_global(Some(left)).build();
            let response = request.call().map_err(|error| match error {
                ureq::Error::Timeout(_) => CameraError::Late,
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

/// A body that may be read until a deadline, so that a camera that sends a byte now and then occupies no thread.
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
    cameras: BTreeMap<String, (Arc<Camera>, SyncSender<LaidLayer>)>,
    pub snapshots: Arc<SnapshotStore>,
}

impl Cameras {
    /// Starts a thread for each camera of the settings.
    ///
    /// # Errors
    /// [`CameraSettingsError`] if an address is invalid or the service has no such robot.
    pub fn start(
        addresses: &BTreeMap<String, String>,
        robots: &BTreeMap<String, RobotEntry>,
        snapshots: SnapshotStore,
    ) -> Result<Self, CameraSettingsError> {
        let snapshots = Arc::new(snapshots);
        let mut cameras = BTreeMap::new();
        for (robot, address) in addresses {
            if !robots.contains_key(robot) {
                return Err(CameraSettingsError::UnknownRobot { robot: robot.clone() });
            }
            let address =
                WebAddress::parse(address).ok_or_else(|| CameraSettingsError::Address { robot: robot.clone() })?;
            let camera = Arc::new(Camera::new(address));
            // While a picture is on its way, one layer waits. Those between have no picture.
            let (sender, receiver) = mpsc::sync_channel(1);
            let (name, of_thread, store) = (robot.clone(), Arc::clone(&camera), Arc::clone(&snapshots));
            let spawned = thread::Builder::new()
                .name(format!("camera {robot}"))
                .spawn(move || store_snapshots(&name, &of_thread, &store, &receiver));
            if let Err(error) = spawned {
                log::warn!("no pictures of {robot} are stored, because the service cannot start a thread: {error}");
            }
            cameras.insert(robot.clone(), (camera, sender));
        }
        Ok(Self { cameras, snapshots })
    }

    /// Returns the names of the robots with a camera.
    pub fn robots(&self) -> Vec<String> {
        self.cameras.keys().cloned().collect()
    }

    /// Returns the camera of a robot. `None` without one.
    pub fn camera(&self, robot: &str) -> Option<Arc<Camera>> {
        self.cameras.get(robot).map(|(camera, _)| Arc::clone(camera))
    }

    /// Stores a picture of a layer that was just laid, without waiting for it.
    pub fn on_laid(&self, robot: &str, job: &str, layer: u32) {
        let Some((_, sender)) = self.cameras.get(robot) else { return };
        // The layer has no picture if another one waits already, because the camera is slower than the robot.
        let _ = sender.try_send(LaidLayer { job: job.to_owned(), layer });
    }
}

/// Stores a picture of each layer that arrives. A warning is printed when pictures begin to fail.
fn store_snapshots(robot: &str, camera: &Camera, store: &SnapshotStore, laid: &Receiver<LaidLayer>) {
    let mut fails = false;
    for LaidLayer { job, layer } in laid {
        let stored = store_snapshot(camera, store, &job, layer);
        if let (Err(error), false) = (&stored, fails) {
            log::warn!("no picture of {robot} is stored: {error}");
        }
        fails = stored.is_err();
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

fn store_snapshot(camera: &Camera, store: &SnapshotStore, job: &str, layer: u32) -> Result<(), LayerPictureError> {
    Ok(store.add(job, layer, &camera.picture()?)?)
}
