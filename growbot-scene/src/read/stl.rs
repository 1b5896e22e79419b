//! STL: triangles, as text or binary.

use nalgebra::Vector3;

use super::format_error::FormatError;
use super::raw_geometry::RawGeometry;
use super::words::{lines, parse_point};

/// Number of bytes before the triangles of a binary file. `TRIANGLE` is the number of bytes of each triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads an STL file. Many binary files begin like text files, so the length of the file decides whether it is binary.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let count = bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let announced = count.map(|count| count as usize * TRIANGLE + HEADER);
    if announced.is_some_and(|announced| announced == bytes.len()) {
        return Ok(binary(bytes));
    }
    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    match (is_text, announced) {
        (true, _) => read_ascii(bytes),
        (false, Some(declared)) => Err(FormatError::Count { what: "bytes", declared, found: bytes.len() }),
        (false, None) => Err(FormatError::NoStlHeader(bytes.len())),
    }
}

fn binary(bytes: &[u8]) -> RawGeometry {
    let mut geometry = RawGeometry::default();
    for triangle in bytes.get(HEADER..).unwrap_or_default().chunks_exact(TRIANGLE) {
        let number = |index: usize| {
            let bytes = triangle.get(4 * index..).and_then(|rest| rest.first_chunk());
            f64::from(bytes.map_or(f32::NAN, |bytes| f32::from_le_bytes(*bytes)))
        };
        // The first three numbers are the normal.
        let corner = |index: usize| Vector3::from_fn(|axis, _| number(3 + 3 * index + axis));
        push(&mut geometry, [corner(0), corner(1), corner(2)]);
    }
    geometry
}

fn read_ascii(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let mut geometry = RawGeometry::default();
    let mut corners = Vec::new();
    for (number, words) in lines(bytes).enumerate() {
        let line = number + 1;
        match words.as_slice() {
            ["vertex", coordinates @ ..] => {
                corners.push(parse_point(coordinates).ok_or(FormatError::Coordinates { line, keyword: "vertex" })?);
            }
            ["endfacet", ..] => {
                let found = corners.len();
                let triangle = <[Vector3<f64>; 3]>::try_from(std::mem::take(&mut corners));
                push(&mut geometry, triangle.map_err(|_| FormatError::Facet { line, corners: found })?);
            }
            _ => {}
        }
    }
    if corners.is_empty() { Ok(geometry) } else { Err(FormatError::Truncated("a facet")) }
}

fn push(geometry: &mut RawGeometry, triangle: [Vector3<f64>; 3]) {
    let first = geometry.points.len() as u32;
    geometry.points.extend(triangle);
    geometry.triangles.push([first, first + 1, first + 2]);
}
