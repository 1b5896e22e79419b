//! Connections to a robot's board (ports): a serial line, a TCP connection or any other byte stream.
//!
//! - [`Port`]: the interface of a connection; [`stream`]: TCP connections and serial devices; [`serial`]: serial
//!   devices; [`faulty`]: a connection with simulated faults.

pub mod faulty;
pub mod serial;
pub mod stream;

use std::cell::RefCell;
use std::io;
use std::rc::Rc;
use std::time::Duration;

use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use rustix::time::{ClockId, clock_gettime};

/// A connection to a robot's board, which carries bytes in both directions.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// If the connection is broken.
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError>;

    /// Waits until bytes arrive, and reads them into the buffer. Returns their number, or 0 after the timeout. For a
    /// port with a virtual clock, the timeout is measured on that clock.
    ///
    /// # Errors
    /// If the connection is broken.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError>;

    /// Sends the bytes of the emergency stop in one write. On a serial device, bytes that wait to be sent are dropped
    /// first.
    ///
    /// # Errors
    /// If the connection is broken, or accepts no bytes now.
    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.send(&EMERGENCY_STOP)
    }

    /// Returns the time on the clock that measures the timeouts of [`Port::receive`]: real time, unless the port has a
    /// virtual clock.
    fn now(&self) -> Duration {
        time_since_boot()
    }

    /// Reports whether the clock of a healthy board runs at the same rate as [`Port::now`]. This is false for an
    /// emulated board, whose clock stands still while a busy machine runs other programs.
    fn has_comparable_clock(&self) -> bool {
        true
    }

    /// Returns a second port on the same connection with which another thread can send the emergency stop. From its
    /// first use until it is dropped, all calls of this port block. `None` if the robot is simulated in this program
    /// and ends with it.
    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        None
    }
}

/// A port with several owners. For example, a test breaks parts of a simulated robot while a client uses the port.
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

    fn has_comparable_clock(&self) -> bool {
        self.borrow().has_comparable_clock()
    }

    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        self.borrow_mut().emergency_port()
    }
}

/// Returns the real time since the host was started, including the time in which it slept.
pub fn time_since_boot() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Error of opening or using a port.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The device does not exist.
    #[error("port {0} not found or not usable: check the cable and the name{1}")]
    Missing(String, String),
    /// Another program uses the device.
    #[error("port {0} is in use by {1}: close that program first")]
    Busy(String, String),
    /// Another program has opened the device for exclusive use.
    #[error("port {0} is locked by {1}: end that program")]
    Exclusive(String, String),
    /// This user has no permission to use the device.
    #[error(
        "no permission to use port {0}: add your user to the group of the device (often `dialout`), and log in again"
    )]
    Forbidden(String),
    /// No program listens at the address.
    #[error("no response at {0} ({1}): check the address and that the robot is on")]
    Unreachable(String, String),
    /// The connection worked before, but is now broken.
    #[error(
        "lost the connection to {0} ({1}): check the board's power and its connection, and connect again; layers that \
         are already laid are not lost"
    )]
    Lost(String, #[source] io::Error),
    /// The emulator of a board ended. The fields are its program, its message, and what to do.
    #[error("{0} ended while the board was running: {1}; {2}")]
    EmulatorEnded(&'static str, String, &'static str),
    /// A file of the emulator of a board failed. The first field is the failed action.
    #[error("cannot {0}: {1}")]
    EmulatorFile(&'static str, #[source] io::Error),
}
