//! A scene: obstacles, and how far a point is from them.

use nalgebra::Vector3;

use crate::shapes::{HalfSpace, Shape, Triangle};
use crate::tree::{Bounds, Tree, bounds_of, signed_root};

/// A cloud: each point is a ball of one radius.
#[derive(Debug, Clone)]
pub struct Cloud {
    points: Tree<Vector3<f64>>,
    radius: f64,
}

impl Cloud {
    /// The cloud of balls of this radius (mm) at these points.
    #[must_use]
    pub fn new(points: Vec<Vector3<f64>>, radius: f64) -> Self {
        Self { points: Tree::new(points), radius }
    }
}

/// A mesh of triangles.
#[derive(Debug, Clone)]
pub struct Mesh {
    triangles: Tree<Triangle>,
    /// Whether what it encloses is an obstacle too.
    solid: bool,
}

impl Mesh {
    /// The mesh of these triangles. If it is `solid`, it must be closed.
    #[must_use]
    pub fn new(triangles: Vec<Triangle>, solid: bool) -> Self {
        Self { triangles: Tree::new(triangles), solid }
    }

    /// Whether a point is inside what the mesh encloses.
    fn holds(&self, point: &Vector3<f64>) -> bool {
        let mut winding = 0;
        self.triangles.along_x(point.y, point.z, |triangles| {
            winding += triangles.iter().map(|triangle| triangle.passing(point)).sum::<i32>();
        });
        winding != 0
    }
}

/// Obstacles. Lengths in mm.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    shapes: Option<Tree<Shape>>,
    half_spaces: Vec<HalfSpace>,
    clouds: Vec<Cloud>,
    meshes: Vec<Mesh>,
}

impl Scene {
    /// A scene of these obstacles.
    #[must_use]
    pub fn new(shapes: Vec<Shape>, half_spaces: Vec<HalfSpace>, clouds: Vec<Cloud>, meshes: Vec<Mesh>) -> Self {
        let shapes = (!shapes.is_empty()).then(|| Tree::new(shapes));
        Self { shapes, half_spaces, clouds, meshes }
    }

    /// The distance from a point to the nearest obstacle, mm; negative inside. Never more than 1e-9 mm above the true
    /// distance. Infinite without obstacles.
    #[must_use]
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        let distance = self.distance_within(point, f64::INFINITY);
        let is_inside = self.meshes.iter().any(|mesh| mesh.solid && mesh.holds(point));
        if is_inside { -distance.abs() } else { distance }
    }

    /// The least of `within` and the distance from a point to the nearest surface of an obstacle, mm. Inside of a mesh
    /// it is not negative: who begins outside and keeps off the surface stays outside.
    #[must_use]
    #[inline]
    pub fn distance_within(&self, point: &Vector3<f64>, within: f64) -> f64 {
        let mut best = within;
        for half_space in &self.half_spaces {
            best = best.min(half_space.distance(point));
        }
        // Where nothing is nearer, `best` stays to its last digit.
        if let Some(shapes) = &self.shapes {
            let within = best * best.abs();
            let nearest = shapes.nearest(point, within);
            best = if nearest < within { signed_root(nearest) } else { best };
        }
        for mesh in &self.meshes {
            let within = best.max(0.0) * best.max(0.0);
            let nearest = mesh.triangles.nearest(point, within);
            best = if nearest < within { nearest.sqrt() } else { best };
        }
        for cloud in &self.clouds {
            let reach = (best + cloud.radius).max(0.0);
            let nearest = cloud.points.nearest(point, reach * reach);
            best = if nearest < reach * reach { nearest.sqrt() - cloud.radius } else { best };
        }
        best
    }

    /// The box that holds all obstacles but half spaces.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = self.shapes.as_ref().map_or(Bounds::EMPTY, |shapes| bounds_of(shapes.items()));
        for cloud in &self.clouds {
            bounds = bounds.with(&bounds_of(cloud.points.items()).grown(cloud.radius));
        }
        self.meshes.iter().fold(bounds, |bounds, mesh| bounds.with(&bounds_of(mesh.triangles.items())))
    }

    /// The number of shapes, half spaces, triangles and points.
    #[must_use]
    pub fn len(&self) -> usize {
        let shapes = self.shapes.as_ref().map_or(0, |shapes| shapes.items().len());
        let clouds: usize = self.clouds.iter().map(|cloud| cloud.points.items().len()).sum();
        let meshes: usize = self.meshes.iter().map(|mesh| mesh.triangles.items().len()).sum();
        shapes + self.half_spaces.len() + clouds + meshes
    }

    /// Whether there are no obstacles.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
