//! PLY: points and faces, as text or binary.

use nalgebra::Vector3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::format_error::FormatError;
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
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader)?;
    let mut geometry = RawGeometry::default();
    for (name, element) in &header.elements {
        if element.properties.is_empty() || element.count > bytes.len() {
            return Err(FormatError::TooManyElements { count: element.count, name: name.clone() });
        }
        match name.as_str() {
            "vertex" => {
                let read = Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header);
                geometry.points = read?.into_iter().map(|vertex| vertex.0).collect();
            }
            "face" => {
                let read = Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header);
                for Face(corners) in read? {
                    fan(&corners, &mut geometry)?;
                }
            }
            // A mesh made of strips would be mistaken for a cloud.
            "tristrips" if element.count > 0 => return Err(FormatError::Strips),
            _ => {
                Parser::<Other>::new().read_payload_for_element(&mut reader, element, &header)?;
            }
        }
    }
    Ok(geometry)
}
