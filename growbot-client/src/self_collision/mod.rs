//! Checks whether a body would collide with itself.
//!
//! A body is a tube round its centreline. Two stretches collide if their centrelines come nearer than the tube's outer
//! diameter `D`. Stretches less than `pi D / 2` apart along the body are neighbours and are not compared. A tube of
//! this diameter can only make bends with a radius of `D / 2` or more. Such a bend keeps the ends of a longer stretch
//! at least `D` apart if it turns by no more than half a turn.
//!
//! The search halves the body repeatedly and only examines pairs of pieces that may be near enough. A piece lies within
//! `k l^2 / 8` of its chord (`k` the curvature, `l` the length), so the distance of two chords bounds that of the
//! pieces. Long bodies that stay clear of themselves take a few steps a segment.

mod body_tree;

use std::f64::consts::FRAC_PI_2;

use growbot_core::path::Segment;

use body_tree::{BodyNode, CollisionBody, Span, bound};

/// Closest approach of a body to itself. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// Distance between the two points of the centreline. It is at most the true minimum distance, and below it by at
    /// most [`TOLERANCE`].
    pub distance: f64,
    /// Positions of the two points along the body, the earlier first.
    pub at: [f64; 2],
}

/// Maximum error of a reported distance, as a fraction of the diameter.
pub const TOLERANCE: f64 = 1e-3;
/// Smallest piece that is still halved where the neighbourhood ends, as a fraction of the neighbourhood.
const FINEST_SHARE: f64 = 1.0 / 16.0;
/// Maximum number of pairs to examine. The remaining pairs then count as near as they may be. Only a body that passes
/// itself thousands of times needs more.
const MAX_PAIRS: usize = 4_000_000;

/// Returns the closest approach of a body on this path to itself, if it is nearer than `diameter` (mm, positive).
/// Compares only pairs of points of which the later one lies beyond `since` (mm along the body; 0 for the whole body).
#[must_use]
pub fn closest_self_approach(path: &[Segment], diameter: f64, since: f64) -> Option<Collision> {
    search(path, diameter, since).0
}

/// Like [`closest_self_approach`], but also returns the number of pairs of stretches that were examined.
fn search(path: &[Segment], diameter: f64, since: f64) -> (Option<Collision>, usize) {
    let body = CollisionBody::new(path, since);
    let mut search = CollisionSearch {
        body: &body,
        neighbourhood: FRAC_PI_2 * diameter,
        sag: 0.5 * TOLERANCE * diameter / 2.0,
        nearest: Collision { distance: diameter, at: [0.0; 2] },
        found: false,
        left: MAX_PAIRS,
    };
    search.run();
    (search.found.then_some(search.nearest), MAX_PAIRS - search.left)
}

/// State of a search.
struct CollisionSearch<'a> {
    body: &'a CollisionBody,
    /// Points that are less than this apart along the body are not compared, mm.
    neighbourhood: f64,
    /// A part that stays within this distance of its chord is not halved further, mm.
    sag: f64,
    nearest: Collision,
    found: bool,
    /// Number of pairs that may still be examined.
    left: usize,
}

impl CollisionSearch<'_> {
    fn run(&mut self) {
        let Some(root) = self.body.groups.last() else { return };
        // The earlier stretch comes first. A stretch paired with itself stands for all pairs within it.
        let mut pairs = vec![(*root, None)];
        while let Some((a, b)) = pairs.pop() {
            self.left = self.left.saturating_sub(1);
            match b {
                None => {
                    if !self.may_meet(&a.span, &a.span) {
                        continue;
                    }
                    if self.left == 0 {
                        // The pairs within were not examined.
                        self.found_at(0.0, [a.span.from, a.span.to]);
                        return;
                    }
                    let [first, second] = self.body.halves(&a);
                    pairs.extend([(second, None), (first, None), (first, Some(second))]);
                }
                Some(b) => self.pair(&a, &b, &mut pairs),
            }
        }
    }

    /// Reports whether points of these stretches may collide: they are far enough apart along the body, and the turn
    /// between them can bring them together. A curve that turns by a right angle at most advances by at least
    /// `cos(pi / 4)` of its length.
    fn may_meet(&self, a: &Span, b: &Span) -> bool {
        b.to > self.body.since && b.to - a.from > self.neighbourhood && b.turned[1] - a.turned[0] > FRAC_PI_2
    }

    /// Records a pair of points if it is nearer than all before.
    fn found_at(&mut self, distance: f64, at: [f64; 2]) {
        if distance < self.nearest.distance {
            self.nearest = Collision { distance, at };
            self.found = true;
        }
    }

    fn pair(&mut self, a: &BodyNode, b: &BodyNode, pairs: &mut Vec<(BodyNode, Option<BodyNode>)>) {
        if !self.may_meet(&a.span, &b.span) {
            return;
        }
        let (distance, on) = bound(a, b);
        if distance >= self.nearest.distance {
            return;
        }
        let strangers = b.span.from - a.span.to >= self.neighbourhood;
        let small = |node: &BodyNode| node.is_part() && node.span.length() <= FINEST_SHARE * self.neighbourhood;
        if !strangers && small(a) && small(b) {
            // This is the end of the neighbourhood, where points are still well apart.
            return;
        }
        let fine = |node: &BodyNode| node.is_part() && node.reach <= self.sag;
        if self.left == 0 || (strangers && fine(a) && fine(b)) {
            let along = |span: &Span, share: f64| span.from + share * span.length();
            self.found_at(distance, [along(&a.span, on[0]), along(&b.span, on[1])]);
            return;
        }
        // Halve the node whose position is less certain.
        let coarseness = |node: &BodyNode| match (node.is_part(), strangers) {
            (false, _) => f64::INFINITY,
            (true, true) => node.reach,
            (true, false) => node.span.length(),
        };
        let halve_a = match (a.is_part(), b.is_part()) {
            (false, false) => a.reach >= b.reach,
            _ => coarseness(a) >= coarseness(b),
        };
        // Examine the nearer pair first, because its result may make the other unnecessary.
        let mut halves = if halve_a {
            self.body.halves(a).map(|half| (half, *b))
        } else {
            self.body.halves(b).map(|half| (*a, half))
        };
        let [near, far] = [0, 1].map(|i| bound(&halves[i].0, &halves[i].1).0);
        if near <= far {
            halves.reverse();
        }
        pairs.extend(halves.map(|(a, b)| (a, Some(b))));
    }
}

#[cfg(test)]
mod tests;
