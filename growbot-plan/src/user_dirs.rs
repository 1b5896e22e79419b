//! growbot's directories of the user, as in the XDG base directory specification.

use std::env;
use std::ffi::OsString;
use std::path::PathBuf;

/// Returns the directory of the user's configuration: `growbot` in `$XDG_CONFIG_HOME`, or in `~/.config`. `None` if
/// neither `$XDG_CONFIG_HOME` nor `$HOME` is set.
pub fn config_dir() -> Option<PathBuf> {
    directory(env::var_os("XDG_CONFIG_HOME"), env::var_os("HOME"), ".config")
}

/// Returns the directory of stored state: `growbot` in `$XDG_STATE_HOME`, or in `~/.local/state`. `None` if neither
/// `$XDG_STATE_HOME` nor `$HOME` is set.
pub fn state_dir() -> Option<PathBuf> {
    directory(env::var_os("XDG_STATE_HOME"), env::var_os("HOME"), ".local/state")
}

/// Returns the directory of sockets: `growbot` in `$XDG_RUNTIME_DIR`. `None` if that is not set.
pub fn runtime_dir() -> Option<PathBuf> {
    directory(env::var_os("XDG_RUNTIME_DIR"), None, "")
}

fn directory(own: Option<OsString>, home: Option<OsString>, in_home: &str) -> Option<PathBuf> {
    // The specification requires that relative paths are ignored.
    let absolute = |path: Option<OsString>| path.map(PathBuf::from).filter(|path| path.is_absolute());
    let directory = absolute(own).or_else(|| Some(absolute(home)?.join(in_home)))?;
    Some(directory.join("growbot"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_paths_are_ignored() {
        let of = |own: &str, home: &str| directory(Some(own.into()), Some(home.into()), ".config");
        assert_eq!(of("/conf", "/home/me"), Some("/conf/growbot".into()));
        assert_eq!(of("", "/home/me"), Some("/home/me/.config/growbot".into()));
        assert_eq!(of("relative", "/home/me"), Some("/home/me/.config/growbot".into()));
        assert_eq!(of("relative", "me"), None);
        assert_eq!(directory(None, None, ".config"), None);
    }
}
