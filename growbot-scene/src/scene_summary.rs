//! Content of a scene in numbers.

use serde::Serialize;

use crate::scene_file::{LoadedScene, SceneBox};

/// Content of a scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SceneSummary {
    /// Path of the scene file.
    pub file: String,
    /// Hash of the scene file and of all files that it names, 16 hexadecimal digits.
    pub hash: String,
    /// Margin, mm. Null if the file states none: a plan then takes the deviation that is expected of its robot.
    pub margin_mm: Option<f64>,
    /// Number of boxes, balls and capsules.
    pub shapes: usize,
    /// Number of half spaces.
    pub half_spaces: usize,
    /// Number of triangles of all meshes.
    pub triangles: usize,
    /// Number of points of all clouds.
    pub points: usize,
    /// Box around all obstacles except half spaces. Null if there are only half spaces.
    #[serde(rename = "box")]
    pub bounds: Option<SceneBox>,
}

impl SceneSummary {
    /// Returns the content of a scene that was loaded from this file.
    pub fn new(file: String, loaded: &LoadedScene) -> Self {
        let scene = &loaded.scene;
        Self {
            file,
            hash: format!("{:016x}", loaded.hash),
            margin_mm: loaded.margin,
            shapes: scene.shapes().len(),
            half_spaces: scene.half_spaces().len(),
            triangles: scene.meshes().iter().map(|mesh| mesh.triangles().len()).sum(),
            points: scene.clouds().iter().map(|cloud| cloud.points().len()).sum(),
            bounds: loaded.bounding_box(),
        }
    }
}
