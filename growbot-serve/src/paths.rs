//! Paths of the service's files and of its socket.

use std::fs;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;

use growbot_plan::ownership::{self, OwnershipError, Protection, check_private};
use growbot_remote::socket::{self, SOCKET};

/// Directories of the service: one for its stored state, one for its socket. Only the user can access them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServicePaths {
    state: PathBuf,
    runtime: PathBuf,
}

impl ServicePaths {
    /// Returns the default directories. `None` if neither `$XDG_STATE_HOME` nor `$HOME` is set.
    pub fn for_user() -> Option<Self> {
        Some(Self { state: socket::state_dir()?, runtime: socket::runtime_dir()? })
    }

    /// Returns paths that are all in this directory.
    pub fn in_dir(directory: PathBuf) -> Self {
        Self { runtime: directory.clone(), state: directory }
    }

    /// Creates the missing directories, with access for the user only.
    ///
    /// # Errors
    /// A directory cannot be created.
    pub fn create(&self) -> io::Result<()> {
        for directory in self.directories() {
            fs::DirBuilder::new().recursive(true).mode(0o700).create(directory)?;
        }
        Ok(())
    }

    /// Checks that no other user can access, move or replace the directories and the files of the service.
    ///
    /// # Errors
    /// [`OwnershipError`] with the first file or directory that others can access.
    pub fn check(&self) -> Result<(), OwnershipError> {
        for directory in self.directories() {
            check_private(&directory)?;
        }
        let files = fs::read_dir(&self.state).into_iter().flatten().flatten();
        { files }.try_for_each(|file| ownership::check_one(&file.path(), Protection::Access))
    }

    fn directories(&self) -> [PathBuf; 8] {
        let [runtime, state] = [&self.runtime, &self.state].map(PathBuf::clone);
        [runtime, state, self.logs(), self.scenes(), self.stops(), self.queues(), self.library(), self.snapshots()]
    }

    /// Returns the directory of the stored state.
    pub fn state_dir(&self) -> &PathBuf {
        &self.state
    }

    /// Returns the directory of all jobs' run logs.
    pub fn logs(&self) -> PathBuf {
        self.state.join("jobs")
    }

    /// Returns the directory of the stored scenes.
    pub fn scenes(&self) -> PathBuf {
        self.state.join("scenes")
    }

    /// Returns the directory with the files of stops that no board has confirmed yet, and of pauses that a board may
    /// not have received.
    pub fn stops(&self) -> PathBuf {
        self.state.join("stops")
    }

    /// Returns the directory with the queue of each robot.
    pub fn queues(&self) -> PathBuf {
        self.state.join("queues")
    }

    /// Returns the directory of the library's entries.
    pub fn library(&self) -> PathBuf {
        self.state.join("library")
    }

    /// Returns the directory with the pictures of the layers of each job.
    pub fn snapshots(&self) -> PathBuf {
        self.state.join("snapshots")
    }

    /// Returns the path of the SQLite database with the list of jobs.
    pub fn database(&self) -> PathBuf {
        self.state.join("jobs.sqlite")
    }

    /// Returns the path of the audit log, which records all commands.
    pub fn audit(&self) -> PathBuf {
        self.state.join("audit.jsonl")
    }

    /// Returns the path of the file with the pages' access tokens.
    pub fn tokens(&self) -> PathBuf {
        self.state.join("tokens")
    }

    /// Returns the path of the lock file that a running service holds.
    pub fn lock(&self) -> PathBuf {
        self.state.join("lock")
    }

    /// Returns the path of the file with the webhook's secret, with which receivers check the sender of a notice.
    pub fn webhook_secret(&self) -> PathBuf {
        self.state.join("webhook-secret")
    }

    /// Returns the path of the Unix socket on which growbot's commands reach the service.
    pub fn socket(&self) -> PathBuf {
        self.runtime.join(SOCKET)
    }
}
