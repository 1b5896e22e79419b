//! Class `growbot.Scene`: scenes of obstacles.

use std::path::PathBuf;
use std::sync::Arc;

use growbot_plan::hexadecimal::format_hash;
use growbot_plan::plan as client;
use growbot_scene::scene_file::{LoadedScene, MAX_LENGTH, SceneError, load};
use nalgebra::Vector3;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::arguments::{Rows, path, within, wrong_type};
use crate::error::{Error, ErrorKind};

/// Obstacles, from a scene file (TOML), a mesh (.stl, .obj, .ply, .glb) or a cloud of points (.ply, .pcd).
///
/// margin_mm replaces the margin of the file: the distance that bodies keep from all obstacles. A pickled scene names
/// its file, which must have the same content when it is read again.
#[pyclass(name = "Scene", frozen, module = "growbot")]
#[derive(Clone)]
pub struct PyScene {
    pub loaded: Arc<LoadedScene>,
    pub file: PathBuf,
}

impl PyScene {
    /// Converts an argument, which must be a `growbot.Scene`.
    pub fn given(scene: &Bound<PyAny>) -> Result<Self, Error> {
        Ok(scene.cast::<Self>().map_err(|_| wrong_type("scene", scene, "a growbot.Scene"))?.get().clone())
    }

    /// Reads a scene from a file. `margin` (mm) replaces the margin of the file.
    pub fn read(file: PathBuf, margin: Option<f64>) -> Result<Self, SceneError> {
        let mut loaded = load(&file)?;
        loaded.margin = margin.or(loaded.margin);
        Ok(Self { loaded: Arc::new(loaded), file })
    }
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (file, *, margin_mm = None))]
    fn new(py: Python<'_>, file: &Bound<PyAny>, margin_mm: Option<&Bound<PyAny>>) -> Result<Self, Error> {
        let file = path("file", file)?;
        let margin = margin_mm.map(|margin| within("margin_mm", margin, [0.0, MAX_LENGTH], "mm")).transpose()?;
        py.detach(|| Self::read(file, margin)).map_err(|error| Error::new(ErrorKind::File, error))
    }

    /// Reads the file of a pickled scene, which must have the same content.
    #[classmethod]
    fn _from_state(cls: &Bound<PyType>, file: PathBuf, hash: &str, margin: Option<f64>) -> Result<Self, Error> {
        let scene = cls.py().detach(|| Self::read(file, margin)).map_err(|error| Error::new(ErrorKind::File, error))?;
        let found = format_hash(scene.loaded.hash);
        if found == hash {
            return Ok(scene);
        }
        let message = format!(
            "{} is not the scene that was pickled: its hash is {found}, and that of the pickled scene {hash}: restore \
             the file, or read the new one with growbot.Scene",
            scene.file.display()
        );
        Err(Error::with(ErrorKind::File, message, found, hash))
    }

    fn __reduce__(slf: &Bound<Self>) -> PyResult<(Py<PyAny>, (PathBuf, String, Option<f64>))> {
        let scene = slf.get();
        Ok((slf.get_type().getattr("_from_state")?.unbind(), (scene.file.clone(), scene.hash(), scene.loaded.margin)))
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

    /// Required clearance between the outside of the tube and all obstacles, mm: that given, or that of the file. None
    /// if neither states one. A plan then keeps the distance by which its robot is expected to deviate.
    #[getter]
    fn margin_mm(&self) -> Option<f64> {
        self.loaded.margin
    }

    /// Box that holds everything but half spaces, mm: the smallest and the greatest x, y and z. It shows axes and units
    /// that were read otherwise than expected. None for a scene of half spaces alone.
    #[getter]
    fn box_mm(&self) -> Option<([f64; 3], [f64; 3])> {
        self.loaded.bounding_box().map(|bounds| (bounds.min_mm, bounds.max_mm))
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
            (self.loaded.hash, &self.file, self.loaded.margin) == (other.loaded.hash, &other.file, other.loaded.margin)
        })
    }

    fn __hash__(&self) -> u64 {
        self.loaded.hash
    }

    fn __repr__(&self) -> String {
        let margin = self.loaded.margin.map_or_else(|| "None".to_owned(), |margin| format!("{margin:?}"));
        format!("Scene({:?}, margin_mm={margin})", self.file.display().to_string())
    }
}

/// Loads the scene through which a plan was made. `None` for a plan in empty space.
pub fn through(plan: &client::Plan) -> Result<Option<PyScene>, Error> {
    let Some(through) = &plan.scene else { return Ok(None) };
    let found = PyScene::read(PathBuf::from(&through.file), Some(through.margin))
        .map_err(|error| Error::new(ErrorKind::File, format!("{error}; or give the plan's scene as scene=")))?;
    if found.loaded.hash == through.hash {
        return Ok(Some(found));
    }
    let message =
        format!("{} is not the scene of the plan: plan again, or give the plan's scene as scene=", through.file);
    Err(Error::with(ErrorKind::File, message, format_hash(found.loaded.hash), format_hash(through.hash)))
}
