//! Bodies in the formats of other tools: meshes (STL, OBJ, 3MF, GLB), tables (CSV), and recordings (MCAP).
//!
//! - [`body`]: the layers of a plan or a run log, with the frame of each
//! - [`mesh`]: the printed wall as a closed surface, written by [`stl`], [`obj`], `three_mf` (feature `3mf`) and
//!   [`glb`]
//! - [`obstacles`]: the scene around a body as surfaces
//! - [`centreline_csv`]: centreline and layers as CSV
//! - [`tum`]: the path of the tip as a trajectory
//! - [`mcap`]: the events of a run log over time. Each `message` is JSON ([`foxglove`]), or CDR in the
//!   types of ROS 2 (`ros2`).
//!
//! - **STL** has no indices, so its readers weld corners whose 32-bit numbers are equal. A ring that 32-bit numbers
//!   cannot distinguish from the one before, vertex by vertex, is left out (two-plane paths have layers of nanometres).
//!   A body is rejected if it is so far out that its wall could not be distinguished. GLB counts from the body's start
//!   and has no such limit.
//! - **The volume** is that of the filament. A polygon inside a circle has less area (0.16 % at 64 chords), so vertices
//!   are on a circle that is wider by sqrt(c / sin c), where c is the angle of a chord. Between rings the wall is
//!   straight, and the error is proportional to the square of the bend. So no two rings are more than 0.05 rad apart,
//!   even within layers (those of robots B and C bend by 0.09 and 0.53 rad). The remaining error is below 0.1 %.
//! - **Schemas** have growbot's own descriptions of Foxglove's messages, with the fields in use. Each field has one
//!   type, and an unknown value is left out instead of null. Each layer is a disc and an entity, so the body grows
//!   while a recording plays.

pub mod body;
pub mod centreline_csv;
#[cfg(feature = "mcap")]
pub mod foxglove;
pub mod glb;
#[cfg(feature = "mcap")]
pub mod mcap;
pub mod mesh;
#[cfg(feature = "mcap")]
mod message;
pub mod obj;
pub mod obstacles;
#[cfg(feature = "mcap")]
mod ros2;
pub mod stl;
#[cfg(feature = "3mf")]
pub mod three_mf;
pub mod tum;

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use growbot_core::plan::Planner;
    use growbot_plan::plan::Plan;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;
    use growbot_scene::scene_file;

    use super::body::ExportedBody;
    use super::mesh::{BodyMesh, MeshResolution};
    use super::*;

    /// Returns a bent body and a resolution for its mesh.
    fn bent_body() -> (ExportedBody, MeshResolution) {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let [start, goal] = ["10,20,30,40,50", "300,-200,600,-120,-25"].map(|pose| parse_pose(pose).unwrap());
        let radius = robot.description().planning_radius_mm;
        let plan = Plan::new(&robot, &start, &goal, radius, Planner::Shortest).unwrap();
        (ExportedBody::planned(&robot, &plan), MeshResolution { segments: 16, layers_per_ring: 8 })
    }

    /// Vertices and triangles of a file.
    type Surface = (Vec<[f32; 3]>, Vec<[usize; 3]>);

    /// Reads a binary STL file and merges its equal vertices.
    fn read_stl(bytes: &[u8]) -> Surface {
        let (mut vertices, mut indices) = (Vec::new(), HashMap::new());
        let triangles = bytes[84..].as_chunks::<50>().0.iter().map(|triangle| {
            [0, 1, 2].map(|corner| {
                let corner = triangle[12 + 12 * corner..].first_chunk::<12>().unwrap();
                *indices.entry(*corner).or_insert_with(|| {
                    let numbers = corner.as_chunks::<4>().0;
                    vertices.push([0, 1, 2].map(|axis| f32::from_le_bytes(numbers[axis])));
                    vertices.len() - 1
                })
            })
        });
        let triangles = triangles.collect();
        (vertices, triangles)
    }

    /// Returns the three values of a line of text, which are separated by these characters.
    fn three<T: std::str::FromStr<Err: std::fmt::Debug>>(line: &str, separators: &[char]) -> [T; 3] {
        let values = line.split(separators).filter_map(|word| word.parse().ok());
        values.collect::<Vec<T>>().try_into().ok().unwrap()
    }

    fn read_obj(text: &str) -> Surface {
        let of = |keyword| text.lines().filter_map(move |line| line.strip_prefix(keyword));
        let triangles = of("f ").map(|line| three(line, &[' ']).map(|index: usize| index - 1));
        (of("v ").map(|line| three(line, &[' '])).collect(), triangles.collect())
    }

    #[cfg(feature = "3mf")]
    fn read_three_mf(bytes: &[u8]) -> (String, Surface) {
        let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
        assert!(archive.file_names().map(Result::unwrap).eq([
            "[Content_Types].xml",
            "_rels/.rels",
            "3D/3dmodel.model"
        ]));
        let model = std::io::read_to_string(archive.by_name("3D/3dmodel.model").unwrap()).unwrap();
        let of = |element| model.lines().filter_map(move |line| line.strip_prefix(element));
        let vertices = of("<vertex ").map(|line| three(line, &['"'])).collect();
        let triangles = of("<triangle ").map(|line| three(line, &['"'])).collect();
        (model, (vertices, triangles))
    }

    /// Returns the enclosed volume, by the divergence theorem. Panics unless each edge belongs to two triangles, which
    /// run along it in opposite directions.
    #[track_caller]
    fn enclosed_volume((vertices, triangles): &Surface) -> f64 {
        let mut edges = HashMap::new();
        for [a, b, c] in triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                assert_eq!(edges.insert(edge, ()), None, "two triangles run along {edge:?}");
            }
        }
        assert!(edges.keys().all(|(from, to)| edges.contains_key(&(*to, *from))));
        let corner = |index: usize| nalgebra::Vector3::from(vertices[index].map(f64::from));
        triangles.iter().map(|triangle| triangle.map(corner)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
    }

    #[test]
    fn obj_has_the_surface_of_stl() {
        let (body, resolution) = bent_body();
        let stl = read_stl(&stl::write("planned", &body, resolution).unwrap());
        let text = obj::write("planned", &body, resolution).unwrap();
        assert_same_surface(&read_obj(&text), &stl, &body);
        assert!(
            text.starts_with("# growbot ") && text.contains("growbot-a, planned: printed wall\n# units mm"),
            "{text}"
        );
    }

    #[cfg(feature = "3mf")]
    #[test]
    fn three_mf_has_the_surface_of_stl_and_the_same_bytes_each_time() {
        let (body, resolution) = bent_body();
        let stl = read_stl(&stl::write("planned", &body, resolution).unwrap());
        let bytes = three_mf::write("a < b", &body, resolution).unwrap();
        assert_eq!(bytes, three_mf::write("a < b", &body, resolution).unwrap());
        let (model, surface) = read_three_mf(&bytes);
        assert_same_surface(&surface, &stl, &body);
        for part in [
            "unit=\"millimeter\"",
            "<metadata name=\"Title\">growbot-a, a &lt; b</metadata>",
            concat!("<metadata name=\"Application\">growbot ", env!("CARGO_PKG_VERSION"), "</metadata>"),
        ] {
            assert!(model.contains(part), "{part}: {}", &model[..600]);
        }
        let mut archive = zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
        for index in 0..archive.len() {
            let time = archive.by_index(index).unwrap().last_modified();
            assert!(time.is_none_or(|time| time == zip::DateTime::DEFAULT), "{time:?}");
        }
    }

    /// Panics unless a file has the triangles of the STL file, and the volume of the filament within 0.1 %.
    #[track_caller]
    fn assert_same_surface(surface: &Surface, stl: &Surface, body: &ExportedBody) {
        let corners = |(vertices, triangles): &Surface| -> Vec<[[f32; 3]; 3]> {
            triangles.iter().map(|triangle| triangle.map(|index| vertices[index])).collect()
        };
        assert_eq!(surface.0.len(), stl.0.len());
        assert!(corners(surface) == corners(stl));
        let (volume, expected) = (enclosed_volume(surface), enclosed_volume(stl));
        for expected in [expected, body.filament_volume()] {
            assert!((volume / expected - 1.0).abs() < 1e-3, "{volume} instead of {expected}");
        }
    }

    /// Tests every format of meshes that growbot both writes and reads.
    #[test]
    fn exported_meshes_are_read_back_where_the_body_is() {
        let (body, resolution) = bent_body();
        let mesh = BodyMesh::of_wall(&body, resolution, &nalgebra::Vector3::zeros()).unwrap();
        let files = [
            ("body.stl", stl::write("planned", &body, resolution).unwrap()),
            ("body.obj", obj::write("planned", &body, resolution).unwrap().into_bytes()),
            ("body.glb", glb::write(&[("planned", &body)], None, resolution).unwrap()),
        ];
        let directory = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            let path = directory.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let read = scene_file::load(&path).unwrap().scene;
            let triangles = read.meshes()[0].triangles();
            assert_eq!(triangles.len(), mesh.triangles.len(), "{name}");
            let read_corners = triangles.iter().flat_map(|triangle| triangle.0);
            let centre = read_corners.fold(nalgebra::Vector3::zeros(), |sum, corner| sum + corner);
            let expected = mesh.corners().flatten().fold(nalgebra::Vector3::zeros(), |sum, corner| sum + corner.coords);
            let count = 3.0 * triangles.len() as f64;
            assert!((centre / count - expected / count).norm() < 0.01, "{name}: {centre} instead of {expected}");
            for vertex in &mesh.vertices {
                let distance = read.distance(&vertex.coords).abs();
                assert!(distance < 0.01, "{name}: {vertex} is {distance} mm from the mesh");
            }
        }
    }
}
