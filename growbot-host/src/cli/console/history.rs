//! File in which the console stores the history of typed lines.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;

/// Returns the file of the history, and creates its directory. The file is `growbot/history` in `$XDG_STATE_HOME`, or
/// in `~/.local/state`. `None` if neither directory is known, or if the directory cannot be created.
pub fn file() -> Option<PathBuf> {
    let directory = directory(env::var_os("XDG_STATE_HOME"), env::var_os("HOME"))?;
    fs::create_dir_all(&directory).ok()?;
    Some(directory.join("history"))
}

fn directory(state: Option<OsString>, home: Option<OsString>) -> Option<PathBuf> {
    // The XDG base directory specification requires that relative paths are ignored.
    let absolute = |name: Option<OsString>| name.map(PathBuf::from).filter(|path| path.is_absolute());
    let state = absolute(state).or_else(|| Some(absolute(home)?.join(".local/state")))?;
    Some(state.join("growbot"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn history_is_stored_in_the_users_state_directory() {
        let of = |state: &str, home: &str| directory(Some(state.into()), Some(home.into()));
        assert_eq!(of("/state", "/home/me"), Some("/state/growbot".into()));
        assert_eq!(of("", "/home/me"), Some("/home/me/.local/state/growbot".into()));
        assert_eq!(of("relative", "/home/me"), Some("/home/me/.local/state/growbot".into()));
        assert_eq!(directory(None, None), None);
    }
}
