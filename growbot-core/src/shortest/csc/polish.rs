//! Newton's method on the five numbers of a path, which moves the path's end exactly to the goal. The method is regular
//! for arcs of 0 and of whole turns.
//!
//! An arc of angle `a` that bends in the direction `n` is a point in a plane with the polar coordinates `a` and `n`. So
//! its direction is undetermined if the angle is 0 or a whole turn. The unknowns are therefore the change of `a`, and
//! `eta`, the displacement across `n` in that plane (scaled by `2 sin(a/2)` at larger distances).

use core::f64::consts::TAU;

use nalgebra::{Matrix5, Vector3, Vector5};

use super::{Csc, MAX_NEWTON_START_ERROR};
use crate::linalg5::{Cholesky, solve};
use crate::shortest::problem::{MAX_GOAL_ERROR, PathProblem};
use crate::trigonometry;

/// Max number of Newton steps.
const MAX_ROUNDS: u32 = 24;
/// Max amount by which rounding errors may make the length of a line negative, radii.
const ROUNDING: f64 = 1e-9;
/// Max amount by which the length of a line may be negative, radii, for its sign to be reversed once. Near a fold of
/// the solutions two paths are close, and one of them may have a line of positive length.
const REFLECTED: f64 = 1e-4;
/// Max size of a Newton step, radii and radians. If the step is longer, it is replaced by the damped least-squares
/// step, the smallest step that corrects the error.
const LONG_STEP: f64 = 0.3;
/// Max difference (radians) of an arc's angle from 0 or from a whole turn at which the arc is treated as a point in
/// polar coordinates.
const POLAR: f64 = 0.5;

/// Treatment of a line for which Newton's method gives a slightly negative length.
#[derive(Clone, Copy, PartialEq)]
enum ShortLineCase {
    Any,
    /// The sign of the length was reversed once.
    Reflected,
    /// The line has no length. Either the path still ends at the goal to within [`MAX_GOAL_ERROR`], or it does not
    /// exist.
    LeftOut,
}

/// A Newton step: the changes of the five numbers that describe a path.
struct PolishStep {
    first_across: f64,
    first: f64,
    straight: f64,
    last_across: f64,
    last: f64,
}

impl PathProblem {
    /// Returns a path close to `path` that ends at the goal to within [`MAX_GOAL_ERROR`], after Newton's method if
    /// necessary. `None` if the method does not converge.
    pub(super) fn polished(&self, mut path: Csc) -> Option<Csc> {
        let mut line = ShortLineCase::Any;
        for _ in 0..MAX_ROUNDS {
            let chain = Chain::new(&path);
            let lack = self.residual(&chain);
            let miss = lack.amax();
            if miss <= MAX_GOAL_ERROR * self.scale {
                let min = path.first_angle.min(path.straight).min(path.last_angle);
                if min >= 0.0 {
                    return Some(path);
                }
                if min < -ROUNDING {
                    if path.straight < -REFLECTED || path.straight > -ROUNDING {
                        return None;
                    }
                    (line, path.straight) = match line {
                        ShortLineCase::Any => (ShortLineCase::Reflected, -path.straight),
                        ShortLineCase::Reflected => (ShortLineCase::LeftOut, 0.0),
                        ShortLineCase::LeftOut => return None,
                    };
                    continue;
                }
                path.first_angle = path.first_angle.max(0.0);
                path.straight = path.straight.max(0.0);
                path.last_angle = path.last_angle.max(0.0);
                continue;
            }
            if miss.is_nan() || miss > MAX_NEWTON_START_ERROR * (1.0 + 4.0 * self.scale) {
                return None;
            }
            let step = self.newton_step(&chain, &lack, line)?;
            path = changed(path, &step);
            if line == ShortLineCase::LeftOut {
                path.straight = 0.0;
            }
        }
        None
    }

    /// Returns the Newton step that corrects the error at the goal.
    #[inline(never)]
    fn newton_step(&self, chain: &Chain, lack: &Vector5<f64>, line: ShortLineCase) -> Option<PolishStep> {
        let mut jacobian = self.jacobian(chain);
        if line == ShortLineCase::LeftOut {
            jacobian.column_mut(2).fill(0.0);
        }
        let step = match solve(&jacobian, lack).filter(|step| step.amax() <= LONG_STEP * self.scale) {
            Some(step) => step,
            None => {
                let mut square = jacobian * jacobian.transpose();
                let damping = square.trace() * 1e-14;
                for index in 0..5 {
                    square[(index, index)] += damping;
                }
                jacobian.tr_mul(&Cholesky::new(&square)?.solve(lack))
            }
        };
        let [first_across, first, straight, last_across, last] = step.into();
        Some(PolishStep { first_across, first, straight, last_across, last })
    }

    /// Returns an offset (three numbers) and a change of direction (two numbers) as one vector. The two numbers are the
    /// components along the two axes perpendicular to the goal's direction.
    pub(in crate::shortest) fn column(&self, offset: &Vector3<f64>, turned: &Vector3<f64>) -> Vector5<f64> {
        let [e1, e2] = &self.across;
        Vector5::new(offset.x, offset.y, offset.z, turned.dot(e1), turned.dot(e2))
    }

    /// Returns the differences of position and direction between the goal and the end of a path.
    fn residual(&self, chain: &Chain) -> Vector5<f64> {
        // If the direction is opposite to the goal's, its components perpendicular to the goal's direction would be
        // small too.
        let direction = if chain.direction.dot(&self.direction) > 0.0 { -chain.direction } else { self.across[0] };
        self.column(&(self.goal - chain.end), &direction)
    }

    /// Returns the derivatives of the position and direction at the path's end with respect to the five unknowns.
    fn jacobian(&self, chain: &Chain) -> Matrix5<f64> {
        let Chain { axis, edge, first_half, u, corner, side, last_half, end, direction } = chain;
        let [last_half_sin, last_half_cos] = last_half;
        Matrix5::from_columns(&[
            self.column(&(edge.cross(end) - axis * *first_half), &edge.cross(direction)),
            self.column(&(axis.cross(&(end - corner)) + u), &axis.cross(direction)),
            self.column(u, &Vector3::zeros()),
            self.column(&(side * *last_half_sin), &(side * *last_half_cos)),
            self.column(direction, &side.cross(direction)),
        ])
    }
}

/// Returns the path after a Newton step. The length of the whole path changes by the sum of the changes of both angles
/// and of the line.
fn changed(path: Csc, change: &PolishStep) -> Csc {
    let length = path.length() + change.first + change.straight + change.last;
    let (first_towards, first) =
        arc_changed(path.first_bend_direction, path.first_angle, change.first_across, change.first);
    let (last_towards, last) = arc_changed(path.last_bend_direction, path.last_angle, change.last_across, change.last);
    Csc {
        first_bend_direction: first_towards,
        first_angle: first,
        straight: length - first - last,
        last_bend_direction: last_towards,
        last_angle: last,
    }
}

fn arc_changed(towards: f64, angle: f64, across: f64, change: f64) -> (f64, f64) {
    if angle < POLAR {
        let along = angle + change;
        (towards + libm::atan2(across, along), trigonometry::hypot(along, across))
    } else if angle > TAU - POLAR {
        let along = TAU - angle - change;
        (towards + libm::atan2(across, along), TAU - trigonometry::hypot(along, across))
    } else {
        (towards + across / (2.0 * trigonometry::sin(0.5 * angle)), angle + change)
    }
}

/// Positions (radii), axes and directions at the joints between the arcs and the line of a path. `a` is the angle of
/// the first arc, `n` the direction in which it bends, and `b` the angle of the last arc.
struct Chain {
    /// Axis about which the first arc turns.
    axis: Vector3<f64>,
    /// Axis about which the first arc turns if it is displaced across its bend direction `n`: `z sin(a/2) - n
    /// cos(a/2)`.
    edge: Vector3<f64>,
    /// `sin(a/2)` for the angle `a` of the first arc.
    first_half: f64,
    /// Direction of the line.
    u: Vector3<f64>,
    /// Position of the end of the first arc.
    corner: Vector3<f64>,
    /// Axis about which the last arc turns.
    side: Vector3<f64>,
    /// `sin(b/2)` and `cos(b/2)` for the angle `b` of the last arc.
    last_half: [f64; 2],
    /// Position of the end of the path.
    end: Vector3<f64>,
    /// Direction of the end of the path.
    direction: Vector3<f64>,
}

impl Chain {
    #[inline(never)]
    fn new(path: &Csc) -> Self {
        let (sin_towards, cos_towards) = trigonometry::sin_cos(path.first_bend_direction);
        let bend = Vector3::new(cos_towards, sin_towards, 0.0);
        let axis = Vector3::new(-sin_towards, cos_towards, 0.0);
        let (half_sin, half_cos) = trigonometry::sin_cos(0.5 * path.first_angle);
        let (sin, versine) = (2.0 * half_sin * half_cos, 2.0 * half_sin * half_sin);
        let ahead = Vector3::z();
        let u = ahead * (1.0 - versine) + bend * sin;
        let corner = ahead * sin + bend * versine;
        let edge = ahead * half_sin - bend * half_cos;

        // The tip's x and y axes after the first arc are those at the start, turned about `axis`.
        let (sin_last, cos_last) = trigonometry::sin_cos(path.last_bend_direction - path.first_bend_direction);
        let across = bend * (1.0 - versine) - ahead * sin;
        let towards = across * cos_last + axis * sin_last;
        let side = axis * cos_last - across * sin_last;
        let (last_sin, last_cos) = trigonometry::sin_cos(0.5 * path.last_angle);
        let (sin, versine) = (2.0 * last_sin * last_cos, 2.0 * last_sin * last_sin);
        let end = corner + u * (path.straight + sin) + towards * versine;
        let direction = u * (1.0 - versine) + towards * sin;
        Self { axis, edge, first_half: half_sin, u, corner, side, last_half: [last_sin, last_cos], end, direction }
    }
}
