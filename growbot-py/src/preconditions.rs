//! Checks before a growth, and the scene for it.

use std::ffi::CString;

use growbot_client::feedback::can_measure;
use growbot_client::margin::near_obstacle;
use growbot_client::scene_planning::check_clearance;
use growbot_client::warning::BLOCKING;
use growbot_core::simulation::Disturbance;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::py_plan::PyPlan;
use crate::scene::{PyScene, through};

/// Returns the scene for the growth of a plan: the argument `scene`, of which the plan must be clear, or else the scene
/// through which the plan was made. `None` without a scene.
pub fn scene_for_growth(plan: &PyPlan, scene: Option<&Bound<PyAny>>) -> Result<Option<PyScene>, Error> {
    if let Some(given) = scene {
        let scene = PyScene::given(given)?;
        let file = scene.file.display().to_string();
        let found = check_clearance(&plan.inner, &plan.robot, &file, &scene.loaded)
            .map_err(|unclear| Error::new(ErrorKind::Input, format!("{unclear}; or set ignore_scene=True")))?;
        if let Some(near) = near_obstacle(&plan.inner, &plan.robot, &scene.loaded, found.clearance) {
            warn(given.py(), &near.message)?;
        }
        return Ok(Some(scene));
    }
    through(&plan.inner)
}

/// Issues a Python `UserWarning`.
fn warn(py: Python<'_>, message: &str) -> Result<(), Error> {
    let message = CString::new(message.replace('\0', "")).map_err(|error| Error::new(ErrorKind::Input, error))?;
    Ok(PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, 1)?)
}

/// Checks that a plan can be grown on a board under these conditions. `force` ignores the warnings of the plan.
pub fn check_growable(plan: &PyPlan, conditions: &Conditions, simulated: bool, force: bool) -> Result<(), Error> {
    let warnings = plan.inner.warnings.iter();
    let preventing: Vec<&str> =
        warnings.map(|warning| warning.code.as_str()).filter(|code| BLOCKING.contains(code)).collect();
    if !preventing.is_empty() && !force {
        let codes = preventing.join(", ");
        let message = format!("not grown because of {codes}: change the plan, or ignore the warnings with force=True");
        return Err(Error::with(ErrorKind::Input, message, codes, "no such warning"));
    }
    if conditions.needs_simulation() {
        return Err(Error::new(
            ErrorKind::Input,
            "sag, whole steps, gravity_only and odometry_scale_percent apply only to simulations without a board: use \
             Plan.simulate, or remove these conditions",
        ));
    }
    if !simulated && conditions.disturbance() != Disturbance::default() {
        return Err(Error::new(
            ErrorKind::Input,
            "layers of a real robot cannot be disturbed: remove noises and biases, or connect to \"sim\"",
        ));
    }
    if conditions.feedback() && !can_measure(&plan.robot) {
        let message = format!(
            "robot {} has no sensor that measures layers: give it sensors.filament_motion or sensors.orientation, or \
             remove feedback",
            plan.robot.name()
        );
        return Err(Error::new(ErrorKind::Input, message));
    }
    Ok(())
}
