//! Drives a growing robot's board.
//!
//! The geometry is in growbot-core. This crate contains what a program needs to plan, grow and record a body:
//!
//! - [`robot_file`]: descriptions of robots, built in or from TOML files;
//! - [`pose_text`]: poses as users type them; [`degrees`]: angles in text form;
//! - [`plan`]: a path with its properties; [`warning`]: reasons against growing it; [`self_collision`]: whether a body
//!   would collide with itself;
//! - [`plan_file`]: plans as JSON, and their checks; [`scene_planning`]: plans past obstacles;
//! - [`port`]: the line to a board; [`client`]: requests to it and their responses;
//! - [`stop_signal`]: stops, and the permits that they void;
//! - [`growth`]: a whole job; [`feedback`]: its layers planned again as they are measured; [`arrival`]: the errors at
//!   the goal;
//! - [`maintenance`]: presets of materials, and maintenance commands;
//! - [`run_log`]: the log of a growth, its events and its result; [`run_clock`]: its time; [`forecast`]: its finish
//!   time;
//! - [`input`], [`atomic_file`], [`sanitize`], [`suggest`]: bounded reading, atomic writing, text without control
//!   characters, and suggestions for mistyped names.
//!
//! The feature `schema` derives JSON Schemas of plans, run logs and results.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod arrival;
pub mod atomic_file;
pub mod clearance_guard;
pub mod client;
pub mod crash;
pub mod degrees;
pub mod feedback;
pub mod forecast;
pub mod growth;
pub mod input;
pub mod maintenance;
pub mod margin;
pub mod plan;
pub mod plan_deviation;
pub mod plan_file;
pub mod port;
pub mod pose_text;
pub mod robot_file;
pub mod run_clock;
pub mod run_log;
pub mod sanitize;
pub mod scene_planning;
pub mod self_collision;
pub mod stop_signal;
pub mod suggest;
pub mod warning;
pub mod waypoints;
