//! Paths of the service's files and of its socket.

use std::env;
use std::fs;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;

/// Paths of the service's directories. Only the user can access them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServicePaths {
    state: PathBuf,
    runtime: PathBuf,
}

impl ServicePaths {
    /// Returns the default directories. The state is in `growbot/serve` in `$XDG_STATE_HOME` or `~/.local/state`. The
    /// socket is in `growbot` in `$XDG_RUNTIME_DIR`, or with the state if that is not set. `None` if neither
    /// `$XDG_STATE_HOME` nor `$HOME` is set.
    #[must_use]
    pub fn for_user() -> Option<Self> {
        let absolute = |key: &str| env::var_os(key).map(PathBuf::from).filter(|path| path.is_absolute());
        let state = absolute("XDG_STATE_HOME").or_else(|| Some(absolute("HOME")?.join(".local/state")))?;
        let state = state.join("growbot/serve");
        let runtime = absolute("XDG_RUNTIME_DIR").map_or_else(|| state.clone(), |runtime| runtime.join("growbot"));
        Some(Self { state, runtime })
    }

    /// Returns paths that are all in one directory.
    #[must_use]
    pub fn in_dir(directory: PathBuf) -> Self {
        Self { runtime: directory.clone(), state: directory }
    }

    /// Creates the directories.
    ///
    /// # Errors
    /// A directory cannot be created.
    pub fn create(&self) -> io::Result<()> {
        for directory in [&self.state, &self.runtime, &self.logs(), &self.scenes(), &self.stops()] {
            fs::DirBuilder::new().recursive(true).mode(0o700).create(directory)?;
        }
        Ok(())
    }

    /// Returns the directory of the stored state.
    #[must_use]
    pub fn state_dir(&self) -> &PathBuf {
        &self.state
    }

    /// Returns the directory of all jobs' run logs.
    #[must_use]
    pub fn logs(&self) -> PathBuf {
        self.state.join("jobs")
    }

    /// Returns the directory of the stored scenes.
    #[must_use]
    pub fn scenes(&self) -> PathBuf {
        self.state.join("scenes")
    }

    /// Returns the directory of the stops that no board has confirmed yet.
    #[must_use]
    pub fn stops(&self) -> PathBuf {
        self.state.join("stops")
    }

    /// Returns the path of the list of jobs.
    #[must_use]
    pub fn database(&self) -> PathBuf {
        self.state.join("jobs.sqlite")
    }

    /// Returns the path of the record of commands.
    #[must_use]
    pub fn audit(&self) -> PathBuf {
        self.state.join("audit.jsonl")
    }

    /// Returns the path of the tokens in the page's addresses.
    #[must_use]
    pub fn tokens(&self) -> PathBuf {
        self.state.join("tokens")
    }

    /// Returns the path of the webhook's secret, with which receivers check the sender of a notice.
    #[must_use]
    pub fn webhook_secret(&self) -> PathBuf {
        self.state.join("webhook-secret")
    }

    /// Returns the path of the socket that growbot's commands use.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.runtime.join("serve.sock")
    }
}
