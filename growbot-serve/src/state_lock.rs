//! Lock of the service's data folder. It prevents two services from using the same folder.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::PathBuf;
use std::process;

use growbot_plan::run_log::utc_now;
use growbot_plan::sanitize::one_line;
use rustix::fs::{FlockOperation, flock};
use rustix::process::geteuid;

use super::paths::ServicePaths;

/// Maximum length of the description of the lock's holder in an error message, characters.
const MAX_HOLDER: usize = 200;

/// The held lock of the data folder. It is released when this value is dropped or the process ends. Programs that the
/// service starts do not inherit it.
#[derive(Debug)]
pub struct StateLock(#[expect(dead_code, reason = "it is held")] File);

/// Errors of locking the data folder.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another service uses the folder.
    #[error("this user already runs a service with the data folder {folder} ({holder}): end that process first",
        folder = .folder.display())]
    Held {
        /// The data folder.
        folder: PathBuf,
        /// Description of the process that holds the lock.
        holder: String,
    },
    /// The lock's file cannot be used.
    #[error("cannot lock {path} ({error}): the service needs a writable folder of its own", path = .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
}

impl StateLock {
    /// Locks the data folder for this process, and writes a description of this process into the lock's file.
    ///
    /// # Errors
    /// [`LockError`].
    pub fn acquire(places: &ServicePaths) -> Result<Self, LockError> {
        let path = places.lock();
        let failed = |error| LockError::File { path: path.clone(), error };
        let mut file =
            File::options().create(true).truncate(false).read(true).write(true).open(&path).map_err(failed)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                let text = fs::read_to_string(&path).unwrap_or_default();
                let holder: String = one_line(&text).trim().chars().take(MAX_HOLDER).collect();
                let holder = if holder.is_empty() { "a process that is starting".to_owned() } else { holder };
                return Err(LockError::Held { folder: places.state_dir().clone(), holder });
            }
            Err(error) => return Err(failed(error.into())),
        }
        file.set_len(0).map_err(failed)?;
        let user = geteuid().as_raw();
        writeln!(file, "process {} of user {user}, since {}", process::id(), utc_now()).map_err(failed)?;
        Ok(Self(file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_data_folder_has_one_service() {
        let directory = tempfile::tempdir().unwrap();
        let places = ServicePaths::in_dir(directory.path().to_path_buf());
        let lock = StateLock::acquire(&places).unwrap();
        let refused = StateLock::acquire(&places).unwrap_err().to_string();
        let holder = format!("(process {} of user {}, since ", process::id(), geteuid().as_raw());
        assert!(refused.contains("already runs a service") && refused.contains(&holder), "{refused}");
        drop(lock);
        // A killed service leaves the file behind, but not the lock.
        assert!(places.lock().exists());
        StateLock::acquire(&places).unwrap();
    }
}
