//! Bodies in the formats of other tools: meshes (STL, GLB), tables (CSV), and recordings (MCAP).
//!
//! - [`body`]: the layers of a plan or a run log, with the frame of each
//! - [`mesh`]: the printed wall as a closed surface, written by [`stl`] and [`glb`]
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
pub mod obstacles;
#[cfg(feature = "mcap")]
mod ros2;
pub mod stl;
pub mod tum;

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_plan::plan::Plan;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;
    use growbot_scene::scene_file;

    use super::body::ExportedBody;
    use super::mesh::{BodyMesh, MeshResolution};
    use super::*;

    /// Tests every format of meshes that growbot both writes and reads.
    #[test]
    fn exported_meshes_are_read_back_where_the_body_is() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let [start, goal] = ["10,20,30,40,50", "300,-200,600,-120,-25"].map(|pose| parse_pose(pose).unwrap());
        let radius = robot.description().planning_radius_mm;
        let plan = Plan::new(&robot, &start, &goal, radius, Planner::Shortest).unwrap();
        let body = ExportedBody::planned(&robot, &plan);
        let resolution = MeshResolution { segments: 16, layers_per_ring: 8 };
        let mesh = BodyMesh::of_wall(&body, resolution, &nalgebra::Vector3::zeros()).unwrap();
        let files = [
            ("body.stl", stl::write("planned", &body, resolution).unwrap()),
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
