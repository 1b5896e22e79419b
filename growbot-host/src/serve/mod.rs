//! The service: one process that owns robots and handles the requests of programs and pages.
//!
//! - [`Service`] holds the robots, the jobs and a counter of changes.
//! - [`config`] describes the configured robots. `robot` is one robot, with the thread that owns its board. `growing`
//!   is a job on its board.
//! - [`jobs`] is a database of all jobs that can be rebuilt from their run logs. `audit` records all commands.
//! - [`api`] is the HTTP interface, with `streams` of events. `document` completes its OpenAPI document.
//! - [`server`] listens on the loopback interface, behind a token, and on a socket of the user. `limits` bounds the
//!   resources that clients can use.
//! - [`notices`] are notifications for users who do not watch a page. `notify` sends them.
//! - [`caller`] is the client of that socket.

pub mod api;
mod audit;
pub mod caller;
pub mod config;
mod document;
mod events;
mod growing;
pub mod jobs;
pub mod lending;
mod limits;
pub mod notices;
mod notify;
pub mod orders;
mod places;
mod problem;
mod robot;
mod scenes;
pub mod server;
mod streams;
#[cfg(test)]
mod tests;
pub mod wanted;

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use tokio::sync::watch;

use self::api::Addresses;
use self::audit::Audit;
use self::config::{NotifyEntry, RobotEntry};
pub use self::jobs::JobsError;
use self::jobs::{Job, Jobs};
use self::notify::Notify;
pub use self::notify::NotifyError;
pub use self::places::Places;
use self::robot::Keeper;
pub use self::robot::{RobotState, RobotView};

/// The robots of this user, with their jobs.
pub struct Service {
    places: Places,
    robots: BTreeMap<String, Arc<Keeper>>,
    shared: Arc<Shared>,
    /// Addresses of the service's page. They are set when the service is served.
    addresses: OnceLock<Addresses>,
}

/// Errors that prevent the start of the service.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The list of jobs or another file of the service cannot be used.
    #[error(transparent)]
    Jobs(#[from] JobsError),
    /// The settings of notifications cannot be used.
    #[error(transparent)]
    Notify(#[from] NotifyError),
}

/// Maximum number of previews (pages of plans) that are kept.
const MAX_PREVIEWS: usize = 8;

/// Pages of the latest plans.
#[derive(Default)]
struct Previews {
    latest: u64,
    pages: VecDeque<(u64, String)>,
}

/// State that the threads of all robots and the server share.
struct Shared {
    jobs: Mutex<Jobs>,
    /// A second, read-only connection to the list of jobs. With it the server does not wait for a robot's thread that
    /// writes to the disk.
    jobs_to_read: Mutex<Jobs>,
    audit: Audit,
    notify: Notify,
    previews: Mutex<Previews>,
    /// Counter of changes. Each open connection waits for it to change.
    changes: watch::Sender<u64>,
}

impl Shared {
    /// Keeps the page of a plan, in place of the oldest one if there are too many. Returns the page's number.
    fn keep_preview(&self, page: String) -> u64 {
        let mut previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.latest += 1;
        let number = previews.latest;
        previews.pages.push_back((number, page));
        if previews.pages.len() > MAX_PREVIEWS {
            previews.pages.pop_front();
        }
        number
    }

    fn preview(&self, number: u64) -> Option<String> {
        let previews = self.previews.lock().unwrap_or_else(PoisonError::into_inner);
        previews.pages.iter().find(|(of, _)| *of == number).map(|(_, page)| page.clone())
    }

    fn jobs(&self) -> MutexGuard<'_, Jobs> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn jobs_to_read(&self) -> MutexGuard<'_, Jobs> {
        self.jobs_to_read.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wakes all connections that wait for changes.
    fn changed(&self) {
        self.changes.send_modify(|changes| *changes = changes.wrapping_add(1));
    }
}

impl Service {
    /// Opens the list of jobs and starts a thread for each robot.
    ///
    /// # Errors
    /// [`StartError`] if the directory or the database cannot be used, or if the settings of notifications are invalid.
    pub fn start(
        places: Places,
        robots: &BTreeMap<String, RobotEntry>,
        notify: &NotifyEntry,
    ) -> Result<Self, StartError> {
        let jobs = Jobs::open(&places)?;
        let audit = Audit::open(&places.audit())?;
        let (notify, tellers) = Notify::new(notify, &places)?;
        let shared = Arc::new(Shared {
            jobs: Mutex::new(jobs),
            jobs_to_read: Mutex::new(Jobs::open_to_read(&places)?),
            audit,
            notify,
            previews: Mutex::default(),
            changes: watch::Sender::new(0),
        });
        tellers.start(&shared);
        let robots = robots
            .iter()
            .map(|(name, entry)| (name.clone(), Keeper::start(name, entry, Arc::clone(&shared))))
            .collect();
        Ok(Self { places, robots, shared, addresses: OnceLock::new() })
    }

    /// Returns the paths of the service's files.
    #[must_use]
    pub fn places(&self) -> &Places {
        &self.places
    }

    /// Returns all robots, sorted by name.
    #[must_use]
    pub fn robots(&self) -> Vec<RobotView> {
        self.robots.values().map(|robot| robot.view()).collect()
    }

    fn robot(&self, name: &str) -> Option<&Arc<Keeper>> {
        self.robots.get(name)
    }

    /// Returns the job with this identifier. `None` if it does not exist or cannot be read.
    fn job(&self, id: &str) -> Option<Job> {
        self.shared.jobs_to_read().get(id).ok().flatten()
    }
}
