//! Binary STL: a header of 80 bytes, a count, and 50 bytes for each triangle. STL has no units, so the header states
//! mm.

use nalgebra::Vector3;

use super::body::ExportedBody;
use super::mesh::{BodyMesh, MeshError, MeshResolution};

/// Length of the header, bytes.
const HEADER: usize = 80;
/// Length of a triangle, bytes: its normal and three corners, each of three 32-bit numbers, and two bytes without
/// meaning.
const TRIANGLE: usize = 50;

/// Returns an STL file with the wall of a body in the base's axes, mm, z up. `name` is part of the header.
///
/// # Errors
/// [`MeshError`] if the body has no mesh.
pub fn write(name: &str, body: &ExportedBody, resolution: MeshResolution) -> Result<Vec<u8>, MeshError> {
    Ok(encode(&BodyMesh::of_wall(body, resolution, &Vector3::zeros())?, &body.robot, name))
}

fn encode(mesh: &BodyMesh, robot: &str, name: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + 4 + TRIANGLE * mesh.triangles.len());
    // Text STL begins with "solid", so the header must not. The body's description comes first, so that a long robot
    // name cannot cut it off.
    let header = format!("binary STL, units mm, z up; {name}; growbot {}, {robot}", env!("CARGO_PKG_VERSION"));
    bytes.extend(header.bytes().take(HEADER));
    bytes.resize(HEADER, b' ');
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for corners in mesh.corners() {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        for vector in [normal, a.coords, b.coords, c.coords] {
            bytes.extend(vector.iter().flat_map(|value| (*value as f32).to_le_bytes()));
        }
        bytes.extend([0, 0]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use growbot_plan::run_log::BodyKind;
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn the_bytes_match_the_format() {
        let vertices = vec![Point3::origin(), Point3::new(2.0, 0.0, 0.0), Point3::new(0.0, 3.0, 0.0)];
        let bytes = encode(
            &BodyMesh { vertices, heights: vec![1.0; 3], triangles: vec![[0, 1, 2]] },
            &"a-very-long-name".repeat(9),
            "planned",
        );
        assert_eq!(bytes.len(), HEADER + 4 + TRIANGLE);
        assert!(bytes.starts_with(b"binary STL, units mm"));
        for kind in [BodyKind::Laid, BodyKind::Commanded, BodyKind::AsBuilt] {
            let mesh = BodyMesh { vertices: Vec::new(), heights: Vec::new(), triangles: Vec::new() };
            let header = encode(&mesh, &"a-very-long-name".repeat(9), kind.name());
            let header = String::from_utf8_lossy(&header[..HEADER]).into_owned();
            assert!(header.contains(kind.name()), "{header}");
        }
        assert_eq!(bytes[HEADER..HEADER + 4], [1, 0, 0, 0]);
        let numbers: Vec<f32> = bytes[HEADER + 4..HEADER + 52]
            .as_chunks::<4>()
            .0
            .iter()
            .map(|number| f32::from_le_bytes(*number))
            .collect();
        assert_eq!(numbers, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0]);
    }
}
