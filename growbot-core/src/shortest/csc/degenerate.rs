//! Special paths that the search for roots of the polynomial does not find: paths with an arc of no length or of half a
//! turn, and paths whose lines along the start's and the goal's direction cross.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::far::FAR;
use super::{Csc, CscSearch, MAX_NEWTON_START_ERROR, cosine, in_tip};
use crate::shortest::problem::{MAX_GOAL_ERROR, PathProblem, any_perpendicular};
use crate::trigonometry;

/// Max error at the goal, radii and radians, at which a single arc counts as nearly leading to the goal.
const SHORT: f64 = 4e-3;
/// Max cosine of half the angle between the planes of two half turns. A larger cosine is reduced to this value, because
/// Newton's method would not leave a common plane.
const APART: f64 = 0.999_98;
/// Max difference between half a turn and the angle of an arc, radians, if the line beside the arc is longer than
/// [`FAR`].
const LITTLE: f64 = 0.02;

impl CscSearch<'_> {
    /// Finds the paths to a goal for which the line along the start's direction and the line along the goal's direction
    /// cross, or nearly cross. For such a goal, the polynomial does not determine the plane of the last arc. The
    /// corners of both arcs coincide, and the path's line leaves the plane on one side or the other.
    #[inline(never)]
    pub(super) fn crossing_lines(&mut self) {
        let PathProblem { goal, direction, .. } = *self.problem;
        let start = Vector3::z();
        let cosine_between = direction.z;
        let det = 1.0 - cosine_between * cosine_between;
        let normal = start.cross(&direction);
        if det < 1e-6 || goal.dot(&normal).abs() > MAX_NEWTON_START_ERROR {
            return;
        }
        // Solves [1 c; c 1] [x; y] = [a; b].
        let solve = |a: f64, b: f64| ((a - cosine_between * b) / det, (b - cosine_between * a) / det);
        let (first_tau, last_tau) = solve(goal.z, goal.dot(&direction));
        let straight = -(first_tau + last_tau);
        let (first_cosine, last_cosine) = (cosine(first_tau), cosine(last_tau));
        let (along_start, along_goal) = solve(first_cosine, last_cosine);
        let off = 1.0 - (along_start * first_cosine + along_goal * last_cosine);
        if straight < -MAX_NEWTON_START_ERROR || off < -MAX_NEWTON_START_ERROR {
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
            self.keep(Csc {
                first_bend_direction: first_towards,
                first_angle: first,
                straight,
                last_bend_direction: last_towards,
                last_angle: last,
            });
        }
    }

    /// Finds the paths whose line is parallel to the start's or the goal's direction. One arc of such a path has no
    /// length or is half a turn, so its plane is undetermined, and the polynomial does not change its sign at the root.
    #[inline(never)]
    pub(super) fn special_lines(&mut self) {
        self.one_arc();
        self.almost_one_arc();
        self.half_turns();
        self.two_half_turns();
    }

    /// Finds the paths in which one of the two arcs has no length.
    fn one_arc(&mut self) {
        let PathProblem { goal, direction, .. } = *self.problem;
        for arc in arcs_between(&Vector3::z(), &direction) {
            let rest = goal - arc.offset;
            let towards = || in_tip(&Matrix3::identity(), &arc.towards);
            // A line straight ahead from the start.
            if trigonometry::hypot(rest.x, rest.y) < MAX_NEWTON_START_ERROR {
                self.keep(Csc {
                    first_bend_direction: 0.0,
                    first_angle: 0.0,
                    straight: rest.z,
                    last_bend_direction: towards(),
                    last_angle: arc.angle(),
                });
            }
            // A line straight into the goal.
            let straight = rest.dot(&direction);
            if (rest - direction * straight).norm() < MAX_NEWTON_START_ERROR {
                self.keep(Csc {
                    first_bend_direction: towards(),
                    first_angle: arc.angle(),
                    straight,
                    last_bend_direction: 0.0,
                    last_angle: 0.0,
                });
            }
        }
    }

    /// Finds the paths to a goal that a single arc nearly reaches. The line of such a path is short, and its other arc
    /// is short too, or nearly a whole turn.
    ///
    /// If the other arc turns in the plane of the long arc, the long arc compensates for this turn, to first order. So
    /// the code tries several angles of the other arc, and Newton's method corrects the remaining numbers.
    #[inline(never)]
    fn almost_one_arc(&mut self) {
        let PathProblem { goal, direction, .. } = *self.problem;
        let (squared, across) = (goal.norm_squared(), trigonometry::hypot(goal.x, goal.y));
        let off = (squared - 2.0 * across).abs();
        if across < SHORT || off > SHORT {
            return;
        }
        // The arc through the goal turns by twice the angle of the chord.
        let off = off + (goal * (2.0 * goal.z / squared) - Vector3::z() - direction).norm();
        if !(MAX_GOAL_ERROR..SHORT).contains(&off) {
            return;
        }
        let (towards, angle) = (libm::atan2(goal.y, goal.x), 2.0 * libm::atan2(across, goal.z));
        for short in [0.0, 0.25, -0.25, 1.0, -1.0, 4.0, -4.0].map(|share| share * off) {
            for (other, same_way) in [(short.abs(), short >= 0.0), (TAU - short.abs(), short < 0.0)] {
                let other_towards = if same_way { towards } else { towards + PI };
                let [long, other] = [(towards, angle - short), (other_towards, other)];
                for [(first_towards, first), (last_towards, last)] in [[other, long], [long, other]] {
                    self.keep(Csc {
                        first_bend_direction: first_towards,
                        first_angle: first,
                        straight: 0.0,
                        last_bend_direction: last_towards,
                        last_angle: last,
                    });
                }
            }
        }
    }

    /// Finds the paths in which one of the two arcs is half a turn.
    fn half_turns(&mut self) {
        let PathProblem { goal, direction, .. } = *self.problem;
        let start = Vector3::z();
        for arc in arcs_between(&-start, &direction) {
            // The first arc is half a turn. The rest of the path determines its plane.
            let rest = goal - arc.offset;
            for half in about_half_turns(Vector3::new(rest.x, rest.y, 0.0), -rest.z) {
                let first_towards = libm::atan2(half.towards.y, half.towards.x);
                let last_towards = in_tip(&axes_after(first_towards, half.angle), &arc.towards);
                self.keep(Csc {
                    first_bend_direction: first_towards,
                    first_angle: half.angle,
                    straight: -rest.z,
                    last_bend_direction: last_towards,
                    last_angle: arc.angle(),
                });
            }
        }
        for arc in arcs_between(&start, &-direction) {
            // The last arc is half a turn.
            let rest = goal - arc.offset;
            let straight = -rest.dot(&direction);
            for half in about_half_turns(rest + direction * straight, straight) {
                let first_towards = in_tip(&Matrix3::identity(), &arc.towards);
                let last_towards = in_tip(&axes_after(first_towards, arc.angle()), &half.towards);
                self.keep(Csc {
                    first_bend_direction: first_towards,
                    first_angle: arc.angle(),
                    straight,
                    last_bend_direction: last_towards,
                    last_angle: half.angle,
                });
            }
        }
    }

    /// Finds the paths in which both arcs are half turns. The distance of the goal from the line along the start's
    /// direction determines the angle between the planes of the arcs.
    fn two_half_turns(&mut self) {
        let PathProblem { goal, direction, .. } = *self.problem;
        let across = 0.25 * trigonometry::hypot(goal.x, goal.y);
        if across <= 1.0 + MAX_NEWTON_START_ERROR && direction.z > 1.0 - MAX_NEWTON_START_ERROR {
            // If both arcs began in one plane, Newton's method would not leave it.
            let half_angle = trigonometry::acos(across.min(APART));
            let middle = libm::atan2(goal.y, goal.x);
            for half_angle in [half_angle, -half_angle] {
                let axes = axes_after(middle + half_angle, PI);
                let (sin, cos) = trigonometry::sin_cos(middle - half_angle);
                let last_towards = in_tip(&axes, &Vector3::new(cos, sin, 0.0));
                self.keep(Csc {
                    first_bend_direction: middle + half_angle,
                    first_angle: PI,
                    straight: -goal.z,
                    last_bend_direction: last_towards,
                    last_angle: PI,
                });
            }
        }
    }
}

/// An arc of about half a turn: its angle (radians), and the direction in which it bends.
struct HalfTurn {
    angle: f64,
    towards: Vector3<f64>,
}

/// Returns the arcs of about half a turn that displace the end of the path by `across` (radii), before or after a line
/// of length `straight` (radii). If the line is long, an arc that differs slightly from half a turn turns the line, and
/// the line contributes to the displacement.
fn about_half_turns(across: Vector3<f64>, straight: f64) -> impl Iterator<Item = HalfTurn> {
    let size = across.norm();
    [across, -across].into_iter().zip([size, -size]).filter_map(move |(towards, size)| {
        let off = size - 2.0;
        let is_far = straight > FAR && off.abs() < LITTLE * straight;
        let angle = if is_far { PI - off / straight } else { PI };
        (is_far || off.abs() < MAX_NEWTON_START_ERROR).then_some(HalfTurn { angle, towards })
    })
}

/// An arc of radius 1 that turns the tip from one direction to another.
struct ArcBetween {
    /// Sine of the smaller angle between the two directions. `cos` is the cosine of this angle.
    sin: f64,
    cos: f64,
    is_long: bool,
    offset: Vector3<f64>,
    towards: Vector3<f64>,
}

impl ArcBetween {
    fn angle(&self) -> f64 {
        let short = libm::atan2(self.sin, self.cos);
        if self.is_long { TAU - short } else { short }
    }
}

/// Returns the two arcs that turn the tip from one direction to another: the first turns by the smaller angle, the
/// second by the larger angle. If the directions determine no plane, any plane is used.
fn arcs_between(from: &Vector3<f64>, to: &Vector3<f64>) -> [ArcBetween; 2] {
    let cos = from.dot(to);
    let across = to - from * cos;
    let sin = across.norm();
    let towards = if sin > 1e-14 { across / sin } else { any_perpendicular(from) };
    let short = ArcBetween { sin, cos, is_long: false, offset: from * sin + towards * (1.0 - cos), towards };
    let long = ArcBetween { is_long: true, offset: -short.offset, towards: -towards, ..short };
    [short, long]
}

/// Returns the axes of a tip after an arc, in the axes of the tip before the arc. The arc turns by `angle` and bends
/// towards the angle `towards` of the deposition plane, both in radians.
fn axes_after(towards: f64, angle: f64) -> Matrix3<f64> {
    crate::kinematics::step(towards + PI, angle, angle).rotation.into_inner()
}
