//! Where the lines that were typed are remembered.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;

/// The file of the history, its directory made where it was not there: `growbot/history` in `$XDG_STATE_HOME`, or in
/// `~/.local/state`. None where there is no such place.
pub fn file() -> Option<PathBuf> {
    let directory = directory(env::var_os("XDG_STATE_HOME"), env::var_os("HOME"))?;
    fs::create_dir_all(&directory).ok()?;
    Some(directory.join("history"))
}

fn directory(state: Option<OsString>, home: Option<OsString>) -> Option<PathBuf> {
    // What is not absolute is to be passed over, by the XDG base directory specification.
    let absolute = |name: Option<OsString>| name.map(PathBuf::from).filter(|path| path.is_absolute());
    let state = absolute(state).or_else(|| Some(absolute(home)?.join(".local/state")))?;
    Some(state.join("growbot"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_is_the_users_state_directory() {
        let of = |state: &str, home: &str| directory(Some(state.into()), Some(home.into()));
        assert_eq!(of("/state", "/home/me"), Some("/state/growbot".into()));
        assert_eq!(of("", "/home/me"), Some("/home/me/.local/state/growbot".into()));
        assert_eq!(of("relative", "/home/me"), Some("/home/me/.local/state/growbot".into()));
        assert_eq!(directory(None, None), None);
    }
}
