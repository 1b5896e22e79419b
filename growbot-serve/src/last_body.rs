//! The body that a robot has grown last, at whose tip another body can begin.

use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::plan::Plan;
use growbot_plan::run_log::RecordedRun;
use growbot_remote::api::JobState;

use super::job_store::JobStore;
use super::paths::ServicePaths;
use super::problem::Problem;

/// Start of a body that begins at the tip of the last body of its robot, in place of a pose.
pub const LAST_TIP: &str = "last-tip";

/// Returns the body that this robot has grown last. Jobs without a layer do not count.
pub fn last_body(places: &ServicePaths, robot: &str) -> Result<ContinuedBody, Problem> {
    let store = JobStore::open_to_read(places).map_err(Problem::internal)?;
    for job in store.latest_of(robot).map_err(Problem::internal)? {
        let log = store.log_path(&job.id);
        if !log.exists() {
            continue;
        }
        let record = RecordedRun::open(&log).map_err(Problem::conflict)?;
        if job.state == JobState::Active {
            return Err(Problem::conflict(format!(
                "robot {robot} still grows job {}: wait for its end before a body begins at its tip",
                job.id
            )));
        }
        if !record.as_built.is_empty() {
            return ContinuedBody::of(&record).map_err(|error| Problem::conflict(format!("job {}: {error}", job.id)));
        }
    }
    Err(Problem::conflict(format!("robot {robot} has grown no body yet: give a start pose, or grow a body first")))
}

/// Returns an error if a plan begins at the tip of a body that is not the last one of this robot.
pub fn ensure_at_last_tip(plan: &Plan, places: &ServicePaths, robot: &str) -> Result<(), Problem> {
    if plan.existing_layers.is_empty() || last_body(places, robot)?.layers == plan.existing_layers {
        return Ok(());
    }
    Err(Problem::conflict(format!(
        "the plan begins at the tip of a body that is not the last one of robot {robot}: plan again from its tip"
    )))
}
