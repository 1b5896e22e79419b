//! Scenes of obstacles.

use std::path::PathBuf;
use std::sync::Arc;

use growbot_client::plan_file::format_hash;
use growbot_scene::scene_file::{LoadedScene, SceneError, load};
use nalgebra::Vector3;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::arguments::{Rows, path, wrong_type};
use crate::error::{Error, ErrorKind};

/// Obstacles, from a scene file (TOML), a mesh (.stl, .obj, .ply, .glb) or a cloud of points (.ply, .pcd).
#[pyclass(frozen, module = "growbot")]
#[derive(Clone)]
pub struct Scene {
    pub loaded: Arc<LoadedScene>,
    pub file: PathBuf,
}

impl Scene {
    /// Returns the scene in an argument.
    pub fn given(scene: &Bound<PyAny>) -> Result<Self, Error> {
        Ok(scene.cast::<Self>().map_err(|_| wrong_type("scene", scene, "a growbot.Scene"))?.get().clone())
    }

    pub fn read(file: PathBuf) -> Result<Self, SceneError> {
        Ok(Self { loaded: Arc::new(load(&file)?), file })
    }
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (file))]
    fn new(py: Python<'_>, file: &Bound<PyAny>) -> Result<Self, Error> {
        let file = path("file", file)?;
        py.detach(|| Self::read(file)).map_err(|error| Error::new(ErrorKind::File, error))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyType>, (PathBuf,)) {
        (slf.get_type(), (slf.get().file.clone(),))
    }

    /// Name of the scene's file.
    #[getter]
    fn file(&self) -> String {
        self.file.display().to_string()
    }

    /// Hash of the scene's files, 16 hexadecimal digits.
    #[getter]
    fn hash(&self) -> String {
        format_hash(self.loaded.hash)
    }

    /// Required clearance between the outside of the tube and all obstacles, mm.
    #[getter]
    fn margin_mm(&self) -> f64 {
        self.loaded.margin
    }

    /// Returns the distances of points (n, 3), mm, from the nearest obstacle, shape (n,), mm. They are negative inside
    /// of one.
    #[pyo3(signature = (points_mm))]
    fn distances<'py>(
        &self,
        py: Python<'py>,
        points_mm: &Bound<'py, PyAny>,
    ) -> Result<Bound<'py, PyArray1<f64>>, Error> {
        let rows = Rows::read("points_mm", points_mm, &[3])?;
        if let Some(number) = rows.numbers.iter().find(|number| !number.is_finite()) {
            let message = format!("points_mm holds {number}: give finite numbers");
            return Err(Error::with(ErrorKind::Input, message, *number, "finite"));
        }
        let scene = &self.loaded.scene;
        let distances: Vec<f64> = py.detach(|| {
            rows.numbers.chunks_exact(3).map(|point| scene.distance(&Vector3::from_column_slice(point))).collect()
        });
        Ok(PyArray1::from_vec(py, distances))
    }

    fn __eq__(&self, other: &Bound<PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let other = other.get();
            (self.loaded.hash, &self.file) == (other.loaded.hash, &other.file)
        })
    }

    fn __hash__(&self) -> u64 {
        self.loaded.hash
    }

    fn __repr__(&self) -> String {
        format!("Scene({:?}, margin_mm={:?})", self.file.display().to_string(), self.loaded.margin)
    }
}
