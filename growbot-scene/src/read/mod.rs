//! Readers of meshes and point clouds.

pub mod ply;

use nalgebra::Vector3;

/// What a file of a mesh or of a cloud holds: points, and triangles between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// The points, in the file's units.
    pub points: Vec<Vector3<f64>>,
    /// The corners of each triangle, as indices of points.
    pub triangles: Vec<[u32; 3]>,
}

/// Adds a face as triangles from its first corner.
fn fan(corners: &[i64], geometry: &mut Geometry) -> Result<(), String> {
    let points = geometry.points.len();
    let corner = |index: i64| match usize::try_from(index) {
        Ok(found) if found < points => Ok(found as u32),
        _ => Err(format!("a face has the corner {index}, and there are {points} points, counted from 0")),
    };
    let [first, rest @ ..] = corners else { return Ok(()) };
    let first = corner(*first)?;
    for pair in rest.windows(2) {
        geometry.triangles.push([first, corner(pair[0])?, corner(pair[1])?]);
    }
    Ok(())
}
