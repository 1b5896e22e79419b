//! Wavefront OBJ: vertices and faces as text. OBJ has no units, so a comment states mm.

use std::fmt::Write as _;

use nalgebra::Vector3;

use super::body::ExportedBody;
use super::mesh::{BodyMesh, MeshError, MeshResolution};

/// Returns an OBJ file with the wall of a body in the base's axes, mm, z up. `name` is part of its comments. The
/// vertices are those of STL, but shared by their triangles.
///
/// # Errors
/// [`MeshError`] if the body has no mesh.
pub fn write(name: &str, body: &ExportedBody, resolution: MeshResolution) -> Result<String, MeshError> {
    let mesh = BodyMesh::of_wall(body, resolution, &Vector3::zeros())?;
    let (version, robot) = (env!("CARGO_PKG_VERSION"), &body.robot);
    let mut text = format!("# growbot {version}, {robot}, {name}: printed wall\n# units mm, z up\no wall\n");
    for vertex in &mesh.vertices {
        let [x, y, z] = vertex.coords.map(|mm| mm as f32).into();
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for triangle in &mesh.triangles {
        // Indices count from 1.
        let [a, b, c] = triangle.map(|index| index + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    Ok(text)
}
