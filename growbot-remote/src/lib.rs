//! Client of the service that owns robots (`growbot serve`), and the requests and responses that both exchange. This
//! crate knows no server, no database and no terminal.
//!
//! - [`remote_robot`]: a robot of the service; [`client`]: requests to the service, and the events of a job;
//!   [`socket`]: the Unix socket on which it listens; `transport`: HTTP on this socket;
//! - [`emergency`]: the emergency stop by the service and by the port;
//! - [`api`]: the requests and responses.
//!
//! The feature `schema` derives JSON Schemas of the requests and responses.
#![forbid(unsafe_code)]

pub mod api;
pub mod client;
pub mod emergency;
pub mod remote_robot;
pub mod socket;
#[cfg(test)]
mod tests;
mod transport;

/// Path of the API, below the address of the service's page or on the user's socket.
pub const PREFIX: &str = "/api/v1";
