//! Class `growbot.Pose`, and conversion of arguments to poses and goals.

use growbot_core::angle::radians;
use growbot_core::pose::{Frame, Pose as Inner, Position};
use growbot_plan::degrees::{shortest_degrees, shortest_heading};
use growbot_plan::plan::Goal;
use growbot_plan::pose_text::pose_of_numbers;
use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyString, PyTuple, PyType};

use crate::arguments::{Rows, fixed, number, real_number, wrong_shape, wrong_type};
use crate::error::{Error, ErrorKind};

/// Maximum deviation of a matrix from a rigid transform. The square of this number is the minimum length of a
/// direction.
const ROTATION: f64 = 1e-6;

/// The position of a tip and its direction of growth.
///
/// Pose(x_mm, y_mm, z_mm, heading_deg, pitch_deg). Heading is the direction's angle in the x-y plane, and pitch its
/// angle above that plane: 90 is straight up. Five such numbers can replace a pose in every argument. The keyword
/// roll_deg turns the frame about the direction; only the start of a body at the tip of another one has a roll.
#[pyclass(name = "Pose", frozen, module = "growbot", eq)]
#[derive(Clone, PartialEq)]
pub struct PyPose {
    pub inner: Inner,
}

impl From<Inner> for PyPose {
    fn from(inner: Inner) -> Self {
        Self { inner }
    }
}

/// Creates a pose from x, y, z in mm, heading and pitch in degrees, as the command `growbot` does.
pub fn pose_of(numbers: [f64; 5]) -> Result<Inner, Error> {
    // -0 becomes 0, as in typed numbers.
    Ok(pose_of_numbers(numbers.map(|number| number + 0.0))?)
}

/// Creates a goal from three numbers (a position, mm) or five (a pose, mm and degrees).
pub fn goal_of(numbers: &[f64]) -> Result<Goal, Error> {
    match *numbers {
        [x, y, z] => Ok(Goal::Position(Position::new(Vector3::new(x + 0.0, y + 0.0, z + 0.0))?)),
        [x, y, z, heading, pitch] => Ok(Goal::Pose(pose_of([x, y, z, heading, pitch])?)),
        _ => Err(Error::new(ErrorKind::Type, "a goal has 3 or 5 numbers: give x, y, z, or x, y, z, heading, pitch")),
    }
}

/// Converts an argument that is a sequence of numbers to a vector, whose length must be one of `counts`. Lists and
/// tuples are read without NumPy, which need not be installed for them. Other sequences are read by NumPy, because the
/// index of some, such as a pandas Series, is a label.
fn few(name: &str, value: &Bound<PyAny>, counts: &[usize]) -> Result<Vec<f64>, Error> {
    let wanted = if counts.contains(&3) {
        "a growbot.Pose, (x_mm, y_mm, z_mm, heading_deg, pitch_deg), or (x_mm, y_mm, z_mm) for any direction"
    } else {
        "a growbot.Pose or (x_mm, y_mm, z_mm, heading_deg, pitch_deg)"
    };
    if !value.is_instance_of::<PyList>() && !value.is_instance_of::<PyTuple>() {
        if value.is_instance_of::<PyString>() || !value.hasattr("__len__")? {
            return Err(wrong_type(name, value, wanted));
        }
        let numbers = Rows::flat(name, value)?.numbers;
        let found = numbers.len();
        return if counts.contains(&found) { Ok(numbers) } else { Err(wrong_shape(name, &[found], wanted)) };
    }
    let items: Vec<Bound<PyAny>> = value.try_iter()?.collect::<PyResult<_>>()?;
    if !counts.contains(&items.len()) {
        return Err(wrong_shape(name, &[items.len()], wanted));
    }
    let number = |(index, item): (usize, &Bound<PyAny>)| {
        real_number(item).ok_or_else(|| wrong_type(&format!("{name}[{index}]"), item, wanted))
    };
    items.iter().enumerate().map(number).collect()
}

/// Converts an argument to a pose: a `growbot.Pose` or five numbers.
pub fn as_pose(name: &str, value: &Bound<PyAny>) -> Result<Inner, Error> {
    if let Ok(pose) = value.cast::<PyPose>() {
        return Ok(pose.get().inner);
    }
    match few(name, value, &[5])?[..] {
        [x, y, z, heading, pitch] => pose_of([x, y, z, heading, pitch]),
        _ => Err(wrong_type(name, value, "five numbers")),
    }
}

/// Converts an argument to a goal: a `growbot.Pose`, five numbers, or three numbers for a position.
pub fn as_goal(name: &str, value: &Bound<PyAny>) -> Result<Goal, Error> {
    match value.cast::<PyPose>() {
        Ok(pose) => Ok(Goal::Pose(pose.get().inner)),
        Err(_) => goal_of(&few(name, value, &[3, 5])?),
    }
}

/// Returns a frame as a 4x4 matrix, row by row.
pub fn rows_of(frame: &Frame) -> [f64; 16] {
    let matrix = frame.to_homogeneous();
    std::array::from_fn(|index| matrix[(index / 4, index % 4)])
}

#[pymethods]
impl PyPose {
    #[new]
    #[pyo3(signature = (x_mm, y_mm, z_mm, heading_deg, pitch_deg, *, roll_deg = None))]
    fn new(
        x_mm: &Bound<PyAny>,
        y_mm: &Bound<PyAny>,
        z_mm: &Bound<PyAny>,
        heading_deg: &Bound<PyAny>,
        pitch_deg: &Bound<PyAny>,
        roll_deg: Option<&Bound<PyAny>>,
    ) -> Result<Self, Error> {
        let numbers = [
            number("x_mm", x_mm)?,
            number("y_mm", y_mm)?,
            number("z_mm", z_mm)?,
            number("heading_deg", heading_deg)?,
            number("pitch_deg", pitch_deg)?,
        ];
        let roll = roll_deg.map_or(Ok(0.0), |roll| number("roll_deg", roll))?;
        Ok(pose_of(numbers)?.with_roll(radians(roll))?.into())
    }

    /// Returns the pose of a tip with this 4x4 matrix as its frame (base from tip, mm). Its z axis is the direction of
    /// growth. Its roll about that axis is dropped.
    #[classmethod]
    #[pyo3(signature = (matrix))]
    fn from_matrix(_cls: &Bound<PyType>, matrix: &Bound<PyAny>) -> Result<Self, Error> {
        let rows: [f64; 16] = fixed("matrix", matrix, &[4, 4])?;
        let m = nalgebra::Matrix4::from_row_slice(&rows);
        let rotation = m.fixed_view::<3, 3>(0, 0).into_owned();
        let off = (rotation.transpose() * rotation - nalgebra::Matrix3::identity()).amax();
        let last = (m.row(3) - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)).amax();
        let off = off.max(last).max((rotation.determinant() - 1.0).abs());
        if off > ROTATION {
            let message = format!(
                "matrix deviates from a rigid transform by {off:.3e}, above the limit of {ROTATION}: give a rotation, \
                 a translation in mm, and the last row 0, 0, 0, 1"
            );
            return Err(Error::with(ErrorKind::Input, message, off, ROTATION));
        }
        directed([m[(0, 3)], m[(1, 3)], m[(2, 3)]], [m[(0, 2)], m[(1, 2)], m[(2, 2)]])
    }

    /// Returns the pose at a position (3,), mm, with a direction (3,) of any length.
    #[classmethod]
    #[pyo3(signature = (position_mm, direction))]
    fn from_direction(
        _cls: &Bound<PyType>,
        position_mm: &Bound<PyAny>,
        direction: &Bound<PyAny>,
    ) -> Result<Self, Error> {
        directed(fixed("position_mm", position_mm, &[3])?, fixed("direction", direction, &[3])?)
    }

    #[classmethod]
    fn _from_radians(_cls: &Bound<PyType>, state: (f64, f64, f64, f64, f64, f64)) -> Result<Self, Error> {
        Ok(pose_from(state)?.into())
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, ((f64, f64, f64, f64, f64, f64),))> {
        Ok((slf.get_type().getattr("_from_radians")?.unbind(), (state_of(&slf.get().inner),)))
    }

    /// x coordinate, mm.
    #[getter]
    fn x_mm(&self) -> f64 {
        self.inner.position().x
    }

    /// y coordinate, mm.
    #[getter]
    fn y_mm(&self) -> f64 {
        self.inner.position().y
    }

    /// z coordinate, mm.
    #[getter]
    fn z_mm(&self) -> f64 {
        self.inner.position().z
    }

    /// Angle of the direction in the x-y plane, degrees, in (-180, 180].
    #[getter]
    pub fn heading_deg(&self) -> f64 {
        shortest_heading(self.inner.heading()) + 0.0
    }

    /// Angle of the direction above the x-y plane, degrees, in [-90, 90].
    #[getter]
    pub fn pitch_deg(&self) -> f64 {
        shortest_degrees(self.inner.pitch()) + 0.0
    }

    /// Roll of the tip about its direction, degrees, in (-180, 180]. 0 unless the pose is the tip of a body.
    #[getter]
    pub fn roll_deg(&self) -> f64 {
        shortest_heading(self.inner.roll()) + 0.0
    }

    /// Position, shape (3,), mm.
    #[getter]
    fn position_mm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.position().as_slice())
    }

    /// Direction of growth, a unit vector, shape (3,).
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.direction().as_slice())
    }

    /// Frame (base from tip), shape (4, 4), mm.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        use numpy::PyArrayMethods;
        PyArray1::from_slice(py, &rows_of(&self.inner.frame())).reshape([4, 4])
    }

    fn __hash__(&self) -> u64 {
        let (x, y, z, heading, pitch, roll) = state_of(&self.inner);
        // Equal numbers have equal hashes, and -0 counts as 0.
        [x, y, z, heading, pitch, roll].iter().fold(7, |hash: u64, number| {
            (hash ^ (number + 0.0).to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31)
        })
    }

    fn __repr__(&self) -> String {
        let at = self.inner.position();
        let (heading, pitch) = (self.heading_deg(), self.pitch_deg());
        let roll = if self.inner.roll() == 0.0 { String::new() } else { format!(", roll_deg={:?}", self.roll_deg()) };
        format!(
            "Pose(x_mm={:?}, y_mm={:?}, z_mm={:?}, heading_deg={heading:?}, pitch_deg={pitch:?}{roll})",
            at.x, at.y, at.z
        )
    }
}

/// Creates a pose from a position (mm) and a direction of any length.
fn directed(position: [f64; 3], direction: [f64; 3]) -> Result<PyPose, Error> {
    let direction = Vector3::from(direction);
    let norm = direction.norm();
    if !(ROTATION * ROTATION..=1e150).contains(&norm) {
        let message = format!("direction has length {norm}: give one that is not 0, such as (0, 0, 1)");
        return Err(Error::with(ErrorKind::Input, message, norm, 0.0));
    }
    let z = direction / norm;
    let x = if z.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() };
    let x = (x - z * z.dot(&x)).normalize();
    let rotation = nalgebra::Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(rotation);
    let free = Inner::from_frame(&Frame::from_parts(Vector3::zeros().into(), rotation));
    Ok(Inner::new(Vector3::from(position), free.heading(), free.pitch())?.into())
}

/// Returns the numbers of a pose for pickle: x, y, z in mm, and heading, pitch and roll in radians.
pub fn state_of(pose: &Inner) -> (f64, f64, f64, f64, f64, f64) {
    let at = pose.position();
    (at.x, at.y, at.z, pose.heading(), pose.pitch(), pose.roll())
}

/// Creates a pose from the numbers that [`state_of`] returns: x, y, z in mm, and heading, pitch and roll in radians.
pub fn pose_from((x, y, z, heading, pitch, roll): (f64, f64, f64, f64, f64, f64)) -> Result<Inner, Error> {
    Ok(Inner::new(Vector3::new(x, y, z), heading, pitch)?.with_roll(roll)?)
}
