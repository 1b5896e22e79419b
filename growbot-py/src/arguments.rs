//! Conversion and checks of arguments from Python. Each error contains the name of the argument.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyAnyMethods, PyDict, PyFloat, PyInt};

use crate::error::{Error, ErrorKind, outside};

/// Maximum number of rows of an array that is an argument or a result.
pub const MAX_ROWS: usize = 1_000_000;

/// Returns the name of a Python object's type.
pub fn type_name(value: &Bound<PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string())
}

/// Returns the error for an argument of a wrong type. `wanted` describes valid values.
pub fn wrong_type(name: &str, value: &Bound<PyAny>, wanted: &str) -> Error {
    let kind = type_name(value);
    Error::with(ErrorKind::Type, format!("{name} is of type {kind}: give {wanted}"), kind, wanted)
}

/// Converts a Python object to a real number. `None` if it is not a number. Complex numbers are excluded, because NumPy
/// would convert them with only a warning.
pub fn real_number(value: &Bound<PyAny>) -> Option<f64> {
    let known = value.is_exact_instance_of::<PyFloat>() || value.is_exact_instance_of::<PyInt>();
    (known || !type_name(value).contains("complex")).then(|| value.extract().ok()).flatten()
}

/// Converts an argument to a number, which may be infinite but not NaN.
pub fn number(name: &str, value: &Bound<PyAny>) -> Result<f64, Error> {
    let number = real_number(value).ok_or_else(|| wrong_type(name, value, "a number"))?;
    if number.is_nan() {
        return Err(Error::with(ErrorKind::Input, format!("{name} is NaN: give a number"), number, "a number"));
    }
    Ok(number)
}

/// Converts an argument to a number within these limits. `unit` is used in the error message.
pub fn within(name: &str, value: &Bound<PyAny>, [min, max]: [f64; 2], unit: &str) -> Result<f64, Error> {
    let number = number(name, value)?;
    if (min..=max).contains(&number) { Ok(number) } else { Err(outside(name, number, [min, max], unit)) }
}

/// Converts an argument to an integer within these limits.
pub fn integer(name: &str, value: &Bound<PyAny>, min: u64, max: u64) -> Result<u64, Error> {
    let wanted = "a whole number";
    let given: i128 = value.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<pyo3::exceptions::PyOverflowError>(value.py()) {
            Error::with(ErrorKind::Input, format!("{name} is too large: give {min} to {max}"), "too large", max as f64)
        } else {
            wrong_type(name, value, wanted)
        }
    })?;
    match u64::try_from(given) {
        Ok(number) if (min..=max).contains(&number) => Ok(number),
        _ => {
            let limit = if given < i128::from(min) { min } else { max };
            let message = format!("{name} is {given}: give {min} to {max}");
            Err(Error::with(ErrorKind::Input, message, given as f64, limit as f64))
        }
    }
}

/// Converts the argument `threads`, 1 to 1024. The default is one thread for each core.
pub fn threads(value: Option<&Bound<PyAny>>) -> Result<usize, Error> {
    match value {
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        Some(value) => Ok(integer("threads", value, 1, 1024)? as usize),
    }
}

/// Converts an argument to a boolean.
pub fn flag(name: &str, value: &Bound<PyAny>) -> Result<bool, Error> {
    value.extract().map_err(|_| wrong_type(name, value, "True or False"))
}

/// Converts an argument to a string.
pub fn text(name: &str, value: &Bound<PyAny>) -> Result<String, Error> {
    value.extract().map_err(|_| wrong_type(name, value, "a str"))
}

/// Maximum length of a file name, bytes, as in operating systems.
const LONGEST_NAME: usize = 4096;
/// Maximum length of a short string, such as the name of a planner, bytes.
const LONGEST_WORD: usize = 400;

/// Converts an argument to a string of at most 400 bytes.
pub fn word(name: &str, value: &Bound<PyAny>) -> Result<String, Error> {
    let word = text(name, value)?;
    check_length(name, word.len(), LONGEST_WORD)?;
    Ok(word)
}

/// Converts an argument to the path of a file.
pub fn path(name: &str, value: &Bound<PyAny>) -> Result<PathBuf, Error> {
    let path: PathBuf = value.extract().map_err(|_| wrong_type(name, value, "a str or a pathlib.Path"))?;
    check_length(name, path.as_os_str().len(), LONGEST_NAME)?;
    Ok(path)
}

fn check_length(name: &str, length: usize, longest: usize) -> Result<(), Error> {
    if length <= longest {
        return Ok(());
    }
    let message = format!("{name} has {length} bytes, above the limit of {longest}: give a shorter text");
    Err(Error::with(ErrorKind::Input, message, length as f64, longest as f64))
}

/// Maximum length of a plan file or of a robot file, bytes (64 MiB).
const LONGEST_TEXT: u64 = 64 << 20;

/// Reads a text file. Returns its text, and its name for messages. This function replaces
/// `growbot_plan::input::read_text`, which records the file as an input that may not be overwritten. A Python program
/// may overwrite its input.
pub fn text_of_file(path: &Path) -> Result<(String, String), Error> {
    let (bytes, name) = bytes_of_file(path, LONGEST_TEXT)?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::new(ErrorKind::File, format!("{name} is not UTF-8 text: give another file")))?;
    Ok((text, name))
}

/// Reads a file of at most `longest` bytes. Returns its bytes, and its name for messages.
pub fn bytes_of_file(path: &Path, longest: u64) -> Result<(Vec<u8>, String), Error> {
    let name = path.display().to_string();
    let failed = |error: std::io::Error| {
        Error::new(ErrorKind::File, format!("cannot read {name}: {error}; give a file that can be read"))
    };
    let about = fs::metadata(path).map_err(failed)?;
    if !about.is_file() {
        return Err(Error::new(ErrorKind::File, format!("{name} is not a file: give a file")));
    }
    let mut bytes = Vec::new();
    fs::File::open(path).map_err(failed)?.take(longest + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > longest {
        let message = format!("{name} has more than {longest} bytes, the limit: give another file");
        return Err(Error::with(ErrorKind::File, message, about.len() as f64, longest as f64));
    }
    Ok((bytes, name))
}

/// A two-dimensional array of numbers, from anything that NumPy converts to an array.
pub struct Rows {
    /// Number of rows.
    pub count: usize,
    /// Numbers, row by row.
    pub numbers: Vec<f64>,
    /// Number of columns.
    pub width: usize,
}

impl Rows {
    /// Converts an argument to an array of shape `(n, width)`, where `width` is one of these widths.
    pub fn read(name: &str, value: &Bound<PyAny>, widths: &[usize]) -> Result<Self, Error> {
        let wanted = widths.iter().map(|width| format!("(n, {width})")).collect::<Vec<_>>().join(" or ");
        let wanted = format!("an array of shape {wanted}");
        let array = array_of(name, value, &wanted)?;
        let shape = array.shape().to_vec();
        match shape[..] {
            [count, width] if widths.contains(&width) => {
                check_rows(name, count)?;
                Ok(Self { count, width, numbers: numbers(name, &array, &wanted)? })
            }
            _ => Err(wrong_shape(name, &shape, &wanted)),
        }
    }

    /// Converts an argument that is a one-dimensional array or a single number.
    pub fn flat(name: &str, value: &Bound<PyAny>) -> Result<Self, Error> {
        let wanted = "a number or an array of shape (n,)";
        let array = array_of(name, value, wanted)?;
        let shape = array.shape().to_vec();
        let count = match shape[..] {
            [] => 1,
            [count] => count,
            _ => return Err(wrong_shape(name, &shape, wanted)),
        };
        check_rows(name, count)?;
        Ok(Self { count, width: 1, numbers: numbers(name, &array, wanted)? })
    }
}

/// Converts an argument to an array of exactly this shape, with finite numbers.
pub fn fixed<const N: usize>(name: &str, value: &Bound<PyAny>, shape: &[usize]) -> Result<[f64; N], Error> {
    let wanted = format!("numbers of shape {}", describe(shape));
    let array = array_of(name, value, &wanted)?;
    if array.shape() != shape {
        return Err(wrong_shape(name, array.shape(), &wanted));
    }
    let numbers = numbers(name, &array, &wanted)?;
    if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
        let message = format!("{name} holds {number}: give finite numbers");
        return Err(Error::with(ErrorKind::Input, message, *number, "finite"));
    }
    numbers.try_into().map_err(|_| wrong_shape(name, shape, &wanted))
}

/// Checks that the number of rows of an argument is not above the maximum.
pub fn check_rows(name: &str, count: usize) -> Result<(), Error> {
    if count <= MAX_ROWS {
        return Ok(());
    }
    let message =
        format!("{name} needs {count} rows, above the limit of {MAX_ROWS}: split the work into several calls");
    Err(Error::with(ErrorKind::Input, message, count as f64, MAX_ROWS as f64))
}

/// Converts an argument to a NumPy array of any type. An argument that is an array already is not copied.
fn array_of<'py>(name: &str, value: &Bound<'py, PyAny>, wanted: &str) -> Result<Bound<'py, PyUntypedArray>, Error> {
    if let Ok(array) = value.cast::<PyUntypedArray>() {
        return Ok(array.clone());
    }
    let numpy = value.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (value,)).map_err(|_| wrong_type(name, value, wanted))?;
    array.cast_into().map_err(|_| wrong_type(name, value, wanted))
}

/// Returns the numbers of an array in row-major order. The caller must have checked its size.
fn numbers(name: &str, array: &Bound<PyUntypedArray>, wanted: &str) -> Result<Vec<f64>, Error> {
    let py = array.py();
    let kind: String = array.dtype().getattr("kind")?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        let dtype = array.dtype().str()?.to_string();
        let message = format!("{name} is an array of {dtype}: give {wanted} of real numbers");
        return Err(Error::with(ErrorKind::Type, message, dtype, "float64"));
    }
    let arguments = PyDict::new(py);
    arguments.set_item("dtype", "float64")?;
    let array = py.import("numpy")?.call_method("ascontiguousarray", (array,), Some(&arguments))?;
    let array = array.cast_into::<PyArrayDyn<f64>>().map_err(PyErr::from)?;
    Ok(array
        .readonly()
        .as_slice()
        .map_err(|_| {
            Error::new(ErrorKind::Type, format!("{name} is not a plain array: give a numpy array of real numbers"))
        })?
        .to_vec())
}

/// Returns the error for an argument of the wrong shape. `wanted` describes valid values.
pub fn wrong_shape(name: &str, shape: &[usize], wanted: &str) -> Error {
    let shape = describe(shape);
    Error::with(ErrorKind::Type, format!("{name} has shape {shape}: give {wanted}"), shape, wanted)
}

fn describe(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        shape => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}
