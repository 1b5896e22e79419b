//! Ports of the operating system: TCP connections and serial devices.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::serial::Serial;
use super::{Port, PortError};

/// Timeout of a connection attempt.
const CONNECT: Duration = Duration::from_secs(5);
/// Maximum time for which a TCP connection may accept no byte to send. Then the connection counts as lost.
const STALLED: Duration = Duration::from_secs(2);
/// Timeout of a read after bytes have arrived. It is not zero, because a timeout of zero is not valid for a socket.
const AT_ONCE: Duration = Duration::from_millis(1);
/// Interval at which a stream that is blocked by an emergency stop of another thread polls whether that stop is over.
const YIELD_POLL_INTERVAL: Duration = Duration::from_millis(5);

/// A TCP connection or a serial device as a [`Port`].
pub struct Stream {
    name: String,
    bytes: Bytes,
    /// Number of streams on this connection that are sending an emergency stop. All streams of the connection share it.
    emergencies: Arc<AtomicU32>,
    role: StreamRole,
}

/// Use of a stream. Several streams may share one connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum StreamRole {
    /// The stream carries requests and responses. It blocks while an emergency stop is being sent.
    Requests,
    /// The stream is for an emergency stop, which has not been sent.
    Emergency,
    /// The stream is sending an emergency stop. Streams for requests block until this stream is dropped.
    ActiveEmergency,
}

enum Bytes {
    Tcp(TcpStream),
    Serial(Serial),
}

impl Stream {
    /// Connects to a TCP address `HOST:PORT`.
    ///
    /// # Errors
    /// [`PortError::Unreachable`] with the reason of the operating system.
    pub fn tcp(address: &str) -> Result<Self, PortError> {
        let unreachable = |error: io::Error| PortError::Unreachable(address.to_string(), error.to_string());
        let mut last = io::Error::new(io::ErrorKind::NotFound, "the host name has no network address");
        for candidate in address.to_socket_addrs().map_err(unreachable)? {
            match TcpStream::connect_timeout(&candidate, CONNECT) {
                Ok(stream) => return Self::over(format!("tcp:{address}"), stream).map_err(unreachable),
                Err(error) => last = error,
            }
        }
        Err(unreachable(last))
    }

    /// Connects to a TCP address within a time limit, which includes the resolution of the host's name.
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

    /// Creates a port from an existing TCP connection. `name` is its name in error messages.
    ///
    /// # Errors
    /// If the system refuses to send short messages immediately.
    pub fn over(name: String, stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(STALLED))?;
        Ok(Self::new(name, Bytes::Tcp(stream)))
    }

    /// Opens a serial device, unless another growbot command uses it.
    ///
    /// # Errors
    /// Like [`Serial::open`].
    pub fn serial(device: &str) -> Result<Self, PortError> {
        Ok(Self::new(device.to_string(), Bytes::Serial(Serial::open(device)?)))
    }

    /// Opens a serial device for the emergency stop, even if another growbot command uses it.
    ///
    /// # Errors
    /// Like [`Serial::open_for_emergency_stop`].
    pub fn serial_for_emergency_stop(device: &str) -> Result<Self, PortError> {
        Ok(Self::new(device.to_string(), Bytes::Serial(Serial::open_for_emergency_stop(device)?)))
    }

    fn new(name: String, bytes: Bytes) -> Self {
        Self { name, bytes, emergencies: Arc::default(), role: StreamRole::Requests }
    }

    fn lost(&self, error: io::Error) -> PortError {
        PortError::Lost(self.name.clone(), error)
    }

    /// Reports whether this stream must block, because another stream is sending an emergency stop on the connection.
    fn is_left_to_emergency(&self) -> bool {
        self.role == StreamRole::Requests && self.emergencies.load(Ordering::SeqCst) > 0
    }

    /// Blocks while other streams are sending an emergency stop on this connection, until these streams are dropped.
    fn block_if_yielded(&self) {
        while self.is_left_to_emergency() {
            thread::sleep(YIELD_POLL_INTERVAL);
        }
    }

    /// Makes all streams for requests on this connection block until this emergency-stop stream is dropped.
    fn take_line(&mut self) {
        if self.role == StreamRole::Emergency {
            self.role = StreamRole::ActiveEmergency;
            self.emergencies.fetch_add(1, Ordering::SeqCst);
        }
    }

    fn try_clone(&self) -> io::Result<Self> {
        let bytes = match &self.bytes {
            Bytes::Tcp(stream) => Bytes::Tcp(stream.try_clone()?),
            Bytes::Serial(serial) => Bytes::Serial(serial.try_clone()?),
        };
        let emergencies = Arc::clone(&self.emergencies);
        Ok(Self { name: self.name.clone(), bytes, emergencies, role: StreamRole::Emergency })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if self.role == StreamRole::ActiveEmergency {
            self.emergencies.fetch_sub(1, Ordering::SeqCst);
        }
    }
}

/// Waits until bytes have arrived. Returns an error after the timeout.
fn wait_for_bytes(stream: &TcpStream, timeout: Duration) -> io::Result<()> {
    let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
    match poll(&mut [PollFd::new(stream, PollFlags::IN)], Some(&timeout)) {
        Ok(0) => Err(io::ErrorKind::WouldBlock.into()),
        Ok(_) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Reports whether an error means only that no bytes arrived within the timeout.
fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl Port for Stream {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.block_if_yielded();
        let (emergencies, yields) = (&self.emergencies, self.role == StreamRole::Requests);
        let sent = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.write_all(bytes),
            Bytes::Serial(serial) => serial.send(bytes, || yields && emergencies.load(Ordering::SeqCst) > 0),
        };
        self.block_if_yielded();
        sent.map_err(|error| self.lost(error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.block_if_yielded();
        let (emergencies, yields) = (&self.emergencies, self.role == StreamRole::Requests);
        let received = match &mut self.bytes {
            Bytes::Tcp(stream) => wait_for_bytes(stream, timeout).and_then(|()| {
                // Bytes that arrive during an emergency stop are read by the stream that sends the stop.
                match yields && emergencies.load(Ordering::SeqCst) > 0 {
                    true => Err(io::ErrorKind::WouldBlock.into()),
                    false => stream.set_read_timeout(Some(AT_ONCE)).and_then(|()| stream.read(buffer)),
                }
            }),
            Bytes::Serial(serial) => {
                let received = serial.receive(buffer, timeout, || yields && emergencies.load(Ordering::SeqCst) > 0);
                received.and_then(|count| count.ok_or_else(|| io::ErrorKind::WouldBlock.into()))
            }
        };
        self.block_if_yielded();
        match received {
            Ok(0) => {
                let closed = io::Error::new(io::ErrorKind::UnexpectedEof, "the other end closed the connection");
                Err(self.lost(closed))
            }
            Ok(count) => Ok(count),
            Err(error) if is_timeout(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.take_line();
        self.block_if_yielded();
        let sent = match &mut self.bytes {
            Bytes::Tcp(stream) => stream.write_all(&EMERGENCY_STOP),
            Bytes::Serial(serial) => serial.send_ahead(&EMERGENCY_STOP),
        };
        sent.map_err(|error| self.lost(error))
    }

    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        // If this fails, a program that is interrupted advises its user to cut the power.
        self.try_clone().ok().map(|line| Box::new(line) as Box<dyn Port + Send>)
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::sync::mpsc::RecvTimeoutError;

    use super::*;

    /// Tests a server that accepts only one connection, as a robot at a TCP port does.
    #[test]
    fn an_emergency_stop_uses_the_open_connection_and_returns_it() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut line = Stream::tcp(&listener.local_addr().unwrap().to_string()).unwrap();
        let (mut board, _) = listener.accept().unwrap();
        let mut receive = [0; 8];
        for _ in 0..3 {
            let mut stop = line.emergency_port().unwrap();
            // The stream for requests is already receiving. It does not read bytes that arrive during the stop.
            let ((received, arrived), (begins, begun)) = (mpsc::channel(), mpsc::channel());
            let worker = thread::spawn(move || {
                begins.send(()).unwrap();
                let mut bytes = [0; 8];
                let mut count = 0;
                while count == 0 {
                    count = line.receive(&mut bytes, CONNECT).unwrap();
                }
                received.send(bytes.get(..count).unwrap().to_vec()).unwrap();
                line
            });
            begun.recv().unwrap();
            // Without this time the thread would wait for the end of the stop before it waits for bytes.
            thread::sleep(20 * YIELD_POLL_INTERVAL);
            stop.send_emergency_stop().unwrap();
            board.read_exact(&mut receive).unwrap();
            assert_eq!(receive, EMERGENCY_STOP);
            board.write_all(b"off").unwrap();
            let mut bytes = [0; 8];
            // The thread would read them first.
            thread::sleep(20 * YIELD_POLL_INTERVAL);
            assert_eq!(stop.receive(&mut bytes, CONNECT).unwrap(), 3);
            assert_eq!(arrived.recv_timeout(Duration::ZERO), Err(RecvTimeoutError::Timeout));
            drop(stop);
            board.write_all(b"on").unwrap();
            assert_eq!(arrived.recv_timeout(CONNECT).unwrap(), b"on");
            line = worker.join().unwrap();
        }
    }
}
