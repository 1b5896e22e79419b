//! The scene around a body as surfaces of triangles, for GLB: its obstacles, and a mark at the narrowest point.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use growbot_scene::obstacle_selection::SelectionLimits;
use growbot_scene::shapes::Shape;
use nalgebra::{Point3, Vector3};

use super::mesh::BodyMesh;
use crate::view::{SceneView, Subject, ViewError};

/// Maximum numbers of obstacles in a GLB file. They take some 30 MB.
const LIMITS: SelectionLimits = SelectionLimits { shapes: 1000, triangles: 200_000, points: 20_000 };
/// Number of chords around balls and capsules. `STEPS` is the number of chords from pole to pole.
const ROUND: u32 = 24;
const STEPS: u32 = 12;
/// Smallest radius with which a point of a cloud is shown, mm. `MARK` is the radius of the mark at the closest
/// approach, mm.
const LEAST_POINT: f64 = 0.5;
const MARK: f64 = 1.0;

/// Returns the part of the scene that is shown around a body. `None` without a scene.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn scene_view(subject: &Subject) -> Result<Option<SceneView>, ViewError> {
    SceneView::for_subject(subject, &LIMITS)
}

/// Returns the obstacles as triangles, relative to an origin (mm). `None` without obstacles.
pub fn surfaces(around: &SceneView, origin: &Vector3<f64>) -> Option<BodyMesh> {
    let shown = &around.obstacles;
    let mut surface = MeshBuilder::new(origin);
    for shape in &shown.shapes {
        match shape {
            Shape::Box { centre, half_extents: half, rotation } => {
                let corner = |sign: [f64; 3]| centre + rotation * half.component_mul(&Vector3::from(sign));
                surface.cuboid(corner);
            }
            Shape::Ball { centre, radius } => surface.capsule(centre, centre, *radius),
            Shape::Capsule { from, to, radius } => surface.capsule(from, to, *radius),
        }
    }
    for square in &shown.squares {
        surface.add(square, &[[0, 1, 2], [0, 2, 3]]);
    }
    for triangle in &shown.triangles {
        surface.add(&triangle.0, &[[0, 1, 2]]);
    }
    for (at, radius) in &shown.points {
        surface.octahedron(at, radius.max(LEAST_POINT));
    }
    surface.finish()
}

/// Returns the mark at the closest approach as triangles, relative to an origin (mm). It leads from the body's
/// centreline to the obstacle. Returns `None` without obstacles.
pub fn mark(around: &SceneView, origin: &Vector3<f64>) -> Option<BodyMesh> {
    let (found, _) = around.closest_approach.as_ref()?;
    let mut surface = MeshBuilder::new(origin);
    surface.capsule(&found.on_body, &found.on_obstacle, MARK);
    surface.octahedron(&found.on_obstacle, 3.0 * MARK);
    surface.finish()
}

/// An unfinished surface.
struct MeshBuilder {
    origin: Vector3<f64>,
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl MeshBuilder {
    fn new(origin: &Vector3<f64>) -> Self {
        Self { origin: *origin, vertices: Vec::new(), triangles: Vec::new() }
    }

    fn finish(self) -> Option<BodyMesh> {
        let Self { vertices, triangles, .. } = self;
        (!triangles.is_empty()).then(|| BodyMesh { vertices, heights: Vec::new(), triangles })
    }

    /// Adds corners, with triangles between them. The triangles contain indices of `corners`.
    fn add(&mut self, corners: &[Vector3<f64>], triangles: &[[u32; 3]]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners.iter().map(|corner| Point3::from(corner - self.origin)));
        self.triangles.extend(triangles.iter().map(|triangle| triangle.map(|corner| first + corner)));
    }

    /// Adds a box. `corner` returns the corner for the signs (-1 or 1) of its coordinates along the box's axes.
    fn cuboid(&mut self, corner: impl Fn([f64; 3]) -> Vector3<f64>) {
        let sign = |index: u32, bit: u32| if index >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let corners: Vec<Vector3<f64>> = (0..8).map(|index| corner([0, 1, 2].map(|bit| sign(index, bit)))).collect();
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        self.add(&corners, &triangles);
    }

    /// Adds a capsule. If both ends are equal, it is a ball.
    fn capsule(&mut self, from: &Vector3<f64>, to: &Vector3<f64>, radius: f64) {
        let axis = (to - from).try_normalize(1e-9).unwrap_or_else(Vector3::z);
        let aside = axis.cross(&if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
        let other = axis.cross(&aside);
        let ring = |middle: &Vector3<f64>, latitude: f64| {
            let (out, up) = (radius * libm::cos(latitude), radius * libm::sin(latitude));
            let (middle, per) = (middle + axis * up, TAU / f64::from(ROUND));
            (0..ROUND).map(move |corner| {
                let angle = per * f64::from(corner);
                middle + (aside * libm::cos(angle) + other * libm::sin(angle)) * out
            })
        };
        let half = STEPS / 2;
        let latitude = |step: u32| PI * f64::from(step) / f64::from(STEPS) - FRAC_PI_2;
        let mut corners = vec![from - axis * radius];
        corners.extend((1..=half).flat_map(|step| ring(from, latitude(step))));
        corners.extend((half..STEPS).flat_map(|step| ring(to, latitude(step))));
        corners.push(to + axis * radius);
        let (rings, last) = (STEPS, corners.len() as u32 - 1);
        let at = |ring: u32, corner: u32| 1 + ring * ROUND + corner % ROUND;
        let mut triangles = Vec::new();
        for corner in 0..ROUND {
            triangles.push([0, at(0, corner + 1), at(0, corner)]);
            triangles.push([last, at(rings - 1, corner), at(rings - 1, corner + 1)]);
            for below in 0..rings - 1 {
                let [a, b] = [at(below, corner), at(below, corner + 1)];
                let [c, d] = [at(below + 1, corner), at(below + 1, corner + 1)];
                triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
        self.add(&corners, &triangles);
    }

    fn octahedron(&mut self, at: &Vector3<f64>, radius: f64) {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * radius);
        let corners: Vec<Vector3<f64>> = axes.iter().flat_map(|axis| [at + axis, at - axis]).collect();
        let triangles = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        self.add(&corners, &triangles);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the volume of a surface, which is wrong unless all triangles are counter-clockwise seen from outside.
    fn volume(add: impl Fn(&mut MeshBuilder)) -> f64 {
        let mut surface = MeshBuilder::new(&Vector3::new(10.0, 20.0, 30.0));
        add(&mut surface);
        surface.finish().unwrap().volume()
    }

    #[test]
    fn surfaces_enclose_the_shape_volumes() {
        let centre = Vector3::new(1.0, -2.0, 3.0);
        let cuboid =
            volume(|it| it.cuboid(|sign| centre + Vector3::from(sign).component_mul(&Vector3::new(1.0, 2.0, 3.0))));
        assert!((cuboid - 48.0).abs() < 1e-9, "{cuboid}");
        let ball = volume(|it| it.capsule(&centre, &centre, 10.0)) / (4.0 / 3.0 * PI * 1000.0);
        assert!((0.95..1.0).contains(&ball), "{ball}");
        let along = Vector3::new(30.0, 40.0, 0.0);
        let pipe = volume(|it| it.capsule(&centre, &(centre + along), 10.0)) / (PI * 100.0 * (50.0 + 40.0 / 3.0));
        assert!((0.95..1.0).contains(&pipe), "{pipe}");
        let octahedron = volume(|it| it.octahedron(&centre, 3.0));
        assert!((octahedron - 36.0).abs() < 1e-9, "{octahedron}");
    }
}
