//! The listening socket of the pages: handed over by the service manager, or bound by the service itself.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};

use listenfd::ListenFd;

use super::server_error::{HandOverError, ServerError};

/// Takes the socket that systemd, or another service manager with the protocol of systemd (`LISTEN_FDS`), hands over.
/// Returns `None` if nothing is handed over. The function must be called before the process has threads.
///
/// # Errors
/// [`ServerError::HandedOver`] if anything but one listening TCP socket of the loopback interface is handed over.
pub fn take_handed_over() -> Result<Option<TcpListener>, ServerError> {
    let mut given = ListenFd::from_env();
    match given.len() {
        0 => return Ok(None),
        1 => {}
        count => return Err(HandOverError::Count(count).into()),
    }
    let listener = given.take_tcp_listener(0).map_err(HandOverError::Socket)?;
    let Some(listener) = listener else { return Ok(None) };
    let address = listener.local_addr().map_err(HandOverError::Socket)?;
    if !address.ip().is_loopback() {
        return Err(HandOverError::Reachable(address).into());
    }
    Ok(Some(listener))
}

/// Returns the listener of the pages: the handed-over socket, otherwise a new socket at this port of the loopback
/// interface. Port 0 stands for any free port.
///
/// # Errors
/// [`ServerError::Address`].
pub async fn listen(handed_over: Option<TcpListener>, port: u16) -> Result<tokio::net::TcpListener, ServerError> {
    let failed = |error: io::Error| ServerError::Address { port, error };
    let Some(listener) = handed_over else {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        return tokio::net::TcpListener::bind(address).await.map_err(failed);
    };
    listener.set_nonblocking(true).and_then(|()| tokio::net::TcpListener::from_std(listener)).map_err(failed)
}
