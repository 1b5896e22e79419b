//! Robots and ports that a settings file names, with their paths.

use std::path::Path;

use growbot_plan::robot_file;

/// Returns the robot that a settings file names: a built-in name, or a path, which is resolved from the file's
/// directory.
pub fn robot_from(robot: &str, directory: &Path) -> String {
    if robot_file::is_built_in(robot) { robot.to_owned() } else { resolve_path(directory, robot) }
}

/// Returns the port that a settings file names. A path in it is resolved from the file's directory.
pub fn port_from(port: &str, directory: &Path) -> String {
    match port.split_once(':') {
        Some((board @ ("emulator" | "rp2040"), image)) => format!("{board}:{}", resolve_path(directory, image)),
        Some(("sim", name)) if name.contains('/') => format!("sim:{}", resolve_path(directory, name)),
        _ => port.to_owned(),
    }
}

/// Resolves a path relative to this directory.
fn resolve_path(directory: &Path, path: &str) -> String {
    directory.join(path).to_string_lossy().into_owned()
}
