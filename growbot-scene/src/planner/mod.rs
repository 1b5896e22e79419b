//! Paths through a scene.
//!
//! First the shortest unobstructed ways are tried, in order of length. Then bodies are drawn at random, and trees of
//! arcs and lines are grown at finer and finer resolutions (`search_tree.rs`). Each tip of a tree is connected to the
//! goal by growbot's own shortest paths. A path that is found is shortened while it stays clear (`improve.rs`), and
//! shorter ones are searched for as well. If no path is found for several rounds, the planner tries to prove that
//! obstacles separate start and goal (`flood.rs`).
//!
//! All work is counted in distance queries, so that a search that is limited by their number gives the same result on
//! every machine.

mod budget;
mod flood;
mod improve;
mod problem;
mod search_tree;
mod via_path;
mod ways_to_goal;

use std::time::Instant;

use growbot_core::random::Rng;

use self::budget::BudgetTracker;
use self::flood::Flood;
use self::improve::{PathShortener, cost, is_via_path_clear, perturbed, sample_path, straighten};
pub use self::problem::{PlannerGoal, PlanningProblem};
pub use self::search_tree::SearchResolution;
use self::search_tree::SearchTree;
pub use self::via_path::ViaPath;
use crate::centreline::length;

/// Limits of a search.
#[derive(Debug, Clone, Copy)]
pub struct SearchBudget {
    /// Maximum number of distance queries. If this is the only limit, the result is the same on every machine.
    pub max_queries: u64,
    /// Time at which the search stops in any case. `None` for no time limit.
    pub deadline: Option<Instant>,
    /// True to stop at the first path found.
    pub stop_at_first: bool,
}

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub enum SearchOutcome {
    /// The shortest clear path that was found.
    Found(ViaPath),
    /// No path exists: start or goal is too near to an obstacle, or no gap between them is wide enough.
    Infeasible(InfeasibleReason),
    /// The search was completed at all resolutions without a path. The field is the finest resolution.
    ExhaustedAt(SearchResolution),
    /// No path was found within the budget.
    BudgetExhausted,
}

/// Reason why no path exists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InfeasibleReason {
    /// The start is too near to an obstacle. The field is the start's distance from the obstacle, mm.
    StartTooClose(f64),
    /// The goal is too near to an obstacle. The field is the goal's distance from the obstacle, mm.
    GoalTooClose(f64),
    /// The goal is farther from the start than the maximum length of the body. The field is the goal's distance, mm,
    /// less its tolerance.
    GoalTooFar(f64),
    /// Obstacles surround the start or the goal, and no gap is wide enough.
    Separated,
}

/// Number of resolutions at which the search grows trees.
const LEVELS: usize = 5;
/// Limit of distance queries for each part of a round: the growth of a tree, or random bodies.
const QUOTA: u64 = 2_000;
/// Limit of distance queries for the shortening in a round.
const SHORTENING: u64 = 5 * QUOTA;
/// Numbers of rounds without a path after which separation of start and goal is checked.
const ROUNDS_TO_FLOOD: [u32; 3] = [6, 16, 32];
/// Maximum excess of a new body's length over the best length for which the new body is shortened, as a fraction of the
/// best length.
const LONGER: f64 = 0.05;

/// Searches for a path. Calls `report` with each path that is better than all previous ones.
pub fn search(problem: &PlanningProblem, budget: &SearchBudget, report: &mut dyn FnMut(&ViaPath)) -> SearchOutcome {
    if let Some(why) = check_feasibility(problem) {
        return SearchOutcome::Infeasible(why);
    }
    let mut meter = BudgetTracker::new(budget.max_queries, budget.deadline);
    for stretches in problem.ways_to_goal(&problem.start) {
        let direct = ViaPath { via: Vec::new(), length: length(&stretches), segments: stretches };
        if direct.length <= problem.max_length && is_via_path_clear(problem, &direct, &mut meter.work) {
            report(&direct);
            return SearchOutcome::Found(direct);
        }
    }
    let mut search = Search { problem, meter, random: Rng::new(&[SEED]), trees: Vec::new(), best: None, report };
    search.run(budget.stop_at_first)
}

/// Seed of the random numbers of a search.
const SEED: u64 = 2026;

/// Returns the reason why no path exists, if a quick check finds one.
pub fn check_feasibility(problem: &PlanningProblem) -> Option<InfeasibleReason> {
    let (start, goal) = (problem.start.position, problem.goal.position());
    let near = problem.scene.distance(&start);
    if near < problem.required_clearance.distance {
        return Some(InfeasibleReason::StartTooClose(near));
    }
    let near = problem.scene.distance(&goal);
    if near + problem.tolerance() < problem.required_clearance.distance {
        return Some(InfeasibleReason::GoalTooClose(near));
    }
    let far = (goal - start).norm() - problem.tolerance();
    (far > problem.max_length).then_some(InfeasibleReason::GoalTooFar(far))
}

/// A search in progress.
struct Search<'a, 'b> {
    problem: &'a PlanningProblem<'b>,
    meter: BudgetTracker,
    random: Rng,
    /// The trees that have been begun, one for each resolution, the coarsest first.
    trees: Vec<SearchTree>,
    best: Option<PathShortener>,
    report: &'a mut dyn FnMut(&ViaPath),
}

impl Search<'_, '_> {
    fn run(&mut self, first_only: bool) -> SearchOutcome {
        let mut round = 0;
        while !self.meter.check_exhausted() {
            self.grow_trees(round);
            if self.best.is_none() && self.trees.len() == LEVELS && self.trees.iter().all(SearchTree::is_exhausted) {
                break;
            }
            self.try_random_bodies();
            if first_only && self.best.is_some() {
                break;
            }
            self.shorten();
            round += 1;
            if self.best.is_none() && self.check_separation(round) {
                return SearchOutcome::Infeasible(InfeasibleReason::Separated);
            }
        }
        if let Some(best) = self.best.take() {
            return SearchOutcome::Found(best.chain);
        }
        if self.trees.iter().all(SearchTree::is_exhausted) && self.check_separation_at_all_levels() {
            return SearchOutcome::Infeasible(InfeasibleReason::Separated);
        }
        // A search that was cut off gives no proof, because coarser trees mean little.
        let is_complete = self.trees.len() == LEVELS && self.trees.iter().all(SearchTree::is_exhausted);
        let finest = self.trees.last().filter(|_| is_complete);
        finest.map_or(SearchOutcome::BudgetExhausted, |tree| SearchOutcome::ExhaustedAt(tree.resolution))
    }

    /// In the rounds [`ROUNDS_TO_FLOOD`], checks whether obstacles separate start and goal, each time at a finer
    /// resolution. Returns false in all other rounds.
    fn check_separation(&mut self, round: u32) -> bool {
        let fineness = ROUNDS_TO_FLOOD.iter().position(|rounds| *rounds == round);
        let Some(fineness) = fineness.and_then(|index| flood::FINENESS.get(index)) else { return false };
        flood::separated(self.problem, *fineness, &mut self.meter) == Flood::Separated
    }

    /// Checks whether obstacles separate start and goal, at all resolutions.
    fn check_separation_at_all_levels(&mut self) -> bool {
        let separated = |fineness| flood::separated(self.problem, fineness, &mut self.meter) == Flood::Separated;
        flood::FINENESS.into_iter().any(separated)
    }

    /// Returns the length below which a new path is useful, mm.
    fn below(&self) -> f64 {
        self.best.as_ref().map_or(self.problem.max_length, |best| best.chain.length)
    }

    /// Records and reports a new body if it costs less than the best body so far.
    fn keep(&mut self, shortening: PathShortener) {
        let cost = |chain: &ViaPath| cost(self.problem, chain);
        if self.best.as_ref().is_none_or(|best| cost(&shortening.chain) < cost(&best.chain)) {
            (self.report)(&shortening.chain);
            self.best = Some(shortening);
        }
    }

    /// Grows each tree further, in later rounds by more distance queries, and twice as many as the next finer tree.
    /// Stops at the first path that is found.
    fn grow_trees(&mut self, round: u32) {
        for level in 0..LEVELS.min(round as usize + 1) {
            let below = self.below();
            if self.trees.len() == level {
                self.trees.push(SearchTree::new(self.problem, SearchResolution::of_level(self.problem, level)));
            }
            let Some(tree) = self.trees.get_mut(level) else { return };
            let doublings = (round / 4).saturating_sub(level as u32).min(10);
            let until = self.meter.work.0 + (QUOTA << doublings);
            if let Some(found) = tree.advance(self.problem, &mut self.meter, until, below) {
                let found = straighten(self.problem, found, &mut self.meter.work);
                self.keep(PathShortener::new(found));
                return;
            }
        }
    }

    /// Draws random bodies until one is clear. If a best body exists, the new body is shortened before the two are
    /// compared.
    fn try_random_bodies(&mut self) {
        let below = if self.best.is_some() { self.below() * (1.0 + LONGER) } else { self.problem.max_length };
        let until = self.meter.work.0 + QUOTA;
        while !self.meter.check_exhausted_or_at(until) {
            self.meter.work.0 += 1;
            let drawn = match &self.best {
                Some(best) if self.random.below(2) == 0 => {
                    perturbed(self.problem, &best.chain, &mut self.random, below)
                }
                _ => sample_path(self.problem, &mut self.random, below),
            };
            let Some(found) = drawn.filter(|found| is_via_path_clear(self.problem, found, &mut self.meter.work)) else {
                continue;
            };
            let mut found = PathShortener::new(straighten(self.problem, found, &mut self.meter.work));
            if self.best.is_some() {
                let until = self.meter.work.0 + SHORTENING;
                found.advance(self.problem, &mut self.random, &mut self.meter, until);
            }
            self.keep(found);
            return;
        }
    }

    /// Shortens the best body.
    fn shorten(&mut self) {
        let Some(best) = &mut self.best else { return };
        let before = best.chain.length;
        let until = self.meter.work.0 + SHORTENING;
        best.advance(self.problem, &mut self.random, &mut self.meter, until);
        if best.chain.length < before {
            (self.report)(&best.chain);
        }
    }
}
