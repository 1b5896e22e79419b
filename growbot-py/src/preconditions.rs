//! Checks before a growth, and the scene for it.

use std::ffi::CString;

use growbot_client::growth::GrowthRefusal;
use growbot_plan::margin::near_obstacle;
use growbot_plan::scene_planning::{SceneCheckError, check_clearance};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::py_plan::PyPlan;
use crate::scene::{PyScene, through};

/// Returns the scene for the growth of a plan, and the reason why the plan is not clear of it: the argument `scene`, or
/// else the scene through which the plan was made. `None` without a scene.
pub fn scene_for_growth(
    py: Python<'_>,
    plan: &PyPlan,
    scene: Option<PyScene>,
) -> Result<(Option<PyScene>, Option<SceneCheckError>), Error> {
    let Some(scene) = scene else { return Ok((through(&plan.inner)?, None)) };
    let file = scene.file.display().to_string();
    match check_clearance(&plan.inner, &plan.robot, &file, &scene.loaded) {
        Err(unclear) => Ok((Some(scene), Some(unclear))),
        Ok(found) => {
            if let Some(near) = near_obstacle(&plan.inner, &plan.robot, &scene.loaded, found.clearance) {
                warn(py, &near.message)?;
            }
            Ok((Some(scene), None))
        }
    }
}

/// Issues a Python `UserWarning`.
fn warn(py: Python<'_>, message: &str) -> Result<(), Error> {
    let message = CString::new(message.replace('\0', "")).map_err(|error| Error::new(ErrorKind::Input, error))?;
    Ok(PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, 1)?)
}

/// Checks that these conditions apply to a growth on a board.
pub fn check_conditions(conditions: &Conditions) -> Result<(), Error> {
    if conditions.needs_simulation() {
        return Err(Error::new(
            ErrorKind::Input,
            "sag, whole steps, gravity_only and odometry_scale_percent apply only to simulations without a board: use \
             Plan.simulate, or remove these conditions",
        ));
    }
    Ok(())
}

/// Returns the error for a growth that is refused, with the remedy.
pub fn refused(refusal: &GrowthRefusal) -> Error {
    let remedy = match refusal {
        GrowthRefusal::Warnings { codes } => {
            let message = format!("{refusal}: change the plan, or ignore the warnings with force=True");
            return Error::with(ErrorKind::Input, message, codes.join(", "), "no such warning")
                .with_code(Some(refusal.code()));
        }
        GrowthRefusal::Scene(_) => "or set ignore_scene=True",
        GrowthRefusal::Clearance(_) => "plan with a larger margin_mm or another radius_mm, or set ignore_scene=True",
        GrowthRefusal::Disturbance => "remove noises and biases, or connect to \"sim\"",
        GrowthRefusal::SensorNoise => "remove the noise of the sensors, or add feedback",
        GrowthRefusal::NoSensor { .. } => "give it sensors.filament_motion or sensors.orientation, or remove feedback",
    };
    let separator = if matches!(refusal, GrowthRefusal::Scene(_)) { ";" } else { ":" };
    Error::new(ErrorKind::Input, format!("{refusal}{separator} {remedy}")).with_code(Some(refusal.code()))
}
