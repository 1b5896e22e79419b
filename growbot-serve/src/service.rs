//! The service: its robots with their threads, and the state that all connections share.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

use growbot_client::status::RobotStatus;
use growbot_client::stop_signal::Permit;
use growbot_remote::api::{Job, PageUrls};
use tokio::sync::watch;

use super::audit::Audit;
use super::config::{NotifyEntry, RobotEntry};
use super::job_store::{JobStore, JobStoreError};
use super::notifier::{Notifier, NotifyError};
use super::paths::ServicePaths;
use super::problem::Problem;
use super::robot_worker::RobotWorker;
use super::service_context::ServiceContext;
use crate::watch::heartbeat::OrderAge;

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
}

/// Permits for an order to each robot, issued when the head of an HTTP request arrived. A later stop of a robot voids
/// its permit, also while the body of the request is still being received.
#[derive(Debug, Clone)]
pub struct ArrivalPermits {
    pub(super) permits: BTreeMap<String, Permit>,
    /// Result of the check of the order's age when the request arrived.
    pub(super) age: OrderAge,
}

impl ArrivalPermits {
    /// Replaces the result of the check of the order's age.
    pub(super) fn with_age(self, age: OrderAge) -> Self {
        Self { age, ..self }
    }

    /// Returns the permit for this robot without a check of the order's age: for orders that stop, pause or cool down
    /// the robot.
    pub(super) fn of(&self, robot: &str) -> Result<&Permit, Problem> {
        self.permits.get(robot).ok_or_else(|| Problem::not_found("robot", robot))
    }

    /// Returns the permit for this robot, or an error if the order is too old: for all orders that do not stop, pause
    /// or cool down the robot.
    pub(super) fn recent(&self, robot: &str) -> Result<&Permit, Problem> {
        self.age.check().map_err(Problem::conflict)?;
        self.of(robot)
    }
}

impl Service {
    /// Opens the list of jobs, and starts a thread for each robot and for each channel of notices.
    ///
    /// # Errors
    /// [`StartError`] if the directory or the database cannot be used, or if the settings of notifications are invalid.
    pub fn start(
        places: ServicePaths,
        robots: &BTreeMap<String, RobotEntry>,
        receivers: &NotifyEntry,
    ) -> Result<Self, StartError> {
        let mut jobs = JobStore::open(&places)?;
        let audit = Audit::open(&places.audit())?;
        let (notifier, threads) = Notifier::new(receivers, &places)?;
        jobs.wakers = notifier.wakers();
        let jobs = Arc::new(Mutex::new(jobs));
        threads.start(&jobs);
        let shared = Arc::new(ServiceContext {
            job_writer: jobs,
            job_reader: Mutex::new(JobStore::open_to_read(&places)?),
            audit,
            notifier,
            previews: Mutex::default(),
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

    /// Returns the status of all robots, sorted by the names of the robots.
    pub fn robots(&self) -> Vec<RobotStatus> {
        self.robots.values().map(|robot| robot.status()).collect()
    }

    /// Returns a permit for each robot, for a command that arrives now.
    pub(super) fn permits(&self) -> ArrivalPermits {
        let permits = self.robots.iter().map(|(name, robot)| (name.clone(), robot.signal().permit())).collect();
        ArrivalPermits { permits, age: OrderAge::default() }
    }

    pub(super) fn robot(&self, name: &str) -> Option<&Arc<RobotWorker>> {
        self.robots.get(name)
    }

    /// Returns the job with this identifier. `None` if it does not exist or cannot be read.
    pub(super) fn job(&self, id: &str) -> Option<Job> {
        self.shared.jobs_to_read().get(id).ok().flatten()
    }
}
