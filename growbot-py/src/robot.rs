//! Class `growbot.Robot`.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use growbot_core::robot::Robot as Described;
use growbot_plan::hexadecimal::format_hash;
use growbot_plan::robot_file;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};

use crate::arguments::{path, text, text_of_file, wrong_type};
use crate::error::{Error, ErrorKind};

/// Maximum number of letters of a quoted reason in an error message.
const MAX_REASON: usize = 300;

/// A robot with its checked description.
///
/// Robot() is the paper's robot A. Robot("growbot-b") is another built-in robot (Robot.builtin_names()).
/// Robot("my.toml") is read from a file.
#[pyclass(name = "Robot", frozen, module = "growbot", eq)]
#[derive(Clone, PartialEq)]
pub struct PyRobot {
    pub inner: Arc<Described>,
}

/// Returns the default robot. Its description is parsed only once.
pub fn default_robot() -> Result<Arc<Described>, Error> {
    static DEFAULT: OnceLock<Arc<Described>> = OnceLock::new();
    if let Some(robot) = DEFAULT.get() {
        return Ok(Arc::clone(robot));
    }
    let robot = Arc::new(load(robot_file::DEFAULT.as_ref())?);
    Ok(Arc::clone(DEFAULT.get_or_init(|| robot)))
}

fn load(name_or_file: &Path) -> Result<Described, Error> {
    let failed = |error| Error::new(ErrorKind::File, error);
    match text_of_file(name_or_file) {
        Ok((text, file)) if name_or_file.to_str().is_none_or(|name| !robot_file::is_built_in(name)) => {
            robot_file::parse(&text, &file).map_err(failed)
        }
        // Loads a built-in robot. If its name is unknown, the error lists the built-in names.
        _ => robot_file::load(name_or_file).map_err(failed),
    }
}

/// Converts an argument to a robot: a `growbot.Robot`, the name of a built-in robot, or a robot file. `None` stands for
/// the default robot.
pub fn robot_of(value: Option<&Bound<PyAny>>) -> Result<Arc<Described>, Error> {
    let Some(value) = value else { return default_robot() };
    if let Ok(robot) = value.cast::<PyRobot>() {
        return Ok(Arc::clone(&robot.get().inner));
    }
    let name = path("robot", value).map_err(|_| wrong_type("robot", value, "a growbot.Robot, a name or a file"))?;
    Ok(Arc::new(load(&name)?))
}

#[pymethods]
impl PyRobot {
    #[new]
    #[pyo3(signature = (name_or_file = None))]
    fn new(name_or_file: Option<&Bound<PyAny>>) -> Result<Self, Error> {
        Ok(Self { inner: robot_of(name_or_file)? })
    }

    /// Returns the names of the built-in robots.
    #[staticmethod]
    fn builtin_names() -> Vec<&'static str> {
        robot_file::names().collect()
    }

    /// Returns the robot that the text of a robot file (TOML) describes.
    #[classmethod]
    #[pyo3(signature = (toml))]
    fn from_toml(_cls: &Bound<PyType>, toml: &Bound<PyAny>) -> Result<Self, Error> {
        let toml = text("toml", toml)?;
        let robot = robot_file::parse(&toml, "toml").map_err(|error| Error::new(ErrorKind::Input, error))?;
        Ok(Self { inner: Arc::new(robot) })
    }

    /// Returns the robot with a description: a dict in the format of description, for example a built-in robot with
    /// other numbers.
    #[classmethod]
    #[pyo3(signature = (description))]
    fn from_description(cls: &Bound<PyType>, description: &Bound<PyAny>) -> Result<Self, Error> {
        let wanted = "a dict as Robot.description gives it";
        let arguments = PyDict::new(cls.py());
        arguments.set_item("allow_nan", false)?;
        let json = cls.py().import("json")?.call_method("dumps", (description,), Some(&arguments));
        let json = json.map_err(|_| wrong_type("description", description, wanted))?;
        Self::_from_description(cls, &json)
    }

    #[classmethod]
    fn _from_description(_cls: &Bound<PyType>, json: &Bound<PyAny>) -> Result<Self, Error> {
        let json = text("json", json)?;
        let description = serde_json::from_str(&json).map_err(|error| {
            // The reason may quote the input, which can be long.
            let reason: String = error.to_string().chars().take(MAX_REASON).collect();
            Error::new(
                ErrorKind::Input,
                format!("the dict is not a robot description ({reason}): give a dict in the form of Robot.description"),
            )
        })?;
        let robot = Described::new(description).map_err(|error| Error::new(ErrorKind::Input, error))?;
        Ok(Self { inner: Arc::new(robot) })
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (String,))> {
        let json = serde_json::to_string(slf.get().inner.description()).unwrap_or_default();
        Ok((slf.get_type().getattr("_from_description")?.unbind(), (json,)))
    }

    /// Description as a dict, with the keys of a robot file.
    #[getter]
    fn description(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let json = serde_json::to_string(self.inner.description()).unwrap_or_default();
        Ok(py.import("json")?.call_method1("loads", (json,))?.unbind())
    }

    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    /// Hash of the whole description, 16 hexadecimal digits. Equal hashes mean equal machines.
    #[getter]
    fn hash(&self) -> String {
        format_hash(self.inner.hash())
    }

    /// R_min, the min radius of the centreline, mm.
    #[getter]
    fn min_radius_mm(&self) -> f64 {
        self.inner.min_radius()
    }

    /// Default radius of bends, mm.
    #[getter]
    fn planning_radius_mm(&self) -> f64 {
        self.inner.description().planning_radius_mm
    }

    /// Distance from the centreline to the deposited material, mm.
    #[getter]
    fn tip_radius_mm(&self) -> f64 {
        self.inner.tip_radius()
    }

    /// Diameter of the printed tube over its wall, mm.
    #[getter]
    fn outer_diameter_mm(&self) -> f64 {
        self.inner.outer_diameter()
    }

    fn __hash__(&self) -> u64 {
        self.inner.hash()
    }

    fn __repr__(&self) -> String {
        format!("Robot({:?}, min_radius_mm={:?})", self.inner.name(), self.inner.min_radius())
    }
}
