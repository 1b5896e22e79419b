//! Methods of the class `growbot.Plan`, the classes `growbot.Segment` and `growbot.PlanWarning`, and the functions that
//! plan.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use growbot_core::plan::Planner;
use growbot_core::pose::{Pose as CorePose, tip_direction};
use growbot_core::robot::Robot as Described;
use growbot_core::slicing::{Slicing, layers};
use growbot_pictures::view::Subject;
use growbot_plan::atomic_file::write_atomic;
use growbot_plan::continued_body::ContinuedBody;
use growbot_plan::margin::planning_margin_mm;
use growbot_plan::plan::{self as client, Goal, PlanOptions};
use growbot_plan::plan_file::{self, PlanFile, SegmentJson};
use growbot_plan::scene_planning::{self, EFFORT, MAX_LENGTH_MM, SceneOptions};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyType};

use crate::arguments::{self, Rows, check_rows, flag, integer, number, text, threads, within, word, wrong_type};
use crate::arrays::layer_array;
use crate::error::{Error, ErrorKind};
use crate::interruptible::interruptible;
use crate::page::{framed, page_of};
use crate::path_frames::frames;
use crate::pickle::{self, PlanState};
use crate::pose::{PyPose, as_goal, as_pose, goal_of, pose_of, rows_of};
use crate::py_plan::PyPlan;
use crate::robot::{PyRobot, robot_of};
use crate::run::PyRunLog;
use crate::scene::PyScene;
use crate::simulate::PySimulationResult;

/// A piece of a path.
#[pyclass(name = "Segment", frozen, module = "growbot", get_all, eq)]
#[derive(Clone, PartialEq)]
pub struct PySegment {
    /// "arc", "straight" or "helicoid".
    kind: String,
    /// Length along the segment, mm.
    length_mm: f64,
    /// Angle of greatest deposition in the tip's frame, degrees. The tube bends away from it. None unless it is an arc.
    alpha_deg: Option<f64>,
    /// Angle of the arc, degrees. None unless it is an arc.
    beta_deg: Option<f64>,
    /// m0 of a helicoidal arc, `x'' = w x x'`, `w = m/|m|`, `m = m0 + p x x`, in world axes, lengths in radii.
    m0: Option<[f64; 3]>,
    /// p of a helicoidal arc.
    p: Option<[f64; 3]>,
}

impl From<&SegmentJson> for PySegment {
    fn from(written: &SegmentJson) -> Self {
        let none =
            Self { kind: "straight".to_owned(), length_mm: 0.0, alpha_deg: None, beta_deg: None, m0: None, p: None };
        match *written {
            SegmentJson::Arc { alpha_deg, beta_deg, length_mm } => {
                Self { kind: "arc".to_owned(), length_mm, alpha_deg: Some(alpha_deg), beta_deg: Some(beta_deg), ..none }
            }
            SegmentJson::Straight { length_mm } => Self { length_mm, ..none },
            SegmentJson::Helicoid { length_mm, m0, p } => {
                Self { kind: "helicoid".to_owned(), length_mm, m0: Some(m0), p: Some(p), ..none }
            }
        }
    }
}

/// Fields of a segment for pickle, in the order of [`PySegment`].
type SegmentState = (String, f64, Option<f64>, Option<f64>, Option<[f64; 3]>, Option<[f64; 3]>);

#[pymethods]
impl PySegment {
    #[staticmethod]
    fn _from_state(state: SegmentState) -> Self {
        let (kind, length_mm, alpha_deg, beta_deg, m0, p) = state;
        Self { kind, length_mm, alpha_deg, beta_deg, m0, p }
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (SegmentState,))> {
        let Self { kind, length_mm, alpha_deg, beta_deg, m0, p } = slf.get().clone();
        Ok((slf.get_type().getattr("_from_state")?.unbind(), ((kind, length_mm, alpha_deg, beta_deg, m0, p),)))
    }

    fn __hash__(&self) -> u64 {
        self.length_mm.to_bits()
    }

    fn __repr__(&self) -> String {
        let bend = match (self.alpha_deg, self.beta_deg) {
            (Some(alpha), Some(beta)) => format!(", alpha_deg={alpha:?}, beta_deg={beta:?}"),
            _ => String::new(),
        };
        format!("Segment({:?}, length_mm={:?}{bend})", self.kind, self.length_mm)
    }
}

/// A reason against growing a plan.
#[pyclass(frozen, module = "growbot", get_all, eq)]
#[derive(Clone, PartialEq)]
pub struct PlanWarning {
    /// "thin-layer", "self-collision", "filament-short" or "layer-limit".
    code: String,
    /// Text of the warning.
    message: String,
    /// Value found.
    value: f64,
    /// Limit that the value violates.
    limit: f64,
}

#[pymethods]
impl PlanWarning {
    #[staticmethod]
    fn _from_state(state: (String, String, f64, f64)) -> Self {
        let (code, message, value, limit) = state;
        Self { code, message, value, limit }
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, ((String, String, f64, f64),))> {
        let Self { code, message, value, limit } = slf.get().clone();
        Ok((slf.get_type().getattr("_from_state")?.unbind(), ((code, message, value, limit),)))
    }

    fn __hash__(&self) -> u64 {
        self.value.to_bits() ^ self.limit.to_bits().rotate_left(1)
    }

    fn __repr__(&self) -> String {
        format!("PlanWarning({:?}, value={:?}, limit={:?})", self.code, self.value, self.limit)
    }
}

/// Converts the argument `planner`, the name of a planner. The default is the shortest path.
fn planner_of(value: Option<&Bound<PyAny>>) -> Result<Planner, Error> {
    let Some(value) = value else { return Ok(Planner::Shortest) };
    let name = word("planner", value)?;
    name.parse().map_err(|_| {
        let message = format!("planner is {name:?}: give \"shortest\" or \"two-plane\"");
        Error::with(ErrorKind::Input, message, name, "shortest, two-plane")
    })
}

/// Converts the arguments of a plan's search. The default radius is the robot's planning radius.
fn search_of(
    robot: &Described,
    radius_mm: Option<&Bound<PyAny>>,
    planner: Option<&Bound<PyAny>>,
    avoid_self_collision: Option<&Bound<PyAny>>,
) -> Result<PlanOptions<'static>, Error> {
    Ok(PlanOptions {
        radius: match radius_mm {
            Some(radius) => number("radius_mm", radius)?,
            None => robot.description().planning_radius_mm,
        },
        planner: planner_of(planner)?,
        avoid_self_collision: avoid_self_collision.map_or(Ok(false), |value| flag("avoid_self_collision", value))?,
        existing: None,
    })
}

/// A scene to plan through, with the limits of the search.
struct SceneSearchOptions {
    scene: PyScene,
    effort: u64,
    deadline: Option<Instant>,
}

fn scene_search_options(
    scene: Option<&Bound<PyAny>>,
    effort: Option<&Bound<PyAny>>,
    time_limit_s: Option<&Bound<PyAny>>,
) -> Result<Option<SceneSearchOptions>, Error> {
    let limit = time_limit_s.map(|limit| within("time_limit_s", limit, [1e-3, 86_400.0], "s")).transpose()?;
    let given = effort.map(|effort| integer("effort", effort, 1, 1_000_000)).transpose()?;
    let Some(scene) = scene else {
        return if limit.is_some() || given.is_some() {
            Err(Error::new(
                ErrorKind::Input,
                "effort and time_limit_s apply only to plans through a scene: give scene, or remove them",
            ))
        } else {
            Ok(None)
        };
    };
    let scene = PyScene::given(scene)?;
    let effort = given.unwrap_or(if limit.is_some() { u64::MAX } else { EFFORT });
    let deadline = limit.and_then(|limit| Instant::now().checked_add(Duration::from_secs_f64(limit)));
    Ok(Some(SceneSearchOptions { scene, effort, deadline }))
}

/// Plans the shortest path from a start to a goal that the planner finds.
///
/// start and goal are poses: growbot.Pose, or (x_mm, y_mm, z_mm, heading_deg, pitch_deg). A growbot.RunLog as the start
/// is the tip of its body, which stays in place. A goal (x_mm, y_mm, z_mm) may be reached in any direction. via are
/// poses or positions on the way, in order. radius_mm is that of the bends [default: the robot's planning_radius_mm].
/// planner is "shortest" or "two-plane". With avoid_self_collision, the path is the shortest that does not run into the
/// body. Through a scene, effort limits the work of the search (about 0.1 s per unit), with the same result on every
/// machine. time_limit_s limits its time.
///
/// Raises InputError for a wrong argument (a radius below R_min, for example), and NoPathError if no path is found.
#[pyfunction]
#[pyo3(signature = (start, goal, *, robot = None, radius_mm = None, planner = None, via = None, avoid_self_collision = None, scene = None, effort = None, time_limit_s = None))]
#[expect(clippy::too_many_arguments, reason = "Python's keywords")]
pub fn plan(
    py: Python<'_>,
    start: &Bound<PyAny>,
    goal: &Bound<PyAny>,
    robot: Option<&Bound<PyAny>>,
    radius_mm: Option<&Bound<PyAny>>,
    planner: Option<&Bound<PyAny>>,
    via: Option<&Bound<PyAny>>,
    avoid_self_collision: Option<&Bound<PyAny>>,
    scene: Option<&Bound<PyAny>>,
    effort: Option<&Bound<PyAny>>,
    time_limit_s: Option<&Bound<PyAny>>,
) -> Result<PyPlan, Error> {
    let robot = robot_of(robot)?;
    let continued = start.cast::<PyRunLog>().ok().map(|log| log.get().continued(&robot)).transpose()?;
    let start = continued.as_ref().map_or_else(|| as_pose("start", start), |body| Ok(body.tip()))?;
    let goal = as_goal("goal", goal)?;
    let existing = continued.as_ref().map(ContinuedBody::existing);
    let mut search = PlanOptions { existing, ..search_of(&robot, radius_mm, planner, avoid_self_collision)? };
    let on_the_way = via.map_or(Ok(Vec::new()), goals_on_the_way)?;
    let scene_search = scene_search_options(scene, effort, time_limit_s)?;
    search.avoid_self_collision |= scene_search.is_some();
    let mut plan = py.detach(|| match &scene_search {
        None => client::Plan::through_waypoints(&robot, &start, &on_the_way, &goal, &search).map_err(Error::from),
        Some(SceneSearchOptions { scene, effort, deadline }) => {
            let file = scene.file.display().to_string();
            let through = SceneOptions {
                file: &file,
                loaded: &scene.loaded,
                margin: planning_margin_mm(&robot, &scene.loaded),
                effort: *effort,
                deadline: *deadline,
                first_only: false,
                max_length: MAX_LENGTH_MM,
            };
            let goals: Vec<Goal> = on_the_way.iter().chain([&goal]).copied().collect();
            Ok(scene_planning::plan(&robot, &start, &goals, &search, &through)?)
        }
    })?;
    plan = plan.after_layers(continued.map(|body| body.layers).unwrap_or_default(), &robot);
    Ok(PyPlan { inner: Arc::new(plan), robot })
}

fn goals_on_the_way(via: &Bound<PyAny>) -> Result<Vec<Goal>, Error> {
    let items = via.try_iter().map_err(|_| wrong_type("via", via, "a list of poses and positions"))?;
    let mut goals = Vec::new();
    for (index, item) in items.enumerate() {
        check_rows("via", index + 1)?;
        goals.push(as_goal(&format!("via[{index}]"), &item?)?);
    }
    Ok(goals)
}

/// Plans from starts to goals, on all cores. Returns a list of plans in the order of the rows.
///
/// starts has shape (n, 5): x_mm, y_mm, z_mm, heading_deg, pitch_deg. One pose stands for all rows. goals has shape
/// (n, 5), or (n, 3) for any directions. The other arguments are those of plan. Raises the error of the first row that
/// has no plan, with its number.
#[pyfunction]
#[pyo3(signature = (starts, goals, *, robot = None, radius_mm = None, planner = None, avoid_self_collision = None, threads = None))]
#[expect(clippy::too_many_arguments, reason = "Python's keywords")]
pub fn plan_many<'py>(
    py: Python<'py>,
    starts: &Bound<'py, PyAny>,
    goals: &Bound<'py, PyAny>,
    robot: Option<&Bound<'py, PyAny>>,
    radius_mm: Option<&Bound<'py, PyAny>>,
    planner: Option<&Bound<'py, PyAny>>,
    avoid_self_collision: Option<&Bound<'py, PyAny>>,
    threads: Option<&Bound<'py, PyAny>>,
) -> Result<Bound<'py, PyList>, Error> {
    let robot = robot_of(robot)?;
    let search = search_of(&robot, radius_mm, planner, avoid_self_collision)?;
    let threads = self::threads(threads)?;
    let rows = Rows::read("goals", goals, &[3, 5])?;
    let goals = (0..rows.count)
        .map(|row| goal_of(&rows.numbers[row * rows.width..(row + 1) * rows.width]).map_err(|error| error.of_row(row)))
        .collect::<Result<Vec<Goal>, _>>()?;
    let starts = starts_of(starts, goals.len())?;
    let tasks: Vec<(CorePose, Goal)> =
        goals.iter().enumerate().map(|(row, goal)| (starts[row.min(starts.len() - 1)], *goal)).collect();
    let planned = interruptible(py, threads, &tasks, |(start, goal)| {
        client::Plan::through_waypoints(&robot, start, &[], goal, &search)
    })?;
    let plans = planned
        .into_iter()
        .enumerate()
        .map(|(row, plan)| match plan {
            Ok(plan) => Ok(PyPlan { inner: Arc::new(plan), robot: Arc::clone(&robot) }),
            Err(error) => Err(Error::from(error).of_row(row)),
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(PyList::new(py, plans)?)
}

/// Converts the argument `starts`: one start for all goals, or a start for each goal. `goals` is the number of goals.
fn starts_of(starts: &Bound<PyAny>, goals: usize) -> Result<Vec<CorePose>, Error> {
    if starts.is_instance_of::<PyPose>() {
        return Ok(vec![as_pose("starts", starts)?]);
    }
    if let Ok(rows) = Rows::flat("starts", starts)
        && let Ok(numbers) = <[f64; 5]>::try_from(rows.numbers)
    {
        return Ok(vec![pose_of(numbers)?]);
    }
    let rows = Rows::read("starts", starts, &[5])?;
    if rows.count != goals || goals == 0 {
        let message = format!(
            "starts has {} rows, but goals has {goals}: give the same number, or one start for all",
            rows.count
        );
        return Err(Error::with(ErrorKind::Type, message, rows.count as f64, goals as f64));
    }
    let pose = |row: &[f64]| pose_of([row[0], row[1], row[2], row[3], row[4]]);
    rows.numbers
        .chunks_exact(5)
        .enumerate()
        .map(|(row, numbers)| pose(numbers).map_err(|error| error.of_row(row)))
        .collect()
}

/// Writes a file atomically. If that fails, an existing file stays unchanged.
pub fn write_whole(file: &Path, contents: &[u8]) -> Result<(), Error> {
    write_atomic(file, contents).map_err(|error| Error::new(ErrorKind::File, error))
}

#[pymethods]
impl PyPlan {
    /// Reads a plan's file, and checks it in full.
    #[classmethod]
    #[pyo3(signature = (file))]
    fn load(cls: &Bound<PyType>, file: &Bound<PyAny>) -> Result<Self, Error> {
        let file = arguments::path("file", file)?;
        let (text, name) = arguments::text_of_file(&file)?;
        let read = cls.py().detach(|| plan_file::read(&text, &name, None));
        let (robot, plan) = read.map_err(|error| Error::of(ErrorKind::File, &error))?;
        Ok(Self { inner: Arc::new(plan), robot: Arc::new(robot) })
    }

    /// Reads a plan's JSON, and checks it in full.
    #[classmethod]
    #[pyo3(signature = (json))]
    fn from_json(cls: &Bound<PyType>, json: &Bound<PyAny>) -> Result<Self, Error> {
        let json = text("json", json)?;
        let read = cls.py().detach(|| plan_file::read(&json, "json", None));
        let (robot, plan) = read.map_err(|error| Error::of(ErrorKind::Input, &error))?;
        Ok(Self { inner: Arc::new(plan), robot: Arc::new(robot) })
    }

    #[classmethod]
    fn _from_state(_cls: &Bound<PyType>, robot: &Bound<PyRobot>, state: PlanState) -> Result<Self, Error> {
        let robot = Arc::clone(&robot.get().inner);
        Ok(Self { inner: Arc::new(pickle::plan(&robot, state)?), robot })
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (PyRobot, PlanState))> {
        let Self { inner, robot } = slf.get();
        let robot = PyRobot { inner: Arc::clone(robot) };
        Ok((slf.get_type().getattr("_from_state")?.unbind(), (robot, pickle::of(inner))))
    }

    fn __eq__(&self, other: &Bound<PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.inner == other.get().inner)
    }

    fn __hash__(&self) -> u64 {
        self.inner.robot_hash
            ^ self.inner.requirements.length.to_bits()
            ^ (self.inner.requirements.layers as u64).rotate_left(32)
    }

    fn __repr__(&self) -> String {
        let plan = &self.inner;
        let (kind, length, layers) = (plan.path_type(), plan.requirements.length, plan.requirements.layers);
        format!("Plan({kind:?}, length_mm={length:?}, layer_count={layers}, robot={:?})", plan.robot)
    }

    fn _repr_html_(&self, py: Python<'_>) -> Result<String, Error> {
        Ok(framed(&self.html(py)?))
    }

    /// The robot.
    #[getter]
    fn robot(&self) -> PyRobot {
        PyRobot { inner: Arc::clone(&self.robot) }
    }

    /// Start of the tip.
    #[getter]
    fn start(&self) -> PyPose {
        self.inner.start.into()
    }

    /// Goal of the tip. If its direction was free, it is the one that the planner selected.
    #[getter]
    fn goal(&self) -> PyPose {
        self.inner.goal.into()
    }

    /// Poses on the way.
    #[getter]
    fn via(&self) -> Vec<PyPose> {
        self.inner.via().into_iter().map(PyPose::from).collect()
    }

    /// Planner that found the path: "shortest" or "two-plane".
    #[getter]
    fn planner(&self) -> &'static str {
        self.inner.planner.name()
    }

    /// Radius of the bends, mm.
    #[getter]
    fn radius_mm(&self) -> f64 {
        self.inner.radius
    }

    /// Length of the path, mm.
    #[getter]
    fn length_mm(&self) -> f64 {
        self.inner.requirements.length
    }

    /// Number of layers.
    #[getter]
    fn layer_count(&self) -> usize {
        self.inner.requirements.layers
    }

    /// Time to lay the layers, s.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.requirements.duration
    }

    /// Length of filament, mm.
    #[getter]
    fn filament_mm(&self) -> f64 {
        self.inner.requirements.filament
    }

    /// Types of the segments: C for an arc, S for a straight line, H for a helicoidal arc.
    #[getter]
    fn path_type(&self) -> String {
        self.inner.path_type()
    }

    /// Segments of the path, in order.
    #[getter]
    fn segments(&self) -> Vec<PySegment> {
        PlanFile::from(&*self.inner).segments.iter().map(PySegment::from).collect()
    }

    /// Reasons against growing the plan.
    #[getter]
    fn warnings(&self) -> Vec<PlanWarning> {
        let warning = |warning: &growbot_plan::warning::Warning| PlanWarning {
            code: warning.code.clone(),
            message: warning.message.clone(),
            value: warning.value,
            limit: warning.limit,
        };
        self.inner.warnings.iter().map(warning).collect()
    }

    /// Proven min clearance between the outside of the tube and everything in the scene, mm. None without a scene.
    #[getter]
    fn clearance_mm(&self) -> Option<f64> {
        self.inner.scene.as_ref().map(|scene| scene.clearance)
    }

    /// Returns n points at equal distances along the path, both ends included: positions (n, 3), mm, and directions of
    /// growth (n, 3), unit vectors.
    #[pyo3(signature = (n))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        n: &Bound<'py, PyAny>,
    ) -> Result<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>), Error> {
        let count = integer("n", n, 2, arguments::MAX_ROWS as u64)? as usize;
        let length = self.inner.requirements.length;
        let last = (count - 1) as f64;
        let lengths: Vec<f64> = (0..count).map(|index| length * (index as f64 / last)).collect();
        let frames = py.detach(|| frames(&self.inner.path, &self.inner.start.frame(), &lengths));
        let flat = |of: fn(&growbot_core::pose::Frame) -> nalgebra::Vector3<f64>| {
            let numbers: Vec<f64> = frames.iter().flat_map(|frame| <[f64; 3]>::from(of(frame))).collect();
            PyArray1::from_vec(py, numbers).reshape([count, 3])
        };
        Ok((flat(|frame| frame.translation.vector)?, flat(tip_direction)?))
    }

    /// Returns the tip's frames (base from tip, mm) at lengths s_mm along the path: shape (n, 4, 4). s_mm is a number
    /// or has shape (n,), from 0 to length_mm.
    #[pyo3(signature = (s_mm))]
    fn frames<'py>(&self, py: Python<'py>, s_mm: &Bound<'py, PyAny>) -> Result<Bound<'py, PyArray3<f64>>, Error> {
        let lengths = Rows::flat("s_mm", s_mm)?.numbers;
        let max = self.inner.requirements.length;
        if let Some(wrong) = lengths.iter().find(|length| !(0.0..=max).contains(*length)) {
            return Err(crate::error::outside("s_mm", *wrong, [0.0, max], "mm"));
        }
        let frames = py.detach(|| frames(&self.inner.path, &self.inner.start.frame(), &lengths));
        let numbers: Vec<f64> = frames.iter().flat_map(rows_of).collect();
        Ok(PyArray1::from_vec(py, numbers).reshape([lengths.len(), 4, 4])?)
    }

    /// Returns the layers: a structured array of shape (n,) with the fields layer, segment, alpha_deg, height_mm and
    /// tilt_deg.
    fn layers<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyAny>, Error> {
        let all = layers(&self.inner.path, &self.robot, Slicing::Exact).map(|sliced| (sliced.segment, sliced.layer));
        layer_array(py, self.inner.requirements.layers, all)
    }

    /// Returns the plan as JSON, in the format of `growbot plan -o`.
    fn to_json(&self) -> String {
        PlanFile::with_robot(&self.inner, &self.robot).to_text()
    }

    /// Writes the plan to a file (.json) that growbot and Plan.load read.
    #[pyo3(signature = (file))]
    fn save(&self, file: &Bound<PyAny>) -> Result<(), Error> {
        write_whole(&arguments::path("file", file)?, self.to_json().as_bytes())
    }

    /// Returns the page that shows the body: HTML that needs no network.
    fn html(&self, py: Python<'_>) -> Result<String, Error> {
        let subject =
            Subject { name: "plan", robot: &self.robot, plan: &self.inner, run: None, laid: None, scene: None };
        page_of(py, &subject)
    }

    /// Writes the page to a file [default: a temporary one], and opens it in the browser. Returns the path of the file.
    #[pyo3(signature = (file = None, *, browser = None))]
    fn view(
        slf: &Bound<Self>,
        file: Option<&Bound<PyAny>>,
        browser: Option<&Bound<PyAny>>,
    ) -> Result<Py<PyAny>, Error> {
        let browser = browser.map_or(Ok(true), |value| flag("browser", value))?;
        let file = file.map(|file| arguments::path("file", file)).transpose()?;
        let keywords = PyDict::new(slf.py());
        keywords.set_item("browser", browser)?;
        let view = slf.py().import("growbot._view")?.getattr("view")?;
        Ok(view.call((slf, file), Some(&keywords))?.unbind())
    }

    /// Grows the plan without a board, layer by layer, under conditions (growbot.Conditions) [default: no errors].
    /// Equal seeds give equal growths.
    #[pyo3(signature = (*, seed = None, conditions = None))]
    fn simulate(
        &self,
        py: Python<'_>,
        seed: Option<&Bound<PyAny>>,
        conditions: Option<&Bound<PyAny>>,
    ) -> Result<PySimulationResult, Error> {
        PySimulationResult::grow(py, self, seed, conditions)
    }
}
