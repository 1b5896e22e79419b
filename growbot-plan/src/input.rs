//! Bounded reading of texts from files or from standard input (`-`).

use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::os::fd::AsFd;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::atomic_file::{FileError, note_input};

/// Maximum length of a plan or a robot description, bytes (16 MiB). The longest text is a plan with its table of layers.
pub const MAX_TEXT_BYTES: u64 = 16 << 20;
/// Maximum length of a line of a stream, bytes (1 MiB).
pub const MAX_LINE_BYTES: u64 = 1 << 20;
/// Maximum length of a run log, bytes (256 MiB). A growth of weeks with frequent status requests has a shorter log.
pub const MAX_LOG_BYTES: u64 = 256 << 20;

/// True once an argument `-` of the command line has opened standard input, which can be read only once.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Error of reading a text.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The file is missing or may not be read, or reading failed.
    #[error("cannot read {name}: {error}; give a file that can be read")]
    Unreadable {
        /// Name of the input.
        name: String,
        /// Error of the operating system.
        #[source]
        error: io::Error,
    },
    /// The input is longer than the limit for its kind.
    #[error("{name} is longer than {max} bytes, the limit for a {}: check that this is the right file", kind(.max))]
    TooLong {
        /// Name of the input.
        name: String,
        /// Maximum length, bytes.
        max: u64,
    },
    /// The input is a named pipe, a device or a socket, and reading it might wait for ever.
    #[error("cannot read {name}: it is {what} and may never end; give a file")]
    NotAFile {
        /// Name of the input.
        name: String,
        /// Kind of the input, such as "a device".
        what: &'static str,
    },
    /// Standard input is already read by another argument.
    #[error("standard input (-) can be only one of the inputs: give the other input as a file")]
    ReadAlready,
    /// Standard output is redirected to the input and would overwrite it.
    #[error(transparent)]
    WouldOverwrite(#[from] FileError),
    /// The bytes are not UTF-8.
    #[error("{name} is not UTF-8 text (at byte {position}): save it as UTF-8")]
    NotText {
        /// Name of the input.
        name: String,
        /// Position of the first byte that is not UTF-8, from 0.
        position: usize,
    },
}

/// Returns the name, for error messages, of the kind of input whose maximum length is `max` bytes.
fn kind(max: &u64) -> &'static str {
    if *max == MAX_LOG_BYTES { "run log" } else { "plan or robot description" }
}

/// Returns the name of an input for messages: its path, or "standard input" for `-`.
pub fn display_name(path: &Path) -> String {
    if is_standard_input(path) { "standard input".to_owned() } else { path.display().to_string() }
}

/// Reports whether the path is `-`, which stands for standard input.
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Opens a file, or standard input for `-`. A pipe that the shell has opened (`<(command)`, named /dev/fd/N) is
/// accepted. A named pipe, a device or a socket is not, because opening or reading it might wait for ever. The file is
/// recorded as an input of this program, so [`crate::atomic_file`] refuses to overwrite it.
///
/// # Errors
/// [`InputError::Unreadable`], [`InputError::NotAFile`] or [`InputError::WouldOverwrite`].
pub fn open(path: &Path) -> Result<Box<dyn Read>, InputError> {
    if is_standard_input(path) {
        if TAKEN.swap(true, Ordering::Relaxed) {
            return Err(InputError::ReadAlready);
        }
        note_standard_input()?;
        return Ok(Box::new(io::stdin().lock()));
    }
    let unreadable = |error| InputError::Unreadable { name: display_name(path), error };
    // Check the kind before opening, because opening a named pipe waits for a writer.
    if let Some(what) = never_ending(path, &fs::metadata(path).map_err(unreadable)?) {
        return Err(InputError::NotAFile { name: display_name(path), what });
    }
    let file = File::open(path).map_err(unreadable)?;
    // Opening a directory succeeds on Unix. An error here is clearer than the first failing read.
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(unreadable(io::ErrorKind::IsADirectory.into()));
    }
    if let Ok(same) = file.try_clone() {
        note_input(same, &display_name(path))?;
    }
    Ok(Box::new(file))
}

/// Returns the kind of file at a path, such as "a socket", if reading the file might wait for ever. `None` otherwise.
fn never_ending(path: &Path, metadata: &Metadata) -> Option<&'static str> {
    let kind = metadata.file_type();
    if kind.is_fifo() {
        // The shell's own pipes have no name in any directory.
        return fs::canonicalize(path).is_ok().then_some("a named pipe");
    }
    if kind.is_char_device() || kind.is_block_device() {
        let ends = path == Path::new("/dev/null") || path == Path::new("/dev/stdin");
        return (!ends).then_some("a device");
    }
    kind.is_socket().then_some("a socket")
}

/// Records the file that is redirected to standard input as an input of this program, so that it is not overwritten.
///
/// # Errors
/// Like [`note_input`].
pub fn note_standard_input() -> Result<(), FileError> {
    match io::stdin().as_fd().try_clone_to_owned() {
        Ok(same) => note_input(File::from(same), "standard input"),
        Err(_) => Ok(()),
    }
}

/// Reader that fails at a line longer than [`MAX_LINE_BYTES`]. The whole stream may have any length. The limit prevents
/// a line without an end from filling the memory.
pub struct BoundedLines<R> {
    lines: R,
    /// Number of bytes read since the last newline.
    length: u64,
}

impl<R: Read> BoundedLines<R> {
    /// Wraps a stream of lines.
    pub fn of(lines: R) -> Self {
        Self { lines, length: 0 }
    }
}

impl<R: Read> Read for BoundedLines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.lines.read(buffer)?;
        for byte in buffer.get(..count).unwrap_or_default() {
            self.length = if *byte == b'\n' { 0 } else { self.length + 1 };
            if self.length > MAX_LINE_BYTES {
                let reason = format!(
                    "a line of the input is longer than {MAX_LINE_BYTES} bytes, the limit: check that this is the \
                     right file"
                );
                return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
            }
        }
        Ok(count)
    }
}

/// Reads all bytes of a file, or of standard input for `-`. `max` is the maximum length, bytes.
///
/// # Errors
/// If the file cannot be opened or read, or is longer than `max`.
pub fn read_bytes(path: &Path, max: u64) -> Result<Vec<u8>, InputError> {
    let mut bytes = Vec::new();
    open(path)?
        .take(max + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| InputError::Unreadable { name: display_name(path), error })?;
    if bytes.len() as u64 > max { Err(InputError::TooLong { name: display_name(path), max }) } else { Ok(bytes) }
}

/// Reads the whole text of a file, or of standard input for `-`, without a byte order mark.
///
/// # Errors
/// If the file cannot be opened or read, is longer than [`MAX_TEXT_BYTES`], or is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    text_of(read_bytes(path, MAX_TEXT_BYTES)?, path)
}

/// Converts the bytes of a file to text without a byte order mark. `path` names the file in error messages.
///
/// # Errors
/// [`InputError::TooLong`] or [`InputError::NotText`].
pub fn text_of(bytes: Vec<u8>, path: &Path) -> Result<String, InputError> {
    if bytes.len() as u64 > MAX_TEXT_BYTES {
        return Err(InputError::TooLong { name: display_name(path), max: MAX_TEXT_BYTES });
    }
    let text = String::from_utf8(bytes).map_err(|error| InputError::NotText {
        name: display_name(path),
        position: error.utf8_error().valid_up_to(),
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_utf8_and_oversized_files_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = directory.path().join(name);
            fs::write(&path, bytes).unwrap();
            path
        };
        assert_eq!(read_text(&write("bom", "\u{feff}a".as_bytes())).unwrap(), "a");
        assert!(matches!(read_text(&write("bytes", b"ab\xff")), Err(InputError::NotText { position: 2, .. })));
        let long = vec![b' '; MAX_TEXT_BYTES as usize + 1];
        assert!(matches!(read_text(&write("long", &long)), Err(InputError::TooLong { .. })));
        assert!(matches!(read_text(directory.path()), Err(InputError::Unreadable { .. })));
        assert!(matches!(read_text(&directory.path().join("none")), Err(InputError::Unreadable { .. })));
    }

    #[test]
    fn an_overlong_line_is_refused_and_a_long_stream_of_lines_is_not() {
        let line = vec![b'x'; MAX_LINE_BYTES as usize];
        let lines = [&line[..], b"\n"].concat().repeat(3);
        assert_eq!(io::copy(&mut BoundedLines::of(&lines[..]), &mut io::sink()).unwrap(), lines.len() as u64);
        let endless = [&line[..], b"xy"].concat();
        let error = io::copy(&mut BoundedLines::of(&endless[..]), &mut io::sink()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
    }

    #[test]
    fn endless_inputs_are_refused_before_opening() {
        let directory = tempfile::tempdir().unwrap();
        let fifo = directory.path().join("fifo");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        let _socket = std::os::unix::net::UnixListener::bind(directory.path().join("socket")).unwrap();
        for (path, what) in
            [(fifo, "pipe"), ("/dev/zero".into(), "device"), (directory.path().join("socket"), "socket")]
        {
            let error = read_text(&path).unwrap_err();
            assert!(matches!(error, InputError::NotAFile { .. }) && error.to_string().contains(what), "{error}");
        }
        assert_eq!(read_text("/dev/null".as_ref()).unwrap(), "");
    }
}
