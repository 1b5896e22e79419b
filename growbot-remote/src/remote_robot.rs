//! A robot that the service owns.

use std::fs::canonicalize;
use std::io;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::thread;
use std::time::Duration;

use growbot_client::growth::{GrowthRequest, Override};
use growbot_client::robot_command::RobotCommand;
use growbot_client::status::RobotStatus;
use growbot_plan::job::Command;
use growbot_plan::plan_file::PlanFile;
use serde::Serialize;
use serde_json::json;
use serde_json::value::to_raw_value;

use crate::api::{CommandRequest, CommandResponse, GrowRequest, Job, LeaseRequest, MaintenanceRequest};
use crate::client::{RESPONSE_TIMEOUT, RequestHandle, ServiceClient, ServiceError};

/// A lease of a robot's port. The lease ends when this value is dropped, or when the program ends.
pub struct LeasedPort(UnixStream);

impl Drop for LeasedPort {
    fn drop(&mut self) {
        // If the service has ended, so has the lease.
        let _ = self.0.shutdown(Shutdown::Both);
    }
}

/// A robot that the service owns.
#[derive(Debug, Clone)]
pub struct RemoteRobot {
    /// Client of the service.
    pub client: ServiceClient,
    /// Name of the robot in the service.
    pub name: String,
    /// Status of the robot when it was found.
    pub found: RobotStatus,
}

impl ServiceClient {
    /// Finds the robot with this port. Returns `None` if the service has no robot with this port. `limit` is the
    /// timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn robot_at(self, port: &str, limit: Duration) -> Result<Option<RemoteRobot>, ServiceError> {
        let real = canonicalize(port).ok();
        let is_there =
            |robot: &RobotStatus| robot.port == port || real.is_some() && canonicalize(&robot.port).ok() == real;
        let found = self.robots(limit)?.into_iter().find(is_there);
        Ok(found.and_then(|found| Some(RemoteRobot { client: self, name: found.name.clone()?, found })))
    }
}

impl RemoteRobot {
    /// Finds the robot with this port in the service of this user. Returns `None` if no service owns the port. `limit`
    /// is the timeout of the response.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn find(port: &str, limit: Duration) -> Result<Option<Self>, ServiceError> {
        ServiceClient::find()?.map_or(Ok(None), |client| client.robot_at(port, limit))
    }

    /// Returns the path of a route of this robot.
    fn route(&self, last: &str) -> String {
        format!("/robots/{}{last}", self.name)
    }

    /// Requests the full status of the robot.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn request_status(&self) -> Result<RobotStatus, ServiceError> {
        self.client.get(&self.route("/status"))
    }

    /// Sends a command, and waits until the board has carried it out. Returns the result as text.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn send_command(&self, command: RobotCommand) -> Result<String, ServiceError> {
        self.order("/commands", CommandRequest { command })
    }

    /// Sends an order at a route of this robot, and returns the result as text.
    fn order(&self, route: &str, order: impl Serialize) -> Result<String, ServiceError> {
        let response = self.client.request(&self.route(route), Some(order), Some(RESPONSE_TIMEOUT))?;
        // The service has accepted the order, even if the text is lost or is that of another release.
        let accepted = || "the service has accepted the order".to_owned();
        Ok(response.json().map_or_else(|_| accepted(), |CommandResponse { message, .. }| message))
    }

    /// Sends a command of a user to the growth of a job.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn command_growth(&self, job: &str, command: Command) -> Result<(), ServiceError> {
        let robot_command = match command {
            Command::Pause => RobotCommand::Pause,
            Command::Continue => RobotCommand::Continue,
            Command::Stop => RobotCommand::Stop,
            Command::EmergencyStop => RobotCommand::EmergencyStop,
            Command::Preheat | Command::Load | Command::Unload | Command::Purge => {
                let path = format!("/jobs/{job}/live/commands/{}", command.name());
                return self.client.request(&path, Some(json!({})), Some(RESPONSE_TIMEOUT)).map(drop);
            }
        };
        self.send_command(robot_command).map(drop)
    }

    /// Runs a maintenance task. Returns the result as text.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn maintain(&self, request: &MaintenanceRequest) -> Result<String, ServiceError> {
        self.order("/maintenance", request)
    }

    /// Starts a growth from its first layer. `scene` is the absolute path of a scene, if it is not the one of the plan.
    /// The service neither disturbs layers nor measurements. `handle` can give the order up until it has begun.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn grow(
        &self,
        growth: &GrowthRequest,
        name: String,
        scene: Option<String>,
        handle: &RequestHandle,
    ) -> Result<Job, ServiceError> {
        let plan = PlanFile::with_robot(growth.plan, growth.robot);
        let request = GrowRequest {
            plan: Some(to_raw_value(&plan).map_err(ServiceError::silent)?),
            scene,
            feedback: growth.feedback.is_some(),
            force: growth.overrides.contains(&Override::Warnings),
            ignore_scene: growth.overrides.contains(&Override::Scene),
            name: Some(name),
            ..GrowRequest::default()
        };
        self.client.request_by(handle, &self.route("/jobs"), Some(request), Some(RESPONSE_TIMEOUT))?.json()
    }

    /// Resumes an unfinished job.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub fn resume(&self, job: &str) -> Result<(), ServiceError> {
        self.client.request(&format!("/jobs/{job}/resume"), Some(json!({})), Some(RESPONSE_TIMEOUT)).map(drop)
    }

    /// Leases the port to the command with this name. The service closes the port and keeps it closed until the
    /// returned value is dropped.
    ///
    /// # Errors
    /// [`ServiceError`], for example if the robot has a job.
    pub fn lease_port(&self, to: &str) -> Result<LeasedPort, ServiceError> {
        let request = Some(LeaseRequest { holder: to.to_owned() });
        let response = self.client.request(&self.route("/port-lease"), request, None)?;
        // The service closes a connection whose client does not read the comments that it sends every second.
        let read = move || io::copy(&mut response.body.into_reader(), &mut io::sink());
        thread::Builder::new().name("lease".to_owned()).spawn(read).map_err(ServiceError::silent)?;
        Ok(LeasedPort(response.stream))
    }
}
