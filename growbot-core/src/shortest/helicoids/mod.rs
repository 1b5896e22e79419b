//! Helicoidal arcs from one pose to another.
//!
//! `|m| + p . x'` is constant along such a curve and is scaled to 1, and `|m|` oscillates between a min and a max. The
//! points with the min are the *necks*. The curve is symmetric there: half a turn about the direction of the bend maps
//! the part after a neck to the part before it. Two numbers at the neck, `|m|` and the component of `p` along `m`,
//! determine the whole curve. Two phases determine the beginning and the end of an arc of it.
//!
//! - `joint.rs`: seeds from paths of arc, line and arc whose line has a negative length. A helicoidal arc with a narrow
//!   neck replaces the joint.
//! - `table.rs`: seeds from a table of arcs whose ends have nearly the same relative pose as start and goal.
//! - `closed_form.rs`: the point of a curve at a phase.
//! - `course.rs`: the point of a curve with circles between very narrow necks.
//! - `seed.rs`: the numbers that the search varies. `fit.rs`: the residual of an arc between start and goal.
//! - `refine.rs`: Newton's method from a seed to the goal, first in single precision, then in double precision.
//! - `neck.rs`: the segments of which an arc is grown.
//!
//! All seeds are refined roughly, and the arcs found are refined precisely, shortest first, until one reaches the goal.
//! This search is not complete. docs/measurements.md reports how often it does not find the shortest path.

use heapless::Vec;
use nalgebra::Vector3;

use super::csc::Csc;
use super::{PathProblem, insert_behind};
use crate::helicoid::Helicoid;

mod closed_form;
mod fit;
mod hybrid_curve;
mod overlap_seeds;
mod pieces;
mod refine;
mod seed;
mod table;

use fit::FitGoal;
use refine::{Refinement, refine, refined_precisely};
use seed::Seed;

/// Max length of a helicoidal arc that is a shortest path, radii. The longest of 753 in `tests/best_known.csv` has
/// 7.27.
const MAX_LENGTH: f64 = 8.4;
/// Max difference between the rough and the precise length of an arc, radii.
const ROUGH_LENGTH: f64 = 0.02;
/// Max difference of the rough lengths (radii) of two arcs that count as one.
const SAME_LENGTH: f64 = 2e-3;
/// Max difference of the logarithms of the narrowness of two arcs that count as one.
const SAME_NARROWNESS: f64 = 1.0;
/// Max number of roughly refined arcs that are retained. They are the shortest.
const MAX_ROUGH: usize = 12;
/// Logarithm of the narrowness of the neck below which arcs are not refined roughly. In single precision they cannot be
/// distinguished from arcs that meet in a corner.
const TOO_NARROW: f64 = -13.0;
/// Max residual (radii and radians) of an arc that does not reach the goal in single precision but is refined in double
/// precision.
const NEARLY: f32 = 0.05;

/// A segment of a helicoidal arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidPiece {
    /// The curve, in the frame of the tip that starts the segment.
    pub curve: Helicoid,
    /// Length, radii.
    pub length: f64,
}

/// A helicoidal arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidalArc {
    seed: Seed<f64>,
    /// Angle of `m` in the deposition plane at the start (of the mirror image, if the arc is mirrored), radians.
    towards: f64,
    length: f64,
}

impl HelicoidalArc {
    /// Returns the length, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }
}

/// Returns the shortest helicoidal arc to the goal that is found and is shorter than `longest`. `overlapping` are paths
/// of arc, line and arc whose line has a negative length. `keep_alive` is called every few milliseconds on a
/// microcontroller.
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

/// An arc that was refined roughly.
struct RoughArc {
    seed: Seed<f64>,
    length: f64,
    arrived: bool,
}

/// The arcs found so far.
struct RoughArcs {
    /// The goal, and its mirror image.
    goals: [FitGoal<f32>; 2],
    longest: f64,
    /// The arcs, in order of length.
    arcs: Vec<RoughArc, MAX_ROUGH>,
}

impl RoughArcs {
    fn new(problem: &PathProblem, longest: f64) -> Self {
        Self { goals: FitGoal::both(problem), longest, arcs: Vec::new() }
    }

    /// Refines the seed of a path whose arcs overlap, and inserts the arc.
    #[inline(never)]
    fn add_joint(&mut self, path: &Csc, keep_alive: &mut dyn FnMut()) {
        let seed = overlap_seeds::seed(path);
        if seed.narrowness < TOO_NARROW {
            self.keep(RoughArc { seed, length: path.length(), arrived: false });
        } else {
            self.add(&seed.rough(), keep_alive);
        }
    }

    /// Refines a seed roughly, and inserts the arc.
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

    /// Refines the arcs precisely, shortest first, until the remaining ones are longer than the shortest that reaches
    /// the goal.
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

/// Relative pose of start and goal, in numbers that the roll does not change. Start and goal are in a canonical order,
/// and the goal is on a canonical side.
#[derive(Debug, Clone, Copy)]
struct Invariants {
    numbers: [f32; 5],
    /// True if the goal is on the opposite side.
    mirrored: bool,
    /// True if start and goal are exchanged.
    reversed: bool,
}

impl Invariants {
    /// Returns the invariants of a problem. The weights of the numbers were found by trial.
    fn of(problem: &PathProblem) -> Self {
        let PathProblem { goal, direction, .. } = problem;
        let (along_start, along_goal) = (goal.z, goal.dot(direction));
        let side = Vector3::z().dot(&goal.cross(direction));
        let numbers = [
            along_start.max(along_goal),
            along_start.min(along_goal),
            1.3 * direction.z,
            0.7 * goal.norm(),
            0.7 * side.abs(),
        ];
        Self { numbers: numbers.map(|number| number as f32), mirrored: side < 0.0, reversed: along_start < along_goal }
    }

    /// Returns the square of the distance.
    fn distance(&self, other: &[f32; 5]) -> f32 {
        self.numbers.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum()
    }
}
