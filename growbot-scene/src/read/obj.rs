//! OBJ: points and faces. Normals, textures, materials and groups are ignored.

use super::raw_geometry::{RawGeometry, fan};
use super::words::{lines, parse_point};

/// Reads an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, String> {
    let mut geometry = RawGeometry::default();
    for (number, words) in lines(bytes).enumerate() {
        let number = number + 1;
        match words.as_slice() {
            ["v", coordinates @ ..] => {
                let point = parse_point(coordinates)
                    .ok_or_else(|| format!("line {number} of the file does not have three numbers after `v`"))?;
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
                let corners =
                    corners.ok_or_else(|| format!("line {number} of the file has a corner that is not a number"))?;
                fan(&corners, &mut geometry).map_err(|reason| format!("line {number}: {reason}"))?;
            }
            _ => {}
        }
    }
    Ok(geometry)
}
