//! GLB: glTF 2.0 in one file, a chunk of JSON and one of numbers.
//!
//! glTF is in metres with y up. Vertices are in metres in the base's axes, from the body's start; the matrix of each
//! node turns z up into y up and puts the start in its place.

use nalgebra::Point3;
use serde_json::{Value, json};

use super::body::Body;
use super::mesh::{Mesh, MeshError, Resolution};

/// `glTF`, as the specification has it.
const MAGIC: u32 = 0x4654_6c67;
/// Of the container.
const VERSION: u32 = 2;
/// Kinds of chunks: `JSON` and `BIN`.
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// glTF's numbers for kinds of data.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const TRIANGLES: u32 = 4;

/// Colours of bodies: the one that is shown, and one beside it.
const COLOURS: [[f64; 4]; 2] = [[0.85, 0.55, 0.2, 1.0], [0.3, 0.5, 0.75, 1.0]];

/// The walls of bodies, each a node of this name.
///
/// # Errors
/// Where there is no mesh of one.
pub fn write(bodies: &[(&str, &Body)], resolution: Resolution) -> Result<Vec<u8>, MeshError> {
    let (mut nodes, mut meshes, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    let (mut accessors, mut views, mut binary) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (name, body)) in bodies.iter().enumerate() {
        let start = body.base_from_start.translation.vector;
        let mesh = Mesh::of_wall(body, resolution, &start)?;
        let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(metres).collect();
        let bound = |pick: fn(f32, f32) -> f32| {
            let first = positions.first().copied().unwrap_or_default();
            positions.iter().fold(first, |[x, y, z], [a, b, c]| [pick(x, *a), pick(y, *b), pick(z, *c)])
        };
        let [x, y, z] = <[f64; 3]>::from(start).map(|mm| mm / 1000.0);
        // By columns: x stays, y becomes -z, z becomes y.
        nodes.push(json!({
            "name": name,
            "mesh": index,
            "matrix": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, z, -y, 1.0],
        }));
        let (first, second) = (2 * index, 2 * index + 1);
        meshes.push(json!({
            "name": if index == 0 { "wall".to_owned() } else { format!("wall, {name}") },
            "primitives": [{
                "attributes": { "POSITION": first },
                "indices": second,
                "material": index,
                "mode": TRIANGLES,
            }],
        }));
        let colour = COLOURS.get(index).or(COLOURS.last());
        materials.push(json!({
            "name": if index == 0 { "filament".to_owned() } else { format!("filament, {name}") },
            "pbrMetallicRoughness": { "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.7 },
        }));
        accessors.push(json!({
            "bufferView": first, "componentType": FLOAT, "count": positions.len(), "type": "VEC3",
            "min": bound(f32::min), "max": bound(f32::max),
        }));
        accessors.push(json!({
            "bufferView": second, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR",
        }));
        let mut view = |bytes: Vec<u8>, target: u32| {
            views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "target": target }));
            binary.extend(bytes);
        };
        let positions = positions.as_flattened().iter().flat_map(|number| number.to_le_bytes());
        view(positions.collect(), ARRAY_BUFFER);
        let indices = mesh.triangles.as_flattened().iter().flat_map(|index| index.to_le_bytes());
        view(indices.collect(), ELEMENT_ARRAY_BUFFER);
    }
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("growbot ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    Ok(container(&document, &binary))
}

/// A point in mm, in metres.
fn metres(point: &Point3<f64>) -> [f32; 3] {
    [point.x, point.y, point.z].map(|mm| (mm / 1000.0) as f32)
}

/// Both chunks, each filled up to a multiple of four bytes.
fn container(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let mut bytes = Vec::with_capacity(length);
    let word = |number: usize| (number as u32).to_le_bytes();
    for number in [MAGIC, VERSION] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(word(length));
    for (kind, chunk) in [(JSON_CHUNK, &text), (BINARY_CHUNK, &binary)] {
        bytes.extend(word(chunk.len()));
        bytes.extend(kind.to_le_bytes());
        bytes.extend(chunk);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_filled_up_and_counted() {
        let bytes = container(&json!({ "a": 1 }), &[1, 2, 3, 4, 5]);
        assert_eq!(bytes.len(), 12 + 8 + 8 + 8 + 8);
        assert_eq!(bytes[..12], [b'g', b'l', b'T', b'F', 2, 0, 0, 0, 44, 0, 0, 0]);
        assert_eq!(bytes[12..28], *b"\x08\0\0\0JSON{\"a\":1} ");
        assert_eq!(bytes[28..], *b"\x08\0\0\0BIN\0\x01\x02\x03\x04\x05\0\0\0");
    }
}
