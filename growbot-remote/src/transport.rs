//! HTTP of `ureq` on a Unix socket.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};
use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::{Buffers, ConnectionDetails, Connector, LazyBuffers, NextTimeout, Transport};
use ureq::{Agent, Error};

/// Connects to a Unix socket. Does not wait: a program that accepts no connections is an error.
///
/// # Errors
/// No program listens on the socket, or its queue of new connections is full.
pub fn connect_unix(path: &Path) -> io::Result<UnixStream> {
    let socket =
        socket_with(AddressFamily::UNIX, SocketType::STREAM, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK, None)?;
    connect(&socket, &SocketAddrUnix::new(path)?)?;
    let stream = UnixStream::from(socket);
    stream.set_nonblocking(false)?;
    Ok(stream)
}

/// Returns an agent for one request on this stream. `total` is the time limit of the request with its response, and
/// `wait` the limit of each wait for a part of it.
pub fn agent_on(stream: UnixStream, total: Option<Duration>, wait: Duration) -> Agent {
    // The proxies of the environment are for other machines.
    let config = Agent::config_builder().proxy(None).http_status_as_error(false).timeout_global(total);
    let config = config.timeout_per_read(Some(wait)).timeout_per_write(Some(wait)).build();
    Agent::with_parts(config, StreamConnector(Mutex::new(Some(stream))), NoResolver)
}

/// Connector that uses one stream, once.
#[derive(Debug)]
struct StreamConnector(Mutex<Option<UnixStream>>);

impl Connector for StreamConnector {
    type Out = StreamTransport;

    fn connect(&self, details: &ConnectionDetails, _: Option<()>) -> Result<Option<StreamTransport>, Error> {
        let buffers = LazyBuffers::new(details.config.input_buffer_size(), details.config.output_buffer_size());
        let stream = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        Ok(stream.map(|stream| StreamTransport { stream, buffers }))
    }
}

/// Resolver that finds no addresses, because a connected stream needs none.
#[derive(Debug)]
struct NoResolver;

impl Resolver for NoResolver {
    fn resolve(&self, _: &Uri, _: &Config, _: NextTimeout) -> Result<ResolvedSocketAddrs, Error> {
        Ok(self.empty())
    }
}

#[derive(Debug)]
struct StreamTransport {
    stream: UnixStream,
    buffers: LazyBuffers,
}

impl Transport for StreamTransport {
    fn buffers(&mut self) -> &mut dyn Buffers {
        &mut self.buffers
    }

    fn transmit_output(&mut self, amount: usize, timeout: NextTimeout) -> Result<(), Error> {
        let timeout = timeout.for_write();
        self.stream.set_write_timeout(timeout.not_zero().as_deref().copied())?;
        match self.stream.write_all(&self.buffers.output()[..amount]) {
            // The service has refused the request before it has read all of it. Its response can be read.
            Err(error) if matches!(error.kind(), ErrorKind::BrokenPipe | ErrorKind::ConnectionReset) => Ok(()),
            sent => sent.map_err(|error| timed_error(error, timeout)),
        }
    }

    fn await_input(&mut self, timeout: NextTimeout) -> Result<bool, Error> {
        let timeout = timeout.for_read();
        self.stream.set_read_timeout(timeout.not_zero().as_deref().copied())?;
        let received = loop {
            match self.stream.read(self.buffers.input_append_buf()) {
                // A signal has interrupted the read.
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                received => break received.map_err(|error| timed_error(error, timeout))?,
            }
        };
        self.buffers.input_appended(received);
        Ok(received > 0)
    }

    fn is_open(&mut self) -> bool {
        // Each request has a connection of its own.
        false
    }
}

/// Returns the error of a read or write with this timeout.
fn timed_error(error: io::Error, timeout: NextTimeout) -> Error {
    let is_late = matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut);
    if is_late { Error::Timeout(timeout.reason) } else { error.into() }
}
