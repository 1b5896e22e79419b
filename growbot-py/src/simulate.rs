//! Simulated growths without a board: class `growbot.SimulationResult`, and `simulate_many`.

use std::sync::Arc;

use growbot_client::growth::DEFAULT_SEED;
use growbot_core::layer::Layer;
use growbot_core::robot::Robot as Described;
use growbot_pictures::view::{SimulatedBody, Subject};
use growbot_plan::plan as client;
use growbot_plan::plan_deviation::{PlanDeviation, centreline};
use growbot_sim::simulation::{Simulation, SimulationResult as CoreResult};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyAnyMethods;

use crate::arguments::{check_rows, integer, threads, wrong_type};
use crate::arrays::{layer_array, structured};
use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::interruptible::interruptible;
use crate::page::{framed, page_of};
use crate::pose::PyPose;
use crate::py_plan::PyPlan;

/// A growth that was simulated without a board.
#[pyclass(name = "SimulationResult", frozen, module = "growbot")]
pub struct PySimulationResult {
    plan: Arc<client::Plan>,
    robot: Arc<Described>,
    seed: u64,
    conditions: Option<Py<PyAny>>,
    outcome: CoreResult,
    laid: Vec<Layer>,
}

impl PySimulationResult {
    /// Simulates one growth of a plan.
    pub fn grow(
        py: Python<'_>,
        plan: &PyPlan,
        seed: Option<&Bound<PyAny>>,
        conditions: Option<&Bound<PyAny>>,
    ) -> Result<Self, Error> {
        let seed = seed_of(seed)?;
        let simulation = Conditions::read(conditions)?.simulation(plan)?;
        let conditions = conditions.map(|conditions| conditions.clone().unbind());
        let (outcome, laid) = py.detach(|| {
            let mut laid = Vec::new();
            let outcome = simulation.run_by_layer(seed, |layer| laid.push(*layer));
            (outcome, simulation.layers_as_laid(&laid))
        });
        Ok(Self { plan: Arc::clone(&plan.inner), robot: Arc::clone(&plan.robot), seed, conditions, outcome, laid })
    }
}

/// Converts the argument `seed`, the seed of random errors. The default is 1.
pub fn seed_of(value: Option<&Bound<PyAny>>) -> Result<u64, Error> {
    value.map_or(Ok(DEFAULT_SEED), |value| integer("seed", value, 0, u64::MAX))
}

#[pymethods]
impl PySimulationResult {
    /// Grows the body again. pickle stores only plan, seed and conditions.
    #[staticmethod]
    fn _again(
        py: Python<'_>,
        plan: &Bound<'_, PyPlan>,
        seed: &Bound<'_, PyAny>,
        conditions: Option<&Bound<'_, PyAny>>,
    ) -> Result<Self, Error> {
        Self::grow(py, plan.get(), Some(seed), conditions)
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (PyPlan, u64, Option<Py<PyAny>>))> {
        let Self { plan, robot, seed, conditions, .. } = slf.get();
        let plan = PyPlan { inner: Arc::clone(plan), robot: Arc::clone(robot) };
        let conditions = conditions.as_ref().map(|conditions| conditions.clone_ref(slf.py()));
        Ok((slf.get_type().getattr("_again")?.unbind(), (plan, *seed, conditions)))
    }

    /// Seed of the random errors.
    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    /// Number of layers laid.
    #[getter]
    fn layer_count(&self) -> u64 {
        self.outcome.grown.layers
    }

    /// Length of the body, mm.
    #[getter]
    fn length_mm(&self) -> f64 {
        self.outcome.grown.length
    }

    /// Pose of the tip at the end.
    #[getter]
    fn final_pose(&self) -> PyPose {
        self.outcome.arrival.final_pose.into()
    }

    /// Distance of the tip from the goal, mm.
    #[getter]
    fn position_error_mm(&self) -> f64 {
        self.outcome.arrival.position_error_mm
    }

    /// position_error_mm divided by the length of the planned path. 0 for a path of length 0.
    #[getter]
    fn normalized_position_error(&self) -> f64 {
        self.outcome.arrival.normalized_position_error
    }

    /// Difference of the headings, degrees, or None: a vertical tip or goal has no heading.
    #[getter]
    fn heading_error_deg(&self) -> Option<f64> {
        self.outcome.arrival.heading_error_deg
    }

    /// Difference of the pitches, degrees.
    #[getter]
    fn pitch_error_deg(&self) -> f64 {
        self.outcome.arrival.pitch_error_deg
    }

    /// Angle between the directions, degrees.
    #[getter]
    fn direction_error_deg(&self) -> f64 {
        self.outcome.arrival.direction_error_deg
    }

    /// Pose of the tip as feedback estimates it. None without feedback.
    #[getter]
    fn estimated_pose(&self) -> Option<PyPose> {
        let estimate = self.outcome.grown.estimate.as_ref()?;
        Some(growbot_core::pose::Pose::from_frame(&estimate.base_from_tip).into())
    }

    /// Standard deviation of the estimated position, mm. None without feedback.
    #[getter]
    fn position_sd_mm(&self) -> Option<f64> {
        self.outcome.grown.estimate.as_ref().map(|estimate| estimate.position_sd)
    }

    /// Estimated systematic error of the growth, percent. None without feedback.
    #[getter]
    fn growth_bias_percent(&self) -> Option<f64> {
        self.outcome.grown.estimate.as_ref().map(|estimate| 100.0 * estimate.systematic_errors.growth)
    }

    /// Distance by which the tip hangs below its position without weight, mm. None without sag.
    #[getter]
    fn sag_mm(&self) -> Option<f64> {
        self.outcome.sag.map(|hung| hung.deflection)
    }

    /// Greatest distance of the body, as it lies, from the planned path, mm.
    #[getter]
    fn plan_deviation_mm(&self, py: Python<'_>) -> f64 {
        let start = self.plan.start.frame();
        py.detach(|| PlanDeviation::of(&self.plan, &self.robot, &centreline(&start, self.laid.iter().copied())).max_mm)
    }

    /// Returns the layers of the body as it lies: a structured array of shape (n,) with the fields layer, segment
    /// (always 0), alpha_deg, height_mm and tilt_deg. Each begins where the one before ends, so twist is part of all
    /// later angles. With sag the layers are bent as the body hangs.
    fn layers<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Error> {
        layer_array(py, self.laid.len(), self.laid.iter().map(|layer| (0, *layer)))
    }

    /// Returns the page that shows the body as it was laid: HTML that needs no network.
    fn html(&self, py: Python<'_>) -> Result<String, Error> {
        let subject = Subject {
            name: "simulated growth",
            robot: &self.robot,
            plan: &self.plan,
            run: None,
            laid: Some(SimulatedBody { layers: &self.laid, tip: self.outcome.arrival.final_pose }),
            scene: None,
        };
        page_of(py, &subject)
    }

    fn _repr_html_(&self, py: Python<'_>) -> Result<String, Error> {
        Ok(framed(&self.html(py)?))
    }

    fn __eq__(&self, other: &Bound<PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let other = other.get();
            self.plan == other.plan
                && self.outcome == other.outcome
                && self.laid == other.laid
                && self.seed == other.seed
        })
    }

    fn __hash__(&self) -> u64 {
        self.outcome.arrival.position_error_mm.to_bits() ^ self.seed
    }

    fn __repr__(&self) -> String {
        let Self { outcome, seed, .. } = self;
        let (error, layers) = (outcome.arrival.position_error_mm, outcome.grown.layers);
        format!("SimulationResult(position_error_mm={error:?}, layer_count={layers}, seed={seed})")
    }
}

/// Names and NumPy types of the fields of a row that [`simulate_many`] returns.
const FIELDS: [(&str, &str); 14] = [
    ("plan", "<i8"),
    ("seed", "<u8"),
    ("layers", "<i8"),
    ("length_mm", "<f8"),
    ("x_mm", "<f8"),
    ("y_mm", "<f8"),
    ("z_mm", "<f8"),
    ("heading_deg", "<f8"),
    ("pitch_deg", "<f8"),
    ("position_error_mm", "<f8"),
    ("normalized_position_error", "<f8"),
    ("heading_error_deg", "<f8"),
    ("pitch_error_deg", "<f8"),
    ("direction_error_deg", "<f8"),
];

/// Grows plans without a board, once for each seed, on all cores.
///
/// plans is one plan for all seeds, or a list of as many as there are seeds. seeds are integers, shape (n,). Returns a
/// structured array of shape (n,): plan (its index), seed, layers, length_mm, x_mm, y_mm, z_mm, heading_deg, pitch_deg
/// (the pose of the tip), position_error_mm, normalized_position_error, heading_error_deg (NaN if tip or goal is
/// vertical), pitch_error_deg and direction_error_deg. Each row equals the result of `growbot simulate` with its seed.
#[pyfunction]
#[pyo3(signature = (plans, seeds, *, conditions = None, threads = None))]
pub fn simulate_many<'py>(
    py: Python<'py>,
    plans: &Bound<'py, PyAny>,
    seeds: &Bound<'py, PyAny>,
    conditions: Option<&Bound<'py, PyAny>>,
    threads: Option<&Bound<'py, PyAny>>,
) -> Result<Bound<'py, PyAny>, Error> {
    let conditions = Conditions::read(conditions)?;
    let threads = self::threads(threads)?;
    let seeds = seeds_of(seeds)?;
    let plans = plans_of(plans, seeds.len())?;
    let simulations = plans.iter().map(|plan| conditions.simulation(plan)).collect::<Result<Vec<Simulation>, _>>()?;
    let tasks: Vec<(usize, u64)> =
        seeds.iter().enumerate().map(|(row, seed)| (row.min(simulations.len().saturating_sub(1)), *seed)).collect();
    let grown = interruptible(py, threads, &tasks, |(plan, seed)| simulations[*plan].run(*seed))?;
    rows(py, &tasks, &grown)
}

/// Returns outcomes of growths as a structured array with the fields `FIELDS`. `tasks` are the index of the plan and
/// the seed of each growth.
pub fn rows<'py>(py: Python<'py>, tasks: &[(usize, u64)], grown: &[CoreResult]) -> Result<Bound<'py, PyAny>, Error> {
    let array = structured(py, grown.len(), &FIELDS)?;
    let set = |name: &str, of: &dyn Fn(&CoreResult) -> f64| {
        array.set_item(name, PyArray1::from_vec(py, grown.iter().map(of).collect()))
    };
    array.set_item("plan", PyArray1::from_vec(py, tasks.iter().map(|(plan, _)| *plan as i64).collect()))?;
    array.set_item("seed", PyArray1::from_vec(py, tasks.iter().map(|(_, seed)| *seed).collect()))?;
    let layers = grown.iter().map(|outcome| outcome.grown.layers as i64).collect();
    array.set_item("layers", PyArray1::from_vec(py, layers))?;
    set("length_mm", &|outcome| outcome.grown.length)?;
    set("x_mm", &|outcome| outcome.arrival.final_pose.position().x)?;
    set("y_mm", &|outcome| outcome.arrival.final_pose.position().y)?;
    set("z_mm", &|outcome| outcome.arrival.final_pose.position().z)?;
    set("heading_deg", &|outcome| PyPose::from(outcome.arrival.final_pose).heading_deg())?;
    set("pitch_deg", &|outcome| PyPose::from(outcome.arrival.final_pose).pitch_deg())?;
    set("position_error_mm", &|outcome| outcome.arrival.position_error_mm)?;
    set("normalized_position_error", &|outcome| outcome.arrival.normalized_position_error)?;
    set("heading_error_deg", &|outcome| outcome.arrival.heading_error_deg.unwrap_or(f64::NAN))?;
    set("pitch_error_deg", &|outcome| outcome.arrival.pitch_error_deg)?;
    set("direction_error_deg", &|outcome| outcome.arrival.direction_error_deg)?;
    Ok(array)
}

/// Converts the argument `seeds`: a list, a range or an array of integers.
fn seeds_of(seeds: &Bound<PyAny>) -> Result<Vec<u64>, Error> {
    let wanted = "whole numbers that are not negative, shape (n,)";
    let numpy = seeds.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (seeds,)).map_err(|_| wrong_type("seeds", seeds, wanted))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let [count] = shape[..] else { return Err(crate::arguments::wrong_shape("seeds", &shape, wanted)) };
    check_rows("seeds", count)?;
    if count == 0 {
        return Ok(Vec::new());
    }
    if kind != "u" && kind != "i" {
        let dtype = array.getattr("dtype")?.str()?.to_string();
        let message = format!("seeds is an array of {dtype}: give {wanted}");
        return Err(Error::with(ErrorKind::Type, message, dtype, "uint64"));
    }
    if kind == "i" && array.call_method0("min")?.extract::<i64>()? < 0 {
        let least: i64 = array.call_method0("min")?.extract()?;
        return Err(Error::with(ErrorKind::Input, format!("seeds holds {least}: give {wanted}"), least as f64, 0.0));
    }
    Ok(array.call_method1("astype", ("uint64",))?.extract::<Vec<u64>>()?)
}

/// Converts the argument `plans`: one plan for all seeds, or a list with a plan for each seed. `seeds` is the number of
/// seeds.
fn plans_of(plans: &Bound<PyAny>, seeds: usize) -> Result<Vec<PyPlan>, Error> {
    let wanted = "a growbot.Plan or a list of them";
    if let Ok(plan) = plans.cast::<PyPlan>() {
        return Ok(vec![plan.get().clone()]);
    }
    let mut all = Vec::new();
    for item in plans.try_iter().map_err(|_| wrong_type("plans", plans, wanted))? {
        let item = item?;
        check_rows("plans", all.len() + 1)?;
        all.push(item.cast::<PyPlan>().map_err(|_| wrong_type("plans", &item, wanted))?.get().clone());
    }
    if all.len() == seeds {
        return Ok(all);
    }
    let message =
        format!("plans has {} entries, but seeds has {seeds}: give the same number, or one plan for all", all.len());
    Err(Error::with(ErrorKind::Type, message, all.len() as f64, seeds as f64))
}
