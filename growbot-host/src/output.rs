//! Results on standard output, whose reader may close it. Everything else is a message ([`crate::messages`]).
//!
//! Control characters are removed, so that text from outside cannot control the terminal
//! ([`growbot_plan::sanitize`]).

use std::io::{self, IsTerminal, Write};
use std::path::Path;

use growbot_plan::atomic_file::{FileError, write_atomic};
use growbot_plan::sanitize::lines;

use crate::display;

/// Errors of writing a result.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The reader of standard output has closed it, as `head` does. This needs no message.
    #[error("standard output was closed by the program that reads it")]
    Closed,
    /// Standard output cannot be written, for example because a disk is full.
    #[error("cannot write to standard output: {0}")]
    Stdout(io::Error),
    /// Standard output is a terminal, and the result is binary.
    #[error("this format is binary and cannot be shown on a terminal: name a file with -o, or redirect the output")]
    Terminal,
    /// A file cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl From<io::Error> for OutputError {
    /// Converts an error of standard output.
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe { Self::Closed } else { Self::Stdout(error) }
    }
}

/// Writes to standard output and flushes it. So a reader at the other end of a pipe receives the result at once, and an
/// error is detected.
///
/// # Errors
/// [`OutputError::Closed`] or [`OutputError::Stdout`].
pub fn print(text: &str) -> Result<(), OutputError> {
    print_bytes(lines(text).as_bytes())
}

/// Writes a whole result to this file, or to standard output for `-`. Returns true if it was a file.
///
/// # Errors
/// Errors of [`print()`], or [`OutputError::File`].
pub fn write_to(path: &Path, contents: &[u8]) -> Result<bool, OutputError> {
    if is_standard_output(path) {
        print_bytes(contents)?;
        return Ok(false);
    }
    write_atomic(path, contents)?;
    Ok(true)
}

/// Returns true if the path is `-`, which stands for standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Returns an error if standard output is a terminal, for results that are binary.
///
/// # Errors
/// [`OutputError::Terminal`].
pub fn refuse_terminal() -> Result<(), OutputError> {
    if io::stdout().is_terminal() { Err(OutputError::Terminal) } else { Ok(()) }
}

/// Like [`print()`], but for binary results.
///
/// # Errors
/// Errors of [`print()`].
pub fn print_bytes(bytes: &[u8]) -> Result<(), OutputError> {
    display::end_spinner();
    let mut stdout = io::stdout().lock();
    stdout.write_all(bytes)?;
    stdout.flush()?;
    Ok(())
}
