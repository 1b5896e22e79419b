//! Class `growbot._growbot.Board`: a robot at a port. `python/growbot/_board.py` wraps it and its growths in context
//! managers and typed events.

use growbot_client::growth::{LogTarget, Override};
use pyo3::prelude::*;

use crate::arguments::{flag, path, word, wrong_type};
use crate::board_handle::{BoardHandle, GrowthArguments};
use crate::conditions::Conditions;
use crate::error::Error;
use crate::growth::Growth;
use crate::local_board::LocalBoard;
use crate::preconditions::check_conditions;
use crate::py_plan::PyPlan;
use crate::remote_board::RemoteBoard;
use crate::robot::robot_of;
use crate::scene::PyScene;
use crate::simulate::seed_of;

/// A robot at a port.
#[pyclass(name = "Board", frozen, module = "growbot._growbot")]
pub struct PyBoard {
    board: Box<dyn BoardHandle>,
    /// True if the robot is simulated.
    #[pyo3(get)]
    simulated: bool,
    /// True if a service owns the robot.
    #[pyo3(get)]
    is_remote: bool,
}

#[pymethods]
impl PyBoard {
    #[new]
    #[pyo3(signature = (port, robot = None, take_over = None))]
    fn new(
        py: Python<'_>,
        port: &Bound<PyAny>,
        robot: Option<&Bound<PyAny>>,
        take_over: Option<&Bound<PyAny>>,
    ) -> Result<Self, Error> {
        let name = word("port", port)?;
        if let Some(board) = RemoteBoard::find(py, name.clone())? {
            return Ok(Self { simulated: board.kind.is_simulated(), is_remote: true, board: Box::new(board) });
        }
        let take_over = take_over.map_or(Ok(false), |value| flag("take_over", value))?;
        let board = LocalBoard::open(py, name, robot_of(robot)?, take_over)?;
        Ok(Self { simulated: board.kind.is_simulated(), is_remote: false, board: Box::new(board) })
    }

    fn status_json(&self, py: Python<'_>) -> Result<String, Error> {
        Ok(serde_json::to_string(&self.board.status(py)?).unwrap_or_default())
    }

    fn stop(&self, py: Python<'_>) -> Result<String, Error> {
        self.board.stop(py)
    }

    fn emergency_stop(&self, py: Python<'_>) -> Result<(), Error> {
        self.board.emergency_stop(py)
    }

    #[pyo3(signature = (plan, conditions = None, seed = None, log = None, overwrite = None, force = None, ignore_scene = None, scene = None))]
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    fn grow(
        &self,
        plan: &Bound<PyAny>,
        conditions: Option<&Bound<PyAny>>,
        seed: Option<&Bound<PyAny>>,
        log: Option<&Bound<PyAny>>,
        overwrite: Option<&Bound<PyAny>>,
        force: Option<&Bound<PyAny>>,
        ignore_scene: Option<&Bound<PyAny>>,
        scene: Option<&Bound<PyAny>>,
    ) -> Result<Growth, Error> {
        let is_set = |name, value: Option<&Bound<PyAny>>| value.map_or(Ok(false), |value| flag(name, value));
        let arguments = GrowthArguments {
            plan: plan.cast::<PyPlan>().map_err(|_| wrong_type("plan", plan, "a growbot.Plan"))?.get().clone(),
            conditions: Conditions::read(conditions)?,
            seed: seed_of(seed)?,
            scene: scene.map(PyScene::given).transpose()?,
            log: match (log.map(|file| path("log", file)).transpose()?, is_set("overwrite", overwrite)?) {
                (None, _) => LogTarget::Disabled,
                (Some(file), true) => LogTarget::Replaced(file),
                (Some(file), false) => LogTarget::File(file),
            },
            overrides: Override::given([
                (is_set("force", force)?, Override::Warnings),
                (is_set("ignore_scene", ignore_scene)?, Override::Scene),
            ]),
        };
        check_conditions(&arguments.conditions)?;
        self.board.grow(plan.py(), arguments)
    }

    fn attach(&self, py: Python<'_>) -> Result<Growth, Error> {
        self.board.attach(py)
    }

    fn close(&self, py: Python<'_>) -> Result<(), Error> {
        self.board.close(py)
    }
}
