//! Helicoidal arcs from one pose to another.
//!
//! `|m| + p . x'` is constant along such a curve and is scaled to 1, and `|m|` swings between a min and a max. The
//! point with the min is the *neck*. The curve is symmetric there: half a turn about the direction of the bend maps the
//! part after the neck to the part before it. So two numbers at the neck, `|m|` and the component of `p` along `m`,
//! give the whole curve, and one integration from there gives all arcs that begin and end anywhere on it (`neck.rs`).
//!
//! The search has three steps:
//!
//! 1. A grid over the two numbers is searched for arcs whose ends lie to each other nearly as start and goal do
//!    (`grid.rs`). Paths of arc, line and arc whose line has a negative length give further seeds (`at_joint`).
//! 2. Each seed is refined by the Levenberg-Marquardt method, first with a coarse integration, then with a fine one
//!    (`refine.rs`).
//! 3. The result becomes one piece, or two pieces that meet at the neck (`pieces.rs`).
//!
//! At a narrow neck the torsion, `-(m . p)/|m|^2`, turns the plane of the bend within a very short length: there the
//! curve is nearly three circular arcs. The steps of the coarse integration therefore integrate the direction of `m` in
//! closed form.

use heapless::Vec;

use super::csc::Csc;
use super::{Problem, insert_behind};
use crate::angle::wrap_signed;
use crate::helicoid::Helicoid;
use crate::pose::Frame;
use crate::trigonometry;

mod grid;
mod neck;
mod pieces;
mod refine;

use grid::{Grid, Seeds, pop_shortest};
use pieces::arc_of;
use refine::{Seed, refined};

/// Max number of arcs that are retained. Trial: with 1 there are as many misses; `plan_where` offers the others to
/// its caller.
pub const MAX_ARCS: usize = 3;
/// Max length of a helicoidal arc that is a shortest path, radii. The longest of 753 in `tests/best_known.csv` has
/// 7.27.
const MAX_LENGTH: f64 = 8.4;
/// Max change of an arc's length by refinement that is reckoned with, radii. Longer seeds than the best arc plus
/// this are left out. Trial: with 0.1 there are 12 misses, with 0.25 and 1.0 as many as with 0.5.
const MARGIN: f64 = 0.5;
/// Max difference of the coarse lengths (radii) for two arcs to count as one. Trial: 1e-4 and 0.02 give as many
/// misses as now.
const SAME_LENGTH: f64 = 2e-3;
/// Max number of coarse lengths that are remembered. Trial: 8 and 72 give as many misses; a shorter list only costs
/// time.
const MAX_TRIED: usize = 24;
/// Max number of fine refinements that may fail at about one length before that length is left out. Trial: with 1
/// and 20 there are 14 and 9 misses; more cost time.
const MAX_FAILED: usize = 5;
/// Overlap of two arcs (radii) below which their seeds are refined finely at once. Trial: with 0.002 there are as
/// many misses, with 0.2 there are 9, for more fine refinements.
const LITTLE_OVERLAP: f64 = 0.02;
/// Narrowness of the necks that are tried where two arcs overlap, as shares of the expected one. Trial: with the
/// expected one alone there are 12 misses, with 0.5, 1 and 2 there are 9.
const AT_JOINT: [f64; 3] = [0.2, 1.0, 5.0];
/// Max difference between the coarse and the fine length of an arc, radii. Bounded by the test
/// `the_coarse_integration_agrees_with_the_fine_one`.
const COARSE_LENGTH: f64 = 0.02;

/// A piece of a helicoidal arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The curve, in the frame of the tip that starts the piece.
    pub curve: Helicoid,
    /// Length, radii.
    pub length: f64,
}

impl Piece {
    /// `start_from_end`, lengths in radii.
    fn frame(&self) -> Frame {
        self.curve.frame_after(self.length)
    }
}

/// A helicoidal arc. An arc with a narrow neck has two pieces that meet at the neck: in one piece, a rounding error
/// before the neck would turn everything after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidalArc {
    /// The only piece, or the one before the neck.
    pub first: Piece,
    /// The piece after the neck.
    pub second: Option<Piece>,
}

impl HelicoidalArc {
    /// The pieces in order.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + use<> {
        [Some(self.first), self.second].into_iter().flatten()
    }

    /// Length, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.pieces().map(|piece| piece.length).sum()
    }
}

/// Finds helicoidal arcs to the goal that are shorter than `longest`, shortest first. `overlapping` are paths of arc,
/// line and arc whose line has a negative length. `keep_alive` is called every few milliseconds on a microcontroller.
#[inline(never)] // Its room on the stack is not the caller's.
pub(super) fn search(
    problem: &Problem,
    overlapping: &[Csc],
    longest: f64,
    found: &mut Vec<HelicoidalArc, MAX_ARCS>,
    keep_alive: &mut dyn FnMut(),
) {
    let longest = longest.min(MAX_LENGTH);
    let mut search = Search { problem, longest, found, refined: Tried::default(), failed: Tried::default() };
    for path in overlapping {
        for seed in at_joint(path) {
            keep_alive();
            if path.straight > -LITTLE_OVERLAP {
                // The coarse integration cannot resolve such a small overlap.
                search.refine_finely(&seed, keep_alive);
            } else {
                search.refine(&seed, keep_alive);
            }
        }
    }
    let mut seeds = Seeds::new();
    Grid::new(problem).seeds(longest, &mut seeds, keep_alive);
    // Short seeds first: the arcs found bound the length of the seeds that are still worth refining.
    while let Some(seed) = pop_shortest(&mut seeds) {
        keep_alive();
        search.refine(&seed.seed(), keep_alive);
    }
}

/// Seeds with a narrow neck where two arcs overlap, which means that the line between them has a negative length. At
/// the neck the bend turns from the plane of the first arc to that of the last. Two arcs would need to turn it at once.
///
/// Near such a neck `m'' = m/|m|`. If the plane turns by a small angle `psi`, the square of `twist` is `narrowness
/// psi^2 2/pi^2`, and the bend is longer than that of two arcs by `psi^2 sqrt(2 narrowness)/8`: this is the overlap.
/// For greater angles `psi/2` is replaced by its tangent, which is roughly right.
fn at_joint(path: &Csc) -> [Seed; 3] {
    let turned = wrap_signed(path.last_towards - path.first_towards);
    let tangent = trigonometry::tan(0.5 * turned.abs().clamp(0.1, 3.0));
    let overlap = -path.straight;
    AT_JOINT.map(|share| {
        let narrowness = (share * 2.0 * overlap * overlap / (tangent * tangent * tangent * tangent)).clamp(1e-9, 1.0);
        Seed {
            narrowness: libm::log(narrowness),
            twist: libm::log((0.9 * tangent * libm::sqrt(narrowness)).clamp(1e-5, 3.0)),
            mirrored: turned > 0.0,
            before: (path.first - 0.5 * overlap).max(0.05),
            after: (path.last - 0.5 * overlap).max(0.05),
        }
    })
}

/// The arcs found and tried so far.
struct Search<'a> {
    problem: &'a Problem,
    longest: f64,
    found: &'a mut Vec<HelicoidalArc, MAX_ARCS>,
    /// Arcs that were refined finely.
    refined: Tried,
    /// Arcs for which the fine refinement failed.
    failed: Tried,
}

/// An arc that was tried.
#[derive(Debug)]
struct TriedArc {
    /// Length by the coarse integration, radii.
    length: f32,
    mirrored: bool,
}

/// The arcs that were tried.
#[derive(Debug, Default)]
struct Tried(Vec<TriedArc, MAX_TRIED>);

impl Tried {
    /// Remembers an arc. If the list is full, the arc may be tried again, which only costs time.
    fn push(&mut self, length: f64, mirrored: bool) {
        let _ = self.0.push(TriedArc { length: length as f32, mirrored });
    }

    /// The number of arcs whose length differs from this by less than `off`.
    fn about(&self, length: f64, mirrored: bool, off: f64) -> usize {
        let about = |arc: &&TriedArc| (f64::from(arc.length) - length).abs() < off && arc.mirrored == mirrored;
        self.0.iter().filter(about).count()
    }
}

impl Search<'_> {
    /// Refines a seed and keeps the arc, if it may be the shortest.
    #[inline(never)]
    fn refine(&mut self, seed: &Seed, keep_alive: &mut dyn FnMut()) {
        let best = self.found.first().map_or(self.longest, HelicoidalArc::length);
        if seed.length() > best + MARGIN {
            return;
        }
        if let Some(coarse) = refined(self.problem, seed, best, false, keep_alive) {
            self.refine_finely(&coarse, keep_alive);
        }
    }

    /// Refines a seed that was refined coarsely, and keeps the arc.
    #[inline(never)]
    fn refine_finely(&mut self, coarse: &Seed, keep_alive: &mut dyn FnMut()) {
        let best = self.found.first().map_or(self.longest, HelicoidalArc::length);
        let length = coarse.length();
        let known = self.refined.about(length, coarse.mirrored, SAME_LENGTH) > 0
            || self.failed.about(length, coarse.mirrored, COARSE_LENGTH) > MAX_FAILED;
        if length > best + COARSE_LENGTH || known {
            return;
        }
        if let Some(fine) = refined(self.problem, coarse, best, true, keep_alive)
            && let Some(arc) = arc_of(self.problem, &fine, keep_alive)
        {
            self.refined.push(length, coarse.mirrored);
            if arc.length() >= self.longest {
                return;
            }
            insert_behind(self.found, arc, |other| other.length() <= arc.length());
        } else {
            self.failed.push(length, coarse.mirrored);
        }
    }
}
