//! The library behind the `growbot` command.
//!
//! The geometry is growbot-core's; here are the files, texts and streams around it:
//!
//! - [`robot_file`]: descriptions of robots, built in or from TOML files; [`robot_explained`], in words; [`robot_questions`], for a new one; their [`schema`];
//! - [`pose_text`]: poses as people type them;
//! - [`plan`]: a path with all that is said about it, and [`warning`], what speaks against growing it;
//! - [`clearance`]: whether a body would run into itself;
//! - [`plan_file`] and [`plan_check`]: plans as JSON, and what is checked before one is believed;
//! - [`workspace`]: which goals are within reach, in numbers and as a picture;
//! - [`batch`]: many plans from a CSV stream;
//! - [`reproduce`]: the experiments of the paper, done again, with page and figures;
//! - [`layer_table`]: the layers of a plan as CSV; [`view`]: a body in a page to look at, or in a picture; [`drawing`], what pictures are drawn with; [`export`]: bodies as STL, GLB, CSV and MCAP;
//! - [`port`]: where a robot is: simulated here, emulated, or at the end of a line; [`tip`], what a simulated one does, and [`truth`], what it has really laid;
//! - [`client`]: requests to its board and their answers; [`growth`], a whole job; [`arrival`], how near it came; [`run_log`], and its time, [`run_clock`];
//! - [`image_seal`]: firmware images get their seal; [`crash`]: where in an image the firmware crashed;
//! - [`watch`]: a growth under way, as a page on this machine;
//! - [`simulation`]: growth without a robot, with what goes wrong, once or a million times;
//! - [`input`], [`output`], [`printable`], [`progress`], [`parallel`]: bounded reading, whole files or none, pipes that close, text that
//!   steers no terminal, progress, all cores.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod arrival;
pub mod batch;
pub mod clearance;
pub mod client;
pub mod crash;
pub mod degrees;
pub mod drawing;
pub mod export;
pub mod feedback;
pub mod growth;
pub mod image_seal;
pub mod input;
pub mod layer_table;
pub mod nearest;
pub mod output;
pub mod parallel;
pub mod plan;
pub mod plan_check;
pub mod plan_file;
pub mod port;
pub mod pose_text;
pub mod printable;
pub mod progress;
pub mod reproduce;
pub mod robot_explained;
pub mod robot_file;
pub mod robot_questions;
pub mod run_clock;
pub mod run_log;
pub mod schema;
pub mod simulation;
pub mod tip;
pub mod truth;
pub mod view;
pub mod warning;
pub mod watch;
pub mod workspace;

/// The book's chapter about the libraries: its code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../book/src/libraries.md")]
pub struct Libraries;
