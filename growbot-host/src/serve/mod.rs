//! The service: one process that owns robots, and whom programs and pages ask.
//!
//! - [`Service`]: the robots, the jobs, and what has changed;
//! - [`config`]: which robots there are; `robot`: one of them, with the thread that owns its board; `growing`: a job on
//!   its board;
//! - [`jobs`]: all jobs, in a database that can be rebuilt from their run logs; `audit`: who has ordered what;
//! - [`api`]: HTTP, with `streams` of events; `document`: what its OpenAPI document adds; [`server`]: on the loopback
//!   interface, behind a token, and on a socket of the user's; `limits`: what clients may take of it;
//! - [`notices`]: what those are told who do not look; `notify`: by whom;
//! - [`caller`]: the other end of that socket.

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

/// Who owns the robots of this user, and what they do.
pub struct Service {
    places: Places,
    robots: BTreeMap<String, Arc<Keeper>>,
    shared: Arc<Shared>,
    /// Where its page is, once it is served.
    addresses: OnceLock<Addresses>,
}

/// Why the service cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Its files.
    #[error(transparent)]
    Jobs(#[from] JobsError),
    /// Whom it is to tell.
    #[error(transparent)]
    Notify(#[from] NotifyError),
}

/// Pages of plans that are kept to be looked at.
const MAX_PREVIEWS: usize = 8;

/// The pages of the latest plans.
#[derive(Default)]
struct Previews {
    latest: u64,
    pages: VecDeque<(u64, String)>,
}

/// What the threads of all robots and the server share.
struct Shared {
    jobs: Mutex<Jobs>,
    /// The same to look at: the server does not wait until a robot's thread has written to the disk.
    jobs_to_read: Mutex<Jobs>,
    audit: Audit,
    notify: Notify,
    previews: Mutex<Previews>,
    /// Counts what has changed; each open connection listens.
    changes: watch::Sender<u64>,
}

impl Shared {
    /// Keeps the page of a plan for a while; gives its number.
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

    /// Has all who listen look anew.
    fn changed(&self) {
        self.changes.send_modify(|changes| *changes = changes.wrapping_add(1));
    }
}

impl Service {
    /// Opens the jobs, and has a thread own each robot.
    ///
    /// # Errors
    /// [`StartError`]: the directory or the database cannot be used, or what is configured cannot be done.
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

    /// Where the service keeps what it knows.
    #[must_use]
    pub fn places(&self) -> &Places {
        &self.places
    }

    /// All robots, by name.
    #[must_use]
    pub fn robots(&self) -> Vec<RobotView> {
        self.robots.values().map(|robot| robot.view()).collect()
    }

    fn robot(&self, name: &str) -> Option<&Arc<Keeper>> {
        self.robots.get(name)
    }

    /// A job.
    fn job(&self, id: &str) -> Option<Job> {
        self.shared.jobs_to_read().get(id).ok().flatten()
    }
}
