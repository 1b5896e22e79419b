//! Shortening directly, with no theory of what a shortest curve looks like: a chain of equally long arcs, each bent by at
//! most 1, is pulled to the goal, and then its length descends while its end is held there.

use core::f64::consts::TAU;

use nalgebra::{Rotation3, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::Problem;
use super::random::Random;

const ARCS: usize = 20;
/// Strides down the length, at most.
const SHORTENINGS: usize = 150;
/// Two numbers per arc, and the length.
const UNKNOWNS: usize = 2 * ARCS + 1;
type Unknowns = SVector<f64, UNKNOWNS>;

/// Where a tip is and how it is turned; z is its tangent, and x and y are carried along without twist.
#[derive(Clone, Copy)]
struct Frame {
    position: Vector3<f64>,
    axes: Rotation3<f64>,
}

impl Frame {
    fn then(&self, next: &Frame) -> Frame {
        Frame { position: self.position + self.axes * next.position, axes: self.axes * next.axes }
    }
}

/// The curvature vector for two unconstrained numbers: as long as the sine of their norm, so never longer than 1.
fn curvature(numbers: Vector2<f64>) -> Vector2<f64> {
    let norm = numbers.norm();
    if norm > 0.0 { numbers * (libm::sin(norm) / norm) } else { numbers }
}

/// The frame at the end of an arc, from its beginning.
fn arc(numbers: Vector2<f64>, length: f64) -> Frame {
    let curvature = curvature(numbers);
    let bend = curvature.norm().max(1e-9);
    let (sin, cos) = libm::sincos(bend * length);
    let aside = curvature * ((1.0 - cos) / (bend * bend));
    Frame {
        position: Vector3::new(aside.x, aside.y, sin / bend),
        axes: Rotation3::new(Vector3::new(-curvature.y, curvature.x, 0.0) * length),
    }
}

fn numbers(unknowns: &Unknowns, arc: usize) -> Vector2<f64> {
    Vector2::new(unknowns[2 * arc], unknowns[2 * arc + 1])
}

/// The frames along the chain, from the start to the end.
fn frames(unknowns: &Unknowns) -> Vec<Frame> {
    let length = unknowns[UNKNOWNS - 1] / ARCS as f64;
    let mut frames = vec![Frame { position: Vector3::zeros(), axes: Rotation3::identity() }];
    for index in 0..ARCS {
        frames.push(frames[index].then(&arc(numbers(unknowns, index), length)));
    }
    frames
}

fn miss(problem: &Problem, end: &Frame) -> Vector6<f64> {
    let position = end.position - problem.goal;
    let tangent = end.axes * Vector3::z() - problem.tangent;
    Vector6::new(position.x, position.y, position.z, tangent.x, tangent.y, tangent.z)
}

/// The miss, and its slopes by differences in one unknown at a time.
fn miss_and_slopes(problem: &Problem, unknowns: &Unknowns) -> (Vector6<f64>, SMatrix<f64, 6, UNKNOWNS>) {
    let size = 1e-6;
    let each = unknowns[UNKNOWNS - 1] / ARCS as f64;
    let frames = frames(unknowns);
    let here = miss(problem, &frames[ARCS]);
    let mut slopes = SMatrix::<f64, 6, UNKNOWNS>::zeros();
    let mut rest = Frame { position: Vector3::zeros(), axes: Rotation3::identity() };
    for index in (0..ARCS).rev() {
        for (part, beside) in [Vector2::new(size, 0.0), Vector2::new(0.0, size)].into_iter().enumerate() {
            let end = frames[index].then(&arc(numbers(unknowns, index) + beside, each)).then(&rest);
            slopes.set_column(2 * index + part, &((miss(problem, &end) - here) / size));
        }
        rest = arc(numbers(unknowns, index), each).then(&rest);
    }
    let mut longer = *unknowns;
    longer[UNKNOWNS - 1] += size;
    slopes.set_column(UNKNOWNS - 1, &((miss(problem, &self::frames(&longer)[ARCS]) - here) / size));
    (here, slopes)
}

/// The least change of the unknowns that changes the miss by this, to first order.
fn least_change(slopes: &SMatrix<f64, 6, UNKNOWNS>, change: &Vector6<f64>) -> Option<Unknowns> {
    // The tangents' difference has but two independent parts: the small number makes up for the third.
    let squares = slopes * slopes.transpose() + SMatrix::<f64, 6, 6>::identity() * 1e-6;
    Some(slopes.transpose() * squares.cholesky()?.solve(change))
}

/// The nearest chain that ends at the goal, to 1e-4.
fn pulled(problem: &Problem, mut unknowns: Unknowns, steps: usize) -> Option<Unknowns> {
    for _ in 0..steps {
        let (miss, slopes) = miss_and_slopes(problem, &unknowns);
        if miss.norm() < 1e-4 {
            return Some(unknowns);
        }
        let step = least_change(&slopes, &-miss)?;
        unknowns += step * (1.0 / step.norm()).min(1.0);
        if unknowns[UNKNOWNS - 1] < 0.0 {
            return None;
        }
    }
    None
}

/// A chain that has been shortened as far as it goes.
#[derive(Debug, Clone)]
pub struct Chain {
    /// The position at the middle of each arc, and the unit axis it bends about; only of those that bend.
    pub arcs: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// Arc length, radii.
    pub length: f64,
}

/// A chain to the goal from a random start, shortened; nothing if the start leads to none.
pub fn straightened(problem: &Problem, random: &mut Random) -> Option<Chain> {
    let mut unknowns = Unknowns::zeros();
    // A few stretches, each bent to a side of its own.
    let stretches = 1 + (random.unit() * 4.0) as usize;
    let bends: Vec<_> = (0..stretches)
        .map(|_| {
            let (sin, cos) = libm::sincos(random.between(0.0, TAU));
            Vector2::new(cos, sin) * random.between(0.2, 1.2)
        })
        .collect();
    for index in 0..ARCS {
        let bend = bends[index * stretches / ARCS];
        unknowns[2 * index] = bend.x + 0.05 * random.normal();
        unknowns[2 * index + 1] = bend.y + 0.05 * random.normal();
    }
    unknowns[UNKNOWNS - 1] = problem.goal.norm() + random.between(1.0, 9.0);
    unknowns = pulled(problem, unknowns, 30)?;

    // Down the length, as far as this leaves the end where it is; the stride grows while that goes well.
    let mut stride = 0.3;
    for _ in 0..SHORTENINGS {
        let (_, slopes) = miss_and_slopes(problem, &unknowns);
        let mut down = Unknowns::zeros();
        down[UNKNOWNS - 1] = -1.0;
        down -= least_change(&slopes, &(slopes * down))?;
        let next = pulled(problem, unknowns + down * (stride / down.norm()), 5);
        match next.filter(|next| next[UNKNOWNS - 1] < unknowns[UNKNOWNS - 1]) {
            Some(next) => {
                unknowns = next;
                stride *= 1.3;
            }
            None => stride *= 0.5,
        }
        if stride < 1e-3 {
            break;
        }
    }
    let length = unknowns[UNKNOWNS - 1];
    let arcs = frames(&unknowns)
        .iter()
        .take(ARCS)
        .enumerate()
        .filter_map(|(index, frame)| {
            let bend = numbers(&unknowns, index);
            let curvature = curvature(bend);
            let middle = frame.then(&arc(bend, 0.5 * length / ARCS as f64));
            let axis = frame.axes * Vector3::new(-curvature.y, curvature.x, 0.0);
            (curvature.norm() > 0.3).then_some((middle.position, axis.normalize()))
        })
        .collect();
    Some(Chain { arcs, length })
}
