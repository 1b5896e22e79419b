//! The service: its robots with their threads, and the state that all connections share.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

use growbot_remote::api::{Job, PageUrls};
use tokio::sync::watch;

use super::audit::Audit;
use super::camera::{CameraSettingsError, Cameras};
use super::config::{RobotEntry, ServeEntry};
use super::job_store::{JobStore, JobStoreError};
use super::library_store::LibraryStore;
use super::notifier::{Notifier, NotifyError};
use super::paths::ServicePaths;
use super::queue_store::QueueStore;
use super::robot_worker::RobotWorker;
use super::service_context::ServiceContext;
use super::snapshot_store::SnapshotStore;

/// The service of this user: its robots with their threads, their jobs, and the state that all connections share.
pub struct Service {
    pub(super) places: ServicePaths,
    pub(super) robots: BTreeMap<String, Arc<RobotWorker>>,
    pub(super) shared: Arc<ServiceContext>,
    /// URLs of the service's page. `Server::serve` sets them.
    pub(super) addresses: OnceLock<PageUrls>,
}

/// Errors that prevent the start of the service.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The list of jobs or another file of the service cannot be used.
    #[error(transparent)]
    Jobs(#[from] JobStoreError),
    /// The settings of notifications cannot be used.
    #[error(transparent)]
    Notify(#[from] NotifyError),
    /// The settings of cameras cannot be used.
    #[error(transparent)]
    Cameras(#[from] CameraSettingsError),
}

impl Service {
    /// Opens the list of jobs, and starts a thread for each robot, for each channel of notices and for each camera.
    ///
    /// # Errors
    /// [`StartError`] if the directory or the database cannot be used, or if the settings of notifications or cameras
    /// are invalid.
    pub fn start(
        places: ServicePaths,
        robots: &BTreeMap<String, RobotEntry>,
        settings: &ServeEntry,
    ) -> Result<Self, StartError> {
        let mut jobs = JobStore::open(&places)?;
        let audit = Audit::open(&places.audit())?;
        let (notifier, threads) = Notifier::new(&settings.notify, &places)?;
        let cameras = Cameras::start(&settings.cameras, robots, SnapshotStore::new(&places))?;
        jobs.wakers = notifier.wakers();
        let jobs = Arc::new(Mutex::new(jobs));
        threads.start(&jobs);
        let shared = Arc::new(ServiceContext {
            job_writer: jobs,
            job_reader: Mutex::new(JobStore::open_to_read(&places)?),
            audit,
            notifier,
            cameras,
            previews: Mutex::default(),
            queue: QueueStore::new(&places),
            library: LibraryStore::new(&places),
            changes: watch::Sender::new(0),
        });
        let robots = robots
            .iter()
            .map(|(name, entry)| (name.clone(), RobotWorker::start(name, entry, &places, Arc::clone(&shared))))
            .collect();
        Ok(Self { places, robots, shared, addresses: OnceLock::new() })
    }

    /// Returns the paths of the service's files.
    pub fn places(&self) -> &ServicePaths {
        &self.places
    }

    pub(super) fn robot(&self, name: &str) -> Option<&Arc<RobotWorker>> {
        self.robots.get(name)
    }

    /// Returns the job with this identifier. `None` if it does not exist or cannot be read.
    pub(super) fn job(&self, id: &str) -> Option<Job> {
        self.shared.jobs_to_read().get(id).ok().flatten()
    }
}
