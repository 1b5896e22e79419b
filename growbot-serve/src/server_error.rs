//! Errors of the server's start.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use growbot_plan::ownership::OwnershipError;

use super::state_lock::LockError;

/// Errors that prevent the server from listening.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address cannot be bound.
    #[error("cannot serve pages at 127.0.0.1:{port} ({error}): choose another port")]
    Address {
        /// Requested port. 0 stands for any free port.
        port: u16,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The sockets that the service manager hands over are not exactly one socket that the pages can use.
    #[error(
        "the service manager must hand over one listening TCP socket of this machine alone (127.0.0.1 or ::1), but \
         {0}: correct ListenStream in the socket unit"
    )]
    HandedOver(#[from] HandOverError),
    /// Other users can access a file or directory of the service.
    #[error("the files of the service must not be open to other users: {0}")]
    Ownership(#[from] OwnershipError),
    /// Another service uses the data folder.
    #[error("{0}")]
    Lock(#[from] LockError),
    /// A file cannot be used.
    #[error(
        "cannot use {path}: {error}; set XDG_RUNTIME_DIR (folder of the socket) or XDG_STATE_HOME (folder of other \
         files) to a folder of your own", path = .path.display()
    )]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
}

/// Reason why the sockets that the service manager hands over cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum HandOverError {
    /// There is this number of sockets.
    #[error("there are {0} sockets")]
    Count(usize),
    /// The socket cannot be used.
    #[error("{0}")]
    Socket(io::Error),
    /// The socket listens at this address.
    #[error("the socket listens at {0}, which other machines can reach")]
    Reachable(SocketAddr),
}
