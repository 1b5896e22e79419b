//! Boxes, balls, capsules, half spaces, triangles and points, each with its distance from a point.
//!
//! Distances are negative inside. A computed distance is above the true distance only by rounding: at most 1e-9 mm for
//! coordinates within 1e6 mm.

use nalgebra::{Rotation3, Vector3};

use crate::bvh::{Bounds, BvhItem, signed_square};

/// A simple shape. Lengths are in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A box.
    Box {
        /// Centre of the box.
        centre: Vector3<f64>,
        /// Half the lengths of the box's sides.
        half_extents: Vector3<f64>,
        /// Rotation from the box's axes to the base's axes.
        rotation: Rotation3<f64>,
    },
    /// A ball.
    Ball {
        /// Centre of the ball.
        centre: Vector3<f64>,
        /// Radius of the ball.
        radius: f64,
    },
    /// All points within a distance of a line segment.
    Capsule {
        /// One end of the segment.
        from: Vector3<f64>,
        /// Other end of the segment.
        to: Vector3<f64>,
        /// Maximum distance from the segment.
        radius: f64,
    },
}

impl Shape {
    /// Returns the distance from a point to the surface of the shape, mm, negative inside.
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        match self {
            Self::Box { centre, half_extents: half, rotation } => {
                let beyond = rotation.inverse_transform_vector(&(point - centre)).abs() - half;
                let inside = beyond.max();
                if inside <= 0.0 { inside } else { beyond.sup(&Vector3::zeros()).norm() }
            }
            Self::Ball { centre, radius } => (point - centre).norm() - radius,
            Self::Capsule { from, to, radius } => to_segment(point, from, to).sqrt() - radius,
        }
    }
}

impl BvhItem for Shape {
    fn bounds(&self) -> Bounds {
        match self {
            Self::Box { centre, half_extents: half, rotation } => {
                let reach = rotation.matrix().abs() * half;
                // Allows for rounding of the rotation.
                let reach = reach * (1.0 + 1e-12);
                Bounds { min: centre - reach, max: centre + reach }
            }
            Self::Ball { centre, radius } => Bounds::of(&[*centre]).inflated(*radius),
            Self::Capsule { from, to, radius } => Bounds::of(&[*from, *to]).inflated(*radius),
        }
    }

    fn nearest(items: &[Self], point: &Vector3<f64>, best: f64) -> f64 {
        items.iter().fold(best, |best, item| best.min(signed_square(item.distance(point))))
    }
}

/// Returns the square of the distance from a point to a line segment.
fn to_segment(point: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let (along, offset) = (to - from, point - from);
    let square = along.norm_squared();
    let share = if square > 0.0 { (offset.dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
    // Measure from the nearer end, so that the rounding is that of the shorter part.
    if share > 0.5 {
        (point - to + along * (1.0 - share)).norm_squared()
    } else {
        (offset - along * share).norm_squared()
    }
}

/// An obstacle that consists of all points on one side of a plane. The normal points to the other side, which is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// A point of the plane.
    pub point: Vector3<f64>,
    /// Normal of the plane, a unit vector.
    pub normal: Vector3<f64>,
}

impl HalfSpace {
    /// Returns the distance from a point to the plane, mm, negative inside the half space.
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(&(point - self.point))
    }
}

/// A point of a cloud, which is an item without extent.
impl BvhItem for Vector3<f64> {
    fn bounds(&self) -> Bounds {
        Bounds { min: *self, max: *self }
    }

    #[inline]
    fn nearest(items: &[Self], point: &Vector3<f64>, best: f64) -> f64 {
        items.iter().fold(best, |best, item| best.min((item - point).norm_squared()))
    }
}

/// A triangle of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle(pub [Vector3<f64>; 3]);

impl Triangle {
    /// Returns the square of the distance from a point to the triangle.
    fn square(&self, point: &Vector3<f64>) -> f64 {
        let [a, b, c] = &self.0;
        let edges = to_segment(point, a, b).min(to_segment(point, b, c)).min(to_segment(point, c, a));
        let normal = (b - a).cross(&(c - a));
        let area = normal.norm();
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        // If a triangle is nearly a line, its normal is mostly rounding, so only the edges count.
        if area <= 1e-14 * longest {
            return edges;
        }
        let above = |from: &Vector3<f64>, to: &Vector3<f64>| (to - from).cross(&(point - from)).dot(&normal) >= 0.0;
        if !(above(a, b) && above(b, c) && above(c, a)) {
            return edges;
        }
        // The nearest corner has the smallest rounding. The rounding of the normal is larger for thinner triangles.
        let offset = [a, b, c].map(|corner| point - corner);
        let offset =
            offset.into_iter().min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default();
        let rounding = 4.0 * f64::EPSILON * offset.norm() * (longest / area);
        let distance = (offset.dot(&normal).abs() / area - rounding).max(0.0);
        edges.min(distance * distance)
    }

    /// Returns the crossing of the triangle by the ray from `point` towards greater x. The result is 1 if the ray
    /// leaves through the side from which the corners are counter-clockwise, -1 if it enters through this side, and 0
    /// if it does not meet the triangle.
    ///
    /// A ray passes through only one of several triangles with a common edge, because the arithmetic of the edge is the
    /// same for all of them.
    pub fn ray_crossing(&self, point: &Vector3<f64>) -> i32 {
        let [a, b, c] = &self.0;
        let winding = turned(a, b, point) + turned(b, c, point) + turned(c, a, point);
        if winding == 0 {
            return 0;
        }
        let normal = (b - a).cross(&(c - a));
        let ahead = normal.dot(&(a - point)) * normal.x.signum();
        if normal.x != 0.0 && ahead > 0.0 { winding } else { 0 }
    }
}

/// Returns the crossing of an edge with the ray from `point` towards greater y, seen along the x axis: 1 if the edge
/// crosses the ray towards greater z, -1 if it crosses towards smaller z, 0 if it does not cross.
fn turned(from: &Vector3<f64>, to: &Vector3<f64>, point: &Vector3<f64>) -> i32 {
    let upwards = from.z <= point.z && point.z < to.z;
    let downwards = to.z <= point.z && point.z < from.z;
    if !upwards && !downwards {
        return 0;
    }
    // Compute from the lower end in any case, so that the result is the same for both triangles.
    let (low, high) = if upwards { (from, to) } else { (to, from) };
    let side = (high.y - low.y) * (point.z - low.z) - (point.y - low.y) * (high.z - low.z);
    match (side > 0.0, upwards) {
        (false, _) => 0,
        (true, true) => 1,
        (true, false) => -1,
    }
}

impl BvhItem for Triangle {
    fn bounds(&self) -> Bounds {
        Bounds::of(&self.0)
    }

    fn nearest(items: &[Self], point: &Vector3<f64>, best: f64) -> f64 {
        items.iter().fold(best, |best, item| best.min(item.square(point)))
    }
}
