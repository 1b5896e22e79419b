//! File in which the console stores the history of typed lines.

use std::fs;
use std::path::PathBuf;

use growbot_plan::user_dirs;

/// Returns the file of the history, and creates its directory, that of stored state. `None` if the directory is not
/// known or cannot be created.
pub fn file() -> Option<PathBuf> {
    let directory = user_dirs::state_dir()?;
    fs::create_dir_all(&directory).ok()?;
    Some(directory.join("history"))
}
