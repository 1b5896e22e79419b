//! The library behind the `growbot` command: what it shows and writes.
//!
//! Boards, growths, plans and run logs are in growbot-client, simulated robots in growbot-sim, pages, pictures and
//! exports in growbot-pictures. Here is what the command does with them:
//!
//! - [`settings`]: robot and port of commands that are given none;
//! - [`robot_explained`]: a robot in words; [`robot_questions`]: a new one; [`schema`]: what robot files may hold;
//! - [`batch`]: many plans from a CSV stream;
//! - [`workspace`]: which goals are within reach, in numbers and as a picture;
//! - [`watch`]: a growth under way, as a page on this machine;
//! - [`reproduce`]: the experiments of the paper, done again, with page and figures;
//! - [`serve`]: the service that owns robots; [`switch`]: the switch of simulated ones that stay on;
//! - [`crash`]: where in an image the firmware crashed; [`progress`]: how far something has come; [`output`]: results;
//!   [`messages`]: what else is said.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod batch;
pub mod crash;
pub mod finish_time;
pub mod messages;
pub mod output;
pub mod progress;
pub mod reproduce;
pub mod robot_explained;
pub mod robot_questions;
pub mod schema;
pub mod serve;
pub mod settings;
pub mod switch;
pub mod via_csv;
pub mod watch;
pub mod workspace;

/// The book's chapter about the libraries: its code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../book/src/libraries.md")]
pub struct Libraries;
