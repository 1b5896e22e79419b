//! Serial devices: raw bytes at 115200 baud.
//!
//! A growbot command that uses a device holds an advisory lock on it (`flock`), so that a second command is refused.
//! The emergency stop does not take this lock, and no command opens a device for exclusive use (`TIOCEXCL`). The
//! emergency stop can therefore open a device that another command uses.
//!
//! If two programs read one device, each receives some of the bytes. The emergency stop therefore takes a second lock
//! (`fcntl`). While this lock is held, the command that uses the device reads nothing, so the emergency stop receives
//! the board's acknowledgement.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, fcntl_lock};
use rustix::io::Errno;
use rustix::termios::{Action, ControlModes, OptionalActions, QueueSelector, tcflow, tcflush, tcgetattr, tcsetattr};

use super::PortError;

/// Baud rate of serial devices.
const BAUD: u32 = 115_200;
/// Maximum time for which a device may accept no byte to send. Then the connection counts as lost.
const STALLED: Duration = Duration::from_secs(2);
/// Maximum time for which an emergency stop waits for a device that accepts no byte. The caller then sends the stop
/// again.
const EMERGENCY_WAIT: Duration = Duration::from_millis(100);
/// Interval at which a command that uses a device polls whether the emergency stop of another program is over. The
/// emergency stop tries to take its lock at the same interval.
const SILENCE_LOOK: Duration = Duration::from_millis(2);
/// Maximum number of attempts of an emergency stop to take its lock.
const SILENCE_TRIES: u32 = 10;

/// An open serial device. No call blocks for longer than its timeout.
pub struct Serial {
    file: File,
    /// True if this handle is used to send an emergency stop. Such a handle reads even while other handles must not.
    is_for_emergency: bool,
}

impl Serial {
    /// Opens a device and takes its lock, so that no other growbot command can open it.
    ///
    /// # Errors
    /// If the device is missing, busy or forbidden, or is not a serial device.
    pub fn open(device: &str) -> Result<Self, PortError> {
        let serial = Self::open_shared(device, false)?;
        match serial.file.try_lock() {
            Ok(()) => {}
            Err(fs::TryLockError::WouldBlock) => return Err(PortError::Busy(device.to_string(), holder(device))),
            Err(fs::TryLockError::Error(error)) => return Err(unusable(device, &error)),
        }
        serial.set_up().map_err(|error| unusable(device, &error))?;
        Ok(serial)
    }

    /// Opens a device even if another growbot command uses it. For the emergency stop only.
    ///
    /// # Errors
    /// Like [`Serial::open`], but not [`PortError::Busy`]. [`PortError::Exclusive`] if a program has opened the device
    /// for exclusive use.
    pub fn open_for_emergency_stop(device: &str) -> Result<Self, PortError> {
        let serial = Self::open_shared(device, true)?;
        serial.set_up().map_err(|error| unusable(device, &error))?;
        for _ in 0..SILENCE_TRIES {
            // Without the lock, the stop may have to be sent once or twice more until the acknowledgement is received.
            if fcntl_lock(&serial.file, FlockOperation::NonBlockingLockExclusive).is_ok() {
                break;
            }
            sleep(SILENCE_LOOK);
        }
        Ok(serial)
    }

    /// Reports whether this handle must not read, because another program sends an emergency stop to the device.
    fn must_yield(&self) -> bool {
        if self.is_for_emergency {
            return false;
        }
        match fcntl_lock(&self.file, FlockOperation::NonBlockingLockShared) {
            Ok(()) => {
                // An error of unlocking is ignored, because it is as unlikely as one of locking.
                let _ = fcntl_lock(&self.file, FlockOperation::NonBlockingUnlock);
                false
            }
            Err(error) => matches!(error, Errno::AGAIN | Errno::ACCESS),
        }
    }

    fn open_shared(device: &str, is_for_emergency: bool) -> Result<Self, PortError> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        match rustix::fs::open(device, flags, Mode::empty()) {
            Ok(file) => Ok(Self { file: file.into(), is_for_emergency }),
            Err(Errno::BUSY) => Err(PortError::Exclusive(device.to_string(), holder(device))),
            Err(error) => Err(unusable(device, &error.into())),
        }
    }

    /// Sets the device to 115200 baud, raw bytes, 8N1, without flow control and modem lines.
    fn set_up(&self) -> io::Result<()> {
        let mut settings = tcgetattr(&self.file)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB;
        settings.set_speed(BAUD)?;
        Ok(tcsetattr(&self.file, OptionalActions::Now, &settings)?)
    }

    /// Returns a second handle of this device, with which another thread can send the emergency stop.
    ///
    /// # Errors
    /// If the system has no more file descriptors.
    pub fn try_clone(&self) -> io::Result<Self> {
        Ok(Self { file: self.file.try_clone()?, is_for_emergency: true })
    }

    /// Sends bytes. While the device accepts no byte, `gives_up` is called every 100 ms, and sending ends if it returns
    /// true.
    ///
    /// # Errors
    /// If the device is gone or accepts no byte for two seconds, or if `gives_up` has returned true.
    pub fn send(&mut self, bytes: &[u8], gives_up: impl Fn() -> bool) -> io::Result<()> {
        let mut left = bytes;
        let mut since = Instant::now();
        while !left.is_empty() {
            match self.file.write(left) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    left = left.get(count..).unwrap_or_default();
                    since = Instant::now();
                }
                Err(error) if is_passing(&error) => {
                    if since.elapsed() > STALLED || gives_up() {
                        return Err(io::Error::new(ErrorKind::TimedOut, "the device accepts no more bytes"));
                    }
                    self.wait(PollFlags::OUT, EMERGENCY_WAIT)?;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Drops all bytes that wait in the device to be sent, and sends these bytes in one write.
    ///
    /// # Errors
    /// If the device is gone, or does not accept all bytes within 100 ms.
    pub fn send_ahead(&mut self, bytes: &[u8]) -> io::Result<()> {
        // Queued bytes are older than the emergency stop and would only delay it. Both calls may fail on a device
        // without a queue. The write then reports the error.
        let _ = tcflush(&self.file, QueueSelector::OFlush);
        let _ = tcflow(&self.file, Action::OOn);
        let sent = match self.file.write(bytes) {
            Err(error) if is_passing(&error) => {
                self.wait(PollFlags::OUT, EMERGENCY_WAIT)?;
                self.file.write(bytes)
            }
            sent => sent,
        };
        if sent? < bytes.len() {
            return Err(io::Error::new(ErrorKind::TimedOut, "the device accepts no more bytes"));
        }
        Ok(())
    }

    /// Waits for bytes and reads them into the buffer. Returns their number. `None` after the timeout, if another
    /// program has read the bytes, or if `leaves` returns true, because the bytes are then for another thread.
    ///
    /// # Errors
    /// If the device is gone.
    pub fn receive(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
        leaves: impl Fn() -> bool,
    ) -> io::Result<Option<usize>> {
        let began = Instant::now();
        self.wait(PollFlags::IN, timeout)?;
        while self.must_yield() {
            if leaves() || began.elapsed() >= timeout {
                return Ok(None);
            }
            sleep(SILENCE_LOOK);
            self.wait(PollFlags::IN, timeout.saturating_sub(began.elapsed()))?;
        }
        if leaves() {
            return Ok(None);
        }
        match self.file.read(buffer) {
            Ok(count) => Ok(Some(count)),
            Err(error) if is_passing(&error) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Waits until the device can be read or written (`for_what`), or the timeout is over.
    fn wait(&self, for_what: PollFlags, timeout: Duration) -> io::Result<()> {
        let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
        match poll(&mut [PollFd::new(&self.file, for_what)], Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Reports whether an error is temporary: nothing can be read or written now, but perhaps later.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Converts an error of the operating system to the error for a device that cannot be opened.
fn unusable(device: &str, error: &io::Error) -> PortError {
    let name = device.to_string();
    match error.kind() {
        ErrorKind::PermissionDenied => PortError::Forbidden(name),
        ErrorKind::NotFound => PortError::Missing(name, available_ports_hint()),
        _ => PortError::Missing(name, format!(" ({error})")),
    }
}

/// Returns the name of a program that has a device open, or "another program" if it is unknown.
fn holder(device: &str) -> String {
    found_holder(device).unwrap_or_else(|| "another program".to_string())
}

/// Returns the name and process number of a program that has a device open. `None` if it is unknown: Linux shows only
/// the programs of this user.
fn found_holder(device: &str) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    let has_it = |process: &Path| {
        let open = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        open.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file == device)
    };
    let processes = fs::read_dir("/proc").ok()?.flatten().filter(|entry| {
        // Skip the entry `self` and that of this process.
        let number: Option<u32> = entry.file_name().to_str().and_then(|name| name.parse().ok());
        number.is_some_and(|number| number != std::process::id())
    });
    processes.map(|entry| entry.path()).filter(|path| has_it(path)).find_map(|path| {
        let name = fs::read_to_string(path.join("comm")).ok()?;
        Some(format!("{} (process {})", name.trim(), path.file_name()?.to_str()?))
    })
}

/// Returns the names of the available serial devices. None of them is opened.
pub fn serial_devices() -> Vec<String> {
    serialport::available_ports().unwrap_or_default().into_iter().map(|port| port.port_name).collect()
}

/// Returns the end of an error message, which lists the available serial devices.
fn available_ports_hint() -> String {
    let names = serial_devices();
    if names.is_empty() {
        "; no serial devices found".to_string()
    } else {
        format!("; available devices are {}", names.join(", "))
    }
}
