//! Errors of the server's start.

use std::io;

use super::state_lock::LockError;
use crate::ownership::OwnershipError;

/// Errors that prevent the server from listening.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address cannot be bound.
    #[error("cannot serve pages at 127.0.0.1:{port} ({error}): choose another port with --page-port")]
    Address {
        /// Requested port. 0 stands for any free port.
        port: u16,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The sockets that the service manager hands over are not exactly one socket that the pages can use.
    #[error(
        "the service manager must hand over one listening TCP socket of this machine alone (127.0.0.1 or ::1), but \
         {reason}: correct ListenStream in the socket unit"
    )]
    HandedOver {
        /// Reason why the sockets cannot be used.
        reason: String,
    },
    /// Other users can access a file or directory of the service.
    #[error("the files of the service must not be open to other users: {0}")]
    Ownership(#[from] OwnershipError),
    /// Another service uses the data folder.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// A file cannot be used.
    #[error(
        "cannot use {path}: {error}; set XDG_RUNTIME_DIR (folder of the socket) or XDG_STATE_HOME (folder of other \
         files) to a folder of your own"
    )]
    File {
        /// Path of the file.
        path: String,
        /// Error of the operating system.
        error: io::Error,
    },
}
