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
    /// The file cannot be read.
    #[error("cannot read {path}, the queue of the robot ({error}): mend the file, or move it away", path = .path.display())]
    Read {
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
}

impl QueueStore {
    /// Creates the store with the files of these paths.
    pub fn new(places: &ServicePaths) -> Self {
        Self { directory: places.queues(), lock: Mutex::new(()) }
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

    /// Returns the request to grow a queued body.
    pub fn request(&self, robot: &str, id: &str) -> Result<GrowRequest, QueueError> {
        let _lock = self.lock();
        let found = self.read(robot)?.into_iter().find(|stored| stored.body.id == id);
        found.map(|stored| stored.request).ok_or_else(|| QueueError::NotFound(id.to_owned()))
    }

    /// Removes a body from the queue. Returns the bodies that still wait.
    pub fn remove(&self, robot: &str, id: &str) -> Result<Vec<QueuedBody>, QueueError> {
        let _lock = self.lock();
        let mut all = self.read(robot)?;
        let count = all.len();
        all.retain(|stored| stored.body.id != id);
        if all.len() == count {
            return Err(QueueError::NotFound(id.to_owned()));
        }
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
            Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| QueueError::Read { path, error: error.into() }),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(QueueError::Read { path, error }),
        }
    }

    fn write(&self, robot: &str, all: &[StoredBody]) -> Result<(), QueueError> {
        let bytes = serde_json::to_vec(all).unwrap_or_default();
        Ok(write_atomic(&self.path(robot), &bytes)?)
    }
}
