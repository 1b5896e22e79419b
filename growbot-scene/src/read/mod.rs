//! Readers of meshes and point clouds. All counts of a file are checked against its actual bytes before they are used,
//! so that memory is bounded by the file's length.
//!
//! Axes are those of the base, z up. glTF defines y up and metres, so GLB is turned, and a unit is 1000 mm. The other
//! formats define neither axes nor units: coordinates are taken as they are, and a unit is 1 mm by default.

mod format_error;
mod glb;
mod obj;
mod pcd;
mod ply;
mod raw_geometry;
mod stl;
mod words;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

pub use self::format_error::FormatError;
pub use self::raw_geometry::RawGeometry;
use growbot_core::hash::Hasher;
use nalgebra::Vector3;

/// Maximum length of a mesh or cloud, bytes (512 MiB): some 10 million triangles.
pub const MAX_GEOMETRY_BYTES: u64 = 512 << 20;

/// Maximum number of characters of a reason in a message.
const MAX_REASON_CHARS: usize = 200;

/// Function that reads the geometry from the bytes of a file.
type GeometryReader = fn(&[u8]) -> Result<RawGeometry, FormatError>;

/// File extensions of meshes and clouds, in lower case.
const EXTENSIONS: [&str; 5] = ["stl", "obj", "ply", "glb", "pcd"];

/// A mesh or cloud file that has been read.
#[derive(Debug)]
pub struct GeometryFile {
    /// Content of the file.
    pub geometry: RawGeometry,
    /// Hash of the file's bytes, CRC-64/XZ.
    pub hash: u64,
    /// Length of the file, bytes.
    pub length: u64,
    /// Length of a unit of the points according to the file's format, mm: 1000 for GLB, which is in metres, otherwise
    /// 1.
    pub unit_mm: f64,
}

/// Error of reading a file.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file is missing, or may not be read.
    #[error("cannot read {file}: {error}; give the path of a scene file, a mesh or a point cloud")]
    Unreadable {
        /// Path of the file.
        file: String,
        /// Error of the operating system.
        #[source]
        error: std::io::Error,
    },
    /// The file exceeds the size limit.
    #[error("{file} is longer than {limit} bytes, the maximum: make the file smaller")]
    TooLong {
        /// Path of the file.
        file: String,
        /// Maximum length, bytes.
        limit: u64,
    },
    /// The file extension is unknown.
    #[error("{file} has an unknown file extension: use .stl, .obj, .ply, .glb or .pcd")]
    UnknownExtension {
        /// Path of the file.
        file: String,
    },
    /// The content does not match the extension, or is damaged.
    #[error("cannot parse {file}: {}; export the file again", one_line(&error.to_string()))]
    Malformed {
        /// Path of the file.
        file: String,
        /// Fault of the content.
        #[source]
        error: FormatError,
    },
}

/// Returns the extension of a path, in lower case.
fn extension(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase())
}

/// Reports whether a path has the extension of a mesh or cloud.
pub fn is_geometry(path: &Path) -> bool {
    extension(path).is_some_and(|ending| EXTENSIONS.contains(&ending.as_str()))
}

/// Reads all bytes of a file, whose length must not exceed `limit`.
///
/// # Errors
/// [`ReadError::Unreadable`], [`ReadError::TooLong`].
pub fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    let file = || path.display().to_string();
    let unreadable = |error| ReadError::Unreadable { file: file(), error };
    // A pipe or a device might never end.
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(unreadable(std::io::Error::other("the path is not a file")));
    }
    let mut bytes = Vec::new();
    File::open(path).map_err(unreadable)?.take(limit + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > limit { Err(ReadError::TooLong { file: file(), limit }) } else { Ok(bytes) }
}

/// Reads a mesh or a cloud in the format of its extension.
///
/// # Errors
/// Any fault of the file.
pub fn geometry(path: &Path) -> Result<GeometryFile, ReadError> {
    let file = || path.display().to_string();
    let (read, unit_mm): (GeometryReader, f64) = match extension(path).as_deref() {
        Some("stl") => (stl::read, 1.0),
        Some("obj") => (obj::read, 1.0),
        Some("ply") => (ply::read, 1.0),
        Some("glb") => (glb::read, 1000.0),
        Some("pcd") => (pcd::read, 1.0),
        _ => return Err(ReadError::UnknownExtension { file: file() }),
    };
    let bytes = bytes(path, MAX_GEOMETRY_BYTES)?;
    let geometry = read(&bytes).map_err(|error| ReadError::Malformed { file: file(), error })?;
    Ok(GeometryFile { geometry, hash: Hasher::hash(&bytes), length: bytes.len() as u64, unit_mm })
}

/// Returns a text in one line of limited length, whatever a damaged file contains.
pub(crate) fn one_line(text: &str) -> String {
    let words = text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let line = words.collect::<Vec<_>>().join(" ");
    let mut short: String = line.chars().take(MAX_REASON_CHARS).collect();
    if short.len() < line.len() {
        short.push_str("...");
    }
    short
}

/// Numbers of edges at which a mesh is not properly closed. A mesh with such edges encloses no volume.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshDefects {
    /// Number of edges at which a face is missing.
    pub open: usize,
    /// Number of edges that both faces contain in the same order of corners, so that one of the two faces is inside
    /// out.
    pub flipped: usize,
}

/// Counts the edges that do not lie between two faces, one on each side. Points with equal coordinates count as one
/// corner.
pub fn find_defects(points: &[Vector3<f64>], triangles: &[[u32; 3]]) -> MeshDefects {
    let bits = |index: u32| {
        let point = points.get(index as usize).copied().unwrap_or_default();
        // Adding 0 converts -0 to 0.
        point.data.0[0].map(|value| (value + 0.0).to_bits())
    };
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_unstable_by_key(|index| bits(*index));
    let mut corner = vec![0_u32; points.len()];
    let mut before: Option<u32> = None;
    for index in order {
        let same = before.filter(|before| bits(*before) == bits(index));
        let name = same.and_then(|same| corner.get(same as usize).copied()).unwrap_or(index);
        if let Some(place) = corner.get_mut(index as usize) {
            *place = name;
        }
        before = Some(index);
    }
    // Each edge from its lower to its higher corner, and whether a face has it in the opposite direction.
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * triangles.len());
    for face in triangles {
        let face = face.map(|index| corner.get(index as usize).copied().unwrap_or_default());
        for (from, to) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
            if from != to {
                edges.push((from.min(to), from.max(to), from > to));
            }
        }
    }
    edges.sort_unstable();
    let mut faults = MeshDefects::default();
    for group in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        let more = group.iter().map(|edge| if edge.2 { -1 } else { 1 }).sum::<isize>().unsigned_abs();
        // With an even number of faces, none is missing.
        if group.len().is_multiple_of(2) {
            faults.flipped += more / 2;
        } else {
            faults.open += more;
        }
    }
    faults
}
