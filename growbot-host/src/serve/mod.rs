//! The service: one process that owns robots and handles the requests of programs and pages.
//!
//! - [`Service`] holds the robots, the jobs and a counter of changes.
//! - [`config`] describes the configured robots. `robot_worker` is one robot, with the thread that owns its board.
//!   `connector` connects to a board, `robot_stops` raises and delivers the stops of a robot, and `robot_alerts` sends
//!   the notices about it. `stopper` sends emergency stops, and `stop_file` stores an unconfirmed stop on disk.
//!   `job_run` carries out a job on the board.
//! - `job_store` is a database of all jobs that can be rebuilt from their run logs. `job_updates` are the changes of
//!   the database, and `job_history` corrects it by the run logs and the status of the boards. `audit` records all
//!   commands.
//! - [`api`] is the HTTP interface: `job_routes`, `plan_routes`, `command_routes` and `event_stream`s. `openapi`
//!   completes its OpenAPI document.
//! - `page` has the files of the page, and `command_socket` receives its commands.
//! - [`server`] listens on the loopback interface, behind `tokens`, and on a socket of the user. `page_access` checks
//!   the tokens, and [`page_listener`] takes a socket from the service manager. `connections` bounds the connections
//!   and `limits` the other resources that clients of each role can use. `workers` is the thread on which requests
//!   other than commands are handled. `state_lock` prevents a second service from using the same files.
//! - [`notification`] are notifications for users who do not watch a page. `notifier` sends them.
//! - [`client`] is the client of the user's socket.

pub mod api;
mod audit;
pub mod client;
mod command_routes;
mod command_socket;
pub mod commands;
pub mod config;
mod connections;
mod connector;
mod event_routes;
mod event_stream;
#[cfg(test)]
mod fake_board;
pub mod grow_request;
#[cfg(test)]
mod history_tests;
mod job_history;
mod job_routes;
mod job_run;
pub mod job_store;
mod job_updates;
mod json_body;
mod limits;
pub mod notification;
mod notifier;
mod openapi;
mod page;
mod page_access;
pub mod page_listener;
mod paths;
mod plan_routes;
pub mod port_lease;
mod problem;
mod robot_alerts;
mod robot_stops;
mod robot_worker;
mod scene_store;
mod secret_file;
pub mod server;
mod server_error;
mod state_lock;
mod stop_file;
#[cfg(test)]
mod stop_model;
#[cfg(test)]
mod stop_tests;
mod stopper;
mod tokens;
mod workers;

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use axum::body::Bytes;
use growbot_client::stop_signal::Permit;
use tokio::sync::watch;

use self::api::PageUrls;
use self::audit::Audit;
use self::config::{NotifyEntry, RobotEntry};
pub use self::job_store::JobStoreError;
use self::job_store::{Job, JobStore};
use self::notifier::Notifier;
pub use self::notifier::NotifyError;
pub use self::paths::ServicePaths;
use self::problem::Problem;
use self::robot_worker::RobotWorker;
pub use self::robot_worker::{RobotState, RobotStatus};
use crate::watch::heartbeat::OrderAge;

/// The service of this user: its robots with their threads, their jobs, and the state that all connections share.
pub struct Service {
    places: ServicePaths,
    robots: BTreeMap<String, Arc<RobotWorker>>,
    shared: Arc<ServiceContext>,
    /// URLs of the service's page. `Server::serve` sets them.
    addresses: OnceLock<PageUrls>,
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
    permits: BTreeMap<String, Permit>,
    /// Result of the check of the order's age when the request arrived.
    age: OrderAge,
}

impl ArrivalPermits {
    /// Replaces the result of the check of the order's age.
    fn with_age(self, age: OrderAge) -> Self {
        Self { age, ..self }
    }

    /// Returns the permit for this robot without a check of the order's age: for orders that stop, pause or cool down
    /// the robot.
    fn of(&self, robot: &str) -> Result<&Permit, Problem> {
        self.permits.get(robot).ok_or_else(|| Problem::not_found("robot", robot))
    }

    /// Returns the permit for this robot, or an error if the order is too old: for all orders that do not stop, pause
    /// or cool down the robot.
    fn recent(&self, robot: &str) -> Result<&Permit, Problem> {
        self.age.check().map_err(Problem::conflict)?;
        self.of(robot)
    }
}

/// Maximum number of previews (pages of plans) that are kept.
const MAX_PREVIEWS: usize = 8;

/// HTML pages of the latest plans, with their numbers.
#[derive(Default)]
struct Previews {
    latest: u64,
    pages: VecDeque<(u64, Bytes)>,
}

/// State that the threads of all robots and the server share.
struct ServiceContext {
    job_writer: Mutex<JobStore>,
    /// A second, read-only connection to the list of jobs. With it the server does not wait for a robot's thread that
    /// writes to the disk.
    job_reader: Mutex<JobStore>,
    audit: Audit,
    notifier: Notifier,
    previews: Mutex<Previews>,
    /// Counter of changes of the service's state. Each open stream of events waits until the counter changes.
    changes: watch::Sender<u64>,
}

impl ServiceContext {
    /// Keeps the page of a plan. Drops the oldest page if there are more than [`MAX_PREVIEWS`] pages. Returns the
    /// number of the new page.
    fn keep_preview(&self, page: Bytes) -> u64 {
        let mut previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.latest += 1;
        let number = previews.latest;
        previews.pages.push_back((number, page));
        if previews.pages.len() > MAX_PREVIEWS {
            previews.pages.pop_front();
        }
        number
    }

    fn preview(&self, number: u64) -> Option<Bytes> {
        let previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.pages.iter().find(|(of, _)| *of == number).map(|(_, page)| page.clone())
    }

    fn jobs(&self) -> MutexGuard<'_, JobStore> {
        self.job_writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn jobs_to_read(&self) -> MutexGuard<'_, JobStore> {
        self.job_reader.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Increments the counter of changes, which wakes all streams of events that wait for a change.
    fn signal_change(&self) {
        self.changes.send_modify(|changes| *changes = changes.wrapping_add(1));
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
        let shared = Arc::new(ServiceContext {
            job_writer: Mutex::new(jobs),
            job_reader: Mutex::new(JobStore::open_to_read(&places)?),
            audit,
            notifier,
            previews: Mutex::default(),
            changes: watch::Sender::new(0),
        });
        threads.start(&shared);
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
    fn permits(&self) -> ArrivalPermits {
        let permits = self.robots.iter().map(|(name, robot)| (name.clone(), robot.signal().permit())).collect();
        ArrivalPermits { permits, age: OrderAge::default() }
    }

    fn robot(&self, name: &str) -> Option<&Arc<RobotWorker>> {
        self.robots.get(name)
    }

    /// Returns the job with this identifier. `None` if it does not exist or cannot be read.
    fn job(&self, id: &str) -> Option<Job> {
        self.shared.jobs_to_read().get(id).ok().flatten()
    }
}
