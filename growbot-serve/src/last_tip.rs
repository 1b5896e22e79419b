//! The tip of the last body of a robot, at which another body can begin.

use std::sync::Arc;

use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::plan::Plan;
use growbot_remote::api::JobState;

use super::last_body::LastBody;
use super::problem::Problem;
use super::robot_error::RobotRequestError;
use super::robot_worker::RobotWorker;

/// Start of a request that begins at the tip of a body, in place of a pose: this prefix, and the identifier of the
/// body's job.
pub const TIP_OF_JOB: &str = "tip:";

impl RobotWorker {
    /// Returns the body of a job, if it is the last one of this robot and the board still has it. Its run log is read
    /// once.
    pub fn last_body(&self, job: &str) -> Result<Arc<ContinuedBody>, Problem> {
        let robot = &self.name;
        self.ensure_connected()?;
        let found = self.shared.jobs_to_read().get(job).map_err(Problem::internal)?;
        let found = found.filter(|found| found.robot == *robot).ok_or_else(|| Problem::not_found("job", job))?;
        if found.state == JobState::Active {
            return Err(Problem::conflict(format!(
                "robot {robot} still grows job {job}: wait for its end before a body begins at its tip"
            )));
        }
        let is_gone = || {
            Problem::conflict(format!(
                "the board of robot {robot} does not have the body of job {job} any more, because it was reset or \
                 another body was begun: give a start pose"
            ))
        };
        // Nothing is read for a body that cannot be on the board.
        let latest = self.shared.jobs_to_read().latest_body(robot).map_err(Problem::internal)?;
        if latest.is_none_or(|latest| latest.id != job) || self.status().laid != found.laid {
            return Err(is_gone());
        }
        let log = self.shared.jobs_to_read().log_path(job);
        let mut last = self.lock_last_body();
        let read = LastBody::read(last.take(), job, &log).map_err(|error| {
            Problem::conflict(format!("no body can begin at the tip of job {job}: {error}; or give a start pose"))
        })?;
        let read = last.insert(read);
        if read.robot_hash != self.description().map_err(Problem::conflict)?.hash() {
            return Err(Problem::conflict(format!(
                "the body of job {job} was grown with another description of robot {robot}: give a start pose"
            )));
        }
        if !read.is_on_board(&self.status()) {
            return Err(is_gone());
        }
        Ok(Arc::clone(&read.body))
    }

    /// Returns an error if the robot is not connected.
    fn ensure_connected(&self) -> Result<(), RobotRequestError> {
        let reason = self.lock_state().connection_error.clone();
        let robot = || self.name.clone();
        reason.map_or(Ok(()), |reason| Err(RobotRequestError::NotConnected { robot: robot(), reason }))
    }

    /// Returns an error if a plan begins at the tip of a body that is not the last one of this robot.
    pub fn ensure_at_last_tip(&self, plan: &Plan) -> Result<(), Problem> {
        if plan.existing_layers.is_empty() {
            return Ok(());
        }
        self.ensure_connected()?;
        let latest = self.shared.jobs_to_read().latest_body(&self.name).map_err(Problem::internal)?;
        let last = latest.and_then(|job| self.last_body(&job.id).ok());
        if last.is_some_and(|body| body.is_continued_by(plan)) {
            return Ok(());
        }
        Err(Problem::conflict(format!(
            "the plan begins at the tip of a body that is not the last one that the service has grown on robot {}: \
             plan again from the tip of its last job, or stop the service and grow the plan without it",
            self.name
        )))
    }
}
