//! Conversion of errors to Python exceptions, which contain a message, the value, the limit and a code. Their classes are
//! in `python/growbot/_errors.py`.

use std::fmt::Display;

use growbot_core::compact_number::CompactNumber;
use growbot_core::plan::PlanError;
use growbot_core::pose::PoseError;
use growbot_plan::ownership::OwnershipError;
use growbot_plan::scene_planning::ScenePlanError;
use growbot_remote::client::ServiceError;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

use crate::remedies;

/// Class of the Python exception.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// `InputError`: the value of an argument is not valid.
    Input,
    /// `InputTypeError`: an argument has a wrong type or shape.
    Type,
    /// `FileError`: a file is missing or not valid.
    File,
    /// `NoPathError`: the planner found no path.
    NoPath,
    /// `BoardError`: a board does not respond, rejects a request, or has a fault.
    Board,
}

/// The value of an error, or the limit that it violates.
#[derive(Debug, Clone)]
pub enum ErrorValue {
    /// A number, in the unit that the message names.
    Number(f64),
    /// A string.
    Text(String),
}

impl From<f64> for ErrorValue {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<&str> for ErrorValue {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for ErrorValue {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// Error of a call from Python.
#[derive(Debug)]
pub enum Error {
    /// An error that growbot has detected.
    Growbot {
        /// Class of the Python exception.
        kind: ErrorKind,
        /// Message with the cause, the value, the limit and a remedy.
        message: String,
        /// Value that caused the error. `None` if there is none.
        value: Option<ErrorValue>,
        /// Limit that the value violates. `None` without a limit.
        limit: Option<ErrorValue>,
        /// Code of the reason. `None` if it has none.
        code: Option<String>,
    },
    /// An exception that Python has raised, such as `KeyboardInterrupt` for Ctrl-C.
    Python(PyErr),
}

impl Error {
    /// Creates an error without a value and a limit.
    pub fn new(kind: ErrorKind, message: impl Display) -> Self {
        Self::Growbot { kind, message: message.to_string(), value: None, limit: None, code: None }
    }

    /// Creates the error for an error of a library.
    pub fn of(kind: ErrorKind, error: &(dyn std::error::Error + 'static)) -> Self {
        Self::new(kind, remedies::message(error))
    }

    /// Creates an error with a value and the limit that it violates.
    pub fn with(
        kind: ErrorKind,
        message: impl Display,
        value: impl Into<ErrorValue>,
        limit: impl Into<ErrorValue>,
    ) -> Self {
        let (value, limit) = (Some(value.into()), Some(limit.into()));
        Self::Growbot { kind, message: message.to_string(), value, limit, code: None }
    }

    /// Adds the code of the reason.
    pub fn with_code(mut self, reason: Option<&str>) -> Self {
        if let Self::Growbot { code, .. } = &mut self {
            *code = reason.map(str::to_owned);
        }
        self
    }

    /// Adds the index of an array's row to the message.
    pub fn of_row(mut self, row: usize) -> Self {
        if let Self::Growbot { message, .. } = &mut self {
            *message = format!("row {row}: {message}");
        }
        self
    }
}

/// Creates the Python exception of this class from its arguments: message, value, limit and code.
fn exception(
    py: Python<'_>,
    kind: ErrorKind,
    (message, value, limit, code): (String, Option<ErrorValue>, Option<ErrorValue>, Option<String>),
) -> PyResult<PyErr> {
    static CLASSES: [PyOnceLock<Py<PyType>>; 5] = [const { PyOnceLock::new() }; 5];
    let name = ["InputError", "InputTypeError", "FileError", "NoPathError", "BoardError"];
    let class = CLASSES[kind as usize].import(py, "growbot._errors", name[kind as usize])?;
    let python_value = |value: Option<ErrorValue>| match value {
        None => Ok(py.None()),
        Some(ErrorValue::Number(number)) => number.into_py_any(py),
        Some(ErrorValue::Text(text)) => text.into_py_any(py),
    };
    Ok(PyErr::from_value(class.call1((message, python_value(value)?, python_value(limit)?, code))?))
}

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        match error {
            Error::Python(error) => error,
            Error::Growbot { kind, message, value, limit, code } => {
                Python::attach(|py| exception(py, kind, (message, value, limit, code)).unwrap_or_else(|error| error))
            }
        }
    }
}

impl From<PyErr> for Error {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<ServiceError> for Error {
    fn from(error: ServiceError) -> Self {
        let message = remedies::message(&error);
        match &error {
            ServiceError::Ownership(OwnershipError::Owner { owner, .. }) | ServiceError::ForeignPeer { owner, .. } => {
                let value = Some(f64::from(*owner).into());
                Self::Growbot { kind: ErrorKind::Board, message, value, limit: None, code: None }
            }
            ServiceError::Ownership(OwnershipError::Mode { mode, .. }) => {
                Self::with(ErrorKind::Board, message, format!("{mode:04o}"), "0700")
            }
            ServiceError::Rejected { code, .. } => {
                let is_refusal = code.is_some() || error.is_invalid_request();
                let kind = if is_refusal { ErrorKind::Input } else { ErrorKind::Board };
                Self::new(kind, message).with_code(code.as_deref())
            }
            _ => Self::new(ErrorKind::Board, message),
        }
    }
}

impl From<PlanError> for Error {
    fn from(error: PlanError) -> Self {
        let message = error.to_string();
        match error {
            PlanError::RadiusTooSmall { radius, limit } | PlanError::RadiusTooLarge { radius, limit } => {
                Self::with(ErrorKind::Input, message, radius, limit)
            }
            PlanError::GoalNotReached { distance, limit, .. } => {
                Self::with(ErrorKind::NoPath, message, distance, limit)
            }
            PlanError::NoPath | PlanError::TooManySegments(_) => Self::new(ErrorKind::NoPath, message),
        }
    }
}

impl From<PoseError> for Error {
    fn from(error: PoseError) -> Self {
        let message = error.to_string();
        match error {
            PoseError::NotFinite { value, .. } => Self::with(ErrorKind::Input, message, value, "finite"),
            PoseError::TooFar { value, limit, .. } => Self::with(ErrorKind::Input, message, value, limit),
            PoseError::Pitch { value } => Self::with(
                ErrorKind::Input,
                format!("{message}: give an angle within these limits"),
                value,
                90.0_f64.copysign(value),
            ),
        }
    }
}

impl From<ScenePlanError> for Error {
    fn from(error: ScenePlanError) -> Self {
        match error {
            ScenePlanError::Plan(error) => error.into(),
            ScenePlanError::NoPath(error) => {
                use growbot_plan::scene_planning::NoPathError;
                let message = remedies::message(&error);
                match error {
                    NoPathError::Start { distance, need } | NoPathError::Goal { distance, need } => {
                        Self::with(ErrorKind::NoPath, message, distance, need)
                    }
                    NoPathError::TooFar { distance, left } => Self::with(ErrorKind::NoPath, message, distance, left),
                    NoPathError::Separated { need } => Self::with(ErrorKind::NoPath, message, "none", need),
                    NoPathError::AtResolution { step, .. } => {
                        Self::with(ErrorKind::NoPath, message, error.code(), step)
                    }
                    NoPathError::TwoPlaneBlocked => Self::with(ErrorKind::NoPath, message, "two-plane", "shortest"),
                    NoPathError::NotFound => {
                        Self::with(ErrorKind::NoPath, message, error.code(), "effort and time_limit_s")
                    }
                }
            }
        }
    }
}

/// Returns the error for an argument that is outside these limits.
pub fn outside(name: &str, value: f64, [min, max]: [f64; 2], unit: &str) -> Error {
    let limit = if value < min { min } else { max };
    let message =
        format!("{name} is {} {unit}: give {} to {}", CompactNumber(&value), CompactNumber(&min), CompactNumber(&max));
    Error::with(ErrorKind::Input, message, value, limit)
}
