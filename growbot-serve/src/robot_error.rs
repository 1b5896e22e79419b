//! Errors of a robot of the service: of its connection, and of requests to its thread.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use growbot_client::client::ClientError;
use growbot_client::growth::GrowthError;
use growbot_core::link::message::State;
use growbot_plan::plan_file::PlanFileError;
use growbot_plan::robot_file::RobotFileError;
use growbot_plan::run_log::{ReadRunLogError, RunLogError};
use growbot_plan::scene_planning::SceneCheckError;
use growbot_sim::port::OpenError;
use growbot_sim::sim_daemon::SimDaemonError;
use growbot_sim::sim_daemon::process::SimProcessError;

use super::stopper::EmergencyStopError;

/// End of the error message after each stop that the board has not confirmed.
const KEPT: &str = "The service keeps the stop, and sends the stop before anything else once the robot is connected; \
                    the command `withdraw-stop` of the API, or Withdraw stop on the page, withdraws the stop";

/// Reason why a robot is not connected.
#[derive(Debug, thiserror::Error)]
pub enum ConnectionError {
    /// The robot's thread has not tried to connect yet.
    #[error("the service is looking for the robot")]
    Searching,
    /// The robot's thread was not started.
    #[error("cannot start the thread of the robot: {0}")]
    Thread(io::Error),
    /// A command of growbot, with this name, has the port.
    #[error("the port is in use by {0}: end that program first")]
    Leased(String),
    /// The board has sent nothing during a growth.
    #[error("the board has not responded for too long")]
    Silent,
    /// The board's robot, with this name, is not built in, and no description is configured.
    #[error("the board's robot is {0}, which is not built in: set `robot` for this robot in growbot.toml")]
    NotBuiltIn(String),
    #[error("{0}")]
    Board(#[from] ClientError),
    #[error("{0}")]
    Open(#[from] OpenError),
    #[error("{0}")]
    RobotFile(#[from] RobotFileError),
    #[error("{0}")]
    Simulation(#[from] SimDaemonError),
    #[error("{0}")]
    SwitchOn(#[from] SimProcessError),
}

/// Reason why a robot has not carried out a request.
#[derive(Debug, thiserror::Error)]
pub enum RobotRequestError {
    #[error("robot {robot} is not connected: {reason}")]
    NotConnected { robot: String, reason: Arc<ConnectionError> },
    /// Another program has the robot's port.
    #[error("robot {robot}: {reason}")]
    Leased { robot: String, reason: Arc<ConnectionError> },
    /// The connection was lost during the request.
    #[error("{0}")]
    Lost(#[from] Arc<ConnectionError>),
    #[error("the service's thread for this robot has ended: restart the service")]
    ThreadEnded,
    #[error("the request was not started, because its sender closed the connection: send the request again")]
    GivenUp,
    #[error(
        "robot {robot} did not accept the request within {:.0} s, so the request was cancelled: try again",
        limit.as_secs_f64()
    )]
    NotAccepted { robot: String, limit: Duration },
    #[error(
        "robot {robot} accepted the request, but did not finish it within {:.0} s: check the robot's state",
        limit.as_secs_f64()
    )]
    NotFinished { robot: String, limit: Duration },
    #[error("robot {robot} has an active job, {job}: wait until the job ends, or stop the job")]
    Busy { robot: String, job: String },
    #[error("robot {robot} tunes its heater: wait for its end, or stop the robot")]
    Tuning { robot: String },
    #[error("robot {robot} has an active job: stop the job first")]
    CancelDuringJob { robot: String },
    #[error(
        "robot {robot} has an active job: to preheat, load, unload or purge without a value, pause the job first; \
         for other maintenance, stop the job first"
    )]
    MaintenanceDuringJob { robot: String },
    #[error(
        "cannot {command} robot {robot}, because the robot has no active job or is not connected: check the robot's \
         state"
    )]
    NoGrowth { command: &'static str, robot: String },
    #[error("the board did not confirm the emergency stop: cut the robot's power now ({0}). {KEPT}")]
    EmergencyStop(#[from] EmergencyStopError),
    #[error(
        "robot {robot} is not connected ({reason}): if the robot must be off now, send the emergency stop or cut its \
         power. {KEPT}"
    )]
    StopNotSent { robot: String, reason: Arc<ConnectionError> },
    #[error(
        "robot {robot} did not confirm the stop within {} s: send the emergency stop, or cut its power. {KEPT}",
        limit.as_secs()
    )]
    StopUnconfirmed { robot: String, limit: Duration },
    #[error("robot {robot} has no unconfirmed stop: there is nothing to withdraw")]
    NoStop { robot: String },
    #[error("robot {robot} is being stopped now: a stop can be withdrawn only after it has failed")]
    StopInProgress { robot: String },
    /// A later stop has voided the request for a job.
    #[error(
        "the job was not started, because the robot was stopped, had a fault or discarded its body before the order \
         reached it: check the robot, and order the job again"
    )]
    Voided,
    #[error("job {job} is done: there is nothing to resume")]
    JobDone { job: String },
    #[error(
        "job {job} has failed ({}) and cannot be resumed: grow its plan again",
        reason.as_deref().unwrap_or("for an unknown reason")
    )]
    JobFailed { job: String, reason: Option<String> },
    /// The board is in a state in which the service does not continue a job by itself.
    #[error(
        "the board is in state {}: clear the fault or the emergency stop, if there is one, then resume or cancel the \
         job", .0.name()
    )]
    BoardState(State),
    #[error("{0}")]
    Board(#[from] ClientError),
    #[error("{error}{}", remedy(.0), error = .0)]
    Growth(#[from] GrowthError),
    #[error("{0}")]
    Log(#[from] RunLogError),
    #[error("{0}")]
    RecordedRun(#[from] ReadRunLogError),
    #[error("{0}")]
    RecordedPlan(#[from] PlanFileError),
    #[error("{0}")]
    Scene(#[from] SceneCheckError),
}

/// Returns the remedy for clients of the service that the message of an error lacks.
fn remedy(error: &GrowthError) -> &'static str {
    if matches!(error, GrowthError::Unfinished { .. }) { ", or discard it with the command cancel" } else { "" }
}
