//! GLB: glTF 2.0 in one file, with a chunk of JSON and a chunk of binary numbers.
//!
//! glTF is in metres with y up. Vertices are in metres in the base's axes, relative to the body's start. The matrix of
//! each node turns z up into y up and moves the start to its position.

use growbot_core::layer::Layer;
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::body::ExportedBody;
use super::mesh::{BodyMesh, MeshError, MeshResolution};
use super::obstacles::{mark, surfaces};
use crate::view::SceneView;
use crate::view::heights::HeightScale;

/// Magic number of GLB files: the letters `glTF`.
const MAGIC: u32 = 0x4654_6c67;
/// Version of the GLB container.
const VERSION: u32 = 2;
/// Type of the chunk with JSON. `BINARY_CHUNK` is the type of the chunk with binary numbers.
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// Code of glTF for 32-bit floating-point numbers. The constants below are the codes for other number types, for buffer
/// targets and for triangles.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_BYTE: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const TRIANGLES: u32 = 4;

/// Base colour (RGBA) of the first body, by which the colours of its vertices are multiplied. `BESIDE` is the colour of
/// all other bodies.
const WHITE: [f64; 4] = [1.0; 4];
const BESIDE: [f64; 4] = [0.3, 0.5, 0.75, 1.0];

/// Colour (RGBA) of obstacles, which are translucent. `NARROWEST` is the colour of the mark at the closest approach.
const OBSTACLES: [f64; 4] = [0.2, 0.14, 0.09, 0.3];
const NARROWEST: [f64; 4] = [0.45, 0.02, 0.01, 1.0];

/// Returns a GLB file with the walls of bodies, each as a node with its name. The vertices of the first body are
/// coloured by the heights of its layers. If `around` is given, the scene around the first body is added.
///
/// # Errors
/// [`MeshError`] if a body has no mesh.
pub fn write(
    bodies: &[(&str, &ExportedBody)],
    around: Option<&SceneView>,
    resolution: MeshResolution,
) -> Result<Vec<u8>, MeshError> {
    let mut parts = GltfBuilder::default();
    for (name, body) in bodies {
        parts.add(name, body, resolution)?;
    }
    if let (Some(around), Some((_, body))) = (around, bodies.first()) {
        parts.add_scene(around, &body.base_from_start.translation.vector);
    }
    let GltfBuilder { nodes, meshes, materials, accessors, views, binary } = parts;
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

/// Lists of objects of an unfinished glTF document, and its binary numbers.
#[derive(Default)]
struct GltfBuilder {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
}

impl GltfBuilder {
    /// Adds the wall of a body. The first body is coloured by the heights of its layers. Any other has a single colour.
    fn add(&mut self, name: &str, body: &ExportedBody, resolution: MeshResolution) -> Result<(), MeshError> {
        let (index, start) = (self.nodes.len(), body.base_from_start.translation.vector);
        let mesh = BodyMesh::of_wall(body, resolution, &start)?;
        let scale = (index == 0).then(|| {
            let layers: Vec<Layer> = body.layers.iter().map(|laid| laid.layer).collect();
            HeightScale::of_layers(&layers, body.wall_radius)
        });
        self.nodes.push(json!({ "name": name, "mesh": index, "matrix": upright(&start) }));
        let of = |what: &str| if index == 0 { what.to_owned() } else { format!("{what}, {name}") };
        let colour = if scale.is_some() { WHITE } else { BESIDE };
        self.materials.push(json!({
            "name": of("filament"),
            "pbrMetallicRoughness": { "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.7 },
        }));
        let mut attributes = json!({ "POSITION": self.positions(&mesh) });
        let indices = self.indices(&mesh);
        if let Some(scale) = &scale {
            attributes["COLOR_0"] = json!(self.colours(&mesh, scale));
        }
        self.meshes.push(json!({
            "name": of("wall"),
            "extras": { "height_colours_mm": scale.map(|scale| scale.range()) },
            "primitives": [{ "attributes": attributes, "indices": indices, "material": index, "mode": TRIANGLES }],
        }));
        Ok(())
    }

    /// Adds the translucent obstacles of a scene and the mark at the closest approach, relative to the body's start
    /// (mm).
    fn add_scene(&mut self, around: &SceneView, start: &Vector3<f64>) {
        let narrowest = around.closest_approach.as_ref().map(|(found, clearance)| {
            json!({ "clearance_mm": clearance, "along_mm": found.at, "obstacle": found.obstacle.to_string() })
        });
        let shown = json!({ "shown": around.obstacles.len(), "of": around.obstacles.total, "file": around.file });
        let parts = [
            ("obstacles", surfaces(around, start), OBSTACLES, "BLEND", shown),
            ("narrowest place", mark(around, start), NARROWEST, "OPAQUE", json!(narrowest)),
        ];
        for (name, mesh, colour, alpha_mode, extras) in parts {
            let Some(mesh) = mesh else { continue };
            let (index, positions, indices) = (self.nodes.len(), self.positions(&mesh), self.indices(&mesh));
            self.nodes.push(json!({ "name": name, "mesh": index, "matrix": upright(start) }));
            self.materials.push(json!({
                "name": name,
                "pbrMetallicRoughness": { "baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.9 },
                "alphaMode": alpha_mode,
                "doubleSided": true,
            }));
            self.meshes.push(json!({
                "name": name,
                "extras": extras,
                "primitives": [{
                    "attributes": { "POSITION": positions }, "indices": indices, "material": index, "mode": TRIANGLES,
                }],
            }));
        }
    }

    fn positions(&mut self, mesh: &BodyMesh) -> usize {
        let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(metres).collect();
        let bound = |pick: fn(f32, f32) -> f32| {
            let first = positions.first().copied().unwrap_or_default();
            positions.iter().fold(first, |[x, y, z], [a, b, c]| [pick(x, *a), pick(y, *b), pick(z, *c)])
        };
        let accessor = json!({
            "componentType": FLOAT, "count": positions.len(), "type": "VEC3", "min": bound(f32::min),
            "max": bound(f32::max),
        });
        let bytes = positions.as_flattened().iter().flat_map(|number| number.to_le_bytes()).collect();
        self.numbers(bytes, ARRAY_BUFFER, accessor)
    }

    fn indices(&mut self, mesh: &BodyMesh) -> usize {
        let count = 3 * mesh.triangles.len();
        let accessor = json!({ "componentType": UNSIGNED_INT, "count": count, "type": "SCALAR" });
        let bytes = mesh.triangles.as_flattened().iter().flat_map(|index| index.to_le_bytes()).collect();
        self.numbers(bytes, ELEMENT_ARRAY_BUFFER, accessor)
    }

    fn colours(&mut self, mesh: &BodyMesh, scale: &HeightScale) -> usize {
        let count = mesh.vertices.len();
        let accessor = json!({ "componentType": UNSIGNED_BYTE, "normalized": true, "count": count, "type": "VEC4" });
        let bytes = mesh.heights.iter().flat_map(|height| linear(scale.colour(*height))).collect();
        self.numbers(bytes, ARRAY_BUFFER, accessor)
    }

    /// Adds binary numbers with a buffer view for `target`, and returns the index of their accessor.
    fn numbers(&mut self, bytes: Vec<u8>, target: u32, mut accessor: Value) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len(), "target": target });
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(view);
        self.binary.extend(bytes);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Returns the matrix of a node for points relative to `start` (mm), by columns: x stays, y becomes -z, z becomes y.
fn upright(start: &Vector3<f64>) -> [f64; 16] {
    let [x, y, z] = <[f64; 3]>::from(*start).map(|mm| mm / 1000.0);
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, z, -y, 1.0]
}

/// Converts a point from mm to metres.
fn metres(point: &Point3<f64>) -> [f32; 3] {
    [point.x, point.y, point.z].map(|mm| (mm / 1000.0) as f32)
}

/// Converts a colour to glTF's: linear, with the opacity as the last number.
fn linear(colour: [u8; 3]) -> [u8; 4] {
    let [red, green, blue] = colour.map(|part| {
        let share = f64::from(part) / 255.0;
        let linear = if share <= 0.04045 { share / 12.92 } else { libm::pow((share + 0.055) / 1.055, 2.4) };
        (255.0 * linear).round() as u8
    });
    [red, green, blue, 255]
}

/// Returns a GLB file with a chunk of JSON and a chunk of binary numbers, each padded to a multiple of four bytes.
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
    use super::super::body::LayerSource;
    use super::*;
    use crate::drawing::colours::HEIGHTS;

    #[test]
    fn each_body_vertex_has_the_colour_of_its_layer() {
        let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
        let layer = |tilt| Layer { alpha: 0.0, height: 0.8, tilt };
        let body = ExportedBody::of_layers(&robot, (0..20).map(|_| (layer(0.01), LayerSource::Planned)));
        let resolution = MeshResolution { segments: 8, layers_per_ring: 1 };
        let bytes = write(&[("one", &body), ("other", &body)], None, resolution).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let [one, other] = [0, 1].map(|mesh| &document["meshes"][mesh]["primitives"][0]["attributes"]);
        assert!(other.get("COLOR_0").is_none());
        let accessor = &document["accessors"][one["COLOR_0"].as_u64().unwrap() as usize];
        let vertices = 2 * 8 * 21;
        assert_eq!((&accessor["count"], &accessor["type"]), (&json!(vertices), &json!("VEC4")));
        let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let from = 28 + length + view["byteOffset"].as_u64().unwrap() as usize;
        let colours: Vec<&[u8]> = bytes[from..from + 4 * vertices].chunks(4).collect();
        // The body bends away from x. It is highest there and lowest opposite, outside and inside, in every ring.
        for ring in colours.chunks(16) {
            let ends = [&HEIGHTS[4], &HEIGHTS[0]].map(|colour| linear(*colour));
            assert_eq!((ring[0], ring[1], ring[8], ring[9]), (&ends[0][..], &ends[0][..], &ends[1][..], &ends[1][..]));
        }
        let range = &document["meshes"][0]["extras"]["height_colours_mm"];
        assert!((range[0].as_f64().unwrap() - layer(0.01).min_height(body.wall_radius)).abs() < 1e-9, "{range}");
    }

    #[test]
    fn chunks_are_padded_and_counted() {
        let bytes = container(&json!({ "a": 1 }), &[1, 2, 3, 4, 5]);
        assert_eq!(bytes.len(), 12 + 8 + 8 + 8 + 8);
        assert_eq!(bytes[..12], [b'g', b'l', b'T', b'F', 2, 0, 0, 0, 44, 0, 0, 0]);
        assert_eq!(bytes[12..28], *b"\x08\0\0\0JSON{\"a\":1} ");
        assert_eq!(bytes[28..], *b"\x08\0\0\0BIN\0\x01\x02\x03\x04\x05\0\0\0");
    }
}
