//! Where the service keeps what it knows, and where it is found.

use std::env;
use std::fs;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;

/// The service's files: all of them are the user's alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Places {
    state: PathBuf,
    runtime: PathBuf,
}

impl Places {
    /// `growbot/serve` in `$XDG_STATE_HOME` or `~/.local/state` for what is kept, and in `$XDG_RUNTIME_DIR`, or else
    /// beside that, for the socket. None where neither is set.
    #[must_use]
    pub fn of_user() -> Option<Self> {
        let absolute = |key: &str| env::var_os(key).map(PathBuf::from).filter(|path| path.is_absolute());
        let state = absolute("XDG_STATE_HOME").or_else(|| Some(absolute("HOME")?.join(".local/state")))?;
        let state = state.join("growbot/serve");
        let runtime = absolute("XDG_RUNTIME_DIR").map_or_else(|| state.clone(), |runtime| runtime.join("growbot"));
        Some(Self { state, runtime })
    }

    /// All in one directory.
    #[must_use]
    pub fn within(directory: PathBuf) -> Self {
        Self { runtime: directory.clone(), state: directory }
    }

    /// Creates the directories.
    ///
    /// # Errors
    /// The system's.
    pub fn create(&self) -> io::Result<()> {
        for directory in [&self.state, &self.runtime, &self.logs(), &self.scenes()] {
            fs::DirBuilder::new().recursive(true).mode(0o700).create(directory)?;
        }
        Ok(())
    }

    /// The directory of what is kept.
    #[must_use]
    pub fn state(&self) -> &PathBuf {
        &self.state
    }

    /// The run logs of all jobs.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.state.join("jobs")
    }

    /// The scenes that were sent.
    #[must_use]
    pub fn scenes(&self) -> PathBuf {
        self.state.join("scenes")
    }

    /// The list of jobs.
    #[must_use]
    pub fn database(&self) -> PathBuf {
        self.state.join("jobs.sqlite")
    }

    /// The record of orders.
    #[must_use]
    pub fn audit(&self) -> PathBuf {
        self.state.join("orders.jsonl")
    }

    /// The secrets of the page's addresses.
    #[must_use]
    pub fn tokens(&self) -> PathBuf {
        self.state.join("tokens")
    }

    /// The secret by which receivers know that a notice is ours.
    #[must_use]
    pub fn webhook_secret(&self) -> PathBuf {
        self.state.join("webhook-secret")
    }

    /// The socket that commands use.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.runtime.join("serve.sock")
    }
}
