//! Client of the board of a growing robot: sends it the layers of a plan and follows the growth. This crate knows no
//! HTTP, no database and no terminal.
//!
//! Plans, robots and run logs are in growbot-plan. The modules of this crate:
//!
//! - [`port`]: the serial or TCP connection to a board; [`client`]: requests to the board and their responses;
//! - [`stop_signal`]: stops of a robot, and the permits to heat or move that a stop makes invalid;
//! - [`growth`]: one growth from the first layer to the last; [`ground_truth`]: the body that a simulated tip has
//!   really laid;
//! - [`status`]: the status of a robot, for every program; [`recovery`]: the steps by which a person brings a robot out
//!   of a fault, a stop, a pause or a runout;
//! - [`robot_command`]: commands to a robot and what they have done; [`maintenance`]: presets of materials, and
//!   maintenance commands; [`command_report`]: the reports of commands as JSON; [`commissioning_report`]: the findings
//!   about a new robot.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod client;
pub mod command_report;
pub mod commissioning_report;
pub mod ground_truth;
pub mod growth;
pub mod maintenance;
pub mod port;
pub mod procedure;
pub mod recovery;
pub mod robot_command;
pub mod status;
pub mod stop_signal;
