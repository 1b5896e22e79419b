//! Shortening directly, with no theory of what a shortest curve looks like: a chain of arcs, each bent by at most 1, is
//! pulled to the goal, and then its length descends while its end is held there. Arcs that bend about quite another
//! axis than their neighbours are split, and the length descends again.

use core::f64::consts::TAU;

use nalgebra::{Matrix6, Rotation3, Vector2, Vector3, Vector6};

use super::Problem;
use growbot_core::random::Rng;

/// Arcs at the beginning, equally long.
const ARCS: usize = 20;
/// Strides down the length, at most.
const SHORTENINGS: usize = 150;
/// How often arcs are split.
const SPLITS: usize = 6;
/// Arcs are split where their axis is further than this from a neighbour's, radians.
const TURN: f64 = 0.25;
/// A pulled chain ends within this of the goal, radii and radians.
const PULLED: f64 = 1e-4;

/// Where a tip is and how it is turned; z is its tangent, and x and y are carried along without twist.
#[derive(Clone, Copy)]
struct Frame {
    position: Vector3<f64>,
    axes: Rotation3<f64>,
}

impl Frame {
    fn start() -> Self {
        Self { position: Vector3::zeros(), axes: Rotation3::identity() }
    }

    fn then(&self, next: &Self) -> Self {
        Self { position: self.position + self.axes * next.position, axes: self.axes * next.axes }
    }
}

/// What is varied: two numbers per arc, which give its curvature, and the length. `shares` are each arc's share of it.
#[derive(Clone)]
struct Unknowns {
    numbers: Vec<Vector2<f64>>,
    shares: Vec<f64>,
    length: f64,
}

/// A change of the numbers and of the length.
struct Change {
    numbers: Vec<Vector2<f64>>,
    length: f64,
}

/// How the miss changes with each number, and with the length.
struct Slopes {
    numbers: Vec<[Vector6<f64>; 2]>,
    length: Vector6<f64>,
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
    let lateral = curvature * ((1.0 - cos) / (bend * bend));
    Frame {
        position: Vector3::new(lateral.x, lateral.y, sin / bend),
        axes: Rotation3::new(Vector3::new(-curvature.y, curvature.x, 0.0) * length),
    }
}

fn miss(problem: &Problem, end: &Frame) -> Vector6<f64> {
    let position = end.position - problem.goal;
    let tangent = end.axes * Vector3::z() - problem.tangent;
    Vector6::new(position.x, position.y, position.z, tangent.x, tangent.y, tangent.z)
}

impl Unknowns {
    fn arc(&self, index: usize) -> Frame {
        arc(self.numbers[index], self.length * self.shares[index])
    }

    /// The frames along the chain, from the start to the end.
    fn frames(&self) -> Vec<Frame> {
        let mut frames = vec![Frame::start()];
        for index in 0..self.numbers.len() {
            frames.push(frames[index].then(&self.arc(index)));
        }
        frames
    }

    fn end(&self) -> Frame {
        (0..self.numbers.len()).fold(Frame::start(), |frame, index| frame.then(&self.arc(index)))
    }

    /// The miss, and its slopes by differences in one unknown at a time.
    fn miss_and_slopes(&self, problem: &Problem) -> (Vector6<f64>, Slopes) {
        let size = 1e-6;
        let frames = self.frames();
        let here = miss(problem, &frames[self.numbers.len()]);
        let mut numbers = vec![[Vector6::zeros(); 2]; self.numbers.len()];
        let mut rest = Frame::start();
        for index in (0..self.numbers.len()).rev() {
            let with = |beside: Vector2<f64>| {
                let bent = arc(self.numbers[index] + beside, self.length * self.shares[index]);
                (miss(problem, &frames[index].then(&bent).then(&rest)) - here) / size
            };
            numbers[index] = [with(Vector2::new(size, 0.0)), with(Vector2::new(0.0, size))];
            rest = self.arc(index).then(&rest);
        }
        let longer = Self { length: self.length + size, ..self.clone() };
        (here, Slopes { numbers, length: (miss(problem, &longer.end()) - here) / size })
    }

    /// The least change that changes the miss by this, to first order; least in the square's mean along the chain.
    fn min_change(&self, slopes: &Slopes, change: &Vector6<f64>) -> Option<Change> {
        let lightness = |index: usize| 1.0 / (ARCS as f64 * self.shares[index]);
        // The tangents' difference has but two independent parts: the small number makes up for the third.
        let mut squares = Matrix6::identity() * 1e-6 + slopes.length * slopes.length.transpose();
        for (index, pair) in slopes.numbers.iter().enumerate() {
            for slope in pair {
                squares += slope * slope.transpose() * lightness(index);
            }
        }
        let pull = squares.cholesky()?.solve(change);
        let numbers = slopes.numbers.iter().enumerate();
        Some(Change {
            numbers: numbers
                .map(|(index, [x, y])| Vector2::new(x.dot(&pull), y.dot(&pull)) * lightness(index))
                .collect(),
            length: slopes.length.dot(&pull),
        })
    }

    /// The unknowns after a change, of which no more than `longest` is made.
    fn changed(&self, change: &Change, longest: f64) -> Self {
        let squares: f64 =
            change.numbers.iter().zip(&self.shares).map(|(change, share)| change.norm_squared() * share).sum();
        let size = libm::sqrt(squares * ARCS as f64 + change.length * change.length);
        let part = (longest / size).min(1.0);
        Self {
            numbers: self.numbers.iter().zip(&change.numbers).map(|(number, change)| number + change * part).collect(),
            length: self.length + change.length * part,
            shares: self.shares.clone(),
        }
    }

    /// The nearest chain that ends at the goal.
    fn pulled(mut self, problem: &Problem, steps: usize) -> Option<Self> {
        for _ in 0..steps {
            let (miss, slopes) = self.miss_and_slopes(problem);
            if miss.norm() < PULLED {
                return Some(self);
            }
            self = self.changed(&self.min_change(&slopes, &-miss)?, 1.0);
            if self.length < 0.0 {
                return None;
            }
        }
        None
    }

    /// The chain after descending in length, as far as this leaves the end where it is; the stride grows while that
    /// goes well.
    fn shortened(mut self, problem: &Problem, mut stride: f64) -> Option<Self> {
        for _ in 0..SHORTENINGS {
            let (_, slopes) = self.miss_and_slopes(problem);
            let mut down = self.min_change(&slopes, &slopes.length)?;
            down.length -= 1.0;
            let scale = stride / down.length.abs().max(1e-12);
            down.numbers.iter_mut().for_each(|number| *number *= scale);
            down.length *= scale;
            let next = self.changed(&down, stride).pulled(problem, 5);
            match next.filter(|next| next.length < self.length) {
                Some(next) => {
                    self = next;
                    stride *= 1.3;
                }
                None => stride *= 0.5,
            }
            if stride < 1e-3 {
                break;
            }
        }
        Some(self)
    }

    /// The axis about which each arc bends, in space.
    fn axes(&self) -> Vec<Vector3<f64>> {
        let axis = |(frame, numbers): (&Frame, &Vector2<f64>)| {
            let curvature = curvature(*numbers);
            frame.axes * Vector3::new(-curvature.y, curvature.x, 0.0)
        };
        self.frames().iter().zip(&self.numbers).map(axis).collect()
    }

    /// The same chain, with those arcs in two whose axis is far from a neighbour's; nothing if there are none.
    fn split(&self) -> Option<Self> {
        let axes = self.axes();
        let far = |a: usize, b: usize| axes[a].cross(&axes[b]).norm() > TURN || axes[a].dot(&axes[b]) < 0.0;
        let mut split = Self { numbers: Vec::new(), shares: Vec::new(), length: self.length };
        for index in 0..self.numbers.len() {
            let parts = if index > 0 && far(index - 1, index) || index + 1 < axes.len() && far(index, index + 1) {
                2
            } else {
                1
            };
            for _ in 0..parts {
                split.numbers.push(self.numbers[index]);
                split.shares.push(self.shares[index] / f64::from(parts));
            }
        }
        (split.numbers.len() > self.numbers.len()).then_some(split)
    }
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
pub fn straightened(problem: &Problem, random: &mut Rng) -> Option<Chain> {
    // A few stretches, each bent to a side of its own.
    let stretches = 1 + (random.uniform() * 4.0) as usize;
    let bends: Vec<_> = (0..stretches)
        .map(|_| {
            let (sin, cos) = libm::sincos(random.uniform_between(0.0, TAU));
            Vector2::new(cos, sin) * random.uniform_between(0.2, 1.2)
        })
        .collect();
    let mut number =
        |index: usize| bends[index * stretches / ARCS] + Vector2::new(random.normal(), random.normal()) * 0.05;
    let numbers = (0..ARCS).map(&mut number).collect();
    let length = problem.goal.norm() + random.uniform_between(1.0, 9.0);
    let mut chain = Unknowns { numbers, shares: vec![1.0 / ARCS as f64; ARCS], length }.pulled(problem, 30)?;
    chain = chain.shortened(problem, 0.3)?;
    for _ in 0..SPLITS {
        let Some(split) = chain.split() else { break };
        chain = split.shortened(problem, 0.05)?;
    }
    let middles = chain.frames().into_iter().enumerate().take(chain.numbers.len()).map(|(index, frame)| {
        let half = arc(chain.numbers[index], 0.5 * chain.length * chain.shares[index]);
        frame.then(&half).position
    });
    let bent = middles.zip(chain.axes()).filter(|(_, axis)| axis.norm() > 0.3);
    Some(Chain { arcs: bent.map(|(middle, axis)| (middle, axis.normalize())).collect(), length: chain.length })
}
