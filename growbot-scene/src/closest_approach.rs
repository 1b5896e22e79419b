//! The closest approach of a body to the obstacles of a scene: the point of the body, the obstacle and its point.

use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

use crate::path_clearance::{clearance, point_along};
use crate::scene::{Obstacle, Scene};
use crate::shapes::{Shape, Triangle};

/// The closest approach of a body to the obstacles of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestApproach {
    /// Length along the body at which it is nearest to the obstacles, mm.
    pub at: f64,
    /// Point of the body's centreline.
    pub on_body: Vector3<f64>,
    /// Nearest point of the obstacle's surface.
    pub on_obstacle: Vector3<f64>,
    /// Obstacle that is nearest to the body.
    pub obstacle: Obstacle,
    /// Proven minimum distance of the centreline from all obstacles, mm: see [`clearance`]. Negative inside an
    /// obstacle.
    pub distance: f64,
}

/// Returns the closest approach of a body on this path, which grows from the frame `base_from_start`. Returns `None`
/// without obstacles.
pub fn closest_approach(scene: &Scene, path: &[Segment], base_from_start: &Frame) -> Option<ClosestApproach> {
    let found = clearance(scene, path, base_from_start);
    let on_body = point_along(path, base_from_start, found.arc_length);
    let (on_obstacle, obstacle) = scene.nearest_point(&on_body)?;
    Some(ClosestApproach { at: found.arc_length, on_body, on_obstacle, obstacle, distance: found.distance })
}

impl Scene {
    /// Returns the point on the surface of an obstacle that is nearest to `point`, and this obstacle. Returns `None`
    /// without obstacles.
    pub fn nearest_point(&self, point: &Vector3<f64>) -> Option<(Vector3<f64>, Obstacle)> {
        let obstacle = self.nearest(point)?;
        let nearest = match obstacle {
            Obstacle::Shape(shape) => on_shape(&shape, point),
            Obstacle::HalfSpace(plane) => point - plane.normal * plane.distance(point),
            Obstacle::Mesh(number) => {
                let triangles = self.meshes().get(number - 1)?.triangles();
                nearest_to(point, triangles.iter().map(|triangle| on_triangle(triangle, point)))?
            }
            Obstacle::Cloud(number) => {
                let cloud = self.clouds().get(number - 1)?;
                let centre = nearest_to(point, cloud.points().iter().copied())?;
                centre + away(&(point - centre)) * cloud.radius()
            }
        };
        Some((nearest, obstacle))
    }
}

/// Returns the point of `all` that is nearest to `point`.
fn nearest_to(point: &Vector3<f64>, all: impl Iterator<Item = Vector3<f64>>) -> Option<Vector3<f64>> {
    let squares = all.map(|one| ((one - point).norm_squared(), one));
    squares.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, one)| one)
}

/// Returns the unit vector of a direction. It is arbitrary for a zero vector.
fn away(direction: &Vector3<f64>) -> Vector3<f64> {
    direction.try_normalize(1e-12).unwrap_or_else(Vector3::x)
}

/// Returns the point of a shape's surface that is nearest to `point`.
fn on_shape(shape: &Shape, point: &Vector3<f64>) -> Vector3<f64> {
    match shape {
        Shape::Box { centre, half_extents: half, rotation } => {
            let offset = rotation.inverse_transform_vector(&(point - centre));
            let mut nearest = offset.zip_map(half, |at, half| at.max(-half).min(half));
            if offset == nearest {
                // The point is inside, so the nearest face counts.
                let axis = (offset.abs() - half).imax();
                nearest[axis] = half[axis].copysign(offset[axis]);
            }
            centre + rotation * nearest
        }
        Shape::Ball { centre, radius } => centre + away(&(point - centre)) * *radius,
        Shape::Capsule { from, to, radius } => {
            let axis = on_segment(from, to, point);
            // On the axis itself, all directions perpendicular to it are equally short.
            let across = (to - from).cross(&Vector3::new(0.3, 0.5, 0.8));
            axis + (point - axis).try_normalize(1e-12).unwrap_or_else(|| away(&across)) * *radius
        }
    }
}

/// Returns the point of a line segment that is nearest to `point`.
fn on_segment(from: &Vector3<f64>, to: &Vector3<f64>, point: &Vector3<f64>) -> Vector3<f64> {
    let along = to - from;
    let square = along.norm_squared();
    let share = if square > 0.0 { ((point - from).dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
    from + along * share
}

/// Returns the point of a triangle that is nearest to `point`.
fn on_triangle(Triangle([a, b, c]): &Triangle, point: &Vector3<f64>) -> Vector3<f64> {
    let normal = (b - a).cross(&(c - a));
    let above = |from: &Vector3<f64>, to: &Vector3<f64>| (to - from).cross(&(point - from)).dot(&normal) >= 0.0;
    match normal.try_normalize(1e-12) {
        Some(normal) if above(a, b) && above(b, c) && above(c, a) => point - normal * normal.dot(&(point - a)),
        _ => {
            let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| on_segment(from, to, point));
            nearest_to(point, edges.into_iter()).unwrap_or(*a)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path_clearance::CLEARANCE_TOLERANCE_MM;
    use crate::random_scenes::{FAMILIES, TubeLimits, random_scene};
    use crate::shapes::HalfSpace;
    use growbot_core::random::Rng;

    fn anywhere(random: &mut Rng) -> Vector3<f64> {
        Vector3::from_fn(|_, _| random.uniform_between(-400.0, 800.0))
    }

    #[test]
    fn the_nearest_point_is_on_the_surface_at_the_distance() {
        let body = TubeLimits { radius: 100.0, clearance: 25.0 };
        for family in FAMILIES {
            let drawn = random_scene(family, 1, &body);
            let floor = HalfSpace { point: Vector3::new(0.0, 0.0, -100.0), normal: Vector3::z() };
            let mut scene = drawn.scene();
            scene = Scene::new(scene.shapes().to_vec(), vec![floor], scene.clouds().to_vec(), scene.meshes().to_vec());
            let mut random = Rng::new(&[family as u64, 3]);
            for _ in 0..300 {
                let point = anywhere(&mut random);
                let (nearest, _) = scene.nearest_point(&point).unwrap();
                let distance = scene.distance_within(&point, f64::INFINITY).abs();
                assert!(((nearest - point).norm() - distance).abs() < 1e-6, "{family:?} {point} {nearest}");
                assert!(scene.distance_within(&nearest, f64::INFINITY) < 1e-6, "{family:?} {point} {nearest}");
            }
        }
    }

    #[test]
    fn a_body_passing_a_ball_is_nearest_beside_it() {
        let ball = Shape::Ball { centre: Vector3::new(80.0, 0.0, 300.0), radius: 30.0 };
        let scene = Scene::new(vec![ball], vec![], vec![], vec![]);
        let found = closest_approach(&scene, &[Segment::Straight { length: 500.0 }], &Frame::identity()).unwrap();
        assert!((found.distance - 50.0).abs() <= CLEARANCE_TOLERANCE_MM && found.distance <= 50.0, "{found:?}");
        assert!((found.at - 300.0).abs() < 1.0, "{found:?}");
        assert!((found.on_body - Vector3::new(0.0, 0.0, 300.0)).norm() < 1.0, "{found:?}");
        assert!((found.on_obstacle - Vector3::new(50.0, 0.0, 300.0)).norm() < 1.0, "{found:?}");
        assert_eq!(found.obstacle, Obstacle::Shape(ball));
        assert_eq!(closest_approach(&Scene::default(), &[], &Frame::identity()), None);
    }

    #[test]
    fn inside_an_obstacle_the_nearest_point_is_on_its_surface() {
        let half = Vector3::new(10.0, 20.0, 30.0);
        let cases = [
            (
                Shape::Box { centre: Vector3::zeros(), half_extents: half, rotation: nalgebra::Rotation3::identity() },
                10.0,
            ),
            (Shape::Ball { centre: Vector3::zeros(), radius: 7.0 }, 7.0),
            (Shape::Capsule { from: -Vector3::z(), to: Vector3::z(), radius: 5.0 }, 5.0),
        ];
        for (shape, deep) in cases {
            let nearest = on_shape(&shape, &Vector3::zeros());
            assert!((nearest.norm() - deep).abs() < 1e-12 && shape.distance(&nearest).abs() < 1e-12, "{shape:?}");
        }
    }
}
