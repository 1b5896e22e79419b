//! Shortening of a clear body, and drawing of random ones.

use growbot_core::random::Random;
use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;
use std::f64::consts::TAU;

use super::Problem;
use super::chain::Chain;
use super::meter::Meter;
use crate::clear::{Work, is_clear};
use crate::motion::{Curve, Stretch, any_across};

/// Maximum number of positions on the way of a body that is being shortened.
const MAX_VIA: usize = 12;
/// Smallest move of a position, as a power of two of the largest.
const FINEST: f64 = -16.0;

/// Temporary increase of the length of a body, as a fraction of the distance of the goal.
const LONGER: f64 = 1e-3;

/// Price of a position on the way, as a fraction of the distance of the goal.
const PRICE: f64 = 1e-4;

/// Reports whether a body is clear and accepted.
pub(super) fn clear(problem: &Problem, chain: &Chain, work: &mut Work) -> bool {
    chain.stretches.iter().all(|stretch| is_clear(problem.scene, stretch, &problem.need, work))
        && (problem.accept)(chain)
}

/// Returns the price of a position on the way, mm of length. A body of few pieces is worth a little more length.
fn price(problem: &Problem) -> f64 {
    PRICE * (problem.goal.position() - problem.start.position).norm()
}

/// Returns the cost of a body: its length and the price of its positions on the way, mm.
pub(super) fn cost(problem: &Problem, chain: &Chain) -> f64 {
    chain.length + price_of(problem, &chain.via)
}

/// Returns the price of these positions, mm. A position at the goal is free, because it is not a bend on the way.
fn price_of(problem: &Problem, via: &[Vector3<f64>]) -> f64 {
    let on_the_way = via.len() - usize::from(via.last().is_some_and(|last| problem.is_at_goal(last)));
    price(problem) * on_the_way as f64
}

/// If the goal has a tolerance, adds the body's end as a position of its own, so that it can be moved.
fn free_end(problem: &Problem, chain: &Chain, via: &mut Vec<Vector3<f64>>) {
    let has_own = via.last().is_some_and(|last| problem.is_at_goal(last));
    if let Some(last) = chain.stretches.last().filter(|_| problem.tolerance() > 0.0 && !has_own) {
        let goal = problem.goal.position();
        // The position is slightly inside, so that rounding does not put it outside.
        via.push(goal + (last.end().position - goal) * (1.0 - 1e-9));
    }
}

/// Moves a position by a random step of this size. A position at the goal stays within its tolerance.
fn displace(problem: &Problem, position: &mut Vector3<f64>, random: &mut Random, size: f64) {
    let at_goal = problem.is_at_goal(position);
    *position += random.normal_vector() * size;
    if at_goal && !problem.is_at_goal(position) {
        let goal = problem.goal.position();
        *position = goal + (*position - goal).normalize() * (problem.tolerance() * (1.0 - 1e-9));
    }
}

/// A body that is being shortened. `chain` is clear at any time.
pub(super) struct Shortening {
    pub(super) chain: Chain,
    /// The body that is being changed. It may temporarily be a little longer than the shortest.
    current: Chain,
    /// Power of two of the last move that made the body shorter.
    exponent: f64,
}

impl Shortening {
    pub(super) fn new(chain: Chain) -> Self {
        Self { current: chain.clone(), chain, exponent: 0.5 * FINEST }
    }

    /// Tries changes until this much work is done.
    pub(super) fn advance(&mut self, problem: &Problem, random: &mut Random, meter: &mut Meter, until: u64) {
        while !meter.is_over_or_at(until) {
            self.step(problem, random, &mut meter.work);
        }
    }

    /// Moves positions on the way, removes one or adds one. The change is kept if the body is clear and shorter.
    fn step(&mut self, problem: &Problem, random: &mut Random, work: &mut Work) {
        work.0 += 1;
        let mut via = self.current.via.clone();
        let near = (self.exponent + 2.0 * random.even()).clamp(FINEST, 0.0);
        let exponent = if random.below(2) == 0 { near } else { FINEST * random.unit() };
        let span = (problem.goal.position() - problem.start.position).norm().max(problem.radius);
        let size = 0.2 * span * libm::exp2(exponent);
        let choice = random.below(16);
        if choice == 15 {
            free_end(problem, &self.current, &mut via);
        }
        if via.is_empty() || (choice < 2 && via.len() < MAX_VIA) {
            let (at, place) = along(&self.current, random.unit());
            via.insert(place.min(via.len()), at);
            if random.below(2) == 0 {
                via.iter_mut().for_each(|position| displace(problem, position, random, size));
            } else if let Some(position) = via.get_mut(place) {
                displace(problem, position, random, size);
            }
        } else if choice == 2 {
            via.remove(random.below(via.len() as u64) as usize);
        } else if choice < 7 {
            via.iter_mut().for_each(|position| displace(problem, position, random, size));
        } else {
            let index = random.below(via.len() as u64) as usize;
            if let Some(position) = via.get_mut(index) {
                displace(problem, position, random, size);
            }
        }
        let passing = cost(problem, &self.chain) + span * LONGER * libm::exp2(-10.0 * random.unit());
        let limit = if random.below(4) == 0 { passing } else { cost(problem, &self.current) };
        let below = limit - price_of(problem, &via);
        if let Some(next) = problem.chain(&via, below)
            && clear(problem, &next, work)
        {
            if cost(problem, &next) < cost(problem, &self.current) {
                self.exponent = exponent;
            }
            if cost(problem, &next) < cost(problem, &self.chain) {
                self.chain = next.clone();
            }
            self.current = next;
        }
    }
}

/// Removes the positions of a body that are not needed.
pub(super) fn straighten(problem: &Problem, mut chain: Chain, work: &mut Work) -> Chain {
    if let Some(same) = problem.chain(&chain.via, chain.length * (1.0 + 1e-9))
        && clear(problem, &same, work)
    {
        chain = same;
    }
    let mut index = 0;
    while index < chain.via.len() {
        let mut via = chain.via.clone();
        via.remove(index);
        match problem.chain(&via, chain.length + price(problem)).filter(|shorter| clear(problem, shorter, work)) {
            Some(shorter) => chain = shorter,
            None => index += 1,
        }
    }
    chain
}

/// Returns a body without one or several of its positions on the way, which may be longer and is not checked.
pub(super) fn simpler(problem: &Problem, chain: &Chain, random: &mut Random, below: f64) -> Option<Chain> {
    let mut via = chain.via.clone();
    for _ in 0..=random.below(via.len() as u64 / 2 + 1) {
        if !via.is_empty() {
            via.remove(random.below(via.len() as u64) as usize);
        }
    }
    if let (Some(position), true) = (via.first_mut(), random.below(2) == 0) {
        let span = (problem.goal.position() - problem.start.position).norm();
        *position += random.normal_vector() * (0.1 * span * random.unit() * random.unit());
    }
    problem.chain(&via, below)
}

/// Returns the point at this fraction of a body's length, and the number of positions on the way before it.
fn along(chain: &Chain, share: f64) -> (Vector3<f64>, usize) {
    let mut left = share * chain.length;
    for (index, stretch) in chain.stretches.iter().enumerate() {
        if left <= stretch.length {
            return (stretch.point(left), index / 2);
        }
        left -= stretch.length;
    }
    let end = chain.stretches.last().map_or_else(Vector3::zeros, |last| last.end().position);
    (end, chain.via.len())
}

/// Draws a body of up to three random arcs and lines and a way to the goal, below this length. It may not be clear.
pub(super) fn draw(problem: &Problem, random: &mut Random, below: f64) -> Option<Chain> {
    let mut tip = problem.start;
    let mut via = Vec::new();
    let distance = (problem.goal.position() - tip.position).norm();
    for _ in 0..=random.below(3) {
        let x = any_across(&tip.direction);
        let (sin, cos) = sin_cos(TAU * random.unit());
        let towards = x * cos + tip.direction.cross(&x) * sin;
        let bend = (0.5 * distance).min(problem.radius) * random.unit();
        let line = (0.5 * distance).min(below) * random.unit() * random.unit();
        let arc = Stretch { from: tip, towards, curvature: 1.0 / problem.radius, length: bend };
        tip = Stretch::line(arc.end(), line).end();
        via.push(tip.position);
    }
    problem.chain(&via, below)
}
