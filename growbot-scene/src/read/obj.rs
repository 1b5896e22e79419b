//! OBJ: points and faces. Normals, textures, materials and groups are ignored.

use super::format_error::FormatError;
use super::raw_geometry::{RawGeometry, fan};
use super::words::{lines, parse_point};

/// Reads an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let mut geometry = RawGeometry::default();
    for (number, words) in lines(bytes).enumerate() {
        let number = number + 1;
        match words.as_slice() {
            ["v", coordinates @ ..] => {
                let point = parse_point(coordinates).ok_or(FormatError::Coordinates { line: number, keyword: "v" })?;
                geometry.points.push(point);
            }
            ["f", corners @ ..] => {
                let points = geometry.points.len() as i64;
                let index = |word: &&str| {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    // Indices count from 1 or, if negative, from the last point back.
                    Some(if index < 0 { points.checked_add(index)? } else { index - 1 })
                };
                let corners: Option<Vec<i64>> = corners.iter().map(index).collect();
                let corners = corners.ok_or(FormatError::CornerNumber(number))?;
                fan(&corners, &mut geometry)
                    .map_err(|error| FormatError::Line { line: number, error: Box::new(error) })?;
            }
            _ => {}
        }
    }
    Ok(geometry)
}
