//! The robots and growths that pages show, and the permits for orders to them.

use std::collections::BTreeMap;
use std::future::Future;
use std::sync::Arc;

use axum::body::Bytes;
use axum::response::Html;
use futures_util::stream::BoxStream;
use growbot_client::status::RobotStatus;
use growbot_client::stop_signal::Permit;
use growbot_plan::job::Command;
use tokio::sync::watch;

use super::audit::CommandSource;
use super::limits::RoleLimits;
use super::problem::Problem;
use super::stream_event::StreamEvent;
use crate::watch::heartbeat::OrderAge;

/// Permits for an order to each robot, issued when the head of an HTTP request arrived. A later stop of a robot voids
/// its permit, also while the body of the request is still being received.
#[derive(Debug, Clone)]
pub struct ArrivalPermits {
    /// Permits by the names of the robots.
    pub permits: BTreeMap<String, Permit>,
    /// Result of the check of the order's age when the request arrived.
    pub age: OrderAge,
}

impl ArrivalPermits {
    /// Returns the permit for this robot without a check of the order's age: for orders that stop, pause or cool down
    /// the robot.
    pub fn of(&self, robot: &str) -> Result<&Permit, Problem> {
        self.permits.get(robot).ok_or_else(|| Problem::not_found("robot", robot))
    }

    /// Returns the permit for this robot, or an error if the order is too old: for all orders that do not stop, pause
    /// or cool down the robot.
    pub fn recent(&self, robot: &str) -> Result<&Permit, Problem> {
        self.age.check().map_err(Problem::conflict)?;
        self.of(robot)
    }

    /// Returns the permit for a command to the growth of this robot, or an error if the command is too old. A command
    /// that stops or pauses the growth is never too old.
    pub fn for_command(&self, robot: &str, command: Command) -> Result<&Permit, Problem> {
        match command {
            Command::Pause | Command::Stop | Command::EmergencyStop => self.of(robot),
            _ => self.recent(robot),
        }
    }
}

/// The robots and growths that pages show: those of the service, or the growth of this process.
pub trait PageSource: Send + Sync + 'static {
    /// Returns the status of all robots, sorted by the names of the robots.
    fn robots(&self) -> Vec<RobotStatus>;

    /// Returns a receiver of the counter of changes of the robots.
    fn changes(&self) -> watch::Receiver<u64>;

    /// Returns a permit for each robot, for an order that arrives now and has this age.
    fn permits(&self, age: OrderAge) -> ArrivalPermits;

    /// Returns the live page of an active job. For a job that is not active, returns the page of its run log.
    fn live_page(&self, job: &str, limits: &RoleLimits) -> impl Future<Output = Result<Html<Bytes>, Problem>> + Send;

    /// Returns the stream of events for the live page of a job.
    ///
    /// # Errors
    /// The job does not exist.
    fn live_events(&self, job: &str) -> Result<BoxStream<'static, StreamEvent>, Problem>;

    /// Carries out a command to the growth of a job, which arrived with these permits.
    fn send_live_command(
        self: Arc<Self>,
        by: CommandSource,
        job: String,
        command: Command,
        permits: ArrivalPermits,
    ) -> impl Future<Output = Result<(), Problem>> + Send;
}
