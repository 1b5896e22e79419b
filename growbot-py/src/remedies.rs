//! The table of remedies that name arguments and functions of the Python package, for errors of the libraries, which
//! know neither.

use std::error::Error;

use growbot_client::growth::GrowthError;
use growbot_plan::plan_file::PlanFileError;
use growbot_plan::remedy::with_remedies;
use growbot_plan::run_log::{ReadRunLogError, RunLogError};
use growbot_plan::scene_planning::NoPathError;
use growbot_sim::sim_daemon::SimDaemonError;

/// Returns the text of an error with its remedies for Python.
pub fn message(error: &(dyn Error + 'static)) -> String {
    with_remedies(error, |error, text| {
        let remedy =
            of_growth(error).or(of_no_path(error)).or(of_plan_file(error)).or(of_log(error)).or(of_read_log(error));
        text + remedy.unwrap_or_default() + &of_simulated_robot(error)
    })
}

fn of_growth(error: &(dyn Error + 'static)) -> Option<&'static str> {
    match error.downcast_ref()? {
        GrowthError::Interrupted(_) => Some(": check its status, and if that fails cut the robot's power"),
        GrowthError::Unfinished { .. } => Some(" with `growbot resume`, or discard it with `growbot cancel`"),
        _ => None,
    }
}

fn of_log(error: &(dyn Error + 'static)) -> Option<&'static str> {
    matches!(error.downcast_ref()?, RunLogError::Exists { .. }).then_some(", or set overwrite=True")
}

fn of_no_path(error: &(dyn Error + 'static)) -> Option<&'static str> {
    match error.downcast_ref()? {
        NoPathError::TooFar { .. } => Some(": choose a nearer goal"),
        NoPathError::NotFound => Some(": raise effort or time_limit_s"),
        _ => None,
    }
}

fn of_plan_file(error: &(dyn Error + 'static)) -> Option<&'static str> {
    let is_no_plan = matches!(error.downcast_ref()?, PlanFileError::NotJson { .. } | PlanFileError::NoPlan { .. });
    is_no_plan.then_some(": give what Plan.save or Plan.to_json wrote")
}

fn of_read_log(error: &(dyn Error + 'static)) -> Option<&'static str> {
    matches!(error.downcast_ref()?, ReadRunLogError::Header { .. }).then_some(": give the run log of a growth")
}

fn of_simulated_robot(error: &(dyn Error + 'static)) -> String {
    match error.downcast_ref() {
        Some(SimDaemonError::NotRunning(name)) => format!(" with `growbot power on --port sim:{name}`"),
        _ => String::new(),
    }
}
