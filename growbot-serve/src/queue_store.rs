//! Bodies that wait for their robots, in a file for each robot. Nothing takes a body from the queue by itself: a person
//! confirms that the last body is removed.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use growbot_plan::atomic_file::{FileError, write_atomic};
use growbot_remote::api::{GrowRequest, QueuedBody};
use serde::{Deserialize, Serialize};

use super::paths::ServicePaths;

/// Maximum number of bodies that wait for a robot.
pub const MAX_QUEUED: usize = 50;

/// Errors of the queue of a robot.
#[derive(Debug, thiserror::Error)]
pub enum QueueError {
    /// The content of the file cannot be used.
    #[error("cannot use {path}, the queue of the robot ({error}): mend the file, or move it away", path = .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system, or of the content.
        error: io::Error,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The queue is full.
    #[error("{MAX_QUEUED} bodies wait for the robot, the limit: grow or remove one of them")]
    Full,
    /// Another request starts the body.
    #[error("queued body {0:?} is being started by another request: look at the robot")]
    Starting(String),
    /// The queue has no such body.
    #[error("no queued body {0:?}")]
    NotFound(String),
}

/// A body in the file, with the request to grow it.
#[derive(Serialize, Deserialize)]
struct StoredBody {
    body: QueuedBody,
    request: GrowRequest,
}

/// Bodies that wait for the robots of the service.
pub struct QueueStore {
    directory: PathBuf,
    /// Held while the file of a robot is read and replaced.
    lock: Mutex<()>,
    /// Robots and identifiers of the bodies that are being started.
    starting: Mutex<Vec<(String, String)>>,
}

/// Mark of a body that is being started, so that each body starts once.
struct Starting<'a> {
    store: &'a QueueStore,
    body: (String, String),
}

impl Drop for Starting<'_> {
    fn drop(&mut self) {
        self.store.starting().retain(|body| *body != self.body);
    }
}

impl QueueStore {
    /// Creates the store with the files of these paths.
    pub fn new(places: &ServicePaths) -> Self {
        Self { directory: places.queues(), lock: Mutex::new(()), starting: Mutex::default() }
    }

    /// Returns the bodies that wait for a robot, the next one first.
    pub fn bodies(&self, robot: &str) -> Result<Vec<QueuedBody>, QueueError> {
        let _lock = self.lock();
        Ok(self.read(robot)?.into_iter().map(|stored| stored.body).collect())
    }

    /// Adds a body at the end of a robot's queue. Its identifier is replaced by a new one. Returns the body.
    pub fn push(&self, robot: &str, mut body: QueuedBody, request: GrowRequest) -> Result<QueuedBody, QueueError> {
        let _lock = self.lock();
        let mut all = self.read(robot)?;
        if all.len() >= MAX_QUEUED {
            return Err(QueueError::Full);
        }
        let latest = all.iter().filter_map(|stored| stored.body.id.parse::<u64>().ok()).max();
        let time: String = body.created_utc.chars().filter(char::is_ascii_digit).collect();
        body.id = time.parse().unwrap_or(0).max(latest.map_or(0, |latest| latest + 1)).to_string();
        all.push(StoredBody { body: body.clone(), request });
        self.write(robot, &all)?;
        Ok(body)
    }

    /// Starts a queued body by `start`, which gets the request to grow it. Removes the body once it has started.
    pub fn start<T, E: From<QueueError>>(
        &self,
        robot: &str,
        id: &str,
        start: impl FnOnce(GrowRequest) -> Result<T, E>,
    ) -> Result<T, E> {
        let _starting = self.mark_starting(robot, id)?;
        let started = start(self.request(robot, id)?)?;
        if let Err(error) = self.remove(robot, id) {
            log::warn!("robot {robot}: body {id} grows, but stays in the queue ({error}): remove it there");
        }
        Ok(started)
    }

    fn mark_starting(&self, robot: &str, id: &str) -> Result<Starting<'_>, QueueError> {
        let body = (robot.to_owned(), id.to_owned());
        let mut starting = self.starting();
        if starting.contains(&body) {
            return Err(QueueError::Starting(id.to_owned()));
        }
        starting.push(body.clone());
        Ok(Starting { store: self, body })
    }

    fn starting(&self) -> MutexGuard<'_, Vec<(String, String)>> {
        self.starting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the request to grow a queued body.
    fn request(&self, robot: &str, id: &str) -> Result<GrowRequest, QueueError> {
        let _lock = self.lock();
        let found = self.read(robot)?.into_iter().find(|stored| stored.body.id == id);
        found.map(|stored| stored.request).ok_or_else(|| QueueError::NotFound(id.to_owned()))
    }

    /// Removes a body from the queue. Returns the bodies that still wait.
    pub fn remove(&self, robot: &str, id: &str) -> Result<Vec<QueuedBody>, QueueError> {
        self.change(robot, id, |_, _| ())
    }

    /// Moves a body to the front of the queue. Returns the bodies that wait.
    pub fn move_to_front(&self, robot: &str, id: &str) -> Result<Vec<QueuedBody>, QueueError> {
        self.change(robot, id, |all, body| all.insert(0, body))
    }

    /// Takes a body from the queue, and changes the queue of the others with `change`. Returns the bodies that wait.
    fn change(
        &self,
        robot: &str,
        id: &str,
        change: impl FnOnce(&mut Vec<StoredBody>, StoredBody),
    ) -> Result<Vec<QueuedBody>, QueueError> {
        let _lock = self.lock();
        let mut all = self.read(robot)?;
        let at = all.iter().position(|stored| stored.body.id == id);
        let body = all.remove(at.ok_or_else(|| QueueError::NotFound(id.to_owned()))?);
        change(&mut all, body);
        self.write(robot, &all)?;
        Ok(all.into_iter().map(|stored| stored.body).collect())
    }

    fn lock(&self) -> MutexGuard<'_, ()> {
        self.lock.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, robot: &str) -> PathBuf {
        self.directory.join(format!("{robot}.json"))
    }

    fn read(&self, robot: &str) -> Result<Vec<StoredBody>, QueueError> {
        let path = self.path(robot);
        match fs::read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| QueueError::File { path, error: error.into() }),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(QueueError::File { path, error }),
        }
    }

    fn write(&self, robot: &str, all: &[StoredBody]) -> Result<(), QueueError> {
        let path = self.path(robot);
        let bytes =
            serde_json::to_vec(all).map_err(|error| QueueError::File { path: path.clone(), error: error.into() })?;
        Ok(write_atomic(&path, &bytes)?)
    }
}
