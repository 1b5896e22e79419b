//! Shortening of a body that is clear of obstacles, and drawing of random bodies.

use growbot_core::random::Rng;
use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;
use std::f64::consts::TAU;

use super::budget::BudgetTracker;
use super::problem::PlanningProblem;
use super::via_path::ViaPath;
use crate::centreline::{ArcSegment, Curve, any_perpendicular};
use crate::clearance::{DistanceQueries, is_clear};

/// Maximum number of via positions ([`ViaPath`]) of a body that is being shortened.
const MAX_VIA: usize = 12;
/// Binary exponent of the smallest move of a via position, relative to the largest move.
const FINEST: f64 = -16.0;

/// Maximum temporary increase of a body's cost during the shortening, as a fraction of the distance from start to goal.
const LONGER: f64 = 1e-3;

/// Cost of each via position, as a fraction of the distance from start to goal.
const PRICE: f64 = 1e-4;

/// Returns true if a body is clear of obstacles and accepted by the problem's `accept`.
pub(super) fn is_via_path_clear(problem: &PlanningProblem, chain: &ViaPath, work: &mut DistanceQueries) -> bool {
    chain.segments.iter().all(|stretch| is_clear(problem.scene, stretch, &problem.required_clearance, work))
        && (problem.accept)(chain)
}

/// Returns the cost of one via position, mm of length. A body with fewer segments may be a little longer.
fn price(problem: &PlanningProblem) -> f64 {
    PRICE * (problem.goal.position() - problem.start.position).norm()
}

/// Returns the cost of a body, mm: its length and the cost of its via positions.
pub(super) fn cost(problem: &PlanningProblem, chain: &ViaPath) -> f64 {
    chain.length + price_of(problem, &chain.via)
}

/// Returns the cost of these via positions, mm. A position at the goal is free, because it is not a bend on the way.
fn price_of(problem: &PlanningProblem, via: &[Vector3<f64>]) -> f64 {
    let on_the_way = via.len() - usize::from(via.last().is_some_and(|last| problem.is_at_goal(last)));
    price(problem) * on_the_way as f64
}

/// If the goal has a tolerance, adds the body's end as a via position, so that the end can be moved.
fn free_end(problem: &PlanningProblem, chain: &ViaPath, via: &mut Vec<Vector3<f64>>) {
    let has_own = via.last().is_some_and(|last| problem.is_at_goal(last));
    if let Some(last) = chain.segments.last().filter(|_| problem.tolerance() > 0.0 && !has_own) {
        let goal = problem.goal.position();
        // The position is slightly inside, so that rounding does not put it outside.
        via.push(goal + (last.end().position - goal) * (1.0 - 1e-9));
    }
}

/// Moves a position by a random step of this size. A position at the goal stays within the goal's tolerance.
fn displace(problem: &PlanningProblem, position: &mut Vector3<f64>, random: &mut Rng, size: f64) {
    let at_goal = problem.is_at_goal(position);
    *position += random.normal_vector() * size;
    if at_goal && !problem.is_at_goal(position) {
        let goal = problem.goal.position();
        *position = goal + (*position - goal).normalize() * (problem.tolerance() * (1.0 - 1e-9));
    }
}

/// Shortening of a body. `chain` is the best body so far, and clear at any time.
pub(super) struct PathShortener {
    pub(super) chain: ViaPath,
    /// The body that is being changed. It may temporarily cost a little more than the best body.
    current: ViaPath,
    /// Binary exponent of the last move that made the body shorter, relative to the largest move.
    exponent: f64,
}

impl PathShortener {
    pub(super) fn new(chain: ViaPath) -> Self {
        Self { current: chain.clone(), chain, exponent: 0.5 * FINEST }
    }

    /// Tries changes of the path until the work that `meter` counts reaches `until`, or the budget is exhausted.
    pub(super) fn advance(
        &mut self,
        problem: &PlanningProblem,
        random: &mut Rng,
        meter: &mut BudgetTracker,
        until: u64,
    ) {
        while !meter.check_exhausted_or_at(until) {
            self.step(problem, random, &mut meter.work);
        }
    }

    /// Moves via positions, removes one or adds one, at random. The change is kept if the body is clear and costs less,
    /// or at times only a little more.
    fn step(&mut self, problem: &PlanningProblem, random: &mut Rng, work: &mut DistanceQueries) {
        work.0 += 1;
        let mut via = self.current.via.clone();
        let near = (self.exponent + 2.0 * random.uniform_symmetric()).clamp(FINEST, 0.0);
        let exponent = if random.below(2) == 0 { near } else { FINEST * random.uniform() };
        let span = (problem.goal.position() - problem.start.position).norm().max(problem.radius);
        let size = 0.2 * span * libm::exp2(exponent);
        let choice = random.below(16);
        if choice == 15 {
            free_end(problem, &self.current, &mut via);
        }
        if via.is_empty() || (choice < 2 && via.len() < MAX_VIA) {
            let (at, place) = along(&self.current, random.uniform());
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
        let passing = cost(problem, &self.chain) + span * LONGER * libm::exp2(-10.0 * random.uniform());
        let limit = if random.below(4) == 0 { passing } else { cost(problem, &self.current) };
        let below = limit - price_of(problem, &via);
        if let Some(next) = problem.chain(&via, below)
            && is_via_path_clear(problem, &next, work)
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

/// Removes each via position of a body without which the body is still clear and does not cost more.
pub(super) fn straighten(problem: &PlanningProblem, mut chain: ViaPath, work: &mut DistanceQueries) -> ViaPath {
    if let Some(same) = problem.chain(&chain.via, chain.length * (1.0 + 1e-9))
        && is_via_path_clear(problem, &same, work)
    {
        chain = same;
    }
    let mut index = 0;
    while index < chain.via.len() {
        let mut via = chain.via.clone();
        via.remove(index);
        match problem
            .chain(&via, chain.length + price(problem))
            .filter(|shorter| is_via_path_clear(problem, shorter, work))
        {
            Some(shorter) => chain = shorter,
            None => index += 1,
        }
    }
    chain
}

/// Returns a body without one or several of its via positions, if it is shorter than `below` (mm). The returned body
/// may collide with obstacles.
pub(super) fn perturbed(problem: &PlanningProblem, chain: &ViaPath, random: &mut Rng, below: f64) -> Option<ViaPath> {
    let mut via = chain.via.clone();
    for _ in 0..=random.below(via.len() as u64 / 2 + 1) {
        if !via.is_empty() {
            via.remove(random.below(via.len() as u64) as usize);
        }
    }
    if let (Some(position), true) = (via.first_mut(), random.below(2) == 0) {
        let span = (problem.goal.position() - problem.start.position).norm();
        *position += random.normal_vector() * (0.1 * span * random.uniform() * random.uniform());
    }
    problem.chain(&via, below)
}

/// Returns the point at this fraction (0 to 1) of a body's length, and the number of via positions before this point.
fn along(chain: &ViaPath, share: f64) -> (Vector3<f64>, usize) {
    let mut left = share * chain.length;
    for (index, stretch) in chain.segments.iter().enumerate() {
        if left <= stretch.length {
            return (stretch.point(left), index / 2);
        }
        left -= stretch.length;
    }
    let end = chain.segments.last().map_or_else(Vector3::zeros, |last| last.end().position);
    (end, chain.via.len())
}

/// Draws a body of one to three random arcs and lines, followed by the shortest way to the goal. Returns `None` if the
/// body is not shorter than `below` (mm). The body may collide with obstacles.
pub(super) fn sample_path(problem: &PlanningProblem, random: &mut Rng, below: f64) -> Option<ViaPath> {
    let mut tip = problem.start;
    let mut via = Vec::new();
    let distance = (problem.goal.position() - tip.position).norm();
    for _ in 0..=random.below(3) {
        let x = any_perpendicular(&tip.direction);
        let (sin, cos) = sin_cos(TAU * random.uniform());
        let towards = x * cos + tip.direction.cross(&x) * sin;
        let bend = (0.5 * distance).min(problem.radius) * random.uniform();
        let line = (0.5 * distance).min(below) * random.uniform() * random.uniform();
        let arc = ArcSegment { from: tip, towards, curvature: 1.0 / problem.radius, length: bend };
        tip = ArcSegment::line(arc.end(), line).end();
        via.push(tip.position);
    }
    problem.chain(&via, below)
}
