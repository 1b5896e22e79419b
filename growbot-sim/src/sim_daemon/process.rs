//! Start and stop of the background process of a persistent simulated robot (`sim:NAME`).

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use std::{env, io};

use crate::sim_daemon::{DaemonPort, StateDir};

/// Maximum time until a started process serves the robot, or a stopped one has ended.
const LIMIT: Duration = Duration::from_secs(10);

/// Errors of switching a simulated robot on or off.
#[derive(Debug, thiserror::Error)]
pub enum SimProcessError {
    /// The process cannot be started.
    #[error("cannot start the process of a simulated robot: {0}")]
    Process(#[from] io::Error),
    /// The process has ended at once or does not respond.
    #[error("the simulated robot sim:{0} did not start")]
    NotStarted(String),
    /// The process does not end.
    #[error("the process of the simulated robot sim:{0} does not exit: end this process by hand (kill)")]
    NotStopped(String),
}

/// Starts a background process that simulates a robot, and waits until the robot can be connected. `robot` is the name
/// or file of its description. With `None`, the robot keeps its stored description, or uses the configured one if it
/// has none.
///
/// # Errors
/// [`SimProcessError::Process`], [`SimProcessError::NotStarted`].
pub fn switch_on(place: &StateDir, robot: Option<&Path>, pace: f64) -> Result<(), SimProcessError> {
    let mut command = Command::new(env::current_exe()?);
    command.args(["power", "on", "--foreground", "--pace", &pace.to_string()]);
    command.args(["--port", &format!("sim:{}", place.name())]);
    if let Some(robot) = robot {
        command.arg("--robot").arg(robot);
    }
    // The process must outlive the terminal and receive no signals that are sent to this program.
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
    let mut process = command.spawn()?;
    let began = Instant::now();
    while DaemonPort::open_shared(place).is_err() {
        if process.try_wait()?.is_some() || began.elapsed() > LIMIT {
            return Err(SimProcessError::NotStarted(place.name().to_owned()));
        }
        sleep(Duration::from_millis(20));
    }
    Ok(())
}

/// Waits until the process of a robot that was switched off has ended.
///
/// # Errors
/// [`SimProcessError::NotStopped`].
pub fn wait_until_off(place: &StateDir) -> Result<(), SimProcessError> {
    let began = Instant::now();
    while place.is_on() {
        if began.elapsed() > LIMIT {
            return Err(SimProcessError::NotStopped(place.name().to_owned()));
        }
        sleep(Duration::from_millis(5));
    }
    Ok(())
}
