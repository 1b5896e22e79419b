//! Checks before a growth, and loading of the scene of a plan.

use std::ffi::CString;
use std::path::PathBuf;

use growbot_client::feedback::can_measure;
use growbot_client::margin::near_obstacle;
use growbot_client::plan as client;
use growbot_client::plan_file::format_hash;
use growbot_client::scene_planning::check_clearance;
use growbot_client::warning::BLOCKING;
use growbot_core::simulation::Disturbance;
use growbot_pictures::view::{NamedScene, Subject, page};
use growbot_scene::scene_file::LoadedScene;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::plan::PyPlan;
use crate::scene::PyScene;

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

/// Loads the scene through which a plan was made. `None` for a plan in empty space.
fn through(plan: &client::Plan) -> Result<Option<PyScene>, Error> {
    let Some(through) = &plan.scene else { return Ok(None) };
    let found = PyScene::read(PathBuf::from(&through.file), Some(through.margin))
        .map_err(|error| Error::new(ErrorKind::File, format!("{error}; or give the plan's scene as scene=")))?;
    if found.loaded.hash == through.hash {
        return Ok(Some(found));
    }
    let message =
        format!("{} is not the scene of the plan: plan again, or give the plan's scene as scene=", through.file);
    Err(Error::with(ErrorKind::File, message, format_hash(found.loaded.hash), format_hash(through.hash)))
}

/// Returns an HTML page that shows a body and the scene of its plan. The page has no scene if the scene's files are
/// missing or have changed.
pub fn page_of(py: Python<'_>, subject: &Subject) -> Result<String, Error> {
    py.detach(|| {
        let scene = match subject.run {
            Some(run) => run.scene(subject.plan, subject.robot, None).ok().flatten(),
            None => through(subject.plan).ok().flatten().map(|scene| LoadedScene::clone(&scene.loaded)),
        };
        let file = subject.plan.scene.as_ref().map_or("", |scene| &scene.file);
        let scene = scene.as_ref().map(|loaded| NamedScene { file, scene: &loaded.scene });
        page::render(&Subject { scene, ..*subject })
    })
    .map_err(|error| Error::new(ErrorKind::Input, error))
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
