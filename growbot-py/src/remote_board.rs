//! A board that the user's service owns.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, TrySendError};
use std::sync::{Arc, Mutex};
use std::thread;

use growbot_client::growth::DEFAULT_SEED;
use growbot_client::robot_command::RobotCommand;
use growbot_client::status::RobotStatus;
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, RunEvent};
use growbot_remote::api::Job;
use growbot_remote::client::{JobLogUpdate, RESPONSE_TIMEOUT, RequestHandle, ServiceError};
use growbot_remote::remote_robot::RemoteRobot;
use pyo3::prelude::*;

use crate::board_handle::{BoardHandle, GrowthArguments};
use crate::error::{Error, ErrorKind};
use crate::growth::{AHEAD, CommandSender, Growth, GrowthMessage, check_outcome};
use crate::interruptible::{disconnected, in_thread, lock, receive};

/// A board that the user's service owns.
pub struct RemoteBoard {
    /// The robot in the service. `None` once the board is disconnected.
    robot: Mutex<Option<Arc<RemoteRobot>>>,
    /// Kind of the robot.
    pub kind: RobotKind,
}

impl RemoteBoard {
    /// Finds the robot with this port in the user's service. `None` if no service owns the port.
    pub fn find(py: Python<'_>, port: String) -> Result<Option<Self>, Error> {
        let found = receive(py, in_thread(move || RemoteRobot::find(&port, RESPONSE_TIMEOUT)))?;
        Ok(found.map(|robot| Self { kind: robot.found.simulated.into(), robot: Mutex::new(Some(Arc::new(robot))) }))
    }

    fn robot(&self) -> Result<Arc<RemoteRobot>, Error> {
        lock(&self.robot).clone().ok_or_else(disconnected)
    }

    /// Sends a request to the service and waits for the response. Ctrl-C ends the wait.
    fn request<T: Send + 'static>(
        &self,
        py: Python<'_>,
        request: impl FnOnce(&RemoteRobot) -> Result<T, ServiceError> + Send + 'static,
    ) -> Result<T, Error> {
        let robot = self.robot()?;
        receive(py, in_thread(move || request(&robot)))
    }
}

impl BoardHandle for RemoteBoard {
    fn status(&self, py: Python<'_>) -> Result<RobotStatus, Error> {
        self.request(py, RemoteRobot::request_status)
    }

    fn stop(&self, py: Python<'_>) -> Result<String, Error> {
        self.request(py, |robot| robot.send_command(RobotCommand::Stop))
    }

    fn emergency_stop(&self, py: Python<'_>) -> Result<(), Error> {
        self.request(py, |robot| robot.send_command(RobotCommand::EmergencyStop)).map(drop)
    }

    fn grow(&self, py: Python<'_>, arguments: GrowthArguments) -> Result<Growth, Error> {
        let (robot, kind) = (self.robot()?, self.kind);
        if arguments.request(kind).has_imperfection() || arguments.seed != DEFAULT_SEED {
            let message = format!(
                "robot {} is owned by the service, which accepts no noise, bias or seed: remove these conditions, or \
                 connect to \"sim\"",
                robot.name
            );
            return Err(Error::new(ErrorKind::Input, message));
        }
        let log = arguments.log.clone().copy().map_err(|error| Error::of(ErrorKind::File, &error))?;
        let given = arguments.scene.as_ref().map(|scene| scene.file.clone());
        let file = given.or_else(|| Some(PathBuf::from(&arguments.plan.inner.scene.as_ref()?.file)));
        // The service runs in another directory.
        let file = file.map(|file| std::path::absolute(&file).unwrap_or(file).display().to_string());
        let handle = RequestHandle::default();
        let sent = handle.clone();
        let grow =
            move |robot: &RemoteRobot| robot.grow(&arguments.request(kind), "from Python".to_owned(), file, &sent);
        // After Ctrl-C nothing may begin that this program does not follow.
        let job = self.request(py, grow).inspect_err(|_| handle.give_up())?;
        follow(robot, job.id, log)
    }

    fn attach(&self, py: Python<'_>) -> Result<Growth, Error> {
        let robot = self.robot()?;
        let job = self.request(py, RemoteRobot::request_status)?.job.ok_or_else(|| {
            let message = format!("robot {} has no active job: start a growth", robot.name);
            Error::with(ErrorKind::Board, message, "none", "a job")
        })?;
        follow(robot, job, None)
    }

    fn close(&self, _: Python<'_>) -> Result<(), Error> {
        drop(lock(&self.robot).take());
        Ok(())
    }
}

/// Follows a job in a thread of its own. The run log is copied to the file `log` at the end.
fn follow(robot: Arc<RemoteRobot>, job: String, log: Option<PathBuf>) -> Result<Growth, Error> {
    let (messages, receiver) = mpsc::sync_channel(AHEAD);
    let (commanded, of_job) = (Arc::clone(&robot), job.clone());
    let commands: CommandSender = Box::new(move |command| {
        let (robot, job) = (Arc::clone(&commanded), of_job.clone());
        Some(in_thread(move || robot.command_growth(&job, command)))
    });
    let following = move || {
        let mut result = None;
        let followed = robot.client.follow_job(&job, |update| {
            let is_followed = match update {
                JobLogUpdate::Line(line) => match serde_json::from_str(line) {
                    Ok(RunEvent::End { result: end }) => {
                        result = Some(*end);
                        true
                    }
                    _ => messages.send(GrowthMessage::Event(line.to_owned())).is_ok(),
                },
                JobLogUpdate::NoChange | JobLogUpdate::NoResponse => {
                    !matches!(messages.try_send(GrowthMessage::NoChange), Err(TrySendError::Disconnected(_)))
                }
            };
            if is_followed { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        let ended = match followed {
            // Python has left the growth.
            Ok(None) => return,
            Ok(Some(job)) => end(&robot, &job, result.as_ref(), log.as_deref()),
            Err(error) => Err(error.into()),
        };
        let result = result.and_then(|result| serde_json::to_string(&result).ok());
        // Python may have left the growth.
        let _ = messages.send(GrowthMessage::End(result, ended));
    };
    thread::Builder::new().name("growbot".to_owned()).spawn(following).map_err(|_| disconnected())?;
    Ok(Growth::new(receiver, commands))
}

/// Copies the run log of a job that has ended to the file `log`. Returns an error unless the growth is done or was
/// stopped.
fn end(robot: &RemoteRobot, job: &Job, result: Option<&GrowthResult>, log: Option<&Path>) -> Result<(), Error> {
    if let Some(log) = log {
        write_atomic(log, &robot.client.job_log(&job.id)?).map_err(|error| Error::of(ErrorKind::File, &error))?;
    }
    let result = result.ok_or_else(|| {
        let reason = job.reason.as_deref().unwrap_or("the service gave no reason");
        Error::new(ErrorKind::Board, format!("job {} ended without a result: {reason}", job.id))
    })?;
    check_outcome(result)
}
