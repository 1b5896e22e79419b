//! Reports of files that a command has written, as JSON.

use serde::Serialize;

/// Report of a written file.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FileReport<'a> {
    /// Path of the file, as it was given.
    pub file: String,
    /// Format of the file: its extension.
    pub format: &'a str,
    /// Length of the file, bytes.
    pub bytes: usize,
    /// True if the file shows a body of a simulated robot.
    pub simulated: bool,
}
