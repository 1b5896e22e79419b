//! Helicoidal arcs from one pose to another.
//!
//! `|m| + p . x'` is constant along a helicoidal curve and is scaled to 1, and `|m|` oscillates between a min and a
//! max. The points with the min are the *necks*. The curve is symmetric there: half a turn about the direction of the
//! bend maps the part after a neck to the part before it. Two numbers at the neck, `|m|` (its *narrowness*) and the
//! component of `p` along `m` (its *twist*), determine the whole curve. An arc is a part of the curve, whose beginning
//! and end are given by two phases.
//!
//! - `overlap_seeds.rs`: seeds from paths of arc, line and arc whose line has a negative length. A helicoidal arc with
//!   a narrow neck replaces the joint between the two arcs.
//! - `table.rs`: seeds from a table of arcs whose ends have nearly the same relative pose as start and goal.
//!   `invariants.rs`: the numbers by which these poses are compared.
//! - `closed_form.rs`: the point of a curve at a phase.
//! - `hybrid_curve.rs`: the point of a curve with circles between very narrow necks.
//! - `seed.rs`: the numbers that the search varies. `fit.rs`: the residual of an arc between start and goal.
//! - `refine.rs`: Newton's method from a seed to the goal, first in single precision, then in double precision.
//!   `precision.rs`: its parameters in either precision.
//! - `pieces.rs`: the segments of which an arc is grown.
//!
//! All seeds are refined roughly, and the arcs found are refined precisely, shortest first, until one reaches the goal.
//! This search is not complete. docs/measurements.md reports how often it does not find the shortest path.

use heapless::Vec;

use super::csc::Csc;
use super::ordered_list::insert_behind;
use super::problem::PathProblem;
use crate::helicoid::Helicoid;

mod closed_form;
mod fit;
mod hybrid_curve;
mod invariants;
mod overlap_seeds;
mod pieces;
mod precision;
mod refine;
mod seed;
mod table;

use fit::FitGoal;
use invariants::Invariants;
use refine::{Refinement, refine, refined_precisely};
use seed::Seed;

/// Max length of a helicoidal arc that is a shortest path, radii. The longest of 753 such arcs in
/// `tests/best_known.csv` has 7.27.
const MAX_LENGTH: f64 = 8.4;
/// Max difference between the length of an arc after the rough refinement and its precise length, radii.
const ROUGH_LENGTH: f64 = 0.02;
/// Max difference between the lengths (radii) of two roughly refined arcs that count as one.
const SAME_LENGTH: f64 = 2e-3;
/// Max difference between the logarithms of `|m|` at the neck of two arcs that count as one.
const SAME_NARROWNESS: f64 = 1.0;
/// Max number of roughly refined arcs that are retained: the shortest ones.
const MAX_ROUGH: usize = 12;
/// Min logarithm of `|m|` at the neck for a rough refinement. In single precision, an arc with a narrower neck cannot
/// be distinguished from two arcs that meet in a corner.
const TOO_NARROW: f64 = -13.0;
/// Max residual (radii and radians) of an arc that does not converge in single precision but is refined further in
/// double precision.
const NEARLY: f32 = 0.05;

/// A segment of a helicoidal arc, as a curve and a length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidPiece {
    /// The curve, in the frame of the tip at the start of the segment, in radii.
    pub curve: Helicoid,
    /// Length of the segment, radii.
    pub length: f64,
}

/// A helicoidal arc that leads from the start to the goal of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidalArc {
    seed: Seed<f64>,
    /// Angle of `m` in the deposition plane at the start (of the mirror image, if the arc is mirrored), radians.
    towards: f64,
    length: f64,
}

impl HelicoidalArc {
    /// Returns the length of the arc, radii.
    pub fn length(&self) -> f64 {
        self.length
    }
}

/// Returns the shortest helicoidal arc to the goal that the search finds. `None` if it finds no arc shorter than
/// `longest` (radii). `overlapping` are paths of arc, line and arc whose line has a negative length. On a
/// microcontroller, `keep_alive` is called every few milliseconds.
#[inline(never)] // Keeps its stack frame out of the caller's.
pub(super) fn shortest(
    problem: &PathProblem,
    overlapping: &[Csc],
    longest: f64,
    keep_alive: &mut dyn FnMut(),
) -> Option<HelicoidalArc> {
    let mut arcs = RoughArcs::new(problem, longest.min(MAX_LENGTH));
    for path in overlapping {
        arcs.add_joint(path, keep_alive);
    }
    for seed in table::nearest(&Invariants::of(problem)) {
        arcs.add(&seed, keep_alive);
    }
    arcs.shortest(problem, keep_alive)
}

/// An arc to be refined precisely: the result of a rough refinement in single precision, or a seed that is too narrow
/// for it.
struct RoughArc {
    seed: Seed<f64>,
    length: f64,
    arrived: bool,
}

/// The arcs that the search has found so far and that are to be refined precisely.
struct RoughArcs {
    /// The goal of the problem, and the mirror image of this goal.
    goals: [FitGoal<f32>; 2],
    longest: f64,
    /// The arcs, shortest first.
    arcs: Vec<RoughArc, MAX_ROUGH>,
}

impl RoughArcs {
    fn new(problem: &PathProblem, longest: f64) -> Self {
        Self { goals: FitGoal::both(problem), longest, arcs: Vec::new() }
    }

    /// Refines the seed that belongs to a path with overlapping arcs, and inserts the resulting arc.
    #[inline(never)]
    fn add_joint(&mut self, path: &Csc, keep_alive: &mut dyn FnMut()) {
        let seed = overlap_seeds::seed(path);
        if seed.narrowness < TOO_NARROW {
            self.keep(RoughArc { seed, length: path.length(), arrived: false });
        } else {
            self.add(&seed.rough(), keep_alive);
        }
    }

    /// Refines a seed roughly, and inserts the resulting arc.
    #[inline(never)]
    fn add(&mut self, seed: &Seed<f32>, keep_alive: &mut dyn FnMut()) {
        let [goal, mirror_image] = &self.goals;
        let goal = if seed.mirrored { mirror_image } else { goal };
        let (rough, fit, arrived) = match refine(goal, seed, keep_alive) {
            Refinement::Converged(rough, fit) => (rough, fit, true),
            Refinement::NotConverged(rough, fit) if fit.square() < NEARLY * NEARLY => (rough, fit, false),
            Refinement::NotConverged(..) => return,
        };
        self.keep(RoughArc { seed: rough.precise(), length: fit.length().into(), arrived });
    }

    /// Inserts an arc that may be the shortest. A full list drops the longest arc.
    fn keep(&mut self, arc: RoughArc) {
        let RoughArc { length, ref seed, .. } = arc;
        let is_same = |other: &RoughArc| {
            other.arrived
                && other.seed.mirrored == seed.mirrored
                && (other.length - length).abs() < SAME_LENGTH
                && (other.seed.narrowness - seed.narrowness).abs() < SAME_NARROWNESS
        };
        if length < self.longest + ROUGH_LENGTH && !self.arcs.iter().any(is_same) {
            insert_behind(&mut self.arcs, arc, |other| other.length <= length);
        }
    }

    /// Refines the arcs precisely, shortest first, and returns the shortest one that reaches the goal. `None` if none
    /// reaches it.
    #[inline(never)]
    fn shortest(&self, problem: &PathProblem, keep_alive: &mut dyn FnMut()) -> Option<HelicoidalArc> {
        let [goal, mirror_image] = &FitGoal::both(problem);
        let mut shortest: Option<HelicoidalArc> = None;
        for arc in &self.arcs {
            let longest = shortest.map_or(self.longest, |arc| arc.length);
            if arc.length > longest + ROUGH_LENGTH {
                break;
            }
            let goal = if arc.seed.mirrored { mirror_image } else { goal };
            if let Some((seed, fit)) = refined_precisely(goal, &arc.seed, keep_alive)
                && fit.length() < longest
            {
                shortest = Some(HelicoidalArc { seed, towards: fit.towards(), length: fit.length() });
            }
        }
        shortest
    }
}
