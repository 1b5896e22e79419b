//! The library behind the `growbot` command: what it shows and writes.
//!
//! Boards, growths, plans and run logs are growbot-client's, simulated robots growbot-sim's; here is what the command
//! does with them:
//!
//! - [`settings`]: robot and port of commands that are given none;
//! - [`robot_explained`]: a robot in words; [`robot_questions`]: a new one; [`schema`]: what robot files may hold;
//! - [`batch`]: many plans from a CSV stream; [`layer_table`]: the layers of a plan as CSV;
//! - [`workspace`]: which goals are within reach, in numbers and as a picture;
//! - [`view`]: a body in a page to look at, or in a picture; [`drawing`], what pictures are drawn with; [`watch`]: a
//!   growth under way, as a page on this machine;
//! - [`export`]: bodies as STL, GLB, CSV and MCAP;
//! - [`reproduce`]: the experiments of the paper, done again, with page and figures;
//! - [`serve`]: the service that owns robots; [`switch`]: the switch of simulated ones that stay on;
//! - [`crash`]: where in an image the firmware crashed; [`progress`]: how far something has come; [`output`]: results;
//!   [`messages`]: what else is said; [`duration`], [`figures`]: times and numbers as text.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod batch;
pub mod crash;
pub mod drawing;
pub mod duration;
pub mod export;
pub mod figures;
pub mod finish_time;
pub mod layer_table;
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
pub mod view;
pub mod watch;
pub mod workspace;

/// The book's chapter about the libraries: its code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../book/src/libraries.md")]
pub struct Libraries;
