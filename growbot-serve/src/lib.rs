//! The service: one process that owns robots and handles the requests of programs and pages. This crate knows no
//! command line: the program that runs the service gives it the settings.
//!
//! - [`Service`] holds the robots. `service_context` is the state that their threads share: the jobs, the notices and a
//!   counter of changes.
//! - [`config`] describes the configured robots. `robot_worker` is one robot, with the thread that owns its board.
//!   `robot_request` are the requests to that thread, and `robot_error` has their errors. `connector` opens ports,
//!   `robot_stops` raises and delivers the stops of a robot, and `robot_alerts` sends the notices about it. `stopper`
//!   sends emergency stops, and `stop_file` stores an unconfirmed stop on disk. `job_run` carries out a job on the
//!   board.
//! - `job_store` is a database of all jobs that can be rebuilt from their run logs. `job_updates` are the changes of
//!   the database, and `job_history` corrects it by the run logs and the status of the boards. `audit` records all
//!   commands. `queue_store` has the bodies that wait for a robot.
//! - [`api`] is the HTTP interface: `live_routes`, `job_routes`, `queue_routes`, `plan_routes` and `command_routes`.
//!   `handler` has what they share, and `openapi` completes its OpenAPI document. `stream_event` and `event_stream` are
//!   the streams of events.
//! - `page_source` is the source of the robots and growths that pages show, and `job_pages` makes the service one.
//!   `site` serves such a source to clients, after the checks of their requests.
//! - `page` has the files of the page.
//! - [`server`] listens on the loopback interface, behind `tokens`, and on a socket of the user. `page_access` checks
//!   the tokens, and [`page_listener`] takes a socket from the service manager. `access` are the rights of a client,
//!   `connections` bounds the connections, and `limits` the other resources that clients of each role can use.
//!   `workers` is the thread on which requests other than commands are handled. `state_lock` prevents a second service
//!   from using the same files.
//! - [`notification`] are notifications for users who do not watch a page. `alert` are the conditions that cause them,
//!   `notification_queue` stores them, and `notifier` sends them.
//! - `camera` requests a `picture` from the camera of a robot, and `snapshot_store` stores one of each layer.
//!   `camera_routes` are their routes. `web_address` are the addresses of cameras and of the webhook.
//! - [`watch`] is the live page of one growth. A program without a service shows it for its own growth.
//! - [`settings`] reads the settings files, `growbot.toml`, of which one part is for all commands and the other for the
//!   service. [`settings_paths`] resolves the paths of a settings file. [`known_ports`] lists the ports at which robots
//!   are, or may be.
//!
//! Warnings of the service go to the `log` crate.
#![forbid(unsafe_code)]

mod access;
mod alert;
pub mod api;
mod audit;
mod camera;
mod camera_routes;
mod command_routes;
mod commands;
pub mod config;
mod connections;
mod connector;
mod event_stream;
#[cfg(test)]
mod fake_board;
mod grow_request;
mod handler;
#[cfg(test)]
mod history_tests;
mod job_history;
mod job_pages;
mod job_routes;
mod job_run;
pub mod job_store;
mod job_updates;
mod json_body;
pub mod known_ports;
mod last_body;
mod last_tip;
mod library_routes;
mod library_store;
mod limits;
mod live_routes;
pub mod notification;
mod notification_queue;
mod notifier;
mod openapi;
mod page;
mod page_access;
pub mod page_listener;
mod page_source;
mod paths;
mod picture;
mod plan_routes;
mod port_lease;
mod problem;
mod queue_routes;
mod queue_store;
mod request_kind;
mod robot_alerts;
mod robot_error;
mod robot_request;
mod robot_stops;
mod robot_worker;
mod scene_store;
mod secret_file;
pub mod server;
mod server_error;
mod service;
mod service_context;
pub mod settings;
pub mod settings_paths;
mod site;
mod snapshot_store;
mod state_lock;
mod stop_file;
#[cfg(test)]
mod stop_model;
#[cfg(test)]
mod stop_tests;
mod stopper;
mod stream_event;
mod tokens;
mod tuning;
pub mod watch;
mod web_address;
mod workers;

pub use self::camera::CameraSettingsError;
pub use self::job_store::JobStoreError;
pub use self::notifier::{NotifyError, SecretError};
pub use self::paths::ServicePaths;
pub use self::service::{Service, StartError};
pub use self::state_lock::LockError;
