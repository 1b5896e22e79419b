//! A scene: obstacles, and the distance of a point from them.

use std::fmt;

use growbot_core::compact_number::CompactNumber;
use nalgebra::Vector3;

use crate::bvh::{Bounds, Bvh, bounds_of, signed_root};
use crate::shapes::{HalfSpace, Shape, Triangle};

/// An obstacle of a scene, as it is named in messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// A box, ball or capsule.
    Shape(Shape),
    /// A half space.
    HalfSpace(HalfSpace),
    /// The mesh with this number, from 1.
    Mesh(usize),
    /// The cloud of points with this number, from 1.
    Cloud(usize),
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let at = |point: &Vector3<f64>| {
            format!("{}, {}, {}", CompactNumber(&point.x), CompactNumber(&point.y), CompactNumber(&point.z))
        };
        match self {
            Self::Shape(Shape::Box { centre, .. }) => write!(f, "the box at {}", at(centre)),
            Self::Shape(Shape::Ball { centre, .. }) => write!(f, "the ball at {}", at(centre)),
            Self::Shape(Shape::Capsule { from, to, .. }) => write!(f, "the capsule from {} to {}", at(from), at(to)),
            Self::HalfSpace(HalfSpace { point, .. }) => write!(f, "the half space at {}", at(point)),
            Self::Mesh(number) => write!(f, "mesh {number}"),
            Self::Cloud(number) => write!(f, "point cloud {number}"),
        }
    }
}

/// A cloud of points, each of which is a ball of the same radius.
#[derive(Debug, Clone)]
pub struct Cloud {
    points: Bvh<Vector3<f64>>,
    radius: f64,
}

impl Cloud {
    /// Returns the centres of the balls.
    pub fn points(&self) -> &[Vector3<f64>] {
        self.points.items()
    }

    /// Returns the radius of the balls, mm.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Creates a cloud of balls of this radius (mm) at these points.
    pub fn new(points: Vec<Vector3<f64>>, radius: f64) -> Self {
        Self { points: Bvh::new(points), radius }
    }
}

/// A mesh of triangles.
#[derive(Debug, Clone)]
pub struct Mesh {
    triangles: Bvh<Triangle>,
    /// True if the enclosed volume is an obstacle too.
    solid: bool,
}

impl Mesh {
    /// Returns the triangles.
    pub fn triangles(&self) -> &[Triangle] {
        self.triangles.items()
    }

    /// Creates a mesh of which only the triangles are obstacles.
    pub fn surface(triangles: Vec<Triangle>) -> Self {
        Self { triangles: Bvh::new(triangles), solid: false }
    }

    /// Creates a mesh whose enclosed volume is an obstacle too. It must be closed.
    pub fn solid(triangles: Vec<Triangle>) -> Self {
        Self { triangles: Bvh::new(triangles), solid: true }
    }

    /// Reports whether the mesh encloses a point.
    fn encloses(&self, point: &Vector3<f64>) -> bool {
        let mut winding = 0;
        self.triangles.along_x(point.y, point.z, |triangles| {
            winding += triangles.iter().map(|triangle| triangle.ray_crossing(point)).sum::<i32>();
        });
        winding != 0
    }
}

/// The obstacles of a scene. Lengths are in mm.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    shapes: Option<Bvh<Shape>>,
    half_spaces: Vec<HalfSpace>,
    clouds: Vec<Cloud>,
    meshes: Vec<Mesh>,
}

impl Scene {
    /// Creates a scene of these obstacles.
    pub fn new(shapes: Vec<Shape>, half_spaces: Vec<HalfSpace>, clouds: Vec<Cloud>, meshes: Vec<Mesh>) -> Self {
        let shapes = (!shapes.is_empty()).then(|| Bvh::new(shapes));
        Self { shapes, half_spaces, clouds, meshes }
    }

    /// Returns the distance from a point to the nearest obstacle, mm, negative inside. The result is never more than
    /// 1e-9 mm above the true distance. It is infinite without obstacles.
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        let distance = self.distance_within(point, f64::INFINITY);
        if self.contains(point) { -distance.abs() } else { distance }
    }

    /// Reports whether a point is inside a solid mesh.
    pub fn contains(&self, point: &Vector3<f64>) -> bool {
        self.meshes.iter().any(|mesh| mesh.solid && mesh.encloses(point))
    }

    /// Returns the distance from a point to the nearest obstacle surface, at most `within`, mm. The result is not
    /// negative inside a mesh; use [`Scene::contains`] for that. A path that begins outside a mesh and stays clear of
    /// its surface stays outside.
    #[inline]
    pub fn distance_within(&self, point: &Vector3<f64>, within: f64) -> f64 {
        let mut best = within;
        for half_space in &self.half_spaces {
            best = best.min(half_space.distance(point));
        }
        // If nothing is nearer, `best` stays exactly the same.
        if let Some(shapes) = &self.shapes {
            let within = best * best.abs();
            let nearest = shapes.min_signed_square(point, within);
            best = if nearest < within { signed_root(nearest) } else { best };
        }
        for mesh in &self.meshes {
            let within = best.max(0.0) * best.max(0.0);
            let nearest = mesh.triangles.min_signed_square(point, within);
            best = if nearest < within { nearest.sqrt() } else { best };
        }
        for cloud in &self.clouds {
            let reach = (best + cloud.radius).max(0.0);
            let nearest = cloud.points.min_signed_square(point, reach * reach);
            best = if nearest < reach * reach { nearest.sqrt() - cloud.radius } else { best };
        }
        best
    }

    /// Returns the obstacle whose surface is nearest to a point. `None` without obstacles.
    pub fn nearest(&self, point: &Vector3<f64>) -> Option<Obstacle> {
        let shapes = self.shapes.iter().flat_map(Bvh::items);
        let shapes = shapes.map(|shape| (shape.distance(point), Obstacle::Shape(*shape)));
        let half_spaces = self.half_spaces.iter();
        let half_spaces = half_spaces.map(|plane| (plane.distance(point), Obstacle::HalfSpace(*plane)));
        let meshes = (1..).zip(&self.meshes).map(|(number, mesh)| {
            (mesh.triangles.min_signed_square(point, f64::INFINITY).sqrt(), Obstacle::Mesh(number))
        });
        let clouds = (1..).zip(&self.clouds).map(|(number, cloud)| {
            (cloud.points.min_signed_square(point, f64::INFINITY).sqrt() - cloud.radius, Obstacle::Cloud(number))
        });
        let all = shapes.chain(half_spaces).chain(meshes).chain(clouds);
        all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, obstacle)| obstacle)
    }

    /// Returns the boxes, balls and capsules.
    pub fn shapes(&self) -> &[Shape] {
        self.shapes.as_ref().map_or(&[], Bvh::items)
    }

    /// Returns the half spaces.
    pub fn half_spaces(&self) -> &[HalfSpace] {
        &self.half_spaces
    }

    /// Returns the clouds of points.
    pub fn clouds(&self) -> &[Cloud] {
        &self.clouds
    }

    /// Returns the meshes.
    pub fn meshes(&self) -> &[Mesh] {
        &self.meshes
    }

    /// Returns the bounding box of all obstacles except half spaces.
    pub fn bounds(&self) -> Bounds {
        let mut bounds = self.shapes.as_ref().map_or(Bounds::EMPTY, |shapes| bounds_of(shapes.items()));
        for cloud in &self.clouds {
            bounds = bounds.with(&bounds_of(cloud.points.items()).inflated(cloud.radius));
        }
        self.meshes.iter().fold(bounds, |bounds, mesh| bounds.with(&bounds_of(mesh.triangles.items())))
    }

    /// Returns the number of shapes, half spaces, triangles and points.
    pub fn len(&self) -> usize {
        let shapes = self.shapes.as_ref().map_or(0, |shapes| shapes.items().len());
        let clouds: usize = self.clouds.iter().map(|cloud| cloud.points.items().len()).sum();
        let meshes: usize = self.meshes.iter().map(|mesh| mesh.triangles.items().len()).sum();
        shapes + self.half_spaces.len() + clouds + meshes
    }

    /// Reports whether there are no obstacles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
