//! Paths of an arc, a straight line and an arc, in any planes.
//!
//! The first arc has the angle `a`, with `tau = tan(a/2)`. The lines tangent to its two ends meet in the corner `A =
//! tau t0`. The goal's direction and the corner span the plane of the last arc. So the line is one of four: a tangent
//! from `A`, forwards or backwards, to one of the two circles that end in the goal. Each of these four branches has the
//! equation
//!
//! ```text
//! h(a) = tau^2 (1 + f) - (1 - f) = 0,   f = t0 . u
//! ```
//!
//! which requires that the line's direction `u` differs from `t0` by the angle `a`. `tau` is negative for arcs beyond
//! half a turn. All roots of all four branches are roots of one polynomial in `tau` of degree 10:
//!
//! - `polynomial.rs`: the polynomial, with bounds of its rounding;
//! - `isolation.rs`: the polynomial's real roots, each isolated, and the points at which rounding leaves a root open;
//! - `tangents.rs`: the branches that fit at a root, and their paths;
//! - `degenerate.rs`: arcs of no length or of half a turn, where roots are double, and lines that cross, where the
//!   polynomial does not determine the line's plane;
//! - `far.rs`: goals so far away that the polynomial consists of rounding errors only;
//! - `polish.rs`: Newton's method, which moves the end of each path exactly to the goal.

use core::f64::consts::TAU;

use heapless::Vec;
use nalgebra::{Matrix3, Vector3};

use super::ordered_list::insert_behind;
use super::problem::PathProblem;
use crate::trigonometry;

mod degenerate;
mod far;
mod isolation;
mod polish;
mod polynomial;
mod tangents;

/// A path of an arc, a straight line and an arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Csc {
    /// Direction in which the first arc bends, as an angle in the deposition plane from the x axis of the tip at the
    /// start, radians.
    pub first_bend_direction: f64,
    /// Angle of the first arc, radians.
    pub first_angle: f64,
    /// Length of the straight line, radii.
    pub straight: f64,
    /// Direction in which the last arc bends, as an angle in the deposition plane from the x axis of the tip at the end
    /// of the line, radians.
    pub last_bend_direction: f64,
    /// Angle of the last arc, radians.
    pub last_angle: f64,
}

/// Max distance of a goal, radii, for which paths with overlapping arcs are collected, because a helicoidal arc may be
/// close to such a path. With 2 and 3 as limits, the search returns a longer path than the best known one for 22 and 14
/// of the goals in `tests/best_known.csv`. With 8 the results are as good as with 3.9.
const NEAR: f64 = 3.9;
/// Max number of paths of arc, line and arc that are retained. There are up to seven to one goal.
pub const MAX_PATHS: usize = 8;
/// Max number of paths with overlapping arcs that are retained. There are at most seven, one for each root of the
/// polynomial.
const MAX_OVERLAPPING: usize = 8;
/// Max overlap of the two arcs of a path that is retained, radii. With 0.3, the search returns a longer path than the
/// best known one for 12 of the goals in `tests/best_known.csv`. With 3 the results are as good as with 1.
const MAX_OVERLAP: f64 = 1.0;
/// Max error at the goal of a path that Newton's method refines, radii. With 0.001 and with 0.2, the search finds the
/// best known path for as many goals in `tests/best_known.csv` as with 0.05.
const MAX_NEWTON_START_ERROR: f64 = 0.05;
/// Max difference of the lengths and angles of two paths that count as one path, radii and radians. With 1e-4, the
/// search returns a longer path than the best known one for 13 of the goals in `tests/best_known.csv`. With 1e-10 the
/// results are as good as with 1e-7.
const SAME: f64 = 1e-7;

impl Csc {
    /// Returns the length of the whole path, radii.
    pub fn length(&self) -> f64 {
        self.first_angle + self.straight + self.last_angle
    }

    /// Reports whether this path and another path count as the same.
    fn is(&self, other: &Self) -> bool {
        (other.length() - self.length()).abs() < SAME
            && (other.first_angle - self.first_angle).abs() < SAME
            && (other.straight - self.straight).abs() < SAME
    }
}

/// Returns `cos(a)` for `tau = tan(a/2)`.
fn cosine(tau: f64) -> f64 {
    (1.0 - tau * tau) / (1.0 + tau * tau)
}

/// Paths of arc, line and arc whose line has a negative length, so that the arcs overlap. A helicoidal arc is usually
/// close to such a path.
pub(super) type OverlappingPaths = Vec<Csc, MAX_OVERLAPPING>;

/// Returns all paths of arc, line and arc to the goal, shortest first.
pub fn paths(problem: &PathProblem) -> Vec<Csc, MAX_PATHS> {
    let (mut paths, mut overlapping) = (Vec::new(), Vec::new());
    search(problem, &mut paths, &mut overlapping, &mut || ());
    paths
}

/// Adds all paths of arc, line and arc to `paths`, shortest first, and the paths whose arcs overlap to `overlapping`.
/// Calls `keep_alive` a few times.
#[inline(never)] // Keeps its stack frame out of the caller's.
pub(super) fn search(
    problem: &PathProblem,
    paths: &mut Vec<Csc, MAX_PATHS>,
    overlapping: &mut OverlappingPaths,
    keep_alive: &mut dyn FnMut(),
) {
    let mut search = CscSearch { problem, paths, overlapping };
    search.roots(keep_alive);
    search.far();
    search.special_lines();
    search.crossing_lines();
}

struct CscSearch<'a> {
    problem: &'a PathProblem,
    paths: &'a mut Vec<Csc, MAX_PATHS>,
    overlapping: &'a mut OverlappingPaths,
}

impl CscSearch<'_> {
    /// Moves the end of a path exactly to the goal by Newton's method, if necessary, and inserts the path in order of
    /// length. The path is dropped if the method does not converge, or if the path is already in the list.
    #[inline(never)]
    fn keep(&mut self, path: Csc) {
        let Some(path) = self.problem.polished(path) else { return };
        if self.paths.iter().any(|other| other.is(&path)) {
            return;
        }
        insert_behind(self.paths, path, |other| other.length() <= path.length());
    }
}

/// The line of a path, and the arcs before and after it.
struct CscLine {
    /// Direction of the line, a unit vector.
    u: Vector3<f64>,
    /// `tan(a/2)` for the angle `a` of the first arc. Negative if the arc is more than half a turn.
    tau: f64,
    straight: f64,
    /// Direction in which the last arc bends, a unit vector perpendicular to `u`.
    towards: Vector3<f64>,
    /// Angle of the last arc, radians.
    last_angle: f64,
}

impl CscLine {
    fn path(&self) -> Csc {
        let &Self { u, tau, straight, towards, last_angle } = self;
        let half = libm::atan(tau);
        let first = if tau < 0.0 { TAU + 2.0 * half } else { 2.0 * half };
        // The first arc bends towards the line, or away from it if it is more than half a turn.
        let (x, y) = if tau < 0.0 { (-u.x, -u.y) } else { (u.x, u.y) };
        let first_towards = libm::atan2(y, x);
        // The tip's axes after the arc, in the direction of the bend and across it. They are the axes at the start,
        // turned without twist.
        let size = trigonometry::hypot(x, y);
        let bend = if size > 0.0 { Vector3::new(x / size, y / size, 0.0) } else { Vector3::x() };
        let across = Vector3::new(-bend.y, bend.x, 0.0);
        let scale = 1.0 / (1.0 + tau * tau);
        let inwards = bend * ((1.0 - tau * tau) * scale) - Vector3::z() * (2.0 * tau * scale);
        let last_towards = first_towards + libm::atan2(towards.dot(&across), towards.dot(&inwards));
        Csc {
            first_bend_direction: first_towards,
            first_angle: first,
            straight,
            last_bend_direction: last_towards,
            last_angle,
        }
    }
}

/// Returns the angle from the x axis, radians, that a direction has in the deposition plane of a tip with these axes.
fn in_tip(axes: &Matrix3<f64>, towards: &Vector3<f64>) -> f64 {
    let local = axes.transpose() * towards;
    libm::atan2(local.y, local.x)
}
