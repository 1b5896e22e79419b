//! A robot at the other end of a TCP connection or a serial line.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use growbot_core::link::emergency_stop::EMERGENCY_STOP;

use super::serial::Serial;
use super::{Port, PortError};

/// Timeout of a connection attempt.
const CONNECT: Duration = Duration::from_secs(5);
/// Time after which a connection that accepts no byte is given up.
const STALLED: Duration = Duration::from_secs(2);

/// A robot at the other end of a stream of bytes.
pub struct Stream {
    name: String,
    bytes: Bytes,
    /// True if an emergency stop of this program has taken the line.
    emergency: Arc<AtomicBool>,
    /// True if this is the end that the emergency stop uses.
    is_for_emergency: bool,
}

enum Bytes {
    Tcp(TcpStream),
    Serial(Serial),
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

    /// Connects within a time limit, which includes the resolution of the name.
    ///
    /// # Errors
    /// Like [`Stream::tcp`], or if the time is over.
    pub fn tcp_within(address: &str, limit: Duration) -> Result<Self, PortError> {
        let (made, connection) = mpsc::channel();
        let name = address.to_string();
        // The thread ends by itself even if nothing waits for the result.
        thread::spawn(move || made.send(Self::tcp(&name)));
        connection.recv_timeout(limit).unwrap_or_else(|_| {
            Err(PortError::Unreachable(
                address.to_string(),
                format!("no connection within {:.1} s", limit.as_secs_f64()),
            ))
        })
    }

    /// Wraps an existing connection.
    ///
    /// # Errors
    /// If the system refuses to send short messages immediately.
    pub fn over(name: String, stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(STALLED))?;
        Ok(Self::new(name, Bytes::Tcp(stream)))
    }

    /// Opens a serial device, unless another growbot holds it.
    ///
    /// # Errors
    /// Like [`Serial::open`].
    pub fn serial(device: &str) -> Result<Self, PortError> {
        Ok(Self::new(device.to_string(), Bytes::Serial(Serial::open(device)?)))
    }

    /// Opens a serial device for the emergency stop, whether or not another program holds it.
    ///
    /// # Errors
    /// Like [`Serial::open_for_emergency_stop`].
    pub fn serial_for_emergency_stop(device: &str) -> Result<Self, PortError> {
        Ok(Self::new(device.to_string(), Bytes::Serial(Serial::open_for_emergency_stop(device)?)))
    }

    fn new(name: String, bytes: Bytes) -> Self {
        Self { name, bytes, emergency: Arc::default(), is_for_emergency: false }
    }

    fn lost(&self, error: &io::Error) -> PortError {
        PortError::Lost(self.name.clone(), error.to_string())
    }

    /// Reports whether the line is left to the emergency stop of another thread.
    fn is_left_to_emergency(&self) -> bool {
        !self.is_for_emergency && self.emergency.load(Ordering::Relaxed)
    }

    /// Leaves the line to the emergency stop of another thread, which ends the program once it is finished.
    fn block_if_yielded(&self) {
        while self.is_left_to_emergency() {
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// Silences all other ends of this line in this program.
    fn take_line(&self) {
        if self.is_for_emergency {
            self.emergency.store(true, Ordering::Relaxed);
        }
    }

    fn try_clone(&self) -> io::Result<Self> {
        let bytes = match &self.bytes {
            Bytes::Tcp(stream) => Bytes::Tcp(stream.try_clone()?),
            Bytes::Serial(serial) => Bytes::Serial(serial.try_clone()?),
        };
        let emergency = Arc::clone(&self.emergency);
        Ok(Self { name: self.name.clone(), bytes, emergency, is_for_emergency: true })
    }
}

/// Reports whether an error only means that the timeout is over.
fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl Port for Stream {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.block_if_yielded();
        let emergency = &self.emergency;
        let sent = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.write_all(bytes),
            Bytes::Serial(serial) => serial.send(bytes, || emergency.load(Ordering::Relaxed)),
        };
        self.block_if_yielded();
        sent.map_err(|error| self.lost(&error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.block_if_yielded();
        // A timeout of zero would mean to wait for ever.
        let timeout = timeout.max(Duration::from_millis(1));
        let (emergency, leaves) = (&self.emergency, !self.is_for_emergency);
        let received = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.set_read_timeout(Some(timeout)).and_then(|()| stream.read(buffer)),
            Bytes::Serial(serial) => {
                let received = serial.receive(buffer, timeout, || leaves && emergency.load(Ordering::Relaxed));
                received.and_then(|count| count.ok_or_else(|| io::ErrorKind::WouldBlock.into()))
            }
        };
        self.block_if_yielded();
        match received {
            Ok(0) => Err(PortError::Lost(self.name.clone(), "the other side closed the connection".to_string())),
            Ok(count) => Ok(count),
            Err(error) if is_timeout(&error) => Ok(0),
            Err(error) => Err(self.lost(&error)),
        }
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.take_line();
        self.block_if_yielded();
        let sent = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.write_all(&EMERGENCY_STOP),
            Bytes::Serial(serial) => serial.send_ahead(&EMERGENCY_STOP),
        };
        sent.map_err(|error| self.lost(&error))
    }

    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        // Without this port, an interrupted program advises to cut the power.
        self.try_clone().ok().map(|line| Box::new(line) as Box<dyn Port + Send>)
    }
}
