//! The body that a robot has grown last, at whose tip another body can begin.

use std::fs;
use std::sync::Arc;

use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::hexadecimal::format_hash;
use growbot_plan::plan::Plan;
use growbot_plan::run_log::RecordedRun;
use growbot_remote::api::JobState;

use super::problem::Problem;
use super::robot_worker::RobotWorker;

/// Start of a request that begins at the tip of a body, in place of a pose: this prefix, and the identifier of the
/// body's job.
pub const TIP_OF_JOB: &str = "tip:";

/// The last body of a robot as it was read from the run log of its job.
pub struct LastBody {
    job: String,
    /// Length of the run log, bytes. A longer one is read again.
    log_length: u64,
    /// Plan id of the job after its latest amendment, 16 hexadecimal digits.
    plan_id: String,
    laid: u32,
    body: Arc<ContinuedBody>,
}

impl RobotWorker {
    /// Returns the body of a job, if the board still has it. Reads its run log once.
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
        let log_length = fs::metadata(&log).map_or(0, |file| file.len());
        let mut last = self.lock_last_body();
        let is_known = last.as_ref().is_some_and(|last| last.job == job && last.log_length == log_length);
        if !is_known {
            let unknown = |error: &dyn std::fmt::Display| {
                Problem::conflict(format!("no body can begin at the tip of job {job}: {error}; or give a start pose"))
            };
            let record = RecordedRun::open(&log).map_err(|error| unknown(&error))?;
            *last = Some(LastBody {
                job: job.to_owned(),
                log_length,
                plan_id: format_hash(record.plan_id),
                laid: u32::try_from(record.as_built.len()).unwrap_or(u32::MAX),
                body: Arc::new(ContinuedBody::of(&record).map_err(|error| unknown(&error))?),
            });
        }
        let status = self.status();
        let on_board = last.as_ref().filter(|last| {
            status.plan_id.as_ref() == Some(&last.plan_id) && status.laid == last.laid && status.interrupted.is_none()
        });
        on_board.map(|last| Arc::clone(&last.body)).ok_or_else(|| {
            Problem::conflict(format!(
                "the board of robot {robot} does not have the body of job {job} any more: give a start pose"
            ))
        })
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
