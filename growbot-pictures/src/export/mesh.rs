//! The printed wall as a closed surface of triangles.
//!
//! A ring of vertices is at each boundary between layers, on the outer and on the inner surface of the wall (mean
//! radius `r_t`, thickness `wall.width_mm`). All rings have the same angles in the tip's frame, because growth does not
//! twist it. Triangles join ring to ring, and both surfaces at the two rims. So every edge belongs to two triangles,
//! which run along it in opposite directions, and all of them are counter-clockwise seen from outside the material. The
//! radius of the vertices gives a ring of chords the area of the round one. So the mesh has the volume of the filament
//! for any number of chords.

use std::f64::consts::TAU;

use growbot_core::layer::Layer;
use growbot_core::pose::Frame;
use nalgebra::{Point3, Vector3};

use super::body::ExportedBody;

/// Greatest bend from one ring to the next, radians. Layers that bend more (robots B and C) get rings within them, so
/// that the volume is exact to 0.1 %.
const MAX_BEND: f64 = 0.05;

/// Greatest number of triangles: 500 MB of STL.
pub const MAX_TRIANGLES: usize = 10_000_000;

/// Distance below which programs that read a mesh may merge vertices, mm.
const MIN_DISTANCE: f64 = 1e-4;

/// Resolution of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshResolution {
    /// Number of chords around the tube, at least 8.
    pub segments: u32,
    /// Number of layers from one ring of vertices to the next. It is smaller if the body bends by more than 0.05 rad
    /// between them.
    pub layers_per_ring: u32,
}

/// Reason why a mesh of a body cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// The body has almost no length.
    #[error("the body is {length} mm long and has no wall to export as a mesh: export a longer body")]
    TooShort {
        /// Length of the body, mm.
        length: f64,
    },
    /// The file would be too large.
    #[error("the mesh would have {triangles} triangles, more than the maximum of {MAX_TRIANGLES}")]
    TooMany {
        /// Number of triangles.
        triangles: usize,
    },
    /// Numbers of 32 bits cannot distinguish the sides of the wall at this distance from the origin.
    #[error(
        "the body reaches {reach} mm from the origin, where the 32-bit numbers of this format are {spacing} mm apart, \
         too coarse for its wall: plan nearer to the origin"
    )]
    TooFar {
        /// Greatest coordinate of the body, mm.
        reach: f64,
        /// Resolution of 32-bit numbers at this coordinate, mm.
        spacing: f64,
    },
}

/// A closed surface of triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMesh {
    /// Vertices relative to the mesh's origin, mm.
    pub vertices: Vec<Point3<f64>>,
    /// Height of the layer at each vertex, on the middle of the wall at the vertex's angle, mm. Empty for obstacles.
    pub heights: Vec<f64>,
    /// Triangles, as indices of vertices in counter-clockwise order seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl BodyMesh {
    /// Returns the wall of a body, relative to an origin (mm, in base axes).
    ///
    /// A boundary between layers gets no ring if 32-bit numbers cannot distinguish it from the previous ring. So layers
    /// of a few micrometres are merged into their neighbours, and the surface is closed in the file too.
    ///
    /// # Errors
    /// [`MeshError`].
    pub fn of_wall(body: &ExportedBody, resolution: MeshResolution, origin: &Vector3<f64>) -> Result<Self, MeshError> {
        let outline = Outline::new(body, resolution);
        let frames = ring_frames(body, resolution, origin);
        let per_ring = 4 * outline.points.len();
        let triangles = frames.len().saturating_mul(per_ring);
        if triangles > MAX_TRIANGLES {
            return Err(MeshError::TooMany { triangles });
        }
        let reach = frames.iter().map(|(frame, _)| frame.translation.vector.amax()).fold(0.0, f64::max) + outline.outer;
        let spacing = 16.0 * f64::from(f32::EPSILON) * reach;
        if spacing > 0.25 * body.wall_thickness.min(outline.inner * TAU / f64::from(resolution.segments)) {
            return Err(MeshError::TooFar { reach, spacing });
        }
        let rings = outline.distinct_rings(&frames, spacing.max(MIN_DISTANCE));
        if rings.len() < 2 {
            return Err(MeshError::TooShort { length: body.length() });
        }
        let triangles = triangles_of(rings.len() as u32, resolution.segments);
        let heights = rings.iter().flat_map(|(_, layer)| outline.heights(layer, body.wall_radius)).collect();
        let vertices = rings.into_iter().flat_map(|(ring, _)| ring).collect();
        Ok(Self { vertices, heights, triangles })
    }

    /// Returns the corners of each triangle, mm.
    pub fn corners(&self) -> impl Iterator<Item = [Point3<f64>; 3]> {
        let corner = |index: u32| self.vertices.get(index as usize).copied().unwrap_or_default();
        self.triangles.iter().map(move |triangle| triangle.map(corner))
    }

    /// Returns the enclosed volume, by the divergence theorem, mm^3.
    pub fn volume(&self) -> f64 {
        self.corners().map(|[a, b, c]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0).sum()
    }
}

/// Returns the frames, relative to `origin` (mm), at which a ring may be placed: at the start, then at each boundary
/// that needs a ring. Each frame has the layer that ends there.
fn ring_frames(body: &ExportedBody, resolution: MeshResolution, origin: &Vector3<f64>) -> Vec<(Frame, Layer)> {
    let from_origin = |mut frame: Frame| {
        frame.translation.vector -= origin;
        frame
    };
    let first = body.layers.first().map(|laid| laid.layer).unwrap_or_default();
    let mut frames = vec![(from_origin(body.base_from_start), first)];
    let mut below = first;
    let mut bend = 0.0;
    let mut waiting = 0;
    let last = body.layers.len().saturating_sub(1);
    for (index, (before, laid)) in body.layers_with_base().enumerate() {
        let Layer { alpha, height, tilt } = laid.layer;
        if waiting > 0 && bend + tilt > MAX_BEND {
            frames.push((from_origin(before), below));
            (bend, waiting) = (0.0, 0);
        }
        let pieces = (tilt / MAX_BEND).ceil().max(1.0);
        for piece in 1..pieces as u32 {
            let share = f64::from(piece) / pieces;
            let part = Layer { alpha, height: share * height, tilt: share * tilt };
            frames.push((from_origin(before * part.step()), laid.layer));
        }
        (bend, waiting) = (bend + tilt, waiting + 1);
        if waiting >= resolution.layers_per_ring || index == last {
            frames.push((from_origin(laid.base_from_tip), laid.layer));
            (bend, waiting) = (0.0, 0);
        }
        below = laid.layer;
    }
    frames
}

/// Cross-section of a wall.
struct Outline {
    /// Radius of the outer vertices, mm.
    outer: f64,
    /// Radius of the inner vertices, mm.
    inner: f64,
    /// A pair of points for each angle, in the tip's frame: outside, inside, mm.
    points: Vec<[Point3<f64>; 2]>,
}

impl Outline {
    fn new(body: &ExportedBody, resolution: MeshResolution) -> Self {
        let chord = TAU / f64::from(resolution.segments);
        // A polygon of this radius has the area of the round disc.
        let wider = (chord / libm::sin(chord)).sqrt();
        let (outer, inner) = (
            wider * (body.wall_radius + 0.5 * body.wall_thickness),
            wider * (body.wall_radius - 0.5 * body.wall_thickness),
        );
        let pair = |index: u32| {
            let (sin, cos) = libm::sincos(f64::from(index) * chord);
            [outer, inner].map(|radius| Point3::new(radius * cos, radius * sin, 0.0))
        };
        Self { outer, inner, points: (0..resolution.segments).map(pair).collect() }
    }

    /// Returns the vertices of a ring at a frame, outer and inner ones alternating.
    fn ring(&self, frame: &Frame) -> Vec<Point3<f64>> {
        self.points.iter().flatten().map(|point| frame * point).collect()
    }

    /// Returns the height of a layer at each vertex of a ring, on a wall of this mean radius, mm.
    fn heights(&self, layer: &Layer, radius: f64) -> Vec<f64> {
        let chord = TAU / self.points.len() as f64;
        (0..2 * self.points.len()).map(|vertex| layer.height_at((vertex / 2) as f64 * chord, radius)).collect()
    }

    /// Returns the rings at these frames, each with its layer. A ring is left out unless all its vertices are at least
    /// `distance` (mm) from those of the previous ring.
    fn distinct_rings(&self, frames: &[(Frame, Layer)], distance: f64) -> Vec<(Vec<Point3<f64>>, Layer)> {
        let apart = |a: &[Point3<f64>], b: &[Point3<f64>]| {
            a.iter().zip(b).all(|(a, b)| nalgebra::distance_squared(a, b) >= distance * distance)
        };
        let mut rings: Vec<(Vec<_>, Layer)> = Vec::with_capacity(frames.len());
        let end = frames.len().saturating_sub(1);
        for (index, (frame, layer)) in frames.iter().enumerate() {
            let ring = self.ring(frame);
            // The end of the body is fixed, so rings that are too near to it are removed.
            while index == end && rings.len() > 1 && rings.last().is_some_and(|(last, _)| !apart(last, &ring)) {
                rings.pop();
            }
            if rings.last().is_none_or(|(last, _)| apart(last, &ring)) {
                rings.push((ring, *layer));
            }
        }
        rings
    }
}

/// Returns the triangles between rings. Each ring consists of pairs of an outer and an inner vertex.
fn triangles_of(rings: u32, segments: u32) -> Vec<[u32; 3]> {
    let outer = |ring: u32, segment: u32| 2 * (ring * segments + segment % segments);
    let inner = |ring: u32, segment: u32| outer(ring, segment) + 1;
    let quad = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let along = (1..rings).flat_map(|ring| (0..segments).map(move |segment| (ring - 1, ring, segment, segment + 1)));
    let walls = along.flat_map(|(below, above, i, j)| {
        let outside = [outer(below, i), outer(below, j), outer(above, j), outer(above, i)];
        let inside = [inner(below, j), inner(below, i), inner(above, i), inner(above, j)];
        [quad(outside), quad(inside)]
    });
    let top = rings.saturating_sub(1);
    let rims = (0..segments).flat_map(|i| {
        let start = [outer(0, i), inner(0, i), inner(0, i + 1), outer(0, i + 1)];
        let end = [inner(top, i), outer(top, i), outer(top, i + 1), inner(top, i + 1)];
        [quad(start), quad(end)]
    });
    walls.chain(rims).flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use growbot_core::plan::Planner;
    use growbot_plan::plan::Plan;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;
    use proptest::prelude::*;

    use super::super::body::LayerSource;
    use super::*;

    const ROUND: MeshResolution = MeshResolution { segments: 64, layers_per_ring: 1 };

    fn body(robot: &str, start: &str, goal: &str) -> ExportedBody {
        let robot = robot_file::load(robot.as_ref()).unwrap();
        let (start, goal) = (parse_pose(start).unwrap(), parse_pose(goal).unwrap());
        let radius = robot.description().planning_radius_mm;
        ExportedBody::planned(&robot, &Plan::new(&robot, &start, &goal, radius, Planner::TwoPlane).unwrap())
    }

    /// Checks the mesh in 32-bit numbers, with equal vertices merged as readers of the file do.
    #[track_caller]
    fn assert_closed(mesh: &BodyMesh) {
        let mut welded = HashMap::new();
        let mut edges: HashMap<(usize, usize), usize> = HashMap::new();
        for corners in mesh.corners() {
            let [a, b, c] = corners.map(|corner| {
                let next = welded.len();
                *welded.entry(corner.coords.map(|mm| (mm as f32).to_bits())).or_insert(next)
            });
            assert!(a != b && b != c && c != a, "a triangle without area");
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for ((a, b), times) in &edges {
            assert_eq!((*times, edges.get(&(*b, *a))), (1, Some(&1)), "edge {a} to {b}");
        }
        assert_eq!(welded.len(), mesh.vertices.len());
        // A tube with two rims is a torus: V - E + F = 0.
        assert_eq!(welded.len() + mesh.triangles.len(), edges.len() / 2);
    }

    #[track_caller]
    fn assert_holds_the_filament(mesh: &BodyMesh, body: &ExportedBody, share: f64) {
        let wrong = mesh.volume() / body.filament_volume() - 1.0;
        assert!(wrong.abs() < share, "volume off by {wrong:e}");
    }

    #[test]
    fn every_robots_wall_is_closed_and_has_the_filament_volume() {
        for robot in robot_file::names() {
            let body = body(robot, "10,20,30,40,50", "300,-200,600,-120,-25");
            let resolution = MeshResolution { segments: 12, layers_per_ring: 1 };
            let mesh = BodyMesh::of_wall(&body, resolution, &Vector3::zeros()).unwrap();
            assert_closed(&mesh);
            assert_holds_the_filament(&mesh, &body, 1e-3);
        }
    }

    #[test]
    fn coarse_meshes_are_closed_and_have_the_filament_volume() {
        let body = body("growbot-a", "0,0,0,0,90", "200,100,600,0,45");
        for (segments, every) in [(8, 1), (9, 7), (24, 1000), (100, 9)] {
            let mesh = BodyMesh::of_wall(&body, MeshResolution { segments, layers_per_ring: every }, &Vector3::zeros())
                .unwrap();
            assert_closed(&mesh);
            assert_holds_the_filament(&mesh, &body, 1e-3);
            if every == 1000 {
                assert!(mesh.triangles.len() < 10_000, "{}", mesh.triangles.len());
            }
        }
    }

    #[test]
    fn a_straight_tube_has_the_expected_vertices() {
        let body = body("growbot-a", "1,2,3,0,90", "1,2,103,0,90");
        let mesh = BodyMesh::of_wall(&body, ROUND, &Vector3::zeros()).unwrap();
        assert_eq!(mesh.vertices.len(), (body.layers.len() + 1) * 2 * 64);
        let heights = mesh.vertices.iter().map(|vertex| vertex.z);
        assert!((heights.clone().fold(f64::MAX, f64::min) - 3.0).abs() < 1e-9);
        assert!((heights.fold(f64::MIN, f64::max) - 103.0).abs() < 1e-9);
        for vertex in &mesh.vertices {
            let radius = libm::hypot(vertex.x - 1.0, vertex.y - 2.0);
            assert!((radius - 22.0).abs() - 0.8 < 0.02, "{radius}");
        }
        assert_holds_the_filament(&mesh, &body, 1e-9);
    }

    #[test]
    fn layers_too_thin_for_f32_are_merged() {
        let mut body = body("growbot-a", "0,0,0,0,90", "0,0,40,0,90");
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        for thin in [0.0, 1e-9, 1e-6, 1e-5] {
            let heights = [0.774, thin, thin, 0.5, thin];
            let layers =
                heights.map(|height| (Layer { alpha: 1.0, height, tilt: 0.005 * height }, LayerSource::Planned));
            body = ExportedBody::of_layers(&robot, layers);
            let mesh = BodyMesh::of_wall(&body, ROUND, &Vector3::zeros()).unwrap();
            assert_closed(&mesh);
            assert_eq!(mesh.vertices.len(), 3 * 2 * 64);
            assert_holds_the_filament(&mesh, &body, 1e-3);
        }
        body.layers.clear();
        assert!(matches!(BodyMesh::of_wall(&body, ROUND, &Vector3::zeros()), Err(MeshError::TooShort { .. })));
    }

    #[test]
    fn positions_beyond_f32_are_refused_unless_the_origin_is_near() {
        let body = body("growbot-a", "5000000,0,0,0,90", "5000000,0,100,0,90");
        assert!(matches!(BodyMesh::of_wall(&body, ROUND, &Vector3::zeros()), Err(MeshError::TooFar { .. })));
        assert_closed(&BodyMesh::of_wall(&body, ROUND, &Vector3::new(5e6, 0.0, 0.0)).unwrap());
        let fine = MeshResolution { segments: 100_000, layers_per_ring: 1 };
        assert!(matches!(BodyMesh::of_wall(&body, fine, &Vector3::zeros()), Err(MeshError::TooMany { .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn any_layers_give_a_closed_mesh(
            heights in prop::collection::vec((0.0..6.3, 0.2..0.95, 0.0..0.007), 1..40),
            segments in 8_u32..40,
            every in 1_u32..9,
        ) {
            let robot = robot_file::load("growbot-a".as_ref()).unwrap();
            let layers = heights.into_iter().map(|(alpha, height, tilt)| {
                (Layer { alpha, height, tilt }, LayerSource::AsBuilt)
            });
            let body = ExportedBody::of_layers(&robot, layers);
            let mesh = BodyMesh::of_wall(&body, MeshResolution { segments, layers_per_ring: every }, &Vector3::zeros()).unwrap();
            assert_closed(&mesh);
            assert_holds_the_filament(&mesh, &body, 2e-3);
        }
    }
}
