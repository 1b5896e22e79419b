//! The residual of an arc between start and goal, and its derivatives.

use nalgebra::{Matrix3, Matrix6x5, Vector3, Vector6};

use super::hybrid_curve::HybridPoint;
use super::precision::Precision;
use super::seed::Seed;
use crate::float::PortableFloat;
use crate::shortest::PathProblem;

/// Desired end of an arc, in the frame of the tip at the arc's start. The position is in radii.
#[derive(Debug, Clone, Copy)]
pub(super) struct FitGoal<T> {
    pub(super) position: Vector3<T>,
    pub(super) direction: Vector3<T>,
}

impl<T: PortableFloat> FitGoal<T> {
    /// Returns the goal of a problem, and the mirror image of this goal.
    pub(super) fn both(problem: &PathProblem) -> [Self; 2] {
        [1.0, -1.0].map(|side| {
            let turned = |v: &Vector3<f64>| Vector3::new(T::literal(v.x), T::literal(side * v.y), T::literal(v.z));
            Self { position: turned(&problem.goal), direction: turned(&problem.direction) }
        })
    }
}

/// Returns `curve_from_start`: the axes of the tip at the start of the arc, in the axes of the curve. Of all rolls of
/// the tip, it has the one that minimises the residual between the end of the arc and the goal.
pub(super) fn axes<T: PortableFloat>(goal: &FitGoal<T>, start: &HybridPoint<T>, end: &HybridPoint<T>) -> Matrix3<T> {
    let (zero, one) = (T::literal(0.0), T::literal(1.0));
    let z = start.direction;
    let mut other = Vector3::new(zero, zero, zero);
    if let Some(component) = other.get_mut(z.iamin()) {
        *component = one;
    }
    let x = z.cross(&other);
    let x = x / x.norm_squared().root();
    let unrolled = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let (offset, direction) = (unrolled.tr_mul(&(end.position - start.position)), unrolled.tr_mul(&end.direction));
    // The rotation in a plane that fits one pair of vectors best to another pair.
    let (goal, target) = (goal.position, goal.direction);
    let cos = goal.x * offset.x + goal.y * offset.y + target.x * direction.x + target.y * direction.y;
    let sin = goal.x * offset.y - goal.y * offset.x + target.x * direction.y - target.y * direction.x;
    let norm = (cos * cos + sin * sin).root();
    let (cos, sin) = if norm > zero { (cos / norm, sin / norm) } else { (one, zero) };
    unrolled * Matrix3::new(cos, -sin, zero, sin, cos, zero, zero, zero, one)
}

/// An arc that is placed at the start of the problem, with its residual at the goal.
pub(super) struct Fit<T: PortableFloat> {
    pub(super) start: HybridPoint<T>,
    pub(super) end: HybridPoint<T>,
    pub(super) axes: Matrix3<T>,
    pub(super) misfit: Vector6<T>,
}

impl<T: Precision> Fit<T> {
    #[inline(never)]
    pub(super) fn new(goal: &FitGoal<T>, seed: &Seed<T>) -> Self {
        let curve = seed.curve();
        let [start, end] = seed.ends(&curve);
        let axes = axes(goal, &start, &end);
        Self { start, end, axes, misfit: misfit(goal, &start, &end, &axes) }
    }

    /// Returns the square of the norm of the residual.
    pub(super) fn square(&self) -> T {
        self.misfit.norm_squared()
    }

    pub(super) fn length(&self) -> T {
        self.end.length - self.start.length
    }

    /// Returns the derivatives of the residual with respect to the five unknowns.
    #[inline(never)]
    pub(super) fn jacobian(&self, goal: &FitGoal<T>, seed: &Seed<T>) -> Matrix6x5<T> {
        let share = T::DERIVATIVE_STEP;
        let twist = seed.twist + seed.twist_by_narrowness() * share;
        let narrower = Seed { narrowness: seed.narrowness + share, twist, ..*seed };
        let twisted = Seed { twist: seed.twist + share, ..*seed };
        let [by_narrowness, by_twist] = [narrower, twisted].map(|changed| {
            let curve = changed.curve();
            let [start, end] = seed.ends(&curve);
            let axes = shortest_turn(&self.start.direction, &start.direction) * self.axes;
            (misfit(goal, &start, &end, &axes) - self.misfit) / share
        });
        let (position, target) = (self.axes * goal.position, self.axes * goal.direction);
        let start_direction = &self.start.direction;
        let axis = self.start.unit_axis();
        Matrix6x5::from_columns(&[
            by_narrowness,
            by_twist,
            stacked(&(start_direction + axis.cross(&position)), &axis.cross(&target)),
            stacked(&self.end.direction, &self.end.unit_axis().cross(&self.end.direction)),
            stacked(&-start_direction.cross(&position), &-start_direction.cross(&target)),
        ])
    }
}

impl Fit<f64> {
    /// Returns the angle of `m` in the deposition plane at the start, radians.
    pub(super) fn towards(&self) -> f64 {
        let axis = self.axes.tr_mul(&self.start.axis);
        libm::atan2(axis.y, axis.x)
    }
}

fn stacked<T: PortableFloat>(offset: &Vector3<T>, turned: &Vector3<T>) -> Vector6<T> {
    Vector6::new(offset.x, offset.y, offset.z, turned.x, turned.y, turned.z)
}

/// Returns the residual: the offset of the arc's end from the goal (radii), and the difference between the two
/// directions.
fn misfit<T: PortableFloat>(
    goal: &FitGoal<T>,
    start: &HybridPoint<T>,
    end: &HybridPoint<T>,
    axes: &Matrix3<T>,
) -> Vector6<T> {
    stacked(&(end.position - start.position - axes * goal.position), &(end.direction - axes * goal.direction))
}

/// Returns the smallest rotation that turns one unit vector into another.
fn shortest_turn<T: PortableFloat>(from: &Vector3<T>, to: &Vector3<T>) -> Matrix3<T> {
    let v = from.cross(to);
    let (zero, one) = (T::literal(0.0), T::literal(1.0));
    let cross = Matrix3::new(zero, -v.z, v.y, v.z, zero, -v.x, -v.y, v.x, zero);
    Matrix3::new(one, zero, zero, zero, one, zero, zero, zero, one)
        + cross
        + cross * cross / (one + from.dot(to)).max(T::literal(1e-9))
}
