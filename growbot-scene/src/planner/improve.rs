//! Shortening a body that is clear, and drawing new ones at random.

use growbot_core::random::Random;
use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;
use std::f64::consts::TAU;

use super::Problem;
use super::chain::Chain;
use super::meter::Meter;
use crate::clear::{Work, is_clear};
use crate::motion::{Curve, Stretch, any_across};

/// Max number of positions on the way of a body that is being shortened.
const MAX_VIA: usize = 12;
/// The least move of a position, as a power of two of the largest.
const FINEST: f64 = -16.0;

/// By how much a body may become longer for a while, as a share of the distance of the goal.
const LONGER: f64 = 1e-3;

/// What a position on the way costs, as a share of the distance of the goal.
const PRICE: f64 = 1e-4;

/// Whether a body is clear.
pub(super) fn clear(problem: &Problem, chain: &Chain, work: &mut Work) -> bool {
    chain.stretches.iter().all(|stretch| is_clear(problem.scene, stretch, &problem.need, work))
        && (problem.accept)(chain)
}

/// What a position on the way costs, mm of length: a body of few pieces is worth a little more length.
fn price(problem: &Problem) -> f64 {
    PRICE * (problem.goal.position() - problem.start.position).norm()
}

/// The length of a body and the price of its positions on the way, mm.
pub(super) fn cost(problem: &Problem, chain: &Chain) -> f64 {
    chain.length + price_of(problem, &chain.via)
}

/// The price of these positions, mm. One at the goal is no bend on the way to it.
fn price_of(problem: &Problem, via: &[Vector3<f64>]) -> f64 {
    let on_the_way = via.len() - usize::from(via.last().is_some_and(|last| problem.is_at_goal(last)));
    price(problem) * on_the_way as f64
}

/// Lets a body end at a position of its own beside the goal, where it may: its end as it is.
fn free_end(problem: &Problem, chain: &Chain, via: &mut Vec<Vector3<f64>>) {
    let has_own = via.last().is_some_and(|last| problem.is_at_goal(last));
    if let Some(last) = chain.stretches.last().filter(|_| problem.tolerance() > 0.0 && !has_own) {
        let goal = problem.goal.position();
        // A little within, lest rounding puts it outside.
        via.push(goal + (last.end().position - goal) * (1.0 - 1e-9));
    }
}

/// Moves a position by a random step of this size; one at the goal stays as near to that as it needs to be.
fn displace(problem: &Problem, position: &mut Vector3<f64>, random: &mut Random, size: f64) {
    let at_goal = problem.is_at_goal(position);
    *position += random.normal_vector() * size;
    if at_goal && !problem.is_at_goal(position) {
        let goal = problem.goal.position();
        *position = goal + (*position - goal).normalize() * (problem.tolerance() * (1.0 - 1e-9));
    }
}

/// A body that is being shortened: clear at every time.
pub(super) struct Shortening {
    pub(super) chain: Chain,
    /// The body that is changed: a little longer than the shortest at times.
    current: Chain,
    /// The power of two of the last move that made it shorter.
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

    /// Moves positions on the way, leaves one out or adds one: kept if the body is clear and shorter.
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

/// A body without positions that are not needed.
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

/// A body without one of its positions on the way, or without several; clear, and perhaps longer.
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

/// A point of a body, at this share of its length, and the number of positions on the way before it.
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

/// A body of up to three random arcs and lines, and on to the goal, below this length; it may not be clear.
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
