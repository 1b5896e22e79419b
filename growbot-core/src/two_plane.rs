//! The paper's planner: two planar paths that meet on the line from start to goal.
//!
//! Del Dottore et al. 2019, Eqs 9 to 25, after Babaei and Mortazavi 2010. The line from start to goal, of direction
//! `v_se`, lies in two planes. One plane contains the start's direction `v_s`, the other contains the goal's direction
//! `v_e`. In the first plane the path leads to a waypoint on the line (Eqs 12 to 14), where its direction is `v_se`. In
//! the second plane it leads from the waypoint to the goal. Each half is a planar Dubins path.
//!
//! This code corrects the paper, or closes its gaps, in four places:
//! - A direction parallel to the line spans no plane (Eqs 9, 10). Then the other pose's plane is used, so that the path
//!   stays planar. If that pose has no plane either, any plane that contains the line is used.
//! - In the first plane `v_se` is at *minus* the angle of Eq 23. Here headings come from components, by `atan2`.
//! - The point of deposition (Eq 25) comes from the bend direction in the tip's frame: `alpha = bend direction + pi`.
//! - If start and goal are one point, the line does not exist. Then one plane that contains both directions is used.

use nalgebra::Vector3;

use crate::angle::wrap_positive;
use crate::dubins2::{self, Direction, PlanarPose};
use crate::path::{Path, PathFull, Segment};
use crate::pose::{Frame, Pose, tip_direction};

/// Max distance between start and goal, radii, at which the two count as one point. Rounding errors would determine the
/// direction of such a short line. The test `degenerate_poses_are_reached` of [`crate::plan`] checks this value.
const ONE_POINT: f64 = 1e-12;
/// Max length of the cross product of two unit vectors at which the two count as parallel. Rounding errors would
/// determine the plane that such vectors span. The tests `goals_nearly_ahead_are_reached` and
/// `degenerate_poses_are_reached` of [`crate::plan`] check this value.
const PARALLEL: f64 = 1e-12;

/// Returns the two-plane path from start to goal, whose arcs have the given radius (mm).
///
/// # Errors
/// Returns [`PathFull`] if a [`Path`] has no space for all segments. There are at most six, so this does not happen.
#[inline(never)] // Keeps its stack frame out of the caller's.
pub fn two_plane(start: &Pose, goal: &Pose, radius: f64) -> Result<Path, PathFull> {
    let (from, to) = (start.direction(), goal.direction());
    let offset = (goal.position() - start.position()) / radius;
    let distance = offset.norm();
    let mut builder = Builder { path: Path::new(), base_from_tip: start.frame(), radius };
    if distance <= ONE_POINT {
        let normal = normal(&from, &to).unwrap_or_else(|| any_normal(&from));
        builder.planar(&from, &normal, &offset, &to)?;
        return Ok(builder.path);
    }
    let along = offset / distance;
    let (start_normal, goal_normal) = (normal(&from, &along), normal(&along, &to));
    let fallback = any_normal(&along);
    let first = start_normal.or(goal_normal).unwrap_or(fallback);
    let second = goal_normal.or(start_normal).unwrap_or(fallback);
    let to_waypoint = waypoint_distance(&from, &along);
    builder.planar(&from, &first, &(along * to_waypoint), &along)?;
    builder.planar(&along, &second, &(along * (distance - to_waypoint)), &to)?;
    Ok(builder.path)
}

/// Returns the distance from the start to the waypoint along the line to the goal, radii (Eqs 13 and 14, with `epsilon`
/// 0). `from` is the direction at the start, and `along` is the direction of the line. At this distance, a circle
/// tangent to `from` at the start touches a circle tangent to the line at the waypoint.
fn waypoint_distance(from: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
    let cos_rho = from.dot(along).clamp(-1.0, 1.0);
    let sin_rho = from.cross(along).norm();
    let height = 1.0 + cos_rho;
    sin_rho + libm::sqrt((4.0 - height * height).max(0.0))
}

/// Returns the unit normal of the plane that two unit vectors span. `None` if they are parallel.
fn normal(a: &Vector3<f64>, b: &Vector3<f64>) -> Option<Vector3<f64>> {
    let cross = a.cross(b);
    let norm = cross.norm();
    (norm > PARALLEL).then(|| perpendicular(&(cross / norm), a))
}

/// Returns the part of `vector` that is perpendicular to `axis`, scaled to a unit vector.
///
/// [`normal`] uses this function because the rounding error of a cross product is relatively large if the two vectors
/// are nearly parallel. Without the correction the plane would not contain the vector `a`.
fn perpendicular(vector: &Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    (vector - axis * axis.dot(vector)).normalize()
}

/// Returns a unit vector perpendicular to a unit vector.
fn any_normal(axis: &Vector3<f64>) -> Vector3<f64> {
    let min_axis = axis.iamin();
    let mut other = Vector3::zeros();
    if let Some(component) = other.get_mut(min_axis) {
        *component = 1.0;
    }
    perpendicular(&axis.cross(&other), axis)
}

/// Builder that appends planar paths to a path in space, and tracks the frame of the tip at the end of the path.
struct Builder {
    path: Path,
    base_from_tip: Frame,
    radius: f64,
}

impl Builder {
    /// Appends the shortest path in the plane with this normal. The path begins at the tip, whose direction is `from`.
    /// It ends at the position `offset` (radii) relative to the tip, in direction `to`.
    fn planar(
        &mut self,
        from: &Vector3<f64>,
        normal: &Vector3<f64>,
        offset: &Vector3<f64>,
        to: &Vector3<f64>,
    ) -> Result<(), PathFull> {
        let normal = perpendicular(normal, from);
        let left = normal.cross(from);
        let goal =
            PlanarPose { x: offset.dot(from), y: offset.dot(&left), heading: libm::atan2(to.dot(&left), to.dot(from)) };
        for (direction, length) in dubins2::shortest(&goal).pieces() {
            let segment = match direction {
                Direction::Straight => Segment::Straight { length: length * self.radius },
                Direction::Left => self.arc(&normal, length),
                Direction::Right => self.arc(&-normal, length),
            };
            self.base_from_tip *= segment.step();
            self.path.push(segment)?;
        }
        Ok(())
    }

    /// Returns the arc that turns the tip by `bend` (radians) counter-clockwise about `axis` (Eq 25, by `atan2`).
    fn arc(&self, axis: &Vector3<f64>, bend: f64) -> Segment {
        let towards = axis.cross(&tip_direction(&self.base_from_tip));
        let in_tip = self.base_from_tip.rotation.inverse() * towards;
        let alpha = wrap_positive(libm::atan2(in_tip.y, in_tip.x) + core::f64::consts::PI);
        Segment::Arc { alpha, bend, length: bend * self.radius }
    }
}
