//! Class `growbot.SimulationSummary`: statistics over many growths, in constant memory. Sums are exact, so partial
//! results can be merged in any order.

use growbot_core::hash::Hasher;
use growbot_plan::hexadecimal::format_hash;
use growbot_plan::parallel;
use growbot_sim::simulation::SimulationResult;
use growbot_sim::simulation::campaign::Campaign;
use growbot_sim::simulation::statistics::Statistics;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};

use crate::arguments::{check_rows, integer, text, threads, wrong_type};
use crate::conditions::Conditions;
use crate::error::{Error, ErrorKind};
use crate::interruptible::interruptible;
use crate::py_plan::PyPlan;
use crate::simulate::{rows, seed_of};

/// Number of growths per batch. Only the outcomes of one batch are in memory at a time.
const BATCH: u64 = 16_384;

/// Statistics over many simulated growths: the numbers of `growbot simulate --repeat`.
///
/// Merging summaries of parts gives the same bits in any order.
#[pyclass(frozen, module = "growbot", eq)]
#[derive(Clone, PartialEq)]
pub struct SimulationSummary {
    inner: Campaign,
}

/// Grows a plan count times without a board, with the seeds seed, seed + 1, ..., like `growbot simulate --repeat`.
#[pyfunction]
#[pyo3(signature = (plan, count, *, seed = None, conditions = None, threads = None))]
pub fn simulate_repeated(
    py: Python<'_>,
    plan: &Bound<'_, PyAny>,
    count: &Bound<'_, PyAny>,
    seed: Option<&Bound<'_, PyAny>>,
    conditions: Option<&Bound<'_, PyAny>>,
    threads: Option<&Bound<'_, PyAny>>,
) -> Result<SimulationSummary, Error> {
    let mut whole = Campaign::default();
    let task = RepeatRequest::read(plan, count, seed, conditions, threads)?;
    task.run(py, |seeds, outcomes| py.detach(|| add_all(&mut whole, seeds, &outcomes, task.threads)))?;
    Ok(SimulationSummary { inner: whole })
}

/// Like simulate_repeated, but also returns every growth as a row of simulate_many.
#[pyfunction]
#[pyo3(signature = (plan, count, *, seed = None, conditions = None, threads = None))]
pub fn _simulate_repeated_rows<'py>(
    py: Python<'py>,
    plan: &Bound<'py, PyAny>,
    count: &Bound<'py, PyAny>,
    seed: Option<&Bound<'py, PyAny>>,
    conditions: Option<&Bound<'py, PyAny>>,
    threads: Option<&Bound<'py, PyAny>>,
) -> Result<(SimulationSummary, Bound<'py, PyAny>), Error> {
    let (mut whole, mut tasks, mut grown) = (Campaign::default(), Vec::new(), Vec::new());
    let task = RepeatRequest::read(plan, count, seed, conditions, threads)?;
    check_rows("count", task.count as usize)?;
    task.run(py, |seeds, outcomes| {
        py.detach(|| add_all(&mut whole, seeds, &outcomes, task.threads));
        tasks.extend(seeds.iter().map(|seed| (0, *seed)));
        grown.extend(outcomes);
    })?;
    Ok((SimulationSummary { inner: whole }, rows(py, &tasks, &grown)?))
}

/// Checked arguments of a call that grows one plan many times.
struct RepeatRequest {
    plan: PyPlan,
    count: u64,
    seed: u64,
    conditions: Conditions,
    threads: usize,
}

impl RepeatRequest {
    fn read(
        plan: &Bound<PyAny>,
        count: &Bound<PyAny>,
        seed: Option<&Bound<PyAny>>,
        conditions: Option<&Bound<PyAny>>,
        threads: Option<&Bound<PyAny>>,
    ) -> Result<Self, Error> {
        Ok(Self {
            plan: plan.cast::<PyPlan>().map_err(|_| wrong_type("plan", plan, "a growbot.Plan"))?.get().clone(),
            count: integer("count", count, 0, 1 << 53)?,
            seed: seed_of(seed)?,
            conditions: Conditions::read(conditions)?,
            threads: self::threads(threads)?,
        })
    }

    /// Simulates all growths, and calls `each` with the seeds and the outcomes of each batch.
    fn run(&self, py: Python<'_>, mut each: impl FnMut(&[u64], Vec<SimulationResult>)) -> Result<(), Error> {
        let simulation = self.conditions.simulation(&self.plan)?;
        let mut done = 0;
        while done < self.count {
            let runs = done..self.count.min(done + BATCH);
            done = runs.end;
            let seeds: Vec<u64> = runs.map(|run| self.seed.wrapping_add(run)).collect();
            let outcomes = interruptible(py, self.threads, &seeds, |seed| simulation.run(*seed))?;
            each(&seeds, outcomes);
        }
        Ok(())
    }
}

/// Adds outcomes to the statistics `whole`, on several threads. The result does not depend on the number of threads.
fn add_all(whole: &mut Campaign, seeds: &[u64], outcomes: &[SimulationResult], threads: usize) {
    let pairs: Vec<(&u64, &SimulationResult)> = seeds.iter().zip(outcomes).collect();
    let parts: Vec<_> = pairs.chunks(pairs.len().div_ceil(threads).max(1)).collect();
    let part = |pairs: &&[(&u64, &SimulationResult)]| {
        let mut part = Campaign::default();
        pairs.iter().for_each(|(seed, outcome)| part.add(**seed, outcome));
        part
    };
    parallel::map_on(threads.min(parts.len()), &parts, part, |_| ()).iter().for_each(|part| whole.merge(part));
}

/// Returns statistics as a dict with the keys of `growbot simulate --repeat --json`.
fn statistics<'py>(py: Python<'py>, of: &Statistics) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let numbers = [
        ("mean", of.mean()),
        ("sd", of.deviation()),
        ("min", of.min()),
        ("p50", of.percentile(50.0)),
        ("p95", of.percentile(95.0)),
        ("max", of.max()),
    ];
    for (name, number) in numbers {
        dict.set_item(name, number)?;
    }
    Ok(dict)
}

#[pymethods]
impl SimulationSummary {
    /// Returns an empty summary, into which others can be merged.
    #[new]
    fn new() -> Self {
        Self { inner: Campaign::default() }
    }

    /// Reads a summary from the JSON of to_json.
    #[classmethod]
    #[pyo3(signature = (json))]
    fn from_json(_cls: &Bound<PyType>, json: &Bound<PyAny>) -> Result<Self, Error> {
        let json = text("json", json)?;
        let inner = serde_json::from_str(&json).map_err(|error| {
            Error::new(
                ErrorKind::Input,
                format!("json is not a summary ({error}): give the output of SimulationSummary.to_json"),
            )
        })?;
        Ok(Self { inner })
    }

    /// Returns all sums as JSON. Equal summaries give equal bytes.
    fn to_json(&self) -> String {
        serde_json::to_string(&self.inner).unwrap_or_default()
    }

    /// Hash of to_json(), 16 hexadecimal digits.
    #[getter]
    fn hash(&self) -> String {
        format_hash(Hasher::hash(self.to_json().as_bytes()))
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_json")?.unbind(), (slf.get().to_json(),)))
    }

    /// Returns the merged summary of this and another one.
    #[pyo3(signature = (other))]
    fn merged(&self, py: Python<'_>, other: &Bound<PyAny>) -> Result<Self, Error> {
        let other = other.cast::<Self>().map_err(|_| wrong_type("other", other, "a growbot.SimulationSummary"))?.get();
        let mut inner = self.inner.clone();
        py.detach(|| inner.merge(&other.inner));
        Ok(Self { inner })
    }

    /// Number of growths.
    #[getter]
    fn growth_count(&self) -> u64 {
        self.inner.runs
    }

    /// Statistics of the distance from the goal, mm: mean, sd, min, p50, p95, max.
    #[getter]
    fn position_error_mm<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &self.inner.position_error_mm)
    }

    /// Statistics of the distance from the goal divided by the length of the planned path.
    #[getter]
    fn normalized_position_error<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &self.inner.normalized_position_error)
    }

    /// Statistics of the difference of the headings, degrees, over the growths that have one, or None.
    #[getter]
    fn heading_error_deg<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let of = &self.inner.heading_error_deg;
        (!of.is_empty()).then(|| statistics(py, of)).transpose()
    }

    /// Statistics of the difference of the pitches, degrees.
    #[getter]
    fn pitch_error_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &self.inner.pitch_error_deg)
    }

    /// Statistics of the angle between the directions, degrees.
    #[getter]
    fn direction_error_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &self.inner.direction_error_deg)
    }

    /// Statistics of the number of layers.
    #[getter]
    fn layer_count<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &self.inner.layers)
    }

    /// Seed of the growth that ended farthest from the goal. None without growths.
    #[getter]
    fn worst_seed(&self) -> Option<u64> {
        self.inner.farthest.map(|farthest| farthest.seed)
    }

    /// Greatest distance by which a tip hangs below its position without weight, mm. None without sag.
    #[getter]
    fn max_sag_mm(&self) -> Option<f64> {
        self.inner.hung.map(|hung| hung.deflection)
    }

    fn __hash__(&self) -> u64 {
        Hasher::hash(self.to_json().as_bytes())
    }

    fn __repr__(&self) -> String {
        let mean = self.inner.position_error_mm.mean();
        format!("SimulationSummary(growth_count={}, mean position_error_mm={mean:?})", self.inner.runs)
    }
}
