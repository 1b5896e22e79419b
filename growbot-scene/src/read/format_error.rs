//! Faults of the content of a mesh or cloud file.

use ply_rs_bw::parser::ParseError;

/// Fault of the content of a mesh or cloud file.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The file is not binary glTF 2.0.
    #[error("the file is not a binary glTF 2.0 file")]
    NotGlb,
    /// The file ends too early. The field is the part in which it ends.
    #[error("the file ends in the middle of {0}")]
    Truncated(&'static str),
    /// The document in a GLB file is invalid.
    #[error("the file's JSON is invalid: {0}")]
    Json(#[from] serde_json::Error),
    /// A GLB file needs this extension of glTF.
    #[error("the file needs the glTF extension {0}, which is not supported: export the file without this extension")]
    Extension(String),
    /// A GLB file refers to something that it does not contain.
    #[error("the file has no {kind} {index}")]
    Missing {
        /// Kind of the missing item, for example "node".
        kind: &'static str,
        /// Index of the missing item, from 0.
        index: usize,
    },
    /// A GLB file has too many nodes, or nodes that are nested too deeply.
    #[error("the file has more than {max} nodes, or nodes that are nested deeper than {max_depth}")]
    TooManyNodes {
        /// Maximum number of nodes.
        max: usize,
        /// Maximum depth of nested nodes.
        max_depth: usize,
    },
    /// A mesh of a GLB file has strips or fans. The field is their mode in glTF.
    #[error("a mesh has faces of mode {0} (strips or fans): export the mesh as triangles")]
    FaceMode(u32),
    /// A mesh of a GLB file has no positions.
    #[error("a mesh of the file has no positions")]
    NoPositions,
    /// The meshes of a GLB file are too large.
    #[error("the file has more than {max} {what}, counting a mesh once for each node that uses it: simplify it")]
    TooLarge {
        /// Name of the counted items: "points" or "triangles".
        what: &'static str,
        /// Maximum number of these items.
        max: usize,
    },
    /// The numbers of an accessor of a GLB file have a type that does not suit their use.
    #[error("accessor {accessor} of the file has numbers of the kind {kind}, which is not supported")]
    NumberType {
        /// Index of the accessor.
        accessor: usize,
        /// Code of the type in glTF.
        kind: u32,
    },
    /// The accessor of a GLB file with this index is sparse.
    #[error("accessor {0} is sparse, which is not supported: switch sparse accessors off")]
    SparseAccessor(usize),
    /// The accessor of a GLB file with this index has no bytes.
    #[error("accessor {0} of the file has no bytes")]
    EmptyAccessor(usize),
    /// An accessor of a GLB file refers to another file.
    #[error("accessor {accessor} is in buffer {buffer}, which is not in the file: export everything into one file")]
    OtherBuffer {
        /// Index of the accessor.
        accessor: usize,
        /// Index of the buffer.
        buffer: usize,
    },
    /// The accessor of a GLB file with this index extends beyond the data.
    #[error("accessor {0} extends beyond the data of the file")]
    BeyondData(usize),
    /// An accessor of a GLB file has fewer items than it declares.
    #[error("accessor {accessor} of the file has {found} items, but declares {declared}")]
    ShortAccessor {
        /// Index of the accessor.
        accessor: usize,
        /// Number of its items.
        found: usize,
        /// Declared number of items.
        declared: usize,
    },
    /// A face has a corner that is not a point of the file.
    #[error("a face of the file has corner {corner}, but the file has {points} points, counted from 0")]
    Corner {
        /// Index of the point at the corner.
        corner: i64,
        /// Number of points.
        points: usize,
    },
    /// A line of an OBJ file has an error.
    #[error("line {line}: {error}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// Error of the line.
        #[source]
        error: Box<FormatError>,
    },
    /// A corner in a line of an OBJ file is not a number. The field is the number of the line, from 1.
    #[error("line {0} of the file has a corner that is not a number")]
    CornerNumber(usize),
    /// A line with a point lacks coordinates.
    #[error("line {line} of the file does not have three numbers after `{keyword}`")]
    Coordinates {
        /// Number of the line, from 1.
        line: usize,
        /// First word of the line.
        keyword: &'static str,
    },
    /// A facet of an STL file is not a triangle.
    #[error("the facet at line {line} of the file has {corners} corners instead of 3")]
    Facet {
        /// Number of the line at which the facet ends, from 1.
        line: usize,
        /// Number of corners.
        corners: usize,
    },
    /// A binary STL file is shorter than its header. The field is the length of the file, bytes.
    #[error("the file has {0} bytes, fewer than the header of an STL file")]
    NoStlHeader(usize),
    /// The length or the number of points does not match the header.
    #[error("the header of the file declares {declared} {what}, but the file has {found}")]
    Count {
        /// Name of the counted items: "bytes" or "points".
        what: &'static str,
        /// Number in the header.
        declared: usize,
        /// Actual number.
        found: usize,
    },
    /// The parser of PLY files found an error.
    #[error(transparent)]
    Ply(#[from] ParseError),
    /// A PLY file declares more elements than it has bytes.
    #[error("the file declares {count} elements {name:?}, more than the file has bytes")]
    TooManyElements {
        /// Declared number of elements.
        count: usize,
        /// Name of the elements.
        name: String,
    },
    /// A PLY file has strips of triangles.
    #[error("the file has strips of triangles: export the mesh with faces")]
    Strips,
    /// The header of a PCD file lacks an entry. The field is its name.
    #[error("the header of the file has no {0}")]
    NoEntry(&'static str),
    /// The header of a PCD file is not text.
    #[error("the header of the file is not text")]
    HeaderNotText,
    /// The points of a PCD file with the encoding ascii are not text.
    #[error("the points of the file are not text")]
    PointsNotText,
    /// A number in the header of a PCD file is invalid.
    #[error("{entry} in the header has {word:?}, which is not a number")]
    HeaderNumber {
        /// Name of the entry.
        entry: String,
        /// The word that is not a number.
        word: String,
    },
    /// An entry in the header of a PCD file has too few values. The field is its name.
    #[error("{0} in the header has fewer values than FIELDS")]
    ShortEntry(&'static str),
    /// A number in the header of a PCD file is too large. The field is the name of its entry.
    #[error("{0} in the header is too large")]
    LargeEntry(&'static str),
    /// A coordinate in a PCD file has an unsupported type. The field is its name.
    #[error("field {0} in the header is not a single number of type F and size 4 or 8")]
    FieldType(String),
    /// The header of a PCD file lacks a coordinate.
    #[error("the header of the file lacks a field x, y or z")]
    NoCoordinate,
    /// The points of a PCD file have this encoding, which is unknown.
    #[error("the points of the file are written as {0:?}: write the points as ascii or binary")]
    Encoding(String),
    /// A point of a PCD file lacks coordinates.
    #[error("point {point} has no numbers for x, y, z among {words} values")]
    Point {
        /// Number of the point, from 1.
        point: usize,
        /// Declared number of values of a point.
        words: usize,
    },
    /// The points of a binary PCD file have no bytes.
    #[error("a point of the file has no bytes")]
    EmptyPoint,
}
