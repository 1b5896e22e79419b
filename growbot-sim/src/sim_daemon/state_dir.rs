//! The directory with the state of a simulated robot.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use growbot_core::robot::{MAX_ENCODED_LEN, Robot};
use growbot_plan::user_dirs;
use rustix::fs::{FlockOperation, flock};

use super::SimDaemonError;

/// Maximum length of the path of a Unix socket, bytes.
const LONGEST_SOCKET_PATH: usize = 107;

/// The directory with the state of a simulated robot, such as its flash, and with the socket to which programs connect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateDir {
    name: String,
    directory: PathBuf,
}

impl StateDir {
    /// Returns the directory of the simulated robot with this name: `$XDG_STATE_HOME/growbot/robots/NAME` or
    /// `~/.local/state/growbot/robots/NAME`. A name that contains a slash is the path of the directory itself.
    ///
    /// # Errors
    /// [`SimDaemonError::NoHome`].
    pub fn of(name: &str) -> Result<Self, SimDaemonError> {
        let directory = if name.contains('/') {
            PathBuf::from(name)
        } else {
            user_dirs::state_dir().ok_or(SimDaemonError::NoHome)?.join("robots").join(name)
        };
        Ok(Self { name: name.to_owned(), directory })
    }

    /// Returns the names of the simulated robots that are on, in alphabetical order. Those whose name is a path are not
    /// among them.
    pub fn names_of_running() -> Vec<String> {
        let robots = user_dirs::state_dir().and_then(|state| fs::read_dir(state.join("robots")).ok());
        let names = robots.into_iter().flatten().flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let mut on: Vec<String> = names.filter(|name| Self::of(name).is_ok_and(|place| place.is_on())).collect();
        on.sort();
        on
    }

    /// Returns the name of the robot.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.directory.join(name)
    }

    /// Returns the path of the Unix socket to which programs connect.
    pub(super) fn socket_path(&self) -> Result<PathBuf, SimDaemonError> {
        let path = self.file("line");
        if path.as_os_str().len() > LONGEST_SOCKET_PATH {
            let error =
                io::Error::other(format!("a path of more than {LONGEST_SOCKET_PATH} bytes: choose a shorter one"));
            return Err(SimDaemonError::File { what: "listen at", path, error });
        }
        Ok(path)
    }

    /// Creates the directory, with access for this user only.
    ///
    /// # Errors
    /// [`SimDaemonError::File`].
    pub fn create(&self) -> Result<(), SimDaemonError> {
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&self.directory);
        made.map_err(|error| self.failed("create", self.directory.clone(), error))
    }

    /// Locks the robot for this process until the returned file is closed. Returns `None` if another process runs the
    /// robot.
    pub(super) fn hold(&self) -> Result<Option<File>, SimDaemonError> {
        let path = self.file("lock");
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(|error| self.failed("open", path, error))?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(Some(file)),
            Err(_) => Ok(None),
        }
    }

    /// Returns true if a process runs the robot.
    pub fn is_on(&self) -> bool {
        self.directory.is_dir() && matches!(self.hold(), Ok(None))
    }

    /// Returns the robot that the directory belongs to. Returns `None` if it does not belong to a robot yet.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn robot(&self) -> Result<Option<Robot>, SimDaemonError> {
        let path = self.file("robot");
        match fs::read(&path) {
            Ok(bytes) => match Robot::decode(&bytes) {
                Ok(robot) => Ok(Some(robot)),
                Err(error) => Err(self.failed("read", path, io::Error::other(error))),
            },
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(self.failed("read", path, error)),
        }
    }

    /// Checks that this robot may use the directory.
    ///
    /// # Errors
    /// [`SimDaemonError::OtherRobot`], or [`SimDaemonError::AlreadyRunning`] if a process already runs the robot.
    pub fn check(&self, robot: &Robot) -> Result<(), SimDaemonError> {
        if self.is_on() {
            return Err(SimDaemonError::AlreadyRunning(self.name.clone()));
        }
        self.robot()?.map_or(Ok(()), |known| self.check_same_robot(&known, robot))
    }

    /// Returns the pace of the robot's time, as a multiple of real time. Returns `None` if the pace cannot be read.
    pub fn pace(&self) -> Option<f64> {
        fs::read_to_string(self.file("pace")).ok()?.trim().parse().ok()
    }

    pub(super) fn set_pace(&self, pace: f64) -> Result<(), SimDaemonError> {
        self.write("pace", format!("{pace}\n").as_bytes())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), SimDaemonError> {
        let path = self.file(name);
        let written = growbot_plan::atomic_file::write_atomic(&path, bytes);
        written.map_err(|error| self.failed("write", path, io::Error::other(error)))
    }

    fn check_same_robot(&self, known: &Robot, other: &Robot) -> Result<(), SimDaemonError> {
        if known.hash() == other.hash() {
            return Ok(());
        }
        Err(SimDaemonError::OtherRobot {
            name: self.name.clone(),
            stored: format!("{} ({:016x})", known.name(), known.hash()),
            requested: format!("{} ({:016x})", other.name(), other.hash()),
            directory: self.directory.display().to_string(),
        })
    }

    /// Assigns the directory to this robot, unless it belongs to another one.
    pub(super) fn claim(&self, robot: &Robot) -> Result<(), SimDaemonError> {
        match self.robot()? {
            Some(known) => self.check_same_robot(&known, robot),
            None => self.store_robot(robot),
        }
    }

    /// Assigns the directory to this robot, even if it belonged to another one.
    pub(super) fn store_robot(&self, robot: &Robot) -> Result<(), SimDaemonError> {
        let mut buffer = [0; MAX_ENCODED_LEN];
        self.write("robot", robot.encode(&mut buffer).unwrap_or_default())
    }

    pub(super) fn failed(&self, what: &'static str, path: PathBuf, error: io::Error) -> SimDaemonError {
        SimDaemonError::File { what, path, error }
    }
}
