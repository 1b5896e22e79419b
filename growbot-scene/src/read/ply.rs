//! PLY: points and faces, as text or binary.

use nalgebra::Vector3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::raw_geometry::{RawGeometry, fan};

/// A point of a PLY file. Properties other than x, y and z are ignored.
struct Vertex(Vector3<f64>);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(Vector3::repeat(f64::NAN))
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let value = match property {
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            Property::Int(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            _ => return PropertyAccessResult::Ignored,
        };
        match name {
            "x" => self.0.x = value,
            "y" => self.0.y = value,
            "z" => self.0.z = value,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// A face of a PLY file: the indices of its corners.
struct Face(Vec<i64>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_index" | "vertex_indices") {
            return PropertyAccessResult::Ignored;
        }
        self.0 = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::Ignored,
        };
        PropertyAccessResult::Set
    }
}

/// An element of a PLY file that is neither a point nor a face. It is ignored.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

/// Reads a PLY file.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, String> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(|error| error.to_string())?;
    let mut geometry = RawGeometry::default();
    for (name, element) in &header.elements {
        if element.properties.is_empty() || element.count > bytes.len() {
            return Err(format!("the file declares {} elements {name:?}, more than the file has bytes", element.count));
        }
        match name.as_str() {
            "vertex" => {
                let read = Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header);
                geometry.points = read.map_err(|error| error.to_string())?.into_iter().map(|vertex| vertex.0).collect();
            }
            "face" => {
                let read = Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header);
                for Face(corners) in read.map_err(|error| error.to_string())? {
                    fan(&corners, &mut geometry)?;
                }
            }
            // A mesh made of strips would be mistaken for a cloud.
            "tristrips" if element.count > 0 => {
                return Err("the file has strips of triangles: export the mesh with faces".to_owned());
            }
            _ => {
                Parser::<Other>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|error| error.to_string())?;
            }
        }
    }
    Ok(geometry)
}
