//! Plans of bodies and records of growths, as data and files. This crate knows no ports, no boards that respond, no
//! service and no command line.
//!
//! The geometry is in growbot-core. The modules of this crate:
//!
//! - [`robot_file`]: descriptions of robots, built in or from TOML files; [`robot_kind`]: real or
//!   simulated; [`robot_schema`]: the JSON Schema of robot files; [`annotated_robot`]: explanation of a robot;
//!   [`robot_json`]: robots as JSON; [`robot_questions`]: creation of a robot file;
//! - [`pose_text`]: poses as users type them; [`degrees`]: angles in text form;
//! - [`plan`]: a path with its properties; [`waypoints`]: the planning of a path through several goals; [`warning`]:
//!   reasons against growing a plan; [`self_collision`]: parts of a body that would collide with earlier parts;
//! - [`plan_file`]: plans as JSON, and their checks; [`scene_planning`]: plans around obstacles; [`margin`]: the
//!   distance from obstacles that a body needs;
//! - [`batch`]: many plans from a CSV stream; [`via_csv`]: poses from CSV; [`workspace`]: goals within reach;
//! - [`job`]: the layers of a plan for a board, with commands and events; [`feedback`]: new plans of the remaining
//!   layers from measurements; [`clearance_guard`]: the clearance of these plans from obstacles;
//! - [`growth_report`]: the result of a growth; [`arrival`]: the errors of the tip at the goal; [`plan_deviation`]: the
//!   distance of the body from its plan; [`clock_drift`]: the error of a board's clock; [`crash`]: a crash of the
//!   firmware as JSON;
//! - [`run_log`]: the log of a growth, with its events and its result; [`replayed_body`]: the body of a log;
//!   [`tracked_body`]: the body that a board reports; [`run_clock`]: the time since a growth began; [`forecast`]: the
//!   expected finish time of a growth;
//! - [`table`]: tables as CSV, JSON, text and HTML; [`figures`]: numbers as text; [`text_wrap`]: line breaks in texts;
//! - [`file_report`]: reports of written files, as JSON;
//! - [`input`], [`atomic_file`], [`sanitize`], [`suggest`], [`user_dirs`], [`ownership`], [`remedy`], [`parallel`]:
//!   bounded reading, atomic writing, text without control characters, suggestions for mistyped names, the user's
//!   directories, files that another user can change, texts of errors with remedies, and work on all cores.
//!
//! The feature `schema` derives JSON Schemas of robot files, plans, run logs and results. The feature `robot-editing` has
//! the modules that keep the comments of robot files, and the feature `text-wrap` has [`text_wrap`].
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

#[cfg(feature = "robot-editing")]
pub mod annotated_robot;
pub mod arrival;
pub mod atomic_file;
pub mod batch;
pub mod clearance_guard;
pub mod clock_drift;
pub mod continued_body;
pub mod crash;
pub mod degrees;
pub mod feedback;
pub mod figures;
pub mod file_report;
pub mod forecast;
pub mod growth_report;
pub mod hexadecimal;
pub mod input;
pub mod job;
pub mod margin;
pub mod ownership;
pub mod parallel;
pub mod plan;
pub mod plan_deviation;
pub mod plan_file;
pub mod pose_text;
pub mod remedy;
pub mod replayed_body;
pub mod robot_file;
#[cfg(feature = "robot-editing")]
pub mod robot_json;
pub mod robot_kind;
#[cfg(feature = "robot-editing")]
pub mod robot_questions;
#[cfg(feature = "schema")]
pub mod robot_schema;
pub mod run_clock;
pub mod run_log;
pub mod sanitize;
pub mod scene_planning;
pub mod self_collision;
pub mod suggest;
pub mod table;
#[cfg(feature = "text-wrap")]
pub mod text_wrap;
pub mod tracked_body;
pub mod user_dirs;
pub mod via_csv;
pub mod warning;
pub mod waypoints;
pub mod workspace;
