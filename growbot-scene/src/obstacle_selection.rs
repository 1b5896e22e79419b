//! The part of a scene that a view shows: the obstacles near a body, within the limits of a page or a picture.

use nalgebra::Vector3;

use crate::bvh::{Bounds, Bvh, BvhItem};
use crate::scene::{Mesh, Scene};
use crate::shapes::{Shape, Triangle};

/// Maximum distance of shown obstacles from the body, as a fraction of the diagonal of the body's bounding box. The
/// distance is at least `LEAST_FAR`, mm.
const FAR: f64 = 0.5;
const LEAST_FAR: f64 = 200.0;

/// Maximum number of shown obstacles of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelectionLimits {
    /// Maximum number of boxes, balls and capsules together.
    pub shapes: usize,
    /// Maximum number of triangles of meshes.
    pub triangles: usize,
    /// Maximum number of points of clouds.
    pub points: usize,
}

/// Obstacles that are shown in a view. Lengths are in mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObstacleSelection {
    /// Boxes, balls and capsules.
    pub shapes: Vec<Shape>,
    /// Squares that show the planes of half spaces beside the body. The corners of a square are in order,
    /// counter-clockwise seen from the free side.
    pub squares: Vec<[Vector3<f64>; 4]>,
    /// Triangles of meshes.
    pub triangles: Vec<Triangle>,
    /// Points of clouds, each with the radius of its ball.
    pub points: Vec<(Vector3<f64>, f64)>,
    /// Number of all obstacles of the scene, shown or not: shapes, half spaces, triangles and points.
    pub total: usize,
}

impl ObstacleSelection {
    /// Selects the obstacles of a scene near a body. `places` are points of the body's centreline.
    pub fn near(scene: &Scene, places: &[Vector3<f64>], limits: &SelectionLimits) -> Self {
        let around = Neighbourhood::new(places);
        let points = scene.clouds().iter().flat_map(|cloud| cloud.points().iter().map(|at| (*at, cloud.radius())));
        let triangles = scene.meshes().iter().flat_map(Mesh::triangles).copied();
        Self {
            shapes: around.nearest(scene.shapes().iter().copied(), limits.shapes, BvhItem::bounds),
            squares: scene
                .half_spaces()
                .iter()
                .filter_map(|plane| around.square(&plane.point, &plane.normal))
                .collect(),
            triangles: around.nearest(triangles, limits.triangles, BvhItem::bounds),
            points: around.nearest(points, limits.points, |(at, _)| at.bounds()),
            total: scene.len(),
        }
    }

    /// Returns the number of shown obstacles.
    pub fn len(&self) -> usize {
        self.shapes.len() + self.squares.len() + self.triangles.len() + self.points.len()
    }

    /// Reports whether no obstacles are shown.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a message with the number of shown obstacles.
    pub fn summary(&self) -> String {
        if self.len() == self.total {
            format!("{}, all shown", self.total)
        } else {
            format!("{}, the nearest {} shown", self.total, self.len())
        }
    }
}

/// The surroundings of a body.
struct Neighbourhood {
    places: Bvh<Vector3<f64>>,
    centre: Vector3<f64>,
    /// Maximum distance of shown obstacles from the centreline, mm.
    far: f64,
    /// Half the diagonal of the body's bounding box, mm.
    size: f64,
}

impl Neighbourhood {
    fn new(places: &[Vector3<f64>]) -> Self {
        let start = [Vector3::zeros()];
        let bounds = Bounds::of(if places.is_empty() { &start } else { places });
        let size = (bounds.max - bounds.min).norm();
        Self {
            places: Bvh::new(places.to_vec()),
            centre: 0.5 * (bounds.min + bounds.max),
            far: (FAR * size).max(LEAST_FAR),
            size: 0.5 * size,
        }
    }

    /// Returns the square of the distance of a bounding box from the nearest point of the body. For a long item, this
    /// is a lower bound of the item's own squared distance.
    fn square_of(&self, bounds: &Bounds) -> f64 {
        let beside = |place: &Vector3<f64>| (place.sup(&bounds.min).inf(&bounds.max) - place).norm_squared();
        // A small box is about as far as its middle, whose distance the tree finds quickly.
        let (middle, half) = (0.5 * (bounds.min + bounds.max), 0.5 * (bounds.max - bounds.min).norm());
        if half < 0.05 * self.far {
            let distance = (self.places.min_signed_square(&middle, f64::INFINITY).sqrt() - half).max(0.0);
            return distance * distance;
        }
        self.places.items().iter().map(beside).fold(f64::INFINITY, f64::min)
    }

    /// Returns the items of `all` that are near the body. If there are more than `max`, returns only the nearest ones.
    fn nearest<T: Copy>(&self, all: impl Iterator<Item = T>, max: usize, bounds: impl Fn(&T) -> Bounds) -> Vec<T> {
        let far = self.far * self.far;
        let mut near: Vec<(f64, T)> =
            all.map(|item| (self.square_of(&bounds(&item)), item)).filter(|(square, _)| *square <= far).collect();
        if near.len() > max {
            near.select_nth_unstable_by(max, |a, b| a.0.total_cmp(&b.0));
            near.truncate(max);
        }
        near.into_iter().map(|(_, item)| item).collect()
    }

    /// Returns the corners of a square in a plane, beside the body. Returns `None` if the plane is too far away.
    fn square(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> Option<[Vector3<f64>; 4]> {
        let away = normal.dot(&(self.centre - point));
        if away.abs() > self.size + self.far {
            return None;
        }
        let aside = if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let right = (aside - normal * normal.dot(&aside)).normalize();
        let up = normal.cross(&right);
        let (foot, half) = (self.centre - normal * away, self.size + 0.5 * self.far);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        Some(corners.map(|(x, y)| foot + (right * x + up * y) * half))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Cloud;
    use crate::shapes::HalfSpace;

    const LIMITS: SelectionLimits = SelectionLimits { shapes: 10, triangles: 100, points: 100 };

    fn line() -> Vec<Vector3<f64>> {
        (0..=50).map(|step| Vector3::z() * (10.0 * f64::from(step))).collect()
    }

    #[test]
    fn near_obstacles_are_displayed_and_far_ones_are_not() {
        let ball = |x| Shape::Ball { centre: Vector3::new(x, 0.0, 250.0), radius: 20.0 };
        let pillar =
            Shape::Capsule { from: Vector3::new(50.0, 0.0, -9000.0), to: Vector3::new(50.0, 0.0, 9000.0), radius: 5.0 };
        let floor = HalfSpace { point: Vector3::new(700.0, 0.0, -40.0), normal: Vector3::z() };
        let sky = HalfSpace { point: Vector3::new(0.0, 0.0, 9000.0), normal: -Vector3::z() };
        let scene = Scene::new(vec![ball(100.0), ball(5000.0), pillar], vec![floor, sky], vec![], vec![]);
        let shown = ObstacleSelection::near(&scene, &line(), &LIMITS);
        assert!(shown.shapes.contains(&ball(100.0)) && shown.shapes.contains(&pillar) && shown.shapes.len() == 2);
        let [corners] = &shown.squares[..] else { panic!("{shown:?}") };
        assert!(corners.iter().all(|corner| (corner.z + 40.0).abs() < 1e-9), "{corners:?}");
        // The square is around the body, and faces it.
        assert!((corners.iter().sum::<Vector3<f64>>() / 4.0).xy().norm() < 1e-9);
        assert!((corners[1] - corners[0]).cross(&(corners[2] - corners[1])).z > 0.0);
        assert_eq!((shown.len(), shown.summary().as_str()), (3, "5, the nearest 3 shown"));
    }

    #[test]
    fn the_nearest_of_many_obstacles_are_displayed() {
        let points: Vec<Vector3<f64>> = (0..100_000).map(|i| Vector3::new(0.002 * f64::from(i), 0.0, 250.0)).collect();
        let triangles = points.iter().map(|at| Triangle([*at, at + Vector3::x(), at + Vector3::y()])).collect();
        let scene = Scene::new(vec![], vec![], vec![Cloud::new(points, 1.0)], vec![Mesh::surface(triangles)]);
        let shown = ObstacleSelection::near(&scene, &line(), &LIMITS);
        assert_eq!((shown.triangles.len(), shown.points.len(), shown.total), (100, 100, 200_000));
        assert!(shown.points.iter().all(|(at, radius)| at.x < 0.21 && *radius == 1.0), "{:?}", shown.points);
        assert!(shown.triangles.iter().all(|Triangle([at, ..])| at.x < 1.5), "{:?}", shown.triangles);
        // An empty body must not fail.
        assert!(ObstacleSelection::near(&scene, &[], &LIMITS).points.len() <= 100);
        assert!(ObstacleSelection::near(&Scene::default(), &line(), &LIMITS).is_empty());
    }
}
