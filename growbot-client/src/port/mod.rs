//! The line to a robot's board: a serial line or a TCP connection, or whatever else carries bytes.
//!
//! - [`Port`]: what a line can do; [`stream`]: lines that the system has; [`faulty`]: any line, made worse.

pub mod faulty;
pub mod serial;
pub mod stream;

use std::cell::RefCell;
use std::error::Error;
use std::rc::Rc;
use std::time::Duration;

use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use rustix::time::{ClockId, clock_gettime};

/// The line to a robot: bytes both ways.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// If the line is gone.
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError>;

    /// Waits, on the robot's own clock where it has one, until bytes arrive or the time is over, which gives 0.
    ///
    /// # Errors
    /// If the line is gone.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError>;

    /// Sends the emergency stop: in one piece, and ahead of bytes that wait to be sent where the line can drop these.
    ///
    /// # Errors
    /// The line is gone, or takes nothing now.
    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.send(&EMERGENCY_STOP)
    }

    /// The time on the clock by which [`Port::receive`] waits: real time, unless the port has a virtual clock.
    fn now(&self) -> Duration {
        real_time()
    }

    /// Whether a healthy board's clock runs as [`Port::now`] does. The clock of an emulated board stands still while a
    /// busy machine runs other programs.
    fn compares_clocks(&self) -> bool {
        true
    }

    /// The same line for the emergency stop of another thread. From its first use on, this end of the line is silent:
    /// it neither sends nor receives, and waits for the end of the program. None where the robot ends with this
    /// program.
    fn emergency_line(&mut self) -> Option<Box<dyn Port + Send>> {
        None
    }
}

/// A port that somebody else holds too: who breaks things on a simulated tip while a host talks to its board.
impl<P: Port> Port for Rc<RefCell<P>> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.borrow_mut().send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.borrow_mut().receive(buffer, timeout)
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.borrow_mut().send_emergency_stop()
    }

    fn now(&self) -> Duration {
        self.borrow().now()
    }

    fn compares_clocks(&self) -> bool {
        self.borrow().compares_clocks()
    }

    fn emergency_line(&mut self) -> Option<Box<dyn Port + Send>> {
        self.borrow_mut().emergency_line()
    }
}

impl Port for Box<dyn Port> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.as_mut().send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.as_mut().receive(buffer, timeout)
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.as_mut().send_emergency_stop()
    }

    fn now(&self) -> Duration {
        self.as_ref().now()
    }

    fn compares_clocks(&self) -> bool {
        self.as_ref().compares_clocks()
    }

    fn emergency_line(&mut self) -> Option<Box<dyn Port + Send>> {
        self.as_mut().emergency_line()
    }
}

/// Real time since the machine was started, its sleep included.
#[must_use]
pub fn real_time() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Why a port could not be opened, or was lost.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The device is not there.
    #[error("port {0} is not there: check the cable and the name{1}")]
    Missing(String, String),
    /// Another program has it.
    #[error(
        "port {0} is busy: {1} uses it; close that first (in an emergency: `growbot estop --port {0}`, which does \
         not wait for it)"
    )]
    Busy(String, String),
    /// Another program has closed it to all others.
    #[error("port {0} is closed to other programs by {1}: end that")]
    Closed(String, String),
    /// This user may not use it.
    #[error("port {0} may not be used by this user: join its group (often `dialout`) and log in again")]
    Forbidden(String),
    /// Nobody listens there.
    #[error("nobody answers at {0} ({1}): check the address and that the robot is on")]
    Unreachable(String, String),
    /// It worked and then it did not.
    #[error("the line to {0} broke ({1}): check the cable; what the robot has laid stays laid")]
    Lost(String, String),
    /// The time of a simulated board does not pass.
    #[error(transparent)]
    Simulated(Box<dyn Error + Send + Sync>),
}
