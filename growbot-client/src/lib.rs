//! Drives a growing robot's board.
//!
//! The geometry is growbot-core's; here is what a program needs to have a body planned, grown and recorded:
//!
//! - [`robot_file`]: descriptions of robots, built in or from TOML files;
//! - [`pose_text`]: poses as people type them, [`degrees`];
//! - [`plan`]: a path with all that is said about it; [`warning`], what speaks against growing it; [`clearance`],
//!   whether a body would run into itself;
//! - [`plan_file`]: plans as JSON, and their checks; [`through_scene`]: plans past obstacles;
//! - [`port`]: the line to a board; [`client`]: requests to it and their answers;
//! - [`growth`]: a whole job; [`feedback`]: its layers planned again as they are measured; [`arrival`]: how near it
//!   came;
//! - [`maintenance`]: presets of materials, and words that become tasks of a board;
//! - [`run_log`]: the log of a growth, its events and its result, and [`run_clock`], its time; [`forecast`], when it is done;
//! - [`input`], [`files`], [`printable`], [`suggest`]: bounded reading, whole files or none, text that steers no
//!   terminal, and names for mistyped ones.
//!
//! The feature `schema` derives JSON Schemas of plans, run logs and results.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod arrival;
pub mod clearance;
pub mod client;
pub mod crash;
pub mod degrees;
pub mod feedback;
pub mod files;
pub mod forecast;
pub mod growth;
pub mod input;
pub mod keep_clear;
pub mod maintenance;
pub mod plan;
pub mod plan_file;
pub mod port;
pub mod pose_text;
pub mod printable;
pub mod robot_file;
pub mod run_clock;
pub mod run_log;
pub mod suggest;
pub mod through_scene;
pub mod warning;
pub mod waypoints;
