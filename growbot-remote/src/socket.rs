//! Unix socket on which the service of this user listens.

use std::path::PathBuf;

use growbot_plan::user_dirs;

/// Name of the socket in its directory.
pub const SOCKET: &str = "serve.sock";

/// Returns the directory of the service's stored state: `growbot/serve` in `$XDG_STATE_HOME` or `~/.local/state`.
/// `None` if neither `$XDG_STATE_HOME` nor `$HOME` is set.
pub fn state_dir() -> Option<PathBuf> {
    Some(user_dirs::state_dir()?.join("serve"))
}

/// Returns the directory of the service's socket: `growbot` in `$XDG_RUNTIME_DIR`, or [`state_dir`] if that is not set.
/// `None` without both.
pub fn runtime_dir() -> Option<PathBuf> {
    user_dirs::runtime_dir().or_else(state_dir)
}
