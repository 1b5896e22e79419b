//! GLB: the triangles of a glTF 2.0 scene in binary form, transformed by their nodes. Textures, materials, skins and
//! animations are ignored. Compressed and sparse buffers are refused.
//!
//! glTF has y up (specification 2.0, section 3.4), so points are turned here to have z up.

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::format_error::FormatError;
use super::raw_geometry::{RawGeometry, fan};

/// Maximum depth of nested nodes.
const MAX_DEPTH: usize = 64;
/// Maximum number of visited nodes. A node is visited once for each of its parents.
const MAX_VISITS: usize = 1 << 20;
/// Maximum number of points of all nodes together. A mesh counts once for each node that uses it.
const MAX_POINTS: usize = 1 << 26;
/// Code of glTF for the number type "unsigned byte". The constants below are the codes for other number types and for
/// triangles.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const TRIANGLES: u32 = 4;

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
struct Document {
    extensions_required: Vec<String>,
    scene: usize,
    scenes: Vec<GltfRoot>,
    nodes: Vec<GlbNode>,
    meshes: Vec<MeshOf>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct GltfRoot {
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct GlbNode {
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: [f64; 3],
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct MeshOf {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    sparse: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    #[serde(default)]
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

/// Reads a GLB file.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let word = |at: usize| bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|word| u32::from_le_bytes(*word));
    if bytes.get(..4) != Some(b"glTF") || word(4) != Some(2) {
        return Err(FormatError::NotGlb);
    }
    let length = word(12).ok_or(FormatError::Truncated("its header"))? as usize;
    let json = bytes.get(20..).and_then(|rest| rest.get(..length)).ok_or(FormatError::Truncated("its JSON"))?;
    let data = bytes.get(20 + length..).and_then(|rest| rest.get(8..)).unwrap_or_default();
    let document: Document = serde_json::from_slice(json)?;
    if let Some(extension) = document.extensions_required.first() {
        return Err(FormatError::Extension(extension.clone()));
    }
    let mut reader = GlbReader { document: &document, data, geometry: RawGeometry::default(), visits: 0 };
    match document.scenes.get(document.scene) {
        Some(scene) => {
            for node in &scene.nodes {
                reader.node(*node, &base_from_gltf(), 0)?;
            }
        }
        None => return Err(missing("scene", document.scene)),
    }
    Ok(reader.geometry)
}

fn missing(kind: &'static str, index: usize) -> FormatError {
    FormatError::Missing { kind, index }
}

/// Returns the rotation from glTF's axes, y up, to those of the base, z up: x stays, -z becomes y, y becomes z.
fn base_from_gltf() -> Matrix4<f64> {
    Matrix4::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
}

struct GlbReader<'a> {
    document: &'a Document,
    data: &'a [u8],
    geometry: RawGeometry,
    visits: usize,
}

impl<'a> GlbReader<'a> {
    fn node(&mut self, index: usize, world_from_parent: &Matrix4<f64>, depth: usize) -> Result<(), FormatError> {
        let node = self.document.nodes.get(index).ok_or_else(|| missing("node", index))?;
        self.visits += 1;
        if depth > MAX_DEPTH || self.visits > MAX_VISITS {
            return Err(FormatError::TooManyNodes { max: MAX_VISITS, max_depth: MAX_DEPTH });
        }
        let world_from_node = world_from_parent * node.parent_from_node();
        if let Some(mesh) = node.mesh {
            let mesh = self.document.meshes.get(mesh).ok_or_else(|| missing("mesh", mesh))?;
            for primitive in &mesh.primitives {
                self.primitive(primitive, &world_from_node)?;
            }
        }
        for child in &node.children {
            self.node(*child, &world_from_node, depth + 1)?;
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: &Primitive, world_from_node: &Matrix4<f64>) -> Result<(), FormatError> {
        match primitive.mode.unwrap_or(TRIANGLES) {
            TRIANGLES => {}
            // Points and lines have no surface.
            0..TRIANGLES => return Ok(()),
            mode => return Err(FormatError::FaceMode(mode)),
        }
        let position = primitive.attributes.position.ok_or(FormatError::NoPositions)?;
        let first = self.geometry.points.len();
        let items = self.items(position, 12, &[FLOAT])?;
        let count = items.len();
        if first + count > MAX_POINTS {
            return Err(FormatError::TooLarge { what: "points", max: MAX_POINTS });
        }
        for item in items {
            let number = |index: usize| {
                let bytes = item.get(4 * index..).and_then(|rest| rest.first_chunk());
                bytes.map_or(f64::NAN, |bytes| f64::from(f32::from_le_bytes(*bytes)))
            };
            let point = world_from_node * Vector4::new(number(0), number(1), number(2), 1.0);
            self.geometry.points.push(point.xyz());
        }
        let indices = match primitive.indices {
            Some(indices) => self.indices(indices)?,
            None => (0..count as i64).collect(),
        };
        if self.geometry.triangles.len() + indices.len() / 3 > MAX_POINTS {
            return Err(FormatError::TooLarge { what: "triangles", max: MAX_POINTS });
        }
        // A node that mirrors turns its faces inside out. This is reversed here.
        let mirrored = world_from_node.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for face in indices.as_chunks::<3>().0 {
            if let Some(index) = face.iter().find(|index| **index >= count as i64) {
                return Err(FormatError::Corner { corner: *index, points: count });
            }
            let [a, b, c] = face.map(|index| first as i64 + index);
            fan(&if mirrored { [a, c, b] } else { [a, b, c] }, &mut self.geometry)?;
        }
        Ok(())
    }

    fn indices(&self, accessor: usize) -> Result<Vec<i64>, FormatError> {
        let kind = self.document.accessors.get(accessor).map(|accessor| accessor.component_type);
        let size = match kind {
            Some(UNSIGNED_BYTE) => 1,
            Some(UNSIGNED_SHORT) => 2,
            _ => 4,
        };
        let items = self.items(accessor, size, &[UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT])?;
        let number = |item: &[u8]| item.iter().rev().fold(0_i64, |number, byte| number << 8 | i64::from(*byte));
        Ok(items.into_iter().map(number).collect())
    }

    /// Returns the bytes of each item of an accessor.
    fn items(&self, index: usize, size: usize, kinds: &[u32]) -> Result<Vec<&'a [u8]>, FormatError> {
        let accessor = self.document.accessors.get(index).ok_or_else(|| missing("accessor", index))?;
        if !kinds.contains(&accessor.component_type) {
            return Err(FormatError::NumberType { accessor: index, kind: accessor.component_type });
        }
        if accessor.sparse.is_some() {
            return Err(FormatError::SparseAccessor(index));
        }
        let view = accessor.buffer_view.and_then(|view| self.document.buffer_views.get(view));
        let view = view.ok_or(FormatError::EmptyAccessor(index))?;
        if view.buffer != 0 {
            return Err(FormatError::OtherBuffer { accessor: index, buffer: view.buffer });
        }
        let bytes = self.data.get(view.byte_offset..).and_then(|rest| rest.get(..view.byte_length));
        let bytes = bytes.and_then(|bytes| bytes.get(accessor.byte_offset..));
        let bytes = bytes.ok_or(FormatError::BeyondData(index))?;
        let stride = view.byte_stride.unwrap_or(size).max(size);
        let items: Vec<&'a [u8]> =
            bytes.chunks(stride).take(accessor.count).filter_map(|item| item.get(..size)).collect();
        if items.len() < accessor.count {
            let (found, declared) = (items.len(), accessor.count);
            return Err(FormatError::ShortAccessor { accessor: index, found, declared });
        }
        Ok(items)
    }
}

impl GlbNode {
    fn parent_from_node(&self) -> Matrix4<f64> {
        if let Some(matrix) = &self.matrix {
            return Matrix4::from_column_slice(matrix);
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_homogeneous();
        let scale = Matrix4::new_nonuniform_scaling(&Vector3::from(self.scale.unwrap_or([1.0; 3])));
        Matrix4::new_translation(&Vector3::from(self.translation)) * rotation * scale
    }
}
