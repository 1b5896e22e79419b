//! NumPy arrays with named fields, and the array of layers.

use growbot_core::angle::degrees;
use growbot_core::layer::Layer;
use growbot_plan::degrees::degrees_below_turn;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{Error, ErrorKind};

/// Maximum number of rows of an array of layers.
const MAX_LAYERS: usize = 20_000_000;

/// Returns layers as a structured array. `layers` yields the index of each layer's segment and the layer.
pub fn layer_array<'py>(
    py: Python<'py>,
    count: usize,
    layers: impl Iterator<Item = (usize, Layer)>,
) -> Result<Bound<'py, PyAny>, Error> {
    if count > MAX_LAYERS {
        let message = format!("the path has {count} layers, but a table can have at most {MAX_LAYERS}: split the path");
        return Err(Error::with(ErrorKind::Input, message, count as f64, MAX_LAYERS as f64));
    }
    let (mut segments, mut alphas, mut heights, mut tilts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (segment, layer) in layers {
        segments.push(segment as i64);
        alphas.push(if layer.tilt > 0.0 { degrees_below_turn(layer.alpha) } else { 0.0 });
        heights.push(layer.height);
        tilts.push(degrees(layer.tilt));
    }
    let indices: Vec<i64> = (0..segments.len() as i64).collect();
    let fields =
        [("layer", "<i8"), ("segment", "<i8"), ("alpha_deg", "<f8"), ("height_mm", "<f8"), ("tilt_deg", "<f8")];
    let array = structured(py, indices.len(), &fields)?;
    array.set_item("layer", PyArray1::from_vec(py, indices))?;
    array.set_item("segment", PyArray1::from_vec(py, segments))?;
    array.set_item("alpha_deg", PyArray1::from_vec(py, alphas))?;
    array.set_item("height_mm", PyArray1::from_vec(py, heights))?;
    array.set_item("tilt_deg", PyArray1::from_vec(py, tilts))?;
    Ok(array)
}

/// Creates a NumPy structured array with these fields (name, type). Its values are not initialized.
pub fn structured<'py>(py: Python<'py>, rows: usize, fields: &[(&str, &str)]) -> PyResult<Bound<'py, PyAny>> {
    let arguments = PyDict::new(py);
    arguments.set_item("dtype", fields.to_vec())?;
    py.import("numpy")?.call_method("empty", (rows,), Some(&arguments))
}
