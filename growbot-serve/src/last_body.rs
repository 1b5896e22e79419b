//! The body that a robot has grown last, as it was read from the run log of its job.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use growbot_client::status::RobotStatus;
use growbot_plan::continued_body::{ContinuedBody, UnknownTipError};
use growbot_plan::hexadecimal::format_hash;
use growbot_plan::run_log::{ReadRunLogError, RecordedRun};

/// Reason why the tip of a body is not known.
#[derive(Debug, thiserror::Error)]
pub enum LastBodyError {
    /// The run log cannot be read.
    #[error(transparent)]
    RunLog(#[from] ReadRunLogError),
    /// The run log does not contain where the tip is.
    #[error(transparent)]
    Tip(#[from] UnknownTipError),
}

/// The last body of a robot.
pub struct LastBody {
    job: String,
    /// Length of the run log, bytes. A longer one is read again.
    log_length: u64,
    /// Plan id of the job after its latest amendment, 16 hexadecimal digits.
    plan_id: String,
    laid: u32,
    /// Hash of the description of the robot that has grown the body.
    pub robot_hash: u64,
    /// The body.
    pub body: Arc<ContinuedBody>,
}

impl LastBody {
    /// Reads the body of a job from its run log, unless `known` is that body.
    pub fn read(known: Option<Self>, job: &str, log: &Path) -> Result<Self, LastBodyError> {
        let log_length = fs::metadata(log).map_or(0, |file| file.len());
        if let Some(known) = known.filter(|known| known.job == job && known.log_length == log_length) {
            return Ok(known);
        }
        let record = RecordedRun::open(log)?;
        Ok(Self {
            job: job.to_owned(),
            log_length,
            plan_id: format_hash(record.plan_id),
            laid: u32::try_from(record.as_built.len()).unwrap_or(u32::MAX),
            robot_hash: record.robot.hash,
            body: Arc::new(ContinuedBody::of(&record)?),
        })
    }

    /// Reports whether the board with this status has the body.
    pub fn is_on_board(&self, status: &RobotStatus) -> bool {
        let is_same = status.plan_id.as_ref() == Some(&self.plan_id) && status.laid == self.laid;
        is_same && status.interrupted.is_none()
    }
}
