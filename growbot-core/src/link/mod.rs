//! The link between host and board: frames of bytes, and the messages in them. PROTOCOL.md is the specification.

pub mod crash;
mod driver_report;
pub mod emergency_stop;
mod fault;
pub mod frame;
pub mod message;
mod reset_cause;
mod state;
