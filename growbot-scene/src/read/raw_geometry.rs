//! The content of a mesh or cloud file as its reader returns it.

use nalgebra::Vector3;

use super::format_error::FormatError;

/// Content of a mesh or cloud file: points, and triangles between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RawGeometry {
    /// The points in the file's units, in axes with z up.
    pub points: Vec<Vector3<f64>>,
    /// Corners of each triangle, as indices of points.
    pub triangles: Vec<[u32; 3]>,
}

/// Adds a face as a fan of triangles from its first corner.
pub(super) fn fan(corners: &[i64], geometry: &mut RawGeometry) -> Result<(), FormatError> {
    let points = geometry.points.len();
    let corner = |index: i64| match usize::try_from(index) {
        Ok(found) if found < points => Ok(found as u32),
        _ => Err(FormatError::Corner { corner: index, points }),
    };
    let [first, rest @ ..] = corners else { return Ok(()) };
    let first = corner(*first)?;
    for pair in rest.windows(2) {
        geometry.triangles.push([first, corner(pair[0])?, corner(pair[1])?]);
    }
    Ok(())
}
