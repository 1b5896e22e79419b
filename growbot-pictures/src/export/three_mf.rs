//! 3MF: a zip archive with a model in XML, by the core specification. It states its unit, and the triangles share
//! vertices, so a slicer has nothing to guess and nothing to weld.

use std::io::{BufWriter, Cursor, Write as _};

use nalgebra::Vector3;
use zip::ZipWriter;
use zip::result::ZipError;
use zip::write::SimpleFileOptions;

use super::body::ExportedBody;
use super::mesh::{BodyMesh, MeshError, MeshResolution};
use crate::drawing::canvas::escape;

/// Name of the model in the archive. `RELATIONSHIPS` refers to it, and `TYPES` has the types of both by extension.
const MODEL: &str = "3D/3dmodel.model";
const RELATIONSHIPS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="model" Target="/3D/3dmodel.model"
  Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;
const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;

/// Reason why a body cannot be written as 3MF.
#[derive(Debug, thiserror::Error)]
pub enum ThreeMfError {
    /// The body has no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The archive cannot be written.
    #[error("the 3MF archive cannot be written: {0}")]
    Archive(#[from] ZipError),
}

/// Returns a 3MF file with the wall of a body in the base's axes, mm, z up. `name` is part of its title. The vertices
/// are those of STL, but shared by their triangles. The archive has no times, so equal bodies give equal bytes.
///
/// # Errors
/// [`ThreeMfError::Mesh`] if the body has no mesh. [`ThreeMfError::Archive`] if the archive is larger than zip allows.
pub fn write(name: &str, body: &ExportedBody, resolution: MeshResolution) -> Result<Vec<u8>, ThreeMfError> {
    let mesh = BodyMesh::of_wall(body, resolution, &Vector3::zeros())?;
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (part, text) in [("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONSHIPS)] {
        archive.start_file(part, SimpleFileOptions::DEFAULT)?;
        archive.write_all(text.as_bytes()).map_err(ZipError::from)?;
    }
    archive.start_file(MODEL, SimpleFileOptions::DEFAULT)?;
    write_model(&mut archive, &mesh, &format!("{}, {name}", body.robot)).map_err(ZipError::from)?;
    Ok(archive.finish()?.into_inner())
}

/// Writes the model: metadata, one object, and the item of the build that refers to it.
fn write_model(archive: &mut ZipWriter<Cursor<Vec<u8>>>, mesh: &BodyMesh, title: &str) -> std::io::Result<()> {
    // The archive compresses in larger pieces than lines.
    let mut model = BufWriter::with_capacity(1 << 16, archive);
    let (version, title) = (env!("CARGO_PKG_VERSION"), escape(title));
    write!(
        model,
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<metadata name="Title">{title}</metadata>
<metadata name="Application">growbot {version}</metadata>
<resources>
<object id="1" type="model" name="{title}">
<mesh>
<vertices>
"#
    )?;
    for vertex in &mesh.vertices {
        let [x, y, z] = vertex.coords.map(|mm| mm as f32).into();
        writeln!(model, r#"<vertex x="{x}" y="{y}" z="{z}"/>"#)?;
    }
    writeln!(model, "</vertices>\n<triangles>")?;
    for [a, b, c] in &mesh.triangles {
        writeln!(model, r#"<triangle v1="{a}" v2="{b}" v3="{c}"/>"#)?;
    }
    let end = "</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n<item objectid=\"1\"/>\n</build>\n</model>\n";
    model.write_all(end.as_bytes())?;
    model.flush()
}
