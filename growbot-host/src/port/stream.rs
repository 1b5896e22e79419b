//! A robot at the other end of a TCP connection or a serial line.

use std::fs;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

use super::{Port, PortError};

/// Rate of serial lines, baud.
const BAUD: u32 = 115_200;
/// How long a connection may take.
const CONNECT: Duration = Duration::from_secs(5);

/// A robot at the other end of a stream of bytes.
pub struct Stream {
    name: String,
    bytes: Bytes,
}

enum Bytes {
    Tcp(TcpStream),
    Serial(Box<dyn serialport::SerialPort>),
}

impl Stream {
    /// Connects to `HOST:PORT`.
    ///
    /// # Errors
    /// [`PortError::Unreachable`] with the system's reason.
    pub fn tcp(address: &str) -> Result<Self, PortError> {
        let unreachable = |error: io::Error| PortError::Unreachable(address.to_string(), error.to_string());
        let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
        for candidate in address.to_socket_addrs().map_err(unreachable)? {
            match TcpStream::connect_timeout(&candidate, CONNECT) {
                Ok(stream) => return Self::over(format!("tcp:{address}"), stream).map_err(unreachable),
                Err(error) => last = error,
            }
        }
        Err(unreachable(last))
    }

    /// Takes over a connection that has been made.
    ///
    /// # Errors
    /// If the system refuses to send short messages at once.
    pub fn over(name: String, stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        Ok(Self { name, bytes: Bytes::Tcp(stream) })
    }

    /// Opens a serial device at 115200 baud.
    ///
    /// # Errors
    /// A device that is missing, busy or forbidden.
    pub fn serial(device: &str) -> Result<Self, PortError> {
        let opened = serialport::new(device, BAUD).timeout(Duration::from_millis(100)).open();
        match opened {
            Ok(port) => Ok(Self { name: device.to_string(), bytes: Bytes::Serial(port) }),
            Err(error) => Err(serial_error(device, &error)),
        }
    }

    fn lost(&self, error: &io::Error) -> PortError {
        PortError::Lost(self.name.clone(), error.to_string())
    }
}

fn serial_error(device: &str, error: &serialport::Error) -> PortError {
    let name = device.to_string();
    match error.kind() {
        serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => PortError::Forbidden(name),
        // On Unix a device that is there and locked comes back as "no device".
        serialport::ErrorKind::NoDevice if Path::new(device).exists() => {
            PortError::Busy(name, holder(device).unwrap_or_else(|| "another program".to_string()))
        }
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::Io(io::ErrorKind::NotFound) => {
            PortError::Missing(name, there_are())
        }
        _ => PortError::Missing(name, format!(" ({})", error.description)),
    }
}

/// The program that has a device open, where the system tells: Linux does of this user's programs.
fn holder(device: &str) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    let has_it = |process: &Path| {
        let open = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        open.filter_map(|file| fs::read_link(file.path()).ok()).any(|file| file == device)
    };
    let processes = fs::read_dir("/proc").ok()?.flatten().map(|entry| entry.path());
    processes.filter(|path| has_it(path)).find_map(|path| {
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

/// Whether an error only says that the time is over.
fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl Port for Stream {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        let sent = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.write_all(bytes),
            Bytes::Serial(port) => port.write_all(bytes),
        };
        sent.map_err(|error| self.lost(&error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        // No timeout at all would mean to wait for ever.
        let timeout = timeout.max(Duration::from_millis(1));
        let received = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.set_read_timeout(Some(timeout)).and_then(|()| stream.read(buffer)),
            Bytes::Serial(port) => port.set_timeout(timeout).map_err(io::Error::from).and_then(|()| port.read(buffer)),
        };
        match received {
            Ok(0) => Err(PortError::Lost(self.name.clone(), "the other side closed it".to_string())),
            Ok(count) => Ok(count),
            Err(error) if is_timeout(&error) => Ok(0),
            Err(error) => Err(self.lost(&error)),
        }
    }
}
