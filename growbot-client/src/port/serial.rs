//! A serial device: raw bytes at 115200 baud.
//!
//! Growbot's commands share devices by an advisory lock (`flock`): the holder of the lock has the device. The emergency
//! stop does not take this lock, and no command opens a device for exclusive use (`TIOCEXCL`). It can therefore open
//! the device beside the command that holds it.
//!
//! If two programs read one device, each gets some of the bytes. So the emergency stop has a lock of its own, on the
//! device's bytes (`fcntl`). While it is held, the holder of the device reads nothing, so the emergency stop receives
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

/// Rate of serial lines, baud.
const BAUD: u32 = 115_200;
/// Time for which a device may accept no byte before it counts as lost.
const STALLED: Duration = Duration::from_secs(2);
/// Time for which an emergency stop waits for a device that accepts nothing. The stop is then sent again.
const EMERGENCY_WAIT: Duration = Duration::from_millis(100);
/// Interval at which a holder polls whether the emergency stop of another program is over. The emergency stop tries to
/// lock the bytes at the same interval.
const SILENCE_LOOK: Duration = Duration::from_millis(2);
/// Maximum number of tries to lock the bytes.
const SILENCE_TRIES: u32 = 10;

/// An open serial device. It never blocks for longer than the requested wait.
pub struct Serial {
    file: File,
    /// True if this handle sends an emergency stop. The other handles of the device neither send nor receive meanwhile.
    is_for_emergency: bool,
}

impl Serial {
    /// Opens a device and locks it against growbot's other commands.
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

    /// Opens a device even if another program holds it. For the emergency stop only.
    ///
    /// # Errors
    /// Like [`Serial::open`], but busy only if a program other than growbot has opened the device for exclusive use.
    pub fn open_for_emergency_stop(device: &str) -> Result<Self, PortError> {
        let serial = Self::open_shared(device, true)?;
        serial.set_up().map_err(|error| unusable(device, &error))?;
        for _ in 0..SILENCE_TRIES {
            // Without the lock, another stop or two may be needed until the acknowledgement is received.
            if fcntl_lock(&serial.file, FlockOperation::NonBlockingLockExclusive).is_ok() {
                break;
            }
            sleep(SILENCE_LOOK);
        }
        Ok(serial)
    }

    /// Reports whether this handle must not read, because another program uses the line for an emergency stop.
    fn must_yield(&self) -> bool {
        if self.is_for_emergency {
            return false;
        }
        match fcntl_lock(&self.file, FlockOperation::NonBlockingLockShared) {
            Ok(()) => {
                // Unlocking fails as rarely as locking.
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

    /// Sets raw bytes, 8N1, no flow control, no modem lines.
    fn set_up(&self) -> io::Result<()> {
        let mut settings = tcgetattr(&self.file)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB;
        settings.set_speed(BAUD)?;
        Ok(tcsetattr(&self.file, OptionalActions::Now, &settings)?)
    }

    /// Returns a handle of the same device for the emergency stop of another thread.
    ///
    /// # Errors
    /// If the system has no more file descriptors.
    pub fn try_clone(&self) -> io::Result<Self> {
        Ok(Self { file: self.file.try_clone()?, is_for_emergency: true })
    }

    /// Sends bytes. Calls `gives_up` every 100 ms while the device accepts none.
    ///
    /// # Errors
    /// If the device is gone, accepts no byte for two seconds, or `gives_up` returns true.
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

    /// Sends bytes in one write, before all bytes that wait to be sent. The waiting bytes are dropped.
    ///
    /// # Errors
    /// If the device is gone, or does not accept them as a whole within 100 ms.
    pub fn send_ahead(&mut self, bytes: &[u8]) -> io::Result<()> {
        // The queued bytes precede the emergency, and the rest of a frame would only delay it. Both calls may fail on a
        // device without a queue. The write then reports the error.
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

    /// Waits for bytes. `None` after the timeout, if another program has read them first, or if `leaves` returns true
    /// once bytes have arrived, because these bytes belong to another thread.
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

    /// Waits until the device is ready, or the timeout is over.
    fn wait(&self, for_what: PollFlags, timeout: Duration) -> io::Result<()> {
        let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
        match poll(&mut [PollFd::new(&self.file, for_what)], Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Reports whether an error only means that nothing can be read or written now.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Returns the error for a device that cannot be used.
fn unusable(device: &str, error: &io::Error) -> PortError {
    let name = device.to_string();
    match error.kind() {
        ErrorKind::PermissionDenied => PortError::Forbidden(name),
        ErrorKind::NotFound => PortError::Missing(name, available_ports_hint()),
        _ => PortError::Missing(name, format!(" ({error})")),
    }
}

/// Returns the name of the program that has a device open.
fn holder(device: &str) -> String {
    found_holder(device).unwrap_or_else(|| "another program".to_string())
}

/// Returns the name of the program that has a device open, if the system reports it. Linux reports it for the programs
/// of this user.
fn found_holder(device: &str) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    let has_it = |process: &Path| {
        let open = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        open.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file == device)
    };
    let processes = fs::read_dir("/proc").ok()?.flatten().filter(|entry| {
        // Skip `self` and the number of this program.
        let number: Option<u32> = entry.file_name().to_str().and_then(|name| name.parse().ok());
        number.is_some_and(|number| number != std::process::id())
    });
    processes.map(|entry| entry.path()).filter(|path| has_it(path)).find_map(|path| {
        let name = fs::read_to_string(path.join("comm")).ok()?;
        Some(format!("{} (process {})", name.trim(), path.file_name()?.to_str()?))
    })
}

/// Lists the available serial devices for an error message.
fn available_ports_hint() -> String {
    let names: Vec<String> =
        serialport::available_ports().unwrap_or_default().into_iter().map(|port| port.port_name).collect();
    if names.is_empty() {
        "; no serial devices found".to_string()
    } else {
        format!("; available devices are {}", names.join(", "))
    }
}
