//! Special paths that the search for roots misses: arcs of no length or of half a turn, and lines that cross.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::{Csc, NEARLY, Search, cosine, in_tip};
use crate::shortest::{Problem, any_perpendicular, axes_after};
use crate::trigonometry;

impl Search<'_> {
    /// If the lines through start and goal cross, or nearly cross, the plane of the last arc is undetermined: the
    /// corners of both arcs coincide, and the line leaves the plane on one side or the other.
    #[inline(never)]
    pub(super) fn crossing_lines(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        let start = Vector3::z();
        let cosine_between = direction.z;
        let det = 1.0 - cosine_between * cosine_between;
        let normal = start.cross(&direction);
        if det < 1e-6 || goal.dot(&normal).abs() > NEARLY {
            return;
        }
        // Solves [1 c; c 1] [x; y] = [a; b].
        let solve = |a: f64, b: f64| ((a - cosine_between * b) / det, (b - cosine_between * a) / det);
        let (first_tau, last_tau) = solve(goal.z, goal.dot(&direction));
        let straight = -(first_tau + last_tau);
        let (first_cosine, last_cosine) = (cosine(first_tau), cosine(last_tau));
        let (along_start, along_goal) = solve(first_cosine, last_cosine);
        let off = 1.0 - (along_start * first_cosine + along_goal * last_cosine);
        if straight < -NEARLY || off < -NEARLY {
            return;
        }
        let angle = |tau: f64| if tau < 0.0 { TAU + 2.0 * libm::atan(tau) } else { 2.0 * libm::atan(tau) };
        let (first, last) = (angle(first_tau), angle(last_tau));
        let off = libm::sqrt(off.max(0.0)) / libm::sqrt(det);
        for side in [off, -off] {
            let u = start * along_start + direction * along_goal + normal * side;
            let first_towards = if first_tau < 0.0 { libm::atan2(-u.y, -u.x) } else { libm::atan2(u.y, u.x) };
            let towards = direction - u * last_cosine;
            let towards = if last_tau < 0.0 { -towards } else { towards };
            let last_towards = in_tip(&axes_after(first_towards, first), &towards);
            self.keep(Csc { first_towards, first, straight, last_towards, last });
        }
    }

    /// Lines along the start or the goal, forwards or backwards, where a root has no bracket: one arc has no length or
    /// is half a turn, and its plane is free.
    #[inline(never)]
    pub(super) fn special_lines(&mut self) {
        self.one_arc();
        self.half_turns();
        self.two_half_turns();
    }

    /// One of the two arcs has no length.
    fn one_arc(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        for arc in arcs_between(&Vector3::z(), &direction) {
            let rest = goal - arc.offset;
            let towards = in_tip(&Matrix3::identity(), &arc.towards);
            // Straight on from the start.
            if trigonometry::hypot(rest.x, rest.y) < NEARLY {
                self.keep(Csc {
                    first_towards: 0.0,
                    first: 0.0,
                    straight: rest.z,
                    last_towards: towards,
                    last: arc.angle,
                });
            }
            // Straight into the goal.
            let straight = rest.dot(&direction);
            if (rest - direction * straight).norm() < NEARLY {
                self.keep(Csc { first_towards: towards, first: arc.angle, straight, last_towards: 0.0, last: 0.0 });
            }
        }
    }

    /// One of the two arcs is half a turn.
    fn half_turns(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        let start = Vector3::z();
        for arc in arcs_between(&-start, &direction) {
            // Half a turn first. The rest of the path determines its plane.
            let rest = goal - arc.offset;
            if (trigonometry::hypot(rest.x, rest.y) - 2.0).abs() < NEARLY {
                let first_towards = libm::atan2(rest.y, rest.x);
                let last_towards = in_tip(&axes_after(first_towards, PI), &arc.towards);
                self.keep(Csc { first_towards, first: PI, straight: -rest.z, last_towards, last: arc.angle });
            }
        }
        for arc in arcs_between(&start, &-direction) {
            // Half a turn last.
            let rest = goal - arc.offset;
            let straight = -rest.dot(&direction);
            let towards = rest + direction * straight;
            if (towards.norm() - 2.0).abs() < NEARLY {
                let first_towards = in_tip(&Matrix3::identity(), &arc.towards);
                let last_towards = in_tip(&axes_after(first_towards, arc.angle), &towards);
                self.keep(Csc { first_towards, first: arc.angle, straight, last_towards, last: PI });
            }
        }
    }

    /// Both arcs are half turns. The angle between their planes depends on the distance across.
    fn two_half_turns(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        let across = 0.25 * trigonometry::hypot(goal.x, goal.y);
        if across <= 1.0 && direction.z > 1.0 - NEARLY {
            let (middle, half_angle) = (libm::atan2(goal.y, goal.x), trigonometry::acos(across));
            for half_angle in [half_angle, -half_angle] {
                let axes = axes_after(middle + half_angle, PI);
                let (sin, cos) = trigonometry::sin_cos(middle - half_angle);
                let last_towards = in_tip(&axes, &Vector3::new(cos, sin, 0.0));
                self.keep(Csc {
                    first_towards: middle + half_angle,
                    first: PI,
                    straight: -goal.z,
                    last_towards,
                    last: PI,
                });
            }
        }
    }
}

/// An arc from one direction to another.
struct ArcBetween {
    angle: f64,
    offset: Vector3<f64>,
    towards: Vector3<f64>,
}

/// The two arcs from one direction to another: the short and the long way. Any plane is used if none is determined.
fn arcs_between(from: &Vector3<f64>, to: &Vector3<f64>) -> [ArcBetween; 2] {
    let cos = from.dot(to);
    let across = to - from * cos;
    let sin = across.norm();
    let towards = if sin > 1e-14 { across / sin } else { any_perpendicular(from) };
    let angle = libm::atan2(sin, cos);
    let short = ArcBetween { angle, offset: from * sin + towards * (1.0 - cos), towards };
    let long = ArcBetween { angle: TAU - angle, offset: -short.offset, towards: -towards };
    [short, long]
}
