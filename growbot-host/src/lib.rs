//! The library of the `growbot` command.
//!
//! Plans and run logs are in growbot-plan, boards and growths in growbot-client, simulated robots in growbot-sim,
//! pages, pictures and exports in growbot-pictures, the service in growbot-serve, the paper's experiments in
//! growbot-paper. This library contains:
//!
//! - [`settings`]: settings for all commands, such as the default robot and port
//! - [`annotated_robot`]: explanation of a robot
//! - [`robot_questions`]: creation of a robot file
//! - [`schema`]: JSON Schemas of files
//! - [`crash`]: source locations of a firmware crash
//! - [`progress`]: display of progress
//! - [`output`]: results on standard output
//! - [`messages`]: messages on standard error
//! - [`text_wrap`]: line breaks in texts
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in all texts and files. Names carry the unit.
#![forbid(unsafe_code)]

pub mod annotated_robot;
pub mod clock_text;
pub mod crash;
pub mod messages;
pub mod output;
pub mod progress;
pub mod robot_questions;
pub mod schema;
pub mod settings;
pub mod text_wrap;

/// The book's chapter about the libraries. Its code is compiled and run as doctests.
#[cfg(doctest)]
#[doc = include_str!("../../book/src/libraries.md")]
pub struct Libraries;
