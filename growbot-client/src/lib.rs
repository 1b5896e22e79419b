//! Client of the board of a growing robot: plans a body, sends its layers to the board, follows the growth and records
//! it.
//!
//! The geometry is in growbot-core. The modules of this crate:
//!
//! - [`robot_file`]: descriptions of robots, built in or from TOML files;
//! - [`pose_text`]: poses as users type them; [`degrees`]: angles in text form;
//! - [`plan`]: a path with its properties; [`waypoints`]: the planning of a path through several goals; [`warning`]:
//!   reasons against growing a plan; [`self_collision`]: parts of a body that would collide with earlier parts;
//! - [`plan_file`]: plans as JSON, and their checks; [`scene_planning`]: plans around obstacles;
//! - [`port`]: the serial or TCP connection to a board; [`client`]: requests to the board and their responses;
//! - [`stop_signal`]: stops of a robot, and the permits to heat or move that a stop makes invalid;
//! - [`growth`]: one growth from the first layer to the last; [`feedback`]: new plans of the remaining layers from
//!   measurements; [`arrival`]: the errors of the tip at the goal; [`ground_truth`]: the body that a simulated tip has
//!   really laid;
//! - [`maintenance`]: presets of materials, and maintenance commands;
//! - [`run_log`]: the log of a growth, with its events and its result; [`run_clock`]: the time since a growth began;
//!   [`forecast`]: the expected finish time of a growth;
//! - [`input`], [`atomic_file`], [`sanitize`], [`suggest`], [`user_dirs`]: bounded reading, atomic writing, text without
//!   control characters, suggestions for mistyped names, and the user's directories.
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
pub mod ground_truth;
pub mod growth;
pub mod input;
pub mod maintenance;
pub mod margin;
pub mod plan;
pub mod plan_deviation;
pub mod plan_file;
pub mod port;
pub mod pose_text;
pub mod remedy;
pub mod robot_file;
pub mod run_clock;
pub mod run_log;
pub mod sanitize;
pub mod scene_planning;
pub mod self_collision;
pub mod stop_signal;
pub mod suggest;
pub mod user_dirs;
pub mod warning;
pub mod waypoints;
