//! Client of the service that owns robots (`growbot serve`), and the requests and responses that both exchange. This
//! crate knows no server, no database and no terminal.
//!
//! - [`client`]: requests to the service; [`socket`]: the Unix socket on which it listens;
//! - [`commands`]: commands to a robot; [`grow_request`]: the request for a job; [`job`]: a job and its state;
//!   [`page_urls`]: the URLs of the service's page.
//!
//! The feature `schema` derives JSON Schemas of the requests and responses.
#![forbid(unsafe_code)]

pub mod client;
pub mod commands;
pub mod grow_request;
pub mod job;
pub mod page_urls;
pub mod socket;

/// Path of the API, below the address of the service's page or on the user's socket.
pub const PREFIX: &str = "/api/v1";
