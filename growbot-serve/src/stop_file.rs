//! Files with the stop of a robot that its board has not confirmed, and with the pause that its board may not have
//! received. These files outlive the service.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use growbot_client::stop_signal::{StopLevel, StopSignal};
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::run_log::utc_now;
use serde::{Deserialize, Serialize};

use super::paths::ServicePaths;

/// Content of a [`StopFile`].
#[derive(Debug, Serialize, Deserialize)]
struct StoredStop {
    level: StopLevel,
    /// Time at which the file was written, RFC 3339, for people who read the file.
    time_utc: String,
}

/// File with the stop of a robot that its board has not confirmed. The file exists only while a stop is unconfirmed.
pub struct StopFile {
    path: PathBuf,
    /// Level of the stop in the file. `None` if the file does not exist. A thread holds the lock while it compares the
    /// level with the stop signal and writes the file.
    stored: Mutex<Option<StopLevel>>,
}

impl StopFile {
    /// Reads the stop that an earlier service has left. A file that cannot be read counts as an emergency stop, because
    /// the file exists only if a stop was ordered.
    pub fn open(places: &ServicePaths, robot: &str) -> (Self, Option<StopLevel>) {
        let path = places.stops().join(format!("{robot}.json"));
        let stored = match fs::read(&path) {
            Ok(bytes) => {
                Some(serde_json::from_slice(&bytes).map_or(StopLevel::EmergencyStop, |stored: StoredStop| stored.level))
            }
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => {
                log::warn!(
                    "cannot read {}, the file of the unconfirmed stop of robot {robot} ({error}): the service sends \
                     the emergency stop instead",
                    path.display()
                );
                Some(StopLevel::EmergencyStop)
            }
        };
        (Self { path, stored: Mutex::new(stored) }, stored)
    }

    /// Makes the file agree with the stop signal: stores a stop that is not confirmed, and removes a stop that is
    /// confirmed.
    pub fn sync(&self, signal: &StopSignal) {
        let mut stored = self.stored.lock().unwrap_or_else(PoisonError::into_inner);
        let level = signal.level();
        if level == *stored {
            return;
        }
        match self.write(level) {
            Ok(()) => *stored = level,
            Err(error) => log::warn!(
                "cannot write {} ({error}): if the service ends now, an unconfirmed stop is lost, or a confirmed stop \
                 is sent again; if the disk is full, free space",
                self.path.display()
            ),
        }
    }

    fn write(&self, level: Option<StopLevel>) -> io::Result<()> {
        let Some(level) = level else { return fs::remove_file(&self.path) };
        let text = serde_json::to_vec(&StoredStop { level, time_utc: utc_now() })?;
        write_atomic(&self.path, &text).map_err(io::Error::other)
    }
}

/// File that exists while a board may not have received an order to pause.
pub struct PauseFile {
    path: PathBuf,
    is_stored: Mutex<bool>,
}

impl PauseFile {
    /// Returns the pause file of a robot, and true if an earlier service has left the file.
    pub fn open(places: &ServicePaths, robot: &str) -> (Self, bool) {
        let path = places.stops().join(format!("{robot}.pause"));
        let is_stored = path.exists();
        (Self { path, is_stored: Mutex::new(is_stored) }, is_stored)
    }

    /// Creates the file if an order to pause is pending, otherwise removes it.
    pub fn set(&self, is_pending: bool) {
        let mut is_stored = self.is_stored.lock().unwrap_or_else(PoisonError::into_inner);
        if is_pending == *is_stored {
            return;
        }
        let changed = match is_pending {
            true => write_atomic(&self.path, utc_now().as_bytes()).map_err(io::Error::other),
            false => fs::remove_file(&self.path),
        };
        match changed {
            Ok(()) => *is_stored = is_pending,
            Err(error) => log::warn!(
                "cannot change {} ({error}): if the service ends now, an order to pause is lost or repeated; if the \
                 disk is full, free space",
                self.path.display()
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unconfirmed_stop_outlives_the_service_and_a_confirmed_one_does_not() {
        let directory = tempfile::tempdir().unwrap();
        let places = ServicePaths::in_dir(directory.path().to_path_buf());
        places.create().unwrap();
        let signal = StopSignal::default();
        let (file, left) = StopFile::open(&places, "lab");
        assert_eq!(left, None);
        let stop = signal.raise(StopLevel::Stop);
        file.sync(&signal);
        assert_eq!(StopFile::open(&places, "lab").1, Some(StopLevel::Stop));
        signal.confirm(stop);
        file.sync(&signal);
        assert_eq!(StopFile::open(&places, "lab").1, None);
        fs::write(places.stops().join("lab.json"), "{").unwrap();
        assert_eq!(StopFile::open(&places, "lab").1, Some(StopLevel::EmergencyStop), "a damaged file");
    }
}
