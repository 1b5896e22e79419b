//! Scene files: `growbot-scene/1`, TOML. Lengths are in mm.

use std::path::Path;
use std::thread;

use growbot_core::angle::radians;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::read::{self, GeometryFile, MAX_GEOMETRY_BYTES, MeshDefects, ReadError};
use crate::scene::{Cloud, Mesh, Scene};
use crate::shapes::{HalfSpace, Shape, Triangle};

/// Format that this version reads.
pub const FORMAT: &str = "growbot-scene/1";
/// Maximum coordinate and size, mm (10 km), as for poses.
pub const MAX_LENGTH: f64 = 1e7;
/// Maximum number of entries of one kind in a file.
pub const MAX_ENTRIES: usize = 100_000;
/// Maximum length of a scene file, bytes (16 MiB). Meshes and clouds have their own files.
pub const MAX_FILE_BYTES: u64 = 16 << 20;

/// A scene file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Format of the file: `growbot-scene/1`.
    pub format: String,
    /// Minimum distance between the outside of the tube and everything in the scene, mm. By default that by which the
    /// robot is expected to deviate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub margin_mm: Option<f64>,
    /// Boxes.
    #[serde(default, rename = "box", skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxToml>,
    /// Balls.
    #[serde(default, rename = "ball", skip_serializing_if = "Vec::is_empty")]
    pub balls: Vec<BallToml>,
    /// Capsules: cylinders with round ends.
    #[serde(default, rename = "capsule", skip_serializing_if = "Vec::is_empty")]
    pub capsules: Vec<CapsuleToml>,
    /// Half spaces: everything behind a plane.
    #[serde(default, rename = "halfspace", skip_serializing_if = "Vec::is_empty")]
    pub half_spaces: Vec<HalfSpaceToml>,
    /// Meshes in their own files.
    #[serde(default, rename = "mesh", skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshToml>,
    /// Clouds of points in their own files.
    #[serde(default, rename = "points", skip_serializing_if = "Vec::is_empty")]
    pub clouds: Vec<PointsToml>,
}

/// A box of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct BoxToml {
    /// Centre, mm.
    pub center_mm: [f64; 3],
    /// Lengths of the sides, mm.
    pub size_mm: [f64; 3],
    /// Rotation in degrees: roll about x, then pitch about y, then yaw about z, all of the fixed axes.
    #[serde(default)]
    pub rpy_deg: [f64; 3],
}

/// A ball of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct BallToml {
    /// Centre, mm.
    pub center_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
}

/// A capsule of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CapsuleToml {
    /// Centre of one round end, mm.
    pub from_mm: [f64; 3],
    /// Centre of the other round end, mm.
    pub to_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
}

/// A half space of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HalfSpaceToml {
    /// Point of the plane, mm.
    pub point_mm: [f64; 3],
    /// Normal of the plane, which points to the free side.
    pub normal: [f64; 3],
}

/// A mesh of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MeshToml {
    /// File of the mesh, STL, OBJ, PLY or GLB, relative to the scene's file.
    pub file: String,
    /// Length of a unit of the mesh file, mm. By default 1000 for GLB, which is in metres, and 1 for other formats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// True if the enclosed volume is an obstacle too. The mesh must then be closed.
    #[serde(default = "yes")]
    pub solid: bool,
}

/// A cloud of points of a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PointsToml {
    /// File of the cloud, PLY or PCD, relative to the scene's file.
    pub file: String,
    /// Length of a unit of the cloud file, mm. 1 by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Radius of the ball round each point, mm.
    pub radius_mm: f64,
}

fn yes() -> bool {
    true
}

/// Error of loading a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file cannot be read, or its content does not match its extension.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Standard input (`-`) is given instead of a file.
    #[error(
        "a scene cannot be read from standard input, because plans and run logs name the file of their scene: give a \
         file"
    )]
    StandardInput,
    /// The file is not TOML, or has other fields than a scene.
    #[error("{file}, line {line}: {}", read::one_line(error.message()))]
    Toml {
        /// Path of the file.
        file: String,
        /// Number of the line with the error, from 1.
        line: usize,
        /// Error of the TOML parser.
        error: Box<toml::de::Error>,
    },
    /// The scene file has a format version that is not supported.
    #[error(
        "{file} has format {found:?}, but this version of growbot reads {FORMAT:?}: write the file in that \
         format, with the line `format = {FORMAT:?}`"
    )]
    UnsupportedFormat {
        /// Path of the file.
        file: String,
        /// Format that the file names.
        found: String,
    },
    /// A value is not a number, or is out of range.
    #[error("{file}: {field} is {value}, but it must be {limit}")]
    OutOfRange {
        /// Path of the file.
        file: String,
        /// Name of the field.
        field: String,
        /// Value of the field.
        value: f64,
        /// Description of the permitted values.
        limit: &'static str,
    },
    /// The file has too many entries of one kind.
    #[error(
        "{file} has {count} entries of [[{kind}]], but the maximum is {MAX_ENTRIES}: combine several into one mesh or \
         point cloud, or remove some"
    )]
    TooMany {
        /// Path of the file.
        file: String,
        /// Kind of the entries, such as `box`.
        kind: &'static str,
        /// Number of entries.
        count: usize,
    },
    /// A solid mesh has a hole, so it encloses no volume.
    #[error(
        "{file} is an open mesh, with {open} edges that belong to one face only, and cannot be solid: close the mesh, \
         or set `solid = false` in its [[mesh]] of a scene file to use only its faces as obstacles"
    )]
    OpenMesh {
        /// Path of the mesh file.
        file: String,
        /// Number of open edges.
        open: usize,
    },
    /// Faces of a solid mesh are inside out, so its inside is undefined.
    #[error(
        "{file} is a mesh with {flipped} edges whose two faces name their corners in the same direction, so that one \
         of the two is inside out, and cannot be solid: turn its faces to one side (in Blender: Mesh > Normals > \
         Recalculate Outside), or set `solid = false` in its [[mesh]] of a scene file to use only its faces as \
         obstacles"
    )]
    FlippedFaces {
        /// Path of the mesh file.
        file: String,
        /// Number of edges between two faces of which one is inside out.
        flipped: usize,
    },
    /// The meshes and clouds of a scene exceed the total size limit.
    #[error(
        "the meshes and point clouds of {file} are together longer than {MAX_GEOMETRY_BYTES} bytes, the maximum: make \
         them smaller, or remove some"
    )]
    TooLarge {
        /// Path of the scene file.
        file: String,
    },
    /// A file contains no triangles or points.
    #[error("{file} has no {what}: give a file that contains {what}")]
    Empty {
        /// Path of the file.
        file: String,
        /// Missing items: points or faces.
        what: &'static str,
    },
}

/// A box with sides along the axes that holds everything in a scene but its half spaces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SceneBox {
    /// Smallest coordinates, mm.
    pub min_mm: [f64; 3],
    /// Greatest coordinates, mm.
    pub max_mm: [f64; 3],
}

/// A scene that was loaded from its files.
#[derive(Debug, Clone)]
pub struct LoadedScene {
    /// The obstacles.
    pub scene: Scene,
    /// Minimum distance between the outside of the tube and the obstacles, mm. `None` if the scene does not state one.
    pub margin: Option<f64>,
    /// Hash of the scene file and of all mesh and cloud files that it names, CRC-64/XZ.
    pub hash: u64,
}

impl LoadedScene {
    /// Returns the bounding box of all obstacles except half spaces, from which a user can recognize wrong axes or
    /// units. Returns `None` if there are only half spaces, or no obstacles.
    pub fn bounding_box(&self) -> Option<SceneBox> {
        let bounds = self.scene.bounds();
        (!bounds.is_empty()).then(|| SceneBox { min_mm: bounds.min.into(), max_mm: bounds.max.into() })
    }
}

/// Loads a scene: a scene file, or a single mesh or cloud, according to its extension.
///
/// # Errors
/// Any fault of a file. The message contains the value, the limit and a remedy.
pub fn load(path: &Path) -> Result<LoadedScene, SceneError> {
    if path.as_os_str() == "-" {
        return Err(SceneError::StandardInput);
    }
    let name = path.display().to_string();
    if read::is_geometry(path) {
        return load_geometry(path, &name);
    }
    let bytes = read::bytes(path, MAX_FILE_BYTES)?;
    let text = String::from_utf8_lossy(&bytes);
    let written = parse(&text, &name)?;
    let mut hasher = growbot_core::hash::Hasher::default();
    hasher.write_bytes(&bytes);
    let beside = path.parent().unwrap_or(Path::new(""));
    let (mut meshes, mut clouds) = (Vec::new(), Vec::new());
    // A small file may name a large one many times.
    let mut left = MAX_GEOMETRY_BYTES;
    let mut geometry = |file: &Path| -> Result<GeometryFile, SceneError> {
        let read = read::geometry(file)?;
        left = left.checked_sub(read.length).ok_or_else(|| SceneError::TooLarge { file: name.clone() })?;
        Ok(read)
    };
    for mesh in &written.meshes {
        let file = beside.join(&mesh.file);
        let read = geometry(&file)?;
        hasher.write_bytes(&read.hash.to_le_bytes());
        meshes.push(mesh_of(&read, mesh.scale, mesh.solid, &file.display().to_string())?);
    }
    for points in &written.clouds {
        let file = beside.join(&points.file);
        let read = geometry(&file)?;
        hasher.write_bytes(&read.hash.to_le_bytes());
        clouds.push(cloud_of(&read, points.scale, points.radius_mm, &file.display().to_string())?);
    }
    let scene = Scene::new(written.shapes(), written.half_spaces(), clouds, meshes);
    Ok(LoadedScene { scene, margin: written.margin_mm, hash: hasher.finish() })
}

/// Loads a single mesh or cloud. Points are balls without a radius.
fn load_geometry(path: &Path, name: &str) -> Result<LoadedScene, SceneError> {
    let read = read::geometry(path)?;
    let scene = if read.geometry.triangles.is_empty() {
        Scene::new(vec![], vec![], vec![cloud_of(&read, None, 0.0, name)?], vec![])
    } else {
        Scene::new(vec![], vec![], vec![], vec![mesh_of(&read, None, true, name)?])
    };
    Ok(LoadedScene { scene, margin: None, hash: read.hash })
}

/// Parses a scene file. `file` is its name in error messages.
///
/// # Errors
/// If the text is not TOML, has unknown fields or another format, or a number is out of range.
pub fn parse(text: &str, file: &str) -> Result<SceneFile, SceneError> {
    let written: SceneFile = toml::from_str(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start).min(text.len());
        let before = text.as_bytes().get(..at).unwrap_or_default();
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        SceneError::Toml { file: file.to_owned(), line, error: Box::new(error) }
    })?;
    if written.format != FORMAT {
        return Err(SceneError::UnsupportedFormat { file: file.to_owned(), found: read::one_line(&written.format) });
    }
    written.check(file)?;
    Ok(written)
}

impl SceneFile {
    /// Checks the numbers of entries and the range of every value.
    fn check(&self, file: &str) -> Result<(), SceneError> {
        let counts = [
            ("box", self.boxes.len()),
            ("ball", self.balls.len()),
            ("capsule", self.capsules.len()),
            ("halfspace", self.half_spaces.len()),
            ("mesh", self.meshes.len()),
            ("points", self.clouds.len()),
        ];
        if let Some((kind, count)) = counts.into_iter().find(|(_, count)| *count > MAX_ENTRIES) {
            return Err(SceneError::TooMany { file: file.to_owned(), kind, count });
        }
        let check = Check { file };
        if let Some(margin) = self.margin_mm {
            check.size("margin_mm", margin, true)?;
        }
        for (index, written) in self.boxes.iter().enumerate() {
            check.point(&format!("center_mm of [[box]] {}", index + 1), &written.center_mm)?;
            for side in written.size_mm {
                check.size(&format!("size_mm of [[box]] {}", index + 1), side, false)?;
            }
            check.point(&format!("rpy_deg of [[box]] {}", index + 1), &written.rpy_deg)?;
        }
        for (index, written) in self.balls.iter().enumerate() {
            check.point(&format!("center_mm of [[ball]] {}", index + 1), &written.center_mm)?;
            check.size(&format!("radius_mm of [[ball]] {}", index + 1), written.radius_mm, false)?;
        }
        for (index, written) in self.capsules.iter().enumerate() {
            check.point(&format!("from_mm of [[capsule]] {}", index + 1), &written.from_mm)?;
            check.point(&format!("to_mm of [[capsule]] {}", index + 1), &written.to_mm)?;
            check.size(&format!("radius_mm of [[capsule]] {}", index + 1), written.radius_mm, false)?;
        }
        for (index, written) in self.half_spaces.iter().enumerate() {
            check.point(&format!("point_mm of [[halfspace]] {}", index + 1), &written.point_mm)?;
            check.normal(&format!("normal of [[halfspace]] {}", index + 1), &written.normal)?;
        }
        let meshes = self.meshes.iter().map(|written| (&written.file, written.scale));
        for (file, scale) in meshes.chain(self.clouds.iter().map(|written| (&written.file, written.scale))) {
            if let Some(scale) = scale {
                check.size(&format!("scale of {file}"), scale, false)?;
            }
        }
        for written in &self.clouds {
            check.size(&format!("radius_mm of {}", written.file), written.radius_mm, true)?;
        }
        Ok(())
    }

    /// Returns the boxes, balls and capsules.
    pub(crate) fn shapes(&self) -> Vec<Shape> {
        let boxes = self.boxes.iter().map(|written| {
            let [roll, pitch, yaw] = written.rpy_deg.map(radians);
            let turn = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
            let rotation =
                turn(Vector3::z_axis(), yaw) * turn(Vector3::y_axis(), pitch) * turn(Vector3::x_axis(), roll);
            Shape::Box {
                centre: written.center_mm.into(),
                half_extents: Vector3::from(written.size_mm) * 0.5,
                rotation,
            }
        });
        let balls = self.balls.iter().map(|ball| Shape::Ball { centre: ball.center_mm.into(), radius: ball.radius_mm });
        let capsules = self.capsules.iter().map(|written| Shape::Capsule {
            from: written.from_mm.into(),
            to: written.to_mm.into(),
            radius: written.radius_mm,
        });
        boxes.chain(balls).chain(capsules).collect()
    }

    fn half_spaces(&self) -> Vec<HalfSpace> {
        let half_spaces = self.half_spaces.iter();
        half_spaces
            .map(|written| HalfSpace {
                point: written.point_mm.into(),
                normal: Vector3::from(written.normal).normalize(),
            })
            .collect()
    }
}

/// Checks of the values of a scene file, which is named in error messages.
struct Check<'a> {
    file: &'a str,
}

impl Check<'_> {
    fn out_of_range(&self, field: &str, value: f64, limit: &'static str) -> SceneError {
        SceneError::OutOfRange { file: self.file.to_owned(), field: field.to_owned(), value, limit }
    }

    fn point(&self, field: &str, point: &[f64; 3]) -> Result<(), SceneError> {
        match point.iter().find(|value| !value.is_finite() || value.abs() > MAX_LENGTH) {
            Some(value) => Err(self.out_of_range(field, *value, "a number within 1e7 of 0")),
            None => Ok(()),
        }
    }

    fn size(&self, field: &str, value: f64, may_be_zero: bool) -> Result<(), SceneError> {
        let least = if may_be_zero { value >= 0.0 } else { value > 0.0 };
        if least && value <= MAX_LENGTH {
            return Ok(());
        }
        Err(self.out_of_range(field, value, if may_be_zero { "between 0 and 1e7" } else { "above 0 and at most 1e7" }))
    }

    fn normal(&self, field: &str, normal: &[f64; 3]) -> Result<(), SceneError> {
        self.point(field, normal)?;
        let length = Vector3::from(*normal).norm();
        if length > 1e-6 { Ok(()) } else { Err(self.out_of_range(field, length, "longer than 1e-6")) }
    }
}

/// Returns the points in mm after checking that each coordinate is finite and within range.
fn scaled(read: &GeometryFile, scale: Option<f64>, file: &str) -> Result<Vec<Vector3<f64>>, SceneError> {
    let scale = scale.unwrap_or(read.unit_mm);
    let mut points = Vec::with_capacity(read.geometry.points.len());
    for (index, point) in read.geometry.points.iter().enumerate() {
        let point = point * scale;
        if let Some(value) = point.iter().find(|value| !value.is_finite() || value.abs() > MAX_LENGTH) {
            let field = format!("a coordinate of point {} in mm", index + 1);
            let file = file.to_owned();
            return Err(SceneError::OutOfRange { file, field, value: *value, limit: "a number within 1e7 of 0" });
        }
        points.push(point);
    }
    Ok(points)
}

fn cloud_of(read: &GeometryFile, scale: Option<f64>, radius: f64, file: &str) -> Result<Cloud, SceneError> {
    let points = scaled(read, scale, file)?;
    if points.is_empty() {
        return Err(SceneError::Empty { file: file.to_owned(), what: "points" });
    }
    Ok(Cloud::new(points, radius))
}

fn mesh_of(read: &GeometryFile, scale: Option<f64>, solid: bool, file: &str) -> Result<Mesh, SceneError> {
    let points = scaled(read, scale, file)?;
    let geometry = &read.geometry;
    let corner = |index: u32| points.get(index as usize).copied().unwrap_or_default();
    let triangles: Vec<Triangle> = geometry.triangles.iter().map(|face| Triangle(face.map(corner))).collect();
    if triangles.is_empty() {
        return Err(SceneError::Empty { file: file.to_owned(), what: "faces" });
    }
    // The check takes as long as building the tree, so both run in parallel.
    let (faults, mesh) = thread::scope(|scope| {
        let check = || if solid { read::find_defects(&points, &geometry.triangles) } else { MeshDefects::default() };
        let faults = scope.spawn(check);
        let mesh = if solid { Mesh::solid(triangles) } else { Mesh::surface(triangles) };
        // A thread that panicked has checked nothing.
        (faults.join().unwrap_or(MeshDefects { open: usize::MAX, flipped: 0 }), mesh)
    });
    let file = file.to_owned();
    match faults {
        MeshDefects { open: 0, flipped: 0 } => Ok(mesh),
        MeshDefects { open: 0, flipped } => Err(SceneError::FlippedFaces { file, flipped }),
        MeshDefects { open, .. } => Err(SceneError::OpenMesh { file, open }),
    }
}
