//! Reading the texts that people hand over: whole, bounded, from a file or from standard input (`-`).

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// No plan and no robot description is longer than this, bytes (1 MiB).
pub const LONGEST_TEXT: u64 = 1 << 20;

/// Why a text could not be read.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The file is missing, or may not be read, or reading broke off.
    #[error("cannot read {name}: {error}")]
    Unreadable {
        /// What was read.
        name: String,
        /// What the system says.
        error: io::Error,
    },
    /// More bytes than any plan or description has.
    #[error(
        "{name} is longer than {LONGEST_TEXT} bytes, more than any plan or robot description: is it the right file?"
    )]
    TooLong {
        /// What was read.
        name: String,
    },
    /// The bytes are no UTF-8.
    #[error("{name} is not UTF-8 text (at byte {position}): save it as UTF-8")]
    NotText {
        /// What was read.
        name: String,
        /// Where the first byte that is no text stands.
        position: usize,
    },
}

/// How a path is called in messages.
#[must_use]
pub fn name_of(path: &Path) -> String {
    if is_standard_input(path) { "standard input".to_owned() } else { path.display().to_string() }
}

/// Whether the path is `-`, which stands for standard input.
#[must_use]
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Opens a file, or standard input for `-`.
///
/// # Errors
/// [`InputError::Unreadable`].
pub fn open(path: &Path) -> Result<Box<dyn Read>, InputError> {
    if is_standard_input(path) {
        return Ok(Box::new(io::stdin().lock()));
    }
    let unreadable = |error| InputError::Unreadable { name: name_of(path), error };
    let file = File::open(path).map_err(unreadable)?;
    // Opening a directory succeeds on Unix; saying so here reads better than the first failing read.
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(unreadable(io::ErrorKind::IsADirectory.into()));
    }
    Ok(Box::new(file))
}

/// The whole text of a file, or of standard input for `-`, without a byte order mark.
///
/// # Errors
/// What cannot be opened or read, is longer than [`LONGEST_TEXT`], or is no UTF-8.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    let mut bytes = Vec::new();
    open(path)?
        .take(LONGEST_TEXT + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| InputError::Unreadable { name: name_of(path), error })?;
    if bytes.len() as u64 > LONGEST_TEXT {
        return Err(InputError::TooLong { name: name_of(path) });
    }
    let text = String::from_utf8(bytes)
        .map_err(|error| InputError::NotText { name: name_of(path), position: error.utf8_error().valid_up_to() })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_text_of_a_sane_length_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = directory.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        assert_eq!(read_text(&write("bom", "\u{feff}a".as_bytes())).unwrap(), "a");
        assert!(matches!(read_text(&write("bytes", b"ab\xff")), Err(InputError::NotText { position: 2, .. })));
        let long = vec![b' '; LONGEST_TEXT as usize + 1];
        assert!(matches!(read_text(&write("long", &long)), Err(InputError::TooLong { .. })));
        assert!(matches!(read_text(directory.path()), Err(InputError::Unreadable { .. })));
        assert!(matches!(read_text(&directory.path().join("none")), Err(InputError::Unreadable { .. })));
    }
}
