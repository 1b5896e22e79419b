//! The tip of the last body of a robot, at which another body can begin.

use std::sync::Arc;

use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::plan::Plan;
use growbot_remote::api::JobState;

use super::last_body::LastBody;
use super::problem::Problem;
use super::robot_worker::RobotWorker;

/// Start of a request that begins at the tip of a body, in place of a pose: this prefix, and the identifier of the
/// body's job.
pub const TIP_OF_JOB: &str = "tip:";

impl RobotWorker {
    /// Returns the body of a job, if the board still has it. Its run log is read once.
    pub fn last_body(&self, job: &str) -> Result<Arc<ContinuedBody>, Problem> {
        let robot = &self.name;
        let found = self.shared.jobs_to_read().get(job).map_err(Problem::internal)?;
        let found = found.filter(|found| found.robot == *robot).ok_or_else(|| Problem::not_found("job", job))?;
        if found.state == JobState::Active {
            return Err(Problem::conflict(format!(
                "robot {robot} still grows job {job}: wait for its end before a body begins at its tip"
            )));
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
            return Err(Problem::conflict(format!(
                "the board of robot {robot} does not have the body of job {job} any more: give a start pose"
            )));
        }
        Ok(Arc::clone(&read.body))
    }

    /// Returns an error if a plan begins at the tip of a body that is not the last one of this robot.
    pub fn ensure_at_last_tip(&self, plan: &Plan) -> Result<(), Problem> {
        if plan.existing_layers.is_empty() {
            return Ok(());
        }
        let latest = self.shared.jobs_to_read().latest_body(&self.name).map_err(Problem::internal)?;
        if let Some(job) = latest
            && self.last_body(&job.id)?.is_continued_by(plan)
        {
            return Ok(());
        }
        Err(Problem::conflict(format!(
            "the plan begins at the tip of a body that is not the last one of robot {}: plan again from its tip",
            self.name
        )))
    }
}
