//! Class `growbot._growbot.RunLog`: logs of growths.

use std::sync::Arc;

use growbot_core::layer_bytes::decode;
use growbot_core::robot::Robot as Described;
use growbot_pictures::view::Subject;
use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::input::MAX_LOG_BYTES;
use growbot_plan::plan as client;
use growbot_plan::run_log::{Events, RecordedRun, RunEvent, RunLine};
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::arguments::{bytes_of_file, path};
use crate::arrays::layer_array;
use crate::error::{Error, ErrorKind};
use crate::page::{framed, page_of};
use crate::py_plan::PyPlan;

/// The log of a growth, as written by `growbot grow --log` and Board.grow, as far as it can be read.
#[pyclass(name = "RunLog", frozen, module = "growbot._growbot", subclass)]
pub struct PyRunLog {
    name: String,
    bytes: Vec<u8>,
    record: RecordedRun,
    plan: Arc<client::Plan>,
    robot: Arc<Described>,
}

impl PyRunLog {
    /// Returns the body of this log, to begin another one at its tip.
    pub fn continued(&self, robot: &Described) -> Result<ContinuedBody, Error> {
        if self.robot.hash() != robot.hash() {
            let message = format!(
                "the body of {} was grown by {}, but the plan is for {}: pass the robot of the body",
                self.name,
                self.robot.name(),
                robot.name()
            );
            return Err(Error::with(ErrorKind::Input, message, robot.name(), self.robot.name()));
        }
        ContinuedBody::of(&self.record).map_err(|error| Error::of(ErrorKind::Input, &error))
    }
}

/// Returns an event of a run log as JSON, without a time of day.
pub fn json_of(event: RunEvent) -> String {
    serde_json::to_string(&RunLine { event, utc: None }).unwrap_or_default()
}

#[pymethods]
impl PyRunLog {
    #[new]
    #[pyo3(signature = (file))]
    fn new(py: Python<'_>, file: &Bound<PyAny>) -> Result<Self, Error> {
        let (bytes, name) = bytes_of_file(&path("file", file)?, MAX_LOG_BYTES)?;
        py.detach(|| {
            let record = RecordedRun::read(&bytes, &name).map_err(|error| Error::of(ErrorKind::File, &error))?;
            let robot = record.own_robot().map_err(|error| Error::of(ErrorKind::File, &error))?;
            let plan = record.plan(&robot).map_err(|error| Error::of(ErrorKind::File, &error))?;
            Ok(Self { name, bytes, record, plan: Arc::new(plan), robot: Arc::new(robot) })
        })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyType>, (String,)) {
        (slf.get_type(), (slf.get().name.clone(),))
    }

    fn __eq__(&self, other: &Bound<PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.bytes == other.get().bytes)
    }

    fn __hash__(&self) -> u64 {
        self.record.plan_id
    }

    /// Plan of the growth.
    #[getter]
    fn plan(&self) -> PyPlan {
        PyPlan { inner: Arc::clone(&self.plan), robot: Arc::clone(&self.robot) }
    }

    /// Outcome of the growth: "done", "stopped", "fault", ... It is "unfinished" if the log has no end.
    #[getter]
    fn outcome(&self) -> &'static str {
        self.record.outcome().name()
    }

    /// True if a simulated robot grew the body.
    #[getter]
    fn simulated(&self) -> bool {
        self.record.is_simulated()
    }

    /// Description of the parts that could not be read. None for a complete log.
    #[getter]
    fn damage(&self) -> Option<String> {
        self.record.damage.message(&self.name)
    }

    /// Returns the layers as the board's steps have built them: a structured array of shape (n,), as in Plan.layers().
    fn layers<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Error> {
        layer_array(py, self.record.as_built.len(), self.record.commanded().map(|layer| (0, decode(&layer))))
    }

    /// Returns the layers as the plastic of a simulated robot lies, as in layers(). None for a real robot.
    fn simulated_layers<'py>(&self, py: Python<'py>) -> Result<Option<Bound<'py, PyAny>>, Error> {
        let Some(layers) = self.record.simulated() else { return Ok(None) };
        layer_array(py, layers.len(), layers.iter().map(|layer| (0, *layer))).map(Some)
    }

    fn _events_json(&self) -> Vec<String> {
        Events::of(&self.bytes).map(json_of).collect()
    }

    fn _result_json(&self) -> Option<String> {
        self.record.result.as_ref().and_then(|result| serde_json::to_string(result).ok())
    }

    /// Returns the page that shows the body: HTML that needs no network.
    fn html(&self, py: Python<'_>) -> Result<String, Error> {
        let subject = Subject {
            name: &self.name,
            robot: &self.robot,
            plan: &self.plan,
            run: Some(&self.record),
            laid: None,
            scene: None,
        };
        page_of(py, &subject)
    }

    fn _repr_html_(&self, py: Python<'_>) -> Result<String, Error> {
        Ok(framed(&self.html(py)?))
    }

    fn __repr__(&self) -> String {
        let (outcome, layers) = (self.record.outcome().name(), self.record.as_built.len());
        format!("RunLog({:?}, outcome={outcome:?}, layers={layers})", self.name)
    }
}
