//! Refinement of a seed by the Levenberg-Marquardt method.
//!
//! The five unknowns are the logarithms of the two numbers at the neck, the lengths before and after the neck, and the
//! roll.

use nalgebra::{Matrix3, Matrix5, Matrix6x5, Vector3, Vector5, Vector6};

use super::neck::{Neck, Point};
use crate::linalg5::Cholesky;
use crate::shortest::Problem;

/// Max number of rounds with the coarse integration. Trial: with 7 there are 14 misses, with 30 as many as with 15.
const COARSE_ROUNDS: usize = 15;
/// Max number of rounds with the fine integration. Trial: with 6 and 24 there are 31 and 9 misses; more cost time.
const FINE_ROUNDS: usize = 12;
/// Max misfit after the coarse rounds. Trial: with 1e-3 and 0.03 there are 13 and 12 misses, with 0.01 as many as
/// with 3e-3.
const COARSE_MISFIT: f64 = 3e-3;
/// Max misfit after the fine rounds. Trial: 1e-13 and 1e-10 give as many misses as now.
const FINE_MISFIT: f64 = 1e-11;
/// Share to which three coarse rounds must reduce the square of the misfit; else they stop. Trial: 0.1 and 0.9 give
/// as many misses as now.
const FALL: f64 = 0.5;
/// Max number of dampings tried in one round. Trial: with 2 there are 12 misses, with 10 as many as with 5.
const MAX_DAMPINGS: usize = 5;

/// An arc that leads nearly to the goal, by four of the unknowns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seed {
    /// Logarithm of [`Neck::narrowness`].
    pub(super) narrowness: f64,
    /// Logarithm of the absolute value of [`Neck::twist`].
    pub(super) twist: f64,
    /// The twist is negative: the curve is mirrored.
    pub(super) mirrored: bool,
    /// Length before the neck, radii.
    pub(super) before: f64,
    /// Length after the neck, radii.
    pub(super) after: f64,
}

impl Seed {
    pub(super) fn neck(&self) -> Neck {
        let twist = libm::exp(self.twist);
        Neck { narrowness: libm::exp(self.narrowness), twist: if self.mirrored { -twist } else { twist } }
    }

    pub(super) fn length(&self) -> f64 {
        self.before + self.after
    }

    fn in_range(&self, longest: f64) -> bool {
        (0.01..longest + 1.0).contains(&self.length())
            && (-28.0..3.0).contains(&self.narrowness)
            && (-14.0..4.0).contains(&self.twist)
            && self.before.abs() < 12.0
            && self.after.abs() < 12.0
    }
}

/// `neck_from_start`: the axes of a start that grows along the curve, with the roll that brings the goal nearest to the
/// end.
pub(super) fn axes(problem: &Problem, start: &Point, end: &Point) -> Matrix3<f64> {
    let z = start.direction;
    let mut other = Vector3::zeros();
    if let Some(component) = other.get_mut(z.iamin()) {
        *component = 1.0;
    }
    let x = z.cross(&other).normalize();
    let unrolled = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let (offset, direction) = (unrolled.tr_mul(&(end.position - start.position)), unrolled.tr_mul(&end.direction));
    // The rotation of one pair of vectors in a plane that fits it best to another pair.
    let (goal, target) = (problem.goal, problem.direction);
    let cos = goal.x * offset.x + goal.y * offset.y + target.x * direction.x + target.y * direction.y;
    let sin = goal.x * offset.y - goal.y * offset.x + target.x * direction.y - target.y * direction.x;
    let norm = libm::sqrt(cos * cos + sin * sin);
    let (cos, sin) = if norm > 0.0 { (cos / norm, sin / norm) } else { (1.0, 0.0) };
    unrolled * Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// An arc laid into the problem.
struct Fit {
    start: Point,
    end: Point,
    axes: Matrix3<f64>,
    misfit: Vector6<f64>,
}

impl Fit {
    fn new(problem: &Problem, seed: &Seed, fine: bool, keep_alive: &mut dyn FnMut()) -> Self {
        let (start, end) = seed.neck().ends(-seed.before, seed.after, fine, keep_alive);
        let axes = axes(problem, &start, &end);
        Self { start, end, axes, misfit: misfit(problem, &start, &end, &axes) }
    }

    /// Derivatives of the misfit with respect to the five unknowns.
    fn jacobian(&self, problem: &Problem, seed: &Seed, fine: bool, keep_alive: &mut dyn FnMut()) -> Matrix6x5<f64> {
        let neck = seed.neck();
        let share = if fine { 1e-6 } else { 1e-5 };
        let narrower = Neck { narrowness: neck.narrowness * (1.0 + share), ..neck };
        let twisted = Neck { twist: neck.twist * (1.0 + share), ..neck };
        let [by_narrowness, by_twist] = [narrower, twisted].map(|changed| {
            keep_alive();
            let (start, end) = changed.ends(-seed.before, seed.after, fine, keep_alive);
            let axes = shortest_turn(&self.start.direction, &start.direction) * self.axes;
            (misfit(problem, &start, &end, &axes) - self.misfit) / share
        });
        let (goal, target) = (self.axes * problem.goal, self.axes * problem.direction);
        let (start_axis, end_axis) = (neck.axis(&self.start), neck.axis(&self.end));
        let (start_direction, direction) = (&self.start.direction, &self.end.direction);
        Matrix6x5::from_columns(&[
            by_narrowness,
            by_twist,
            stacked(&(start_direction + start_axis.cross(&goal)), &start_axis.cross(&target)),
            stacked(direction, &end_axis.cross(direction)),
            stacked(&-start_direction.cross(&goal), &-start_direction.cross(&target)),
        ])
    }
}

fn stacked(offset: &Vector3<f64>, turned: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(offset.x, offset.y, offset.z, turned.x, turned.y, turned.z)
}

/// Offset of the arc's end from the goal, and difference of the directions.
fn misfit(problem: &Problem, start: &Point, end: &Point, axes: &Matrix3<f64>) -> Vector6<f64> {
    stacked(&(end.position - start.position - axes * problem.goal), &(end.direction - axes * problem.direction))
}

/// The smallest rotation that turns one unit vector into another.
fn shortest_turn(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let cross = from.cross(to).cross_matrix();
    Matrix3::identity() + cross + cross * cross / (1.0 + from.dot(to)).max(1e-9)
}

/// The arc near a seed that leads to the goal. None if the method does not converge.
#[inline(never)]
pub(super) fn refined(
    problem: &Problem,
    seed: &Seed,
    longest: f64,
    fine: bool,
    keep_alive: &mut dyn FnMut(),
) -> Option<Seed> {
    let arrived = if fine { FINE_MISFIT } else { COARSE_MISFIT };
    let mut seed = *seed;
    let mut fit = Fit::new(problem, &seed, fine, keep_alive);
    let mut damping = if fine { 1e-6 } else { 1e-3 };
    let mut before = f64::INFINITY;
    for round in 0..if fine { FINE_ROUNDS } else { COARSE_ROUNDS } {
        keep_alive();
        let square = fit.misfit.norm_squared();
        if square <= arrived * arrived {
            return Some(seed);
        }
        if round % 3 == 0 {
            if !fine && square > FALL * before {
                return None;
            }
            before = square;
        }
        let jacobian = fit.jacobian(problem, &seed, fine, keep_alive);
        let normal = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&fit.misfit);
        let mut better = None;
        for _ in 0..MAX_DAMPINGS {
            let damped = normal + Matrix5::identity() * (damping * 0.2 * normal.trace() + 1e-14);
            if let Some(factors) = Cholesky::new(&damped) {
                let step: Vector5<f64> = -factors.solve(&gradient);
                let step = step / step.amax().max(1.0);
                let next = Seed {
                    narrowness: seed.narrowness + step[0],
                    twist: seed.twist + step[1],
                    before: seed.before + step[2],
                    after: seed.after + step[3],
                    ..seed
                };
                if next.in_range(longest) {
                    keep_alive();
                    let next_fit = Fit::new(problem, &next, fine, keep_alive);
                    if next_fit.misfit.norm_squared() < square {
                        better = Some((next, next_fit));
                        break;
                    }
                }
            }
            damping = (damping * 10.0).max(1e-4);
        }
        (seed, fit) = better?;
        damping = if damping < 1e-8 { 0.0 } else { 0.1 * damping };
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(50))]

        #[test]
        fn an_arc_that_is_a_little_off_is_found_again(
            narrowness in -1.5..-0.5, twist in -1.0..0.0, before in 0.8..1.6, after in 0.8..1.6,
            mirrored in any::<bool>(),
            off in prop::array::uniform4(-0.01..0.01),
        ) {
            let arc = Seed { narrowness, twist, mirrored, before, after };
            let (start, end) = arc.neck().ends(-before, after, true, &mut || ());
            let start_from_neck = Rotation3::rotation_between(&start.direction, &Vector3::z()).unwrap();
            let goal = start_from_neck * (end.position - start.position);
            let problem = Problem::new(&goal, &(start_from_neck * end.direction));
            let [a, b, c, d] = off;
            let seed =
                Seed { narrowness: narrowness + a, twist: twist + b, before: before + c, after: after + d, mirrored };
            let found = refined(&problem, &seed, 8.0, true, &mut || ()).unwrap();
            let fit = Fit::new(&problem, &found, true, &mut || ());
            prop_assert!(fit.misfit.norm() <= FINE_MISFIT);
            prop_assert!((found.length() - arc.length()).abs() < 1e-6, "{found:?} for {arc:?}");
        }
    }
}
