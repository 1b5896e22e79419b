//! Reasons why a port could not be opened.

use growbot_client::port::PortError;
use growbot_core::robot::RobotError;

use super::qemu::QemuError;
use super::rp2040::node_process::Rp2040Error;
use crate::sim_daemon::SimDaemonError;

/// Reason why a port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The port's name is not valid.
    #[error(
        "unknown port `{0}`{near}: use sim, sim:NAME, emulator, emulator:ELF, rp2040, rp2040:ELF, rp2040:ELF,usb, \
         tcp:HOST:PORT or a serial device such as /dev/ttyACM0", near = near(.0)
    )]
    Unknown(String),
    /// The simulated robot runs inside the program that uses it, so no second connection can be opened for the
    /// emergency stop.
    #[error("this simulated robot has no port, because it ends with its program: use sim:NAME, which is persistent")]
    NoEmergencyPort,
    /// The robot exceeds the limits of the boards. The fields are the robot's name and the reason.
    #[error("no board, real or emulated, can drive robot {0}: {1}")]
    UnsupportedRobot(String, RobotError),
    /// Error of the background process of a simulated robot (port `sim:NAME`).
    #[error("{0}")]
    Daemon(#[from] SimDaemonError),
    /// Error of QEMU (port `emulator`).
    #[error(transparent)]
    Emulator(#[from] QemuError),
    /// Error of the emulator of the Raspberry Pi Pico (port `rp2040`).
    #[error(transparent)]
    Rp2040(#[from] Rp2040Error),
    /// Error of the connection.
    #[error("{0}")]
    Port(#[from] PortError),
}

/// Returns a suggestion for the name of a serial device without its directory.
fn near(name: &str) -> String {
    if name.starts_with("tty") { format!(" (did you mean /dev/{name}?)") } else { String::new() }
}
