//! Writing results: to standard output, whose reader may go away, and to files, which are whole or not there.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Says something on standard error. Whoever listened there may have gone; that is no reason to leave a robot alone.
#[macro_export]
macro_rules! tell {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}

/// Why a result could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Whoever read standard output has stopped, as `head` does. Not worth a message.
    #[error("standard output was closed by its reader")]
    Closed,
    /// Standard output cannot be written, say because a disk is full.
    #[error("cannot write to standard output: {0}")]
    Stdout(io::Error),
    /// The directory for a file does not exist.
    #[error("cannot write {file}: there is no directory {directory}; create it, or choose another place")]
    NoDirectory {
        /// The file.
        file: String,
        /// The directory that is not there.
        directory: String,
    },
    /// The file cannot be written.
    #[error("cannot write {file}: {error}")]
    File {
        /// The file.
        file: String,
        /// What the system says.
        error: io::Error,
    },
}

impl From<io::Error> for OutputError {
    /// A failure on standard output.
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe { Self::Closed } else { Self::Stdout(error) }
    }
}

/// Writes to standard output and flushes it, so that a reader at the other end of a pipe has the answer at once and
/// that a failure is noticed.
///
/// # Errors
/// [`OutputError::Closed`] or [`OutputError::Stdout`].
pub fn print(text: &str) -> Result<(), OutputError> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()?;
    Ok(())
}

/// Writes a file beside its place and renames it there, so that nobody ever sees half of it and a failure leaves what
/// was there before. Symbolic links are followed; a device or a named pipe is written to, not replaced.
///
/// # Errors
/// [`OutputError::NoDirectory`] or [`OutputError::File`].
pub fn replace_file(path: &Path, contents: &[u8]) -> Result<(), OutputError> {
    let failed = |error| OutputError::File { file: path.display().to_string(), error };
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&target).ok();
    match &existing {
        Some(existing) if existing.is_dir() => return Err(failed(io::ErrorKind::IsADirectory.into())),
        Some(existing) if !existing.is_file() => {
            return OpenOptions::new()
                .write(true)
                .open(&target)
                .and_then(|mut device| device.write_all(contents))
                .map_err(failed);
        }
        _ => {}
    }
    let directory = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let names_a_directory = path.to_string_lossy().ends_with(std::path::is_separator);
    if names_a_directory || !directory.is_dir() {
        let missing = if names_a_directory { path } else { directory };
        return Err(OutputError::NoDirectory {
            file: path.display().to_string(),
            directory: missing.display().to_string(),
        });
    }
    let (partial, mut file) = create_beside(&target).map_err(failed)?;
    let written = file.write_all(contents).and_then(|()| {
        if let Some(existing) = existing {
            file.set_permissions(existing.permissions())?;
        }
        // Without this a power cut after the rename could leave an empty file where a good one was.
        file.sync_all()?;
        drop(file);
        fs::rename(&partial, &target)
    });
    written.map_err(|error| {
        let _ = fs::remove_file(&partial);
        failed(error)
    })
}

/// A new file of a name of its own in the same directory: a rename works within a file system only.
fn create_beside(target: &Path) -> io::Result<(PathBuf, File)> {
    let mut attempt = 0;
    loop {
        let mut name = OsString::from(".");
        name.push(target.file_name().ok_or(io::ErrorKind::InvalidInput)?);
        name.push(format!(".{}-{attempt}.partial", std::process::id()));
        let partial = target.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).open(&partial) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && attempt < 100 => attempt += 1,
            Err(error) => return Err(error),
            Ok(file) => return Ok((partial, file)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("plan.json");
        replace_file(&path, b"one").unwrap();
        replace_file(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(directory.path()), ["plan.json"]);
    }

    #[test]
    fn a_missing_directory_is_named_and_a_directory_is_not_replaced() {
        let directory = tempfile::tempdir().unwrap();
        let missing = directory.path().join("missing");
        let error = replace_file(&missing.join("plan.json"), b"x").unwrap_err();
        assert!(matches!(&error, OutputError::NoDirectory { directory, .. } if directory.ends_with("missing")));
        assert!(matches!(replace_file(directory.path(), b"x"), Err(OutputError::File { .. })));
        assert!(names(directory.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_written_to() {
        let directory = tempfile::tempdir().unwrap();
        let (file, link) = (directory.path().join("file"), directory.path().join("link"));
        fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        replace_file(&link, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());

        let null = directory.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        replace_file(&null, b"x").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
