//! From a refined seed to the pieces that are grown from the start.

use nalgebra::{Matrix3, Matrix5, Vector3, Vector5};

use super::refine::{Seed, axes};
use super::{HelicoidalArc, Piece};
use crate::helicoid::Helicoid;
use crate::linalg5;
use crate::pose::{Frame, tip_direction};
use crate::shortest::Problem;

/// Logarithm of the narrowness below which a neck divides its arc into two pieces. Trial: -1 and -6 give as many
/// misses as now; without two pieces there are 25 misses.
const NARROW: f64 = -3.0;
/// Min length of both pieces for a neck to divide its arc, radii. Trial: 0.01 and 1e-6 give as many misses as now.
const MIN_PIECE: f64 = 1e-3;
/// Max error of an arc that is grown from its start, radii and radians: a third of what [`crate::plan`] accepts.
/// Trial: with 3e-11 and 3e-12 there are 12 and 17 misses.
const GROWN_TO_GOAL: f64 = 3e-10;
/// Relative change of the neck's width for the numerical derivative. Trial: with 0.01 there are 16 misses, with
/// 1e-7 as many as with 1e-4.
const WIDER: f64 = 1e-4;
/// Max number of steps of Newton's method. Trial: with 1 and 2 there are 21 and 14 misses, with 8 as many as with
/// 4.
const MAX_ROUNDS: u32 = 4;
/// Max change of an unknown in one step. Trial: 0.001 and 1 give as many misses as now.
const MAX_CHANGE: f64 = 0.1;

/// The arc of a seed that was refined finely. None if it does not reach the goal when it is grown from its start.
#[inline(never)]
pub(super) fn arc_of(problem: &Problem, seed: &Seed, keep_alive: &mut dyn FnMut()) -> Option<HelicoidalArc> {
    keep_alive();
    let neck = seed.neck();
    let (start, end) = neck.ends(-seed.before, seed.after, true, keep_alive);
    let start_from_neck = axes(problem, &start, &end).transpose();
    let curve = neck.curve();
    keep_alive();
    let first = in_tip(&start_from_neck, &curve.m(&start.position), &curve.p)?;
    if seed.narrowness >= NARROW || seed.before.min(seed.after) < MIN_PIECE {
        let first = Piece { curve: first, length: seed.length() };
        return lack(problem, &first.frame()).is_none().then_some(HelicoidalArc { first, second: None });
    }
    let tip = first.frame_after(seed.before);
    let tip_from_neck = tip.rotation.inverse().matrix() * start_from_neck;
    let second = in_tip(&tip_from_neck, &curve.m0, &curve.p)?;
    let second = Piece { curve: second, length: seed.after };
    joined(problem, Piece { curve: first, length: seed.before }, second, keep_alive)
}

/// Two pieces that meet at a neck, corrected by Newton's method for the rounding before the neck. The unknowns are the
/// roll and the length of each piece, and the width of the neck.
#[inline(never)]
fn joined(
    problem: &Problem,
    mut first: Piece,
    mut second: Piece,
    keep_alive: &mut dyn FnMut(),
) -> Option<HelicoidalArc> {
    for _ in 0..MAX_ROUNDS {
        keep_alive();
        let joint = first.frame();
        keep_alive();
        let joint_from_end = second.frame();
        let end = joint * joint_from_end;
        let Some(lack) = lack(problem, &end) else { return Some(HelicoidalArc { first, second: Some(second) }) };
        let (about, tip) = (joint.translation.vector, tip_direction(&joint));
        let (at_end, direction) = (end.translation.vector, tip_direction(&end));
        let turn = |axis: &Vector3<f64>, about: &Vector3<f64>| {
            problem.column(&axis.cross(&(at_end - about)), &axis.cross(&direction))
        };
        let shift = |direction: &Vector3<f64>| problem.column(direction, &Vector3::zeros());
        // A longer piece turns further about the axis at its end.
        let axis_after = |piece: &Piece, frame: &Frame| {
            let m = piece.curve.m(&frame.translation.vector);
            m / m.norm().max(f64::MIN_POSITIVE)
        };
        let end_axis = joint.rotation * axis_after(&second, &joint_from_end);
        let wider = Piece { curve: Helicoid { m0: second.curve.m0 * (1.0 + WIDER), ..second.curve }, ..second };
        keep_alive();
        let wider_end = joint * wider.frame();
        let by_width = problem.column(
            &((wider_end.translation.vector - at_end) / WIDER),
            &((tip_direction(&wider_end) - direction) / WIDER),
        );
        let jacobian = Matrix5::from_columns(&[
            turn(&Vector3::z(), &Vector3::zeros()),
            turn(&axis_after(&first, &joint), &about) + shift(&tip),
            turn(&tip, &about),
            turn(&end_axis, &at_end) + shift(&direction),
            by_width,
        ]);
        let step = linalg5::solve(&jacobian, &lack)?;
        if step.amax() > MAX_CHANGE {
            return None;
        }
        first = Piece { curve: first.curve.rolled(-step[0]), length: first.length + step[1] };
        let Helicoid { m0, p } = second.curve.rolled(-step[2]);
        second = Piece { curve: Helicoid { m0: m0 * (1.0 + step[4]), p }, length: second.length + step[3] };
    }
    None
}

/// The offset that is missing to the goal at the end of a path. None if the path arrives.
fn lack(problem: &Problem, end: &Frame) -> Option<Vector5<f64>> {
    let (off, direction) = (problem.goal - end.translation.vector, tip_direction(end));
    let miss = off.norm().max((direction - problem.direction).norm());
    (miss > GROWN_TO_GOAL).then(|| problem.column(&off, &-direction))
}

/// A curve in the frame of a tip. The scale of `m` and `p` is free: the longer of the two becomes a unit vector.
fn in_tip(tip_from_neck: &Matrix3<f64>, m: &Vector3<f64>, p: &Vector3<f64>) -> Option<Helicoid> {
    let (m0, p) = (tip_from_neck * m, tip_from_neck * p);
    let scale = m0.norm().max(p.norm());
    (scale > 0.0).then(|| Helicoid { m0: Vector3::new(m0.x / scale, m0.y / scale, 0.0), p: p / scale })
}
