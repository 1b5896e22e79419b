//! Shortening a body that is clear, and drawing new ones at random.

use growbot_core::random::Random;
use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;
use std::f64::consts::TAU;

use super::Problem;
use super::chain::Chain;
use crate::clear::{Work, is_clear};
use crate::motion::{Stretch, Tip, any_across};

/// Max number of positions on the way of a body that is being shortened.
const MAX_VIA: usize = 12;
/// The least move of a position, as a power of two of the largest.
const FINEST: f64 = -16.0;

/// Whether a body is clear.
pub(super) fn clear(problem: &Problem, chain: &Chain, work: &mut Work) -> bool {
    chain.stretches.iter().all(|stretch| is_clear(problem.scene, stretch, &problem.need, work))
}

/// A body with one position on the way moved, left out or added; clear and shorter, or none.
pub(super) fn shorten(problem: &Problem, chain: &Chain, random: &mut Random, work: &mut Work) -> Option<Chain> {
    work.0 += 1;
    let mut via = chain.via.clone();
    let span = (problem.goal.position() - problem.start.position).norm().max(problem.radius);
    let step = 0.2 * span * libm::exp2(FINEST * random.unit());
    let choice = random.below(16);
    if via.is_empty() || (choice == 0 && via.len() < MAX_VIA) {
        let place = random.below(via.len() as u64 + 1) as usize;
        let at = along(chain, random.unit());
        via.insert(place.min(via.len()), at + random.normal_vector() * step);
    } else {
        let index = random.below(via.len() as u64) as usize;
        if choice == 1 {
            via.remove(index);
        } else if let Some(position) = via.get_mut(index) {
            *position += random.normal_vector() * step;
        }
    }
    let shorter = problem.chain(&via, chain.length)?;
    clear(problem, &shorter, work).then_some(shorter)
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
        match problem.chain(&via, chain.length).filter(|shorter| clear(problem, shorter, work)) {
            Some(shorter) => chain = shorter,
            None => index += 1,
        }
    }
    chain
}

/// A point of a body, at this share of its length.
fn along(chain: &Chain, share: f64) -> Vector3<f64> {
    let mut left = share * chain.length;
    for stretch in &chain.stretches {
        if left <= stretch.length {
            return stretch.tip(left).position;
        }
        left -= stretch.length;
    }
    chain.stretches.last().map_or_else(Vector3::zeros, |last| last.end().position)
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

/// The tip at the start of a body.
pub(super) fn _start(problem: &Problem) -> Tip {
    problem.start
}
