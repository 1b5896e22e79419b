//! The library of the `growbot` command.
//!
//! Plans and run logs are in growbot-plan, boards and growths in growbot-client, simulated robots in growbot-sim,
//! pages, pictures and exports in growbot-pictures, the service in growbot-serve, the paper's experiments in
//! growbot-paper. This library contains:
//!
//! - [`progress`]: display of progress; [`display`]: the last line of the terminal; [`interrupt`]: reactions to Ctrl-C
//! - [`output`]: results on standard output
//! - [`messages`]: messages on standard error
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in all texts and files. Names carry the unit.
#![forbid(unsafe_code)]

pub mod display;
pub mod interrupt;
pub mod messages;
pub mod output;
pub mod progress;

/// The book's chapter about the libraries. Its code is compiled and run as doctests.
#[cfg(doctest)]
#[doc = include_str!("../../book/src/libraries.md")]
pub struct Libraries;
