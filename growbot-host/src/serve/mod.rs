//! The service: one process that owns robots, and whom programs and pages ask.
//!
//! - [`Service`]: the robots, the jobs, and what has changed;
//! - [`config`]: which robots there are; `robot`: one of them, with the thread that owns its board; `growing`: a job on
//!   its board;
//! - [`jobs`]: all jobs, in a database that can be rebuilt from their run logs; `audit`: who has ordered what;
//! - [`api`]: HTTP; [`server`]: on the loopback interface, behind a token, and on a socket of the user's;
//! - [`caller`]: the other end of that socket.

pub mod api;
mod audit;
pub mod caller;
pub mod config;
mod events;
mod growing;
pub mod jobs;
mod places;
mod problem;
mod robot;
pub mod server;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use self::audit::Audit;
use self::config::RobotEntry;
pub use self::jobs::JobsError;
use self::jobs::{Job, Jobs};
pub use self::places::Places;
use self::robot::Keeper;
pub use self::robot::{RobotState, RobotView};

/// Who owns the robots of this user, and what they do.
pub struct Service {
    places: Places,
    robots: BTreeMap<String, Arc<Keeper>>,
    shared: Arc<Shared>,
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
    audit: Audit,
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

    /// Has all who listen look anew.
    fn changed(&self) {
        self.changes.send_modify(|changes| *changes = changes.wrapping_add(1));
    }
}

impl Service {
    /// Opens the jobs, and has a thread own each robot.
    ///
    /// # Errors
    /// [`JobsError`]: the directory or the database cannot be used.
    pub fn start(places: Places, robots: &BTreeMap<String, RobotEntry>) -> Result<Self, JobsError> {
        let jobs = Jobs::open(&places)?;
        let audit = Audit::open(&places.audit())?;
        let shared = Arc::new(Shared {
            jobs: Mutex::new(jobs),
            audit,
            previews: Mutex::default(),
            changes: watch::Sender::new(0),
        });
        let robots = robots
            .iter()
            .map(|(name, entry)| (name.clone(), Keeper::start(name, entry, Arc::clone(&shared))))
            .collect();
        Ok(Self { places, robots, shared })
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
        self.shared.jobs().get(id).ok().flatten()
    }
}
