//! Paths of an arc, a straight line and an arc, in any planes.
//!
//! Given the angle `a` of the first arc, with `tau = tan(a/2)`, the lines tangent to its two ends meet in the corner `A
//! = tau t0`. The goal's direction and the corner span the plane of the last arc, so the line is one of four: a tangent
//! from `A`, forwards or backwards, to one of the two circles that end in the goal. For each of these branches the one
//! equation
//!
//! ```text
//! h(a) = tau^2 (1 + f) - (1 - f) = 0,   f = t0 . u
//! ```
//!
//! says that the line's direction `u` differs from `t0` by the angle `a`. Its roots are bracketed by probes and refined
//! (`roots.rs`); there are up to seven paths. `tau` is negative for arcs beyond half a turn. Some paths need a
//! construction of their own (`special.rs`). Newton's method brings each path exactly to the goal (`newton.rs`).

use heapless::Vec;
use nalgebra::{Matrix3, Vector3};

use super::{Problem, insert_behind};

mod newton;
mod roots;
mod special;

/// An arc, a straight line, an arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Csc {
    /// Direction in the tip's frame towards which the first arc bends, radians.
    pub first_towards: f64,
    /// Angle of the first arc, radians.
    pub first: f64,
    /// Length of the line.
    pub straight: f64,
    /// Direction in the tip's frame, there, towards which the last arc bends, radians.
    pub last_towards: f64,
    /// Angle of the last arc, radians.
    pub last: f64,
}

/// Goals nearer than this (radii) need more probes and may have overlapping paths. Trial: with 2 and 3 there are 22
/// and 14 misses, with 8 as many as now.
const NEAR: f64 = 3.9;
/// Max number of paths that are retained: there are up to seven.
pub const MAX_PATHS: usize = 8;
/// Max number of overlapping paths that are retained: there are up to seven roots.
const MAX_OVERLAPPING: usize = 8;
/// Max overlap of two arcs, radii. Trial: with 0.3 there are 12 misses, with 3 as many as with 1.
const MAX_OVERLAP: f64 = 1.0;
/// Max error at the goal of a path that Newton's method refines, radii. Trial: 0.001 and 0.2 give as many misses as
/// now.
const NEARLY: f64 = 0.05;
/// Max difference of each number for two paths to count as one. Trial: with 1e-4 there are 13 misses, with 1e-10 as
/// many as with 1e-7.
const SAME: f64 = 1e-7;

impl Csc {
    /// Length of the whole path.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.first + self.straight + self.last
    }
}

/// `cos(a)` of `tau = tan(a/2)`.
fn cosine(tau: f64) -> f64 {
    (1.0 - tau * tau) / (1.0 + tau * tau)
}

/// Paths whose line has a negative length, so that the arcs overlap. A helicoidal arc is usually near such a path.
pub(super) type Overlapping = Vec<Csc, MAX_OVERLAPPING>;

/// Finds all paths of this kind, shortest first, and the overlapping ones. `keep_alive` is called for each probe.
#[inline(never)] // Its room on the stack is not the caller's.
pub(super) fn search(
    problem: &Problem,
    paths: &mut Vec<Csc, MAX_PATHS>,
    overlapping: &mut Overlapping,
    keep_alive: &mut dyn FnMut(),
) {
    let mut search = Search { problem, paths, overlapping };
    search.half(1.0, keep_alive);
    search.half(-1.0, keep_alive);
    search.special_lines();
    search.crossing_lines();
}

struct Search<'a> {
    problem: &'a Problem,
    paths: &'a mut Vec<Csc, MAX_PATHS>,
    overlapping: &'a mut Overlapping,
}

impl Search<'_> {
    /// Keeps a path that ends at the goal, after Newton's method if necessary, in order of length.
    #[inline(never)]
    fn keep(&mut self, path: Csc) {
        let Some(path) = self.problem.polished(path) else { return };
        let same = |other: &Csc| {
            (other.length() - path.length()).abs() < SAME
                && (other.first - path.first).abs() < SAME
                && (other.straight - path.straight).abs() < SAME
        };
        if self.paths.iter().any(same) {
            return;
        }
        insert_behind(self.paths, path, |other| other.length() <= path.length());
    }
}

/// The angle in the deposition plane of a tip with these axes.
fn in_tip(axes: &Matrix3<f64>, towards: &Vector3<f64>) -> f64 {
    let local = axes.transpose() * towards;
    libm::atan2(local.y, local.x)
}
