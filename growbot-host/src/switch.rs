//! The switch of simulated robots that stay on.

use std::env;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_sim::resident::{Line, Place};

/// How long a process may take until the robot is on, or has ended.
const LIMIT: Duration = Duration::from_secs(10);

/// Why a simulated robot is not on, or not off.
#[derive(Debug, thiserror::Error)]
pub enum SwitchError {
    /// Its process cannot be started.
    #[error("the process of a simulated robot cannot be started: {0}")]
    Process(#[from] io::Error),
    /// It has ended at once, or does not answer.
    #[error("the simulated robot sim:{0} did not come on: `growbot power on --foreground --port sim:{0}` says why")]
    NotOn(String),
    /// It does not end.
    #[error("the process of the simulated robot sim:{0} does not end: end it by hand")]
    NotOff(String),
}

/// Starts a process of its own that plays a simulated robot, and waits until it does. The robot's description is a name
/// or a file; none for the one that lives there, or else the configured one.
///
/// # Errors
/// [`SwitchError::Process`], [`SwitchError::NotOn`].
pub fn switch_on(place: &Place, robot: Option<&Path>, pace: f64) -> Result<(), SwitchError> {
    let mut command = Command::new(env::current_exe()?);
    command.args(["power", "on", "--foreground", "--pace", &pace.to_string()]);
    command.args(["--port", &format!("sim:{}", place.name())]);
    if let Some(robot) = robot {
        command.arg("--robot").arg(robot);
    }
    // It outlives the terminal, and no signal that is meant for this program reaches it.
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
    let mut process = command.spawn()?;
    let began = Instant::now();
    while Line::open_beside(place).is_err() {
        if process.try_wait()?.is_some() || began.elapsed() > LIMIT {
            return Err(SwitchError::NotOn(place.name().to_owned()));
        }
        sleep(Duration::from_millis(20));
    }
    Ok(())
}

/// Waits for the process of a robot that was switched off to end.
///
/// # Errors
/// [`SwitchError::NotOff`].
pub fn wait_until_off(place: &Place) -> Result<(), SwitchError> {
    let began = Instant::now();
    while place.is_on() {
        if began.elapsed() > LIMIT {
            return Err(SwitchError::NotOff(place.name().to_owned()));
        }
        sleep(Duration::from_millis(5));
    }
    Ok(())
}
