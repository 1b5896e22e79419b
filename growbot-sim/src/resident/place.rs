//! Where a simulated robot keeps what it knows.

use std::env;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use growbot_core::robot::{LONGEST_ENCODED, Robot};
use rustix::fs::{FlockOperation, flock};

use super::ResidentError;

/// The longest path that a Unix socket can have, bytes.
const LONGEST_SOCKET_PATH: usize = 107;

/// The directory of a simulated robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    name: String,
    directory: PathBuf,
}

impl Place {
    /// The place of a robot of this name: a directory of its own in `$XDG_STATE_HOME/growbot/robots` or
    /// `~/.local/state/growbot/robots`; a name with a slash in it is the directory itself.
    ///
    /// # Errors
    /// [`ResidentError::NoHome`].
    pub fn of(name: &str) -> Result<Self, ResidentError> {
        let absolute = |key: &str| env::var_os(key).map(PathBuf::from).filter(|path| path.is_absolute());
        let directory = if name.contains('/') {
            PathBuf::from(name)
        } else {
            let state = absolute("XDG_STATE_HOME").or_else(|| Some(absolute("HOME")?.join(".local/state")));
            state.ok_or(ResidentError::NoHome)?.join("growbot/robots").join(name)
        };
        Ok(Self { name: name.to_owned(), directory })
    }

    /// The robot's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The directory.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.directory.join(name)
    }

    /// The socket of its line.
    pub(super) fn line(&self) -> Result<PathBuf, ResidentError> {
        let path = self.file("line");
        if path.as_os_str().len() > LONGEST_SOCKET_PATH {
            let error =
                io::Error::other(format!("a path of more than {LONGEST_SOCKET_PATH} bytes: choose a shorter one"));
            return Err(ResidentError::File { what: "listen at", path, error });
        }
        Ok(path)
    }

    /// Creates the directory, for this user alone.
    pub(super) fn create(&self) -> Result<(), ResidentError> {
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&self.directory);
        made.map_err(|error| self.failed("create", self.directory.clone(), error))
    }

    /// Holds the robot for this process, for as long as the file is open. None where another process plays it.
    pub(super) fn hold(&self) -> Result<Option<File>, ResidentError> {
        let path = self.file("lock");
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(|error| self.failed("open", path, error))?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(Some(file)),
            Err(_) => Ok(None),
        }
    }

    /// Whether a process plays it.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.directory.is_dir() && matches!(self.hold(), Ok(None))
    }

    /// The robot that lives here; none where nobody does yet.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn robot(&self) -> Result<Option<Robot>, ResidentError> {
        let path = self.file("robot");
        match fs::read(&path) {
            Ok(bytes) => match Robot::decode(&bytes) {
                Ok(robot) => Ok(Some(robot)),
                Err(error) => Err(self.failed("read", path, io::Error::other(error.to_string()))),
            },
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(self.failed("read", path, error)),
        }
    }

    /// Whether this robot may live here.
    ///
    /// # Errors
    /// [`ResidentError::OtherRobot`], or a process plays it already.
    pub fn check(&self, robot: &Robot) -> Result<(), ResidentError> {
        if self.is_on() {
            return Err(ResidentError::On(self.name.clone()));
        }
        self.robot()?.map_or(Ok(()), |known| self.is_the_same(&known, robot))
    }

    /// How many times as fast as real time its time passes; none where that is not known.
    #[must_use]
    pub fn pace(&self) -> Option<f64> {
        fs::read_to_string(self.file("pace")).ok()?.trim().parse().ok()
    }

    pub(super) fn set_pace(&self, pace: f64) -> Result<(), ResidentError> {
        self.write("pace", format!("{pace}\n").as_bytes())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), ResidentError> {
        let path = self.file(name);
        let written = growbot_client::files::replace_file(&path, bytes);
        written.map_err(|error| self.failed("write", path, io::Error::other(error.to_string())))
    }

    fn is_the_same(&self, known: &Robot, asked: &Robot) -> Result<(), ResidentError> {
        if known.hash() == asked.hash() {
            return Ok(());
        }
        Err(ResidentError::OtherRobot {
            name: self.name.clone(),
            is: format!("{} ({:016x})", known.name(), known.hash()),
            asked: format!("{} ({:016x})", asked.name(), asked.hash()),
            directory: self.directory.display().to_string(),
        })
    }

    /// Has this robot live here, unless another one does.
    pub(super) fn settle(&self, robot: &Robot) -> Result<(), ResidentError> {
        match self.robot()? {
            Some(known) => self.is_the_same(&known, robot),
            None => self.become_another(robot),
        }
    }

    /// Has this robot live here, whoever did before.
    pub(super) fn become_another(&self, robot: &Robot) -> Result<(), ResidentError> {
        let mut buffer = [0; LONGEST_ENCODED];
        self.write("robot", robot.encode(&mut buffer).unwrap_or_default())
    }

    pub(super) fn failed(&self, what: &'static str, path: PathBuf, error: io::Error) -> ResidentError {
        ResidentError::File { what, path, error }
    }
}
