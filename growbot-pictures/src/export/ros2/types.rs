//! Definitions of message types of ROS 2 Jazzy, including the types that they contain.

/// Separator between a definition and the definitions of the types that it contains.
const LINE: &str = "================================================================================\n";

/// All message types in use, with the definitions of their fields.
const TYPES: [(&str, &str); 20] = [
    ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"),
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    ("diagnostic_msgs/DiagnosticArray", "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n"),
    (
        "diagnostic_msgs/DiagnosticStatus",
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n\
         string hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
    ),
    ("diagnostic_msgs/KeyValue", "string key\nstring value\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
    ("geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"),
    ("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"),
    ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("nav_msgs/Path", "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n"),
    ("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"),
    ("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n"),
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    ("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"),
    (
        "visualization_msgs/Marker",
        "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 LINE_LIST=5\n\
         int32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\nint32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\n\
         int32 TRIANGLE_LIST=11\nint32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\n\
         int32 DELETEALL=3\nstd_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
         geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
         builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
         std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n\
         visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n\
         visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
    ),
    ("visualization_msgs/MeshFile", "string filename\nuint8[] data\n"),
    ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n"),
];

/// Returns the fields of a type, `package/Name`. `None` if no message here has the type.
fn fields(name: &str) -> Option<&'static str> {
    TYPES.iter().find(|(known, _)| *known == name).map(|(_, fields)| *fields)
}

/// Returns the whole definition of a type, `package/msg/Name`: its fields, then those of all types that it contains, in
/// the format of `ros2msg` schemas of MCAP.
pub fn definition(name: &str) -> String {
    let mut names = vec![name.replace("/msg/", "/")];
    let mut text = String::new();
    let mut next = 0;
    while let Some(name) = names.get(next).cloned() {
        let fields = fields(&name).unwrap_or_default();
        if next > 0 {
            text += &format!("{LINE}MSG: {name}\n");
        }
        text += fields;
        for field in fields.lines() {
            let kind = field.split([' ', '[']).next().unwrap_or_default();
            if kind.contains('/') && !names.iter().any(|known| known == kind) {
                names.push(kind.to_owned());
            }
        }
        next += 1;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_definition_contains_each_dependency_once() {
        let path = definition("nav_msgs/msg/Path");
        assert!(path.starts_with("std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n====="), "{path}");
        for name in ["std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Pose", "geometry_msgs/Quaternion"] {
            assert_eq!(path.matches(&format!("MSG: {name}\n")).count(), 1, "{name}");
        }
        // Every type that is named has a definition.
        for (_, fields) in TYPES {
            for kind in fields.lines().filter_map(|field| field.split([' ', '[']).next()) {
                assert!(!kind.contains('/') || super::fields(kind).is_some(), "{kind}");
            }
        }
    }
}
