//! A serial device: raw bytes at 115200 baud.
//!
//! Growbot's commands share devices by an advisory lock (`flock`): who has it has the device. The emergency stop does
//! not ask for it, and no command takes a device in a way that would keep it out (`TIOCEXCL`): it opens the device
//! beside the command that holds it.
//!
//! Two programs that read one device each get some of the bytes. So the emergency stop has a lock of its own, on the
//! device's bytes (`fcntl`): while it is there, the holder of the device reads nothing, and the board's acknowledgement
//! is heard by who waits for it.

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
/// A device that takes no byte for so long is given up.
const STALLED: Duration = Duration::from_secs(2);
/// For so long an emergency stop waits at a device that takes nothing; then it is sent again.
const EMERGENCY_WAIT: Duration = Duration::from_millis(100);
/// A holder looks so often whether the emergency stop of another program is over, and that one tries so often to have
/// the holder's silence,
const SILENCE_LOOK: Duration = Duration::from_millis(2);
/// so many times.
const SILENCE_TRIES: u32 = 10;

/// An open serial device. It never blocks for longer than the requested wait.
pub struct Serial {
    file: File,
    /// It is the emergency stop's, which others are silent for.
    is_for_emergency: bool,
}

impl Serial {
    /// Opens a device for this program, as far as growbot's commands go.
    ///
    /// # Errors
    /// A device that is missing, busy or forbidden, or is none.
    pub fn open(device: &str) -> Result<Self, PortError> {
        let serial = Self::open_beside(device, false)?;
        match serial.file.try_lock() {
            Ok(()) => {}
            Err(fs::TryLockError::WouldBlock) => return Err(PortError::Busy(device.to_string(), holder(device))),
            Err(fs::TryLockError::Error(error)) => return Err(unusable(device, &error)),
        }
        serial.set_up().map_err(|error| unusable(device, &error))?;
        Ok(serial)
    }

    /// Opens a device whether or not another program holds it: for the emergency stop alone.
    ///
    /// # Errors
    /// As [`Serial::open`], but busy only where another program than growbot's has closed the device to all others.
    pub fn open_for_emergency_stop(device: &str) -> Result<Self, PortError> {
        let serial = Self::open_beside(device, true)?;
        serial.set_up().map_err(|error| unusable(device, &error))?;
        for _ in 0..SILENCE_TRIES {
            // Without it the acknowledgement may need another stop or two.
            if fcntl_lock(&serial.file, FlockOperation::NonBlockingLockExclusive).is_ok() {
                break;
            }
            sleep(SILENCE_LOOK);
        }
        Ok(serial)
    }

    /// Whether the emergency stop of another program wants to hear what the board says.
    fn is_to_be_silent(&self) -> bool {
        if self.is_for_emergency {
            return false;
        }
        match fcntl_lock(&self.file, FlockOperation::NonBlockingLockShared) {
            Ok(()) => {
                // Fails as little as taking it.
                let _ = fcntl_lock(&self.file, FlockOperation::NonBlockingUnlock);
                false
            }
            Err(error) => matches!(error, Errno::AGAIN | Errno::ACCESS),
        }
    }

    fn open_beside(device: &str, is_for_emergency: bool) -> Result<Self, PortError> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        match rustix::fs::open(device, flags, Mode::empty()) {
            Ok(file) => Ok(Self { file: file.into(), is_for_emergency }),
            Err(Errno::BUSY) => Err(PortError::Closed(device.to_string(), holder(device))),
            Err(error) => Err(unusable(device, &error.into())),
        }
    }

    /// Raw bytes, 8N1, no flow control, no modem lines.
    fn set_up(&self) -> io::Result<()> {
        let mut settings = tcgetattr(&self.file)?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB;
        settings.set_speed(BAUD)?;
        Ok(tcsetattr(&self.file, OptionalActions::Now, &settings)?)
    }

    /// The same device for the emergency stop of another thread.
    ///
    /// # Errors
    /// The system has no more files to give.
    pub fn try_clone(&self) -> io::Result<Self> {
        Ok(Self { file: self.file.try_clone()?, is_for_emergency: true })
    }

    /// Sends bytes. `gives_up` is asked every 100 ms while the device takes none.
    ///
    /// # Errors
    /// The device is gone, takes no byte for two seconds, or `gives_up` says so.
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
                        return Err(io::Error::new(ErrorKind::TimedOut, "it takes no more bytes"));
                    }
                    self.wait(PollFlags::OUT, EMERGENCY_WAIT)?;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Sends bytes in one write, ahead of all that waits to be sent, which is dropped.
    ///
    /// # Errors
    /// The device is gone, or does not take them as a whole within 100 ms.
    pub fn send_ahead(&mut self, bytes: &[u8]) -> io::Result<()> {
        // What was queued was asked for before the emergency, and the rest of a frame would only be in the way. Both
        // may fail on a device that has no queue: the write tells.
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
            return Err(io::Error::new(ErrorKind::TimedOut, "it takes no more bytes"));
        }
        Ok(())
    }

    /// Waits for bytes. None where the time is over, where another program has read them first, or where they are to be
    /// left to another thread, as `leaves` says once there are some.
    ///
    /// # Errors
    /// The device is gone.
    pub fn receive(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
        leaves: impl Fn() -> bool,
    ) -> io::Result<Option<usize>> {
        let began = Instant::now();
        self.wait(PollFlags::IN, timeout)?;
        while self.is_to_be_silent() {
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

    /// Waits until the device is ready, or the time is over.
    fn wait(&self, for_what: PollFlags, timeout: Duration) -> io::Result<()> {
        let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
        match poll(&mut [PollFd::new(&self.file, for_what)], Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Whether an error only says that nothing can be read or written now.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Why a device cannot be used.
fn unusable(device: &str, error: &io::Error) -> PortError {
    let name = device.to_string();
    match error.kind() {
        ErrorKind::PermissionDenied => PortError::Forbidden(name),
        ErrorKind::NotFound => PortError::Missing(name, there_are()),
        _ => PortError::Missing(name, format!(" ({error})")),
    }
}

/// The program that has a device open.
fn holder(device: &str) -> String {
    found_holder(device).unwrap_or_else(|| "another program".to_string())
}

/// The same where the system tells: Linux does of this user's programs.
fn found_holder(device: &str) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    let has_it = |process: &Path| {
        let open = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        open.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file == device)
    };
    let processes = fs::read_dir("/proc").ok()?.flatten().filter(|entry| {
        // Not `self`, and not this program by its number.
        let number: Option<u32> = entry.file_name().to_str().and_then(|name| name.parse().ok());
        number.is_some_and(|number| number != std::process::id())
    });
    processes.map(|entry| entry.path()).filter(|path| has_it(path)).find_map(|path| {
        let name = fs::read_to_string(path.join("comm")).ok()?;
        Some(format!("{} (process {})", name.trim(), path.file_name()?.to_str()?))
    })
}

/// The serial devices that there are, to choose from.
fn there_are() -> String {
    let names: Vec<String> =
        serialport::available_ports().unwrap_or_default().into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "; I see no serial device".to_string() } else { format!("; I see {}", names.join(", ")) }
}
