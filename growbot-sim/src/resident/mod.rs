//! Simulated robots that stay on: each is played by a process of its own, as a robot on a bench has a board of its own.
//!
//! A program that uses `sim:NAME` as its port may end, crash or be stopped, and the robot goes on, as far as a robot
//! does without a host. Its flash and its retained memory are files, so that it also comes back as itself after it was
//! switched off in the midst of a layer.
//!
//! - [`Place`]: the directory of a robot; [`play`]: the process; [`Line`]: the port to it; `wire`: what both say.

mod line;
mod place;
mod play;
mod store;
#[cfg(test)]
mod tests;
mod wire;

use std::io;
use std::path::PathBuf;

pub use self::line::{Line, Truth};
pub use self::place::Place;
pub use self::play::play;

/// Why a simulated robot that stays on could not be reached, or not be played.
#[derive(Debug, thiserror::Error)]
pub enum ResidentError {
    /// There is no directory for it.
    #[error("neither XDG_STATE_HOME nor HOME is set, so there is no place for simulated robots: say sim:./NAME")]
    NoHome,
    /// It is off.
    #[error("the simulated robot sim:{0} is off: switch it on with `growbot power on --port sim:{0}`")]
    Off(String),
    /// It is on already.
    #[error("the simulated robot sim:{0} is on already: switch it off with `growbot power off --port sim:{0}`")]
    On(String),
    /// Another program has its line.
    #[error("the simulated robot sim:{0} is in use by another program: end that, or go through it")]
    Busy(String),
    /// Its directory belongs to another robot.
    #[error(
        "sim:{name} is {is}, and not {asked}: choose another name, or leave --robot out; {directory} holds what it \
         knows"
    )]
    OtherRobot {
        /// Its name.
        name: String,
        /// The robot that it is.
        is: String,
        /// The robot that was asked for.
        asked: String,
        /// Where it is.
        directory: String,
    },
    /// A file of it cannot be used.
    #[error("cannot {what} {path} of the simulated robot: {error}", path = .path.display())]
    File {
        /// What was tried.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// What its process says cannot be understood.
    #[error("the process of the simulated robot sim:{0} is of another release: switch the robot off, and on again")]
    OtherRelease(String),
}
