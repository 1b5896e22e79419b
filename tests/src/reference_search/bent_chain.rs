//! Shortens curves directly, without any theory of the form of a shortest curve. The curve is a chain of arcs with
//! curvature at most 1. The chain is pulled to the goal. Then its length descends while its end is held at the goal.
//! Arcs whose axis differs much from a neighbour's are split, and the length descends again.

use core::f64::consts::TAU;

use nalgebra::{Matrix6, Rotation3, Vector2, Vector3, Vector6};

use super::Problem;
use growbot_core::random::Rng;

/// Number of arcs at the beginning. They are equally long.
const ARCS: usize = 20;
/// Max number of steps that shorten a chain.
const SHORTENINGS: usize = 150;
/// Max number of times that arcs are split.
const SPLITS: usize = 6;
/// Angle between the axes of neighbouring arcs above which both are split, radians.
const TURN: f64 = 0.25;
/// Tolerance at the goal for a pulled chain, radii and radians.
const PULLED: f64 = 1e-4;

/// Frame of a tip: position and axes. z is the tangent, and x and y are carried along without twist.
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

/// Unknowns of the search: two numbers per arc, which give its curvature, and the length. `shares` are the fractions of
/// the length that the arcs have.
#[derive(Clone)]
struct Unknowns {
    numbers: Vec<Vector2<f64>>,
    shares: Vec<f64>,
    length: f64,
}

/// Change of the numbers and of the length.
struct Change {
    numbers: Vec<Vector2<f64>>,
    length: f64,
}

/// Derivatives of the error at the goal by each number and by the length.
struct Slopes {
    numbers: Vec<[Vector6<f64>; 2]>,
    length: Vector6<f64>,
}

/// Returns the curvature vector for two unconstrained numbers. Its length is the sine of their norm, so it is at most
/// 1.
fn curvature(numbers: Vector2<f64>) -> Vector2<f64> {
    let norm = numbers.norm();
    if norm > 0.0 { numbers * (libm::sin(norm) / norm) } else { numbers }
}

/// Returns the frame at the end of an arc, relative to its beginning.
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

    /// Returns the frames along the chain, from the start to the end.
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

    /// Returns the error at the goal, and its derivatives by differences in one unknown at a time.
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

    /// Returns the smallest change that changes the error at the goal by `change`, to first order. It minimizes the
    /// mean square along the chain.
    fn min_change(&self, slopes: &Slopes, change: &Vector6<f64>) -> Option<Change> {
        let lightness = |index: usize| 1.0 / (ARCS as f64 * self.shares[index]);
        // The difference of the tangents has only two independent components. The small number stands in for the third.
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

    /// Returns the unknowns after a change, of which at most `longest` is applied.
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

    /// Returns the nearest chain that ends at the goal. `None` if `steps` steps do not reach it.
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

    /// Returns the chain after its length has descended with its end held at the goal. The stride grows after each step
    /// that succeeds and is halved after each step that fails.
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

    /// Returns the axis about which each arc bends, in the chain's frame.
    fn axes(&self) -> Vec<Vector3<f64>> {
        let axis = |(frame, numbers): (&Frame, &Vector2<f64>)| {
            let curvature = curvature(*numbers);
            frame.axes * Vector3::new(-curvature.y, curvature.x, 0.0)
        };
        self.frames().iter().zip(&self.numbers).map(axis).collect()
    }

    /// Returns the same chain, with each arc split in two if its axis is far from a neighbour's. `None` if no arc is
    /// split.
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

/// A chain that has been shortened as far as possible.
#[derive(Debug, Clone)]
pub struct Chain {
    /// Position of the middle and unit axis of each arc. Arcs that hardly bend are left out.
    pub arcs: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// Arc length, radii.
    pub length: f64,
}

/// Returns a shortened chain to the goal from a random start. `None` if this start does not lead to the goal.
pub fn straightened(problem: &Problem, random: &mut Rng) -> Option<Chain> {
    // One to four sections of the chain, each bent in its own direction.
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
