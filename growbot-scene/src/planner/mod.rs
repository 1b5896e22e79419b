//! Paths through a scene: the shortest unobstructed ones, then a search, then shortening.

mod chain;
mod improve;
mod tree;

use std::time::Instant;

use growbot_core::random::Random;
use nalgebra::Vector3;

pub use self::chain::Chain;
use self::improve::{clear, draw, shorten, straighten};
use self::tree::Tree;
use crate::clear::{Need, Work};
use crate::motion::Tip;
use crate::scene::Scene;

/// Where a body is to end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// At a position, pointing anywhere.
    Position {
        /// The position, mm.
        at: Vector3<f64>,
        /// How far from it the body may end, mm.
        tolerance: f64,
    },
    /// At a position, pointing in a direction.
    Pose(Tip),
}

impl Goal {
    /// The position, mm.
    #[must_use]
    pub fn position(&self) -> Vector3<f64> {
        match self {
            Self::Position { at, .. } => *at,
            Self::Pose(tip) => tip.position,
        }
    }
}

/// From where to where, through what.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The obstacles.
    pub scene: &'a Scene,
    /// Where the body starts.
    pub start: Tip,
    /// Where it is to end.
    pub goal: Goal,
    /// The min radius of bends, mm.
    pub radius: f64,
    /// How far the centreline must keep from the obstacles.
    pub need: Need,
    /// Max length, mm.
    pub length_max: f64,
}

/// What a search can tell apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution {
    /// Length of an arc or line, mm.
    pub step: f64,
    /// Number of directions in which a tip may bend.
    pub rolls: u32,
    /// Side of a cell of positions, mm.
    pub position: f64,
    /// Side of a cell of directions.
    pub direction: f64,
}

/// How long to search.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    /// Work, in distances looked up. With this alone the result is the same on every machine.
    pub work: u64,
    /// When to stop whatever is done.
    pub deadline: Option<Instant>,
}

/// What a search came to.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// A path that is clear.
    Found(Chain),
    /// There is none at this resolution.
    None(Option<Resolution>),
    /// None was found with the budget.
    NotFound,
}

const LEVELS: i32 = 5;
const QUOTA: u64 = 2_000;

/// Searches for a path. `report` is called with each better one.
pub fn search(problem: &Problem, budget: &Budget, report: &mut dyn FnMut(&Chain)) -> Outcome {
    let mut work = Work(0);
    let mut best: Option<Chain> = None;
    for way in problem.to_goal(&problem.start) {
        let length = crate::motion::length(&way);
        let direct = Chain { via: Vec::new(), stretches: way, length };
        if length <= problem.length_max && clear(problem, &direct, &mut work) {
            report(&direct);
            return Outcome::Found(direct);
        }
    }
    let mut random = Random::new(&[2026]);
    let span = (problem.goal.position() - problem.start.position).norm();
    let mut trees: Vec<Tree> = Vec::new();
    let mut exhausted = None;
    let mut round = 0_u32;
    while work.0 < budget.work && budget.deadline.is_none_or(|deadline| Instant::now() < deadline) {
        round += 1;
        let below = best.as_ref().map_or(problem.length_max, |best| best.length);
        let mut keep = |found: Chain, work: &mut Work, best: &mut Option<Chain>| {
            let found = straighten(problem, found, work);
            report(&found);
            *best = Some(found);
        };
        if best.is_none() {
            for level in 0..LEVELS.min(round as i32) as usize {
                if trees.len() == level {
                    let step = (0.4 * problem.radius).min(0.25 * span) / libm::exp2(level as f64);
                    let resolution = Resolution { step, rolls: 8 + 4 * level as u32, position: step * step / (2.0 * problem.radius), direction: 0.5 * step / problem.radius };
                    trees.push(Tree::new(problem, resolution));
                }
                let until = work.0 + (QUOTA << (round as usize / 4).saturating_sub(level).min(10));
                if let Some(found) = trees[level].advance(problem, &mut work, until, below) {
                    keep(found, &mut work, &mut best);
                    break;
                }
                if trees[level].is_exhausted() && exhausted.is_none_or(|e: usize| e < level) { exhausted = Some(level); }
            }
            if best.is_none() && exhausted == Some(LEVELS as usize - 1) {
                return Outcome::None(trees.last().map(|tree| tree.resolution));
            }
        }
        let below = best.as_ref().map_or(problem.length_max, |best| best.length);
        let until = work.0 + QUOTA;
        while work.0 < until {
            work.0 += 1;
            if let Some(found) = draw(problem, &mut random, below)
                && clear(problem, &found, &mut work)
            {
                keep(found, &mut work, &mut best);
                break;
            }
        }
        if let Some(mut chain) = best.take() {
            let until = work.0 + 3 * QUOTA;
            while work.0 < until {
                if let Some(shorter) = shorten(problem, &chain, &mut random, &mut work) { chain = shorter; }
            }
            report(&chain);
            best = Some(chain);
        }
    }
    match (best, exhausted) {
        (Some(best), _) => Outcome::Found(best),
        (None, Some(level)) => Outcome::None(Some(trees[level].resolution)),
        (None, None) => Outcome::NotFound,
    }
}
