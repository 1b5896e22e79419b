//! Simulated robots that run in the background. Each runs in its own process and outlives the programs that connect to
//! it.
//!
//! A program that uses `sim:NAME` as its port may end, crash or be stopped. The robot continues, as far as a robot does
//! without a host. Its flash and its retained memory are files, so that it resumes correctly even after it was switched
//! off in the middle of a layer.
//!
//! - [`StateDir`]: the directory of a robot; [`serve`]: the process, which [`process`] starts; [`DaemonPort`]: the port
//!   to it; `protocol`: their messages.

mod persistence;
mod port;
pub mod process;
mod protocol;
mod server;
mod state_dir;
#[cfg(test)]
mod tests;

use std::io;
use std::path::PathBuf;

pub use self::port::{DaemonPort, RemoteTip};
pub use self::server::serve;
pub use self::state_dir::StateDir;

/// Error of connecting to a simulated robot in the background, or of running it.
#[derive(Debug, thiserror::Error)]
pub enum SimDaemonError {
    /// No directory for simulated robots is defined.
    #[error("neither XDG_STATE_HOME nor HOME is set, so simulated robots have no directory: use sim:./NAME")]
    NoHome,
    /// The simulated robot is switched off: its process does not run. The field is the robot's name.
    #[error("the simulated robot sim:{0} is off: switch it on")]
    NotRunning(String),
    /// The process of the simulated robot has not responded in time. The field is the robot's name.
    #[error("the process of the simulated robot sim:{0} does not respond: the machine is busy; try again")]
    Unresponsive(String),
    /// The simulated robot is already switched on: a process runs it. The field is the robot's name.
    #[error("the simulated robot sim:{0} is already on: switch it off")]
    AlreadyRunning(String),
    /// Another program has an exclusive connection to the simulated robot. The field is the robot's name.
    #[error("the simulated robot sim:{0} is in use by another program: end that program first")]
    Busy(String),
    /// The directory of the simulated robot belongs to a different robot description.
    #[error(
        "the simulated robot sim:{name} already exists as robot {stored}, not as robot {requested}: choose another \
         name, or omit the robot description (the state of this robot is in {directory})"
    )]
    OtherRobot {
        /// Name of the simulated robot.
        name: String,
        /// Robot that the directory belongs to.
        stored: String,
        /// Robot that was requested.
        requested: String,
        /// Directory of the simulated robot.
        directory: String,
    },
    /// A file of the robot cannot be used.
    #[error("cannot {what} {path} of the simulated robot: {error}", path = .path.display())]
    File {
        /// Failed operation.
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The robot's process uses another version of the messages. The field is the robot's name.
    #[error("the process of the simulated robot sim:{0} is from another release: switch the robot off and on again")]
    OtherRelease(String),
}
