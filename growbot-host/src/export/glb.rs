//! GLB: glTF 2.0 in one file, a chunk of JSON and one of numbers.
//!
//! glTF is in metres with y up. Vertices are in metres in the base's axes, from the body's start; the matrix of the one node turns z up
//! into y up and puts the start in its place.

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

/// The wall of a body.
///
/// # Errors
/// Where there is no mesh of it.
pub fn write(body: &Body, resolution: Resolution) -> Result<Vec<u8>, MeshError> {
    let start = body.base_from_start.translation.vector;
    let mesh = Mesh::of_wall(body, resolution, &start)?;
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(metres).collect();
    let bound = |pick: fn(f32, f32) -> f32| {
        let first = positions.first().copied().unwrap_or_default();
        positions.iter().fold(first, |[x, y, z], [a, b, c]| [pick(x, *a), pick(y, *b), pick(z, *c)])
    };
    let [x, y, z] = <[f64; 3]>::from(start).map(|mm| mm / 1000.0);
    let position_bytes = 12 * positions.len();
    let index_bytes = 12 * mesh.triangles.len();
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("growbot ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        // By columns: x stays, y becomes -z, z becomes y.
        "nodes": [{
            "name": body.robot,
            "mesh": 0,
            "matrix": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, z, -y, 1.0],
        }],
        "meshes": [{
            "name": "wall",
            "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0, "mode": TRIANGLES }],
        }],
        "materials": [{
            "name": "filament",
            "pbrMetallicRoughness": { "baseColorFactor": [0.85, 0.55, 0.2, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7 },
        }],
        "accessors": [
            {
                "bufferView": 0, "componentType": FLOAT, "count": positions.len(), "type": "VEC3",
                "min": bound(f32::min), "max": bound(f32::max),
            },
            { "bufferView": 1, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(), "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": position_bytes, "target": ARRAY_BUFFER },
            { "buffer": 0, "byteOffset": position_bytes, "byteLength": index_bytes, "target": ELEMENT_ARRAY_BUFFER },
        ],
        "buffers": [{ "byteLength": position_bytes + index_bytes }],
    });
    let mut binary = Vec::with_capacity(position_bytes + index_bytes);
    binary.extend(positions.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
    binary.extend(mesh.triangles.as_flattened().iter().flat_map(|index| index.to_le_bytes()));
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
