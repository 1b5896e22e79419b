//! Refinement of a seed by Newton's method, or by the Levenberg-Marquardt method if Newton's method fails.
//!
//! The five unknowns are the logarithms of the two numbers at the neck (narrowness and twist), the lengths before and
//! after the neck, and the roll.

use nalgebra::{Matrix5, Matrix6x5, Vector3, Vector5, Vector6};

use super::fit::{Fit, FitGoal};
use super::precision::Precision;
use super::seed::Seed;
use crate::float::PortableFloat;
use crate::linalg5::{self, Cholesky};

/// Max number of dampings that a step of the Levenberg-Marquardt method tries.
const MAX_DAMPINGS: usize = 2;
const MAX_HALVINGS: usize = 3;
/// Max number of refinements of one arc. After each of them, the phases of the arc may have to be counted from another
/// neck.
const MAX_VIEWS: u32 = 2;
/// Max change of the logarithm of `|m|` at a very narrow neck in one step.
const MAX_NARROWER: f64 = 0.5;

/// Returns Newton's step. It is computed without the normal equations, whose squares would lose half of the digits,
/// because near a circle few digits are significant. `None` if the derivatives are singular.
#[inline(never)]
fn newton<T: PortableFloat>(
    jacobian: &Matrix6x5<T>,
    misfit: &Vector6<T>,
    fit: &Fit<T>,
    goal: &FitGoal<T>,
) -> Option<Vector5<T>> {
    let target = fit.axes * goal.direction;
    let mut other = Vector3::new(T::literal(0.0), T::literal(0.0), T::literal(0.0));
    if let Some(component) = other.get_mut(target.iamin()) {
        *component = T::literal(1.0);
    }
    let e1 = target.cross(&other);
    let e1 = e1 / e1.norm_squared().root();
    let e2 = target.cross(&e1);
    let five = |[x, y, z, a, b, c]: [T; 6]| {
        let direction = Vector3::new(a, b, c);
        Vector5::new(x, y, z, e1.dot(&direction), e2.dot(&direction))
    };
    let columns = jacobian.data.0.map(five);
    linalg5::solve(&Matrix5::from_columns(&columns), &-five((*misfit).into()))
}

/// Result of the refinement of a seed.
pub(super) enum Refinement<T: PortableFloat> {
    /// The arc leads to the goal.
    Converged(Seed<T>, Fit<T>),
    /// The method did not converge. The values are those of the last arc that it reached.
    NotConverged(Seed<T>, Fit<T>),
}

impl<T: Precision> Seed<T> {
    /// Returns the arc after a step of the refinement. `step` holds the changes of narrowness and twist, and of the
    /// lengths before and after the neck.
    fn changed(&self, step: &Vector5<T>, fit: &Fit<T>) -> Self {
        Self {
            narrowness: self.narrowness + step[0],
            twist: self.twist + step[1] + self.twist_by_narrowness() * step[0],
            start: self.start - step[2] / fit.start.rate,
            end: self.end + step[3] / fit.end.rate,
            ..*self
        }
    }
}

/// Refines a seed in double precision to the arc that leads to the goal, with phases that are counted from a neck.
/// `None` if the refinement does not converge.
pub(super) fn refined_precisely(
    goal: &FitGoal<f64>,
    seed: &Seed<f64>,
    keep_alive: &mut dyn FnMut(),
) -> Option<(Seed<f64>, Fit<f64>)> {
    let mut seed = seed.seen_from_neck().with_circles();
    for _ in 0..MAX_VIEWS {
        let Refinement::Converged(arc, fit) = refine(goal, &seed, keep_alive) else { return None };
        if arc.is_seen_from_neck() {
            return Some((arc, fit));
        }
        seed = arc.seen_from_neck();
    }
    None
}

/// Refines a seed to the arc that leads to the goal, in the precision of `T`.
#[inline(never)]
pub(super) fn refine<T: Precision>(goal: &FitGoal<T>, seed: &Seed<T>, keep_alive: &mut dyn FnMut()) -> Refinement<T> {
    let mut seed = *seed;
    let mut fit = Fit::new(goal, &seed);
    let mut damping = T::DAMPING;
    let mut before = T::literal(1e30);
    let mut jacobian = None;
    for round in 0..T::ROUNDS {
        keep_alive();
        let square = fit.misfit.norm_squared();
        if square <= T::MISFIT * T::MISFIT {
            return Refinement::Converged(seed, fit);
        }
        if round % 3 == 0 {
            if square > T::FALL * before {
                break;
            }
            before = square;
        }
        let derivatives = match jacobian {
            Some(known) => known,
            None => fit.jacobian(goal, &seed),
        };
        jacobian = None;
        if let Some((next, next_fit, share)) = newton_step(goal, &seed, &fit, &derivatives) {
            (seed, fit) = (next, next_fit);
            if share < T::literal(0.1) {
                jacobian = Some(derivatives);
            }
        } else if let Some((next, next_fit)) = damped_step(goal, &seed, &fit, &derivatives, &mut damping) {
            (seed, fit) = (next, next_fit);
        } else {
            break;
        }
    }
    Refinement::NotConverged(seed, fit)
}

/// Returns the arc after a step of Newton's method, damped by Deuflhard's natural monotonicity test. The third value is
/// the size of the next step as a fraction of the size of this step. `None` if no damping passes the test.
#[inline(never)]
fn newton_step<T: Precision>(
    goal: &FitGoal<T>,
    seed: &Seed<T>,
    fit: &Fit<T>,
    jacobian: &Matrix6x5<T>,
) -> Option<(Seed<T>, Fit<T>, T)> {
    let mut full = newton(jacobian, &fit.misfit, fit, goal)?;
    let size = seed.size(&full);
    if seed.uses_circles {
        // The narrowness converges last, after all other unknowns.
        full[0] = full[0].max(T::literal(-MAX_NARROWER)).min(T::literal(MAX_NARROWER));
    }
    let mut share = T::literal(1.0).min(T::literal(1.0) / full.amax());
    for _ in 0..MAX_HALVINGS {
        let next = seed.changed(&(full * share), fit);
        if next.in_range() {
            let next_fit = Fit::new(goal, &next);
            let rest = seed.size(&newton(jacobian, &next_fit.misfit, fit, goal)?);
            if rest <= (T::literal(1.0) - T::literal(0.25) * share) * size {
                return Some((next, next_fit, rest / size));
            }
        }
        share *= T::literal(0.5);
    }
    None
}

/// Returns the arc after a step of the Levenberg-Marquardt method. `None` if no damping reduces the residual.
#[inline(never)]
fn damped_step<T: Precision>(
    goal: &FitGoal<T>,
    seed: &Seed<T>,
    fit: &Fit<T>,
    jacobian: &Matrix6x5<T>,
    damping: &mut T,
) -> Option<(Seed<T>, Fit<T>)> {
    let normal = jacobian.tr_mul(jacobian);
    let gradient = jacobian.tr_mul(&fit.misfit);
    let square = fit.misfit.norm_squared();
    for _ in 0..MAX_DAMPINGS {
        let mut damped = normal;
        for index in 0..5 {
            damped[(index, index)] += *damping * normal[(index, index)] + T::literal(1e-14);
        }
        if let Some(factors) = Cholesky::new(&damped) {
            let step: Vector5<T> = -factors.solve(&gradient);
            let next = seed.changed(&(step / step.amax().max(T::literal(1.0))), fit);
            if next.in_range() {
                let next_fit = Fit::new(goal, &next);
                if next_fit.misfit.norm_squared() < square {
                    *damping *= T::literal(0.1);
                    return Some((next, next_fit));
                }
            }
        }
        *damping = (*damping * T::literal(10.0)).max(T::literal(1e-4));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    /// Returns the goal at the end of an arc, and the length of the arc.
    fn goal_of(arc: &Seed<f64>) -> (FitGoal<f64>, f64) {
        let [start, end] = arc.ends(&arc.curve());
        let start_from_curve = Rotation3::rotation_between(&start.direction, &Vector3::z()).unwrap();
        let position = start_from_curve * (end.position - start.position);
        (FitGoal { position, direction: start_from_curve * end.direction }, end.length - start.length)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn a_perturbed_arc_is_refined_to_the_original(
            narrowness in -4.0..-0.5, twist in -1.0..0.0, start in -3.0..-0.8, end in 0.8..3.0,
            off in prop::array::uniform4(-0.01..0.01),
        ) {
            let arc = Seed { narrowness, twist, mirrored: false, start, end, uses_circles: false };
            let (goal, length) = goal_of(&arc);
            let [a, b, c, d] = off;
            let seed = Seed { narrowness: narrowness + a, twist: twist + b, start: start + c, end: end + d, ..arc };
            let Refinement::Converged(_, fit) = refine(&goal, &seed, &mut || ()) else { panic!("{seed:?} is lost") };
            prop_assert!(fit.square() <= 1e-22);
            prop_assert!((fit.length() - length).abs() < 1e-6, "{} for {length}", fit.length());
        }
    }
}
