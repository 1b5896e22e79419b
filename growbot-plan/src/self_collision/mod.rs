//! Check whether a body would collide with itself.
//!
//! A body is a tube around its centreline. Two parts of the body collide if their centrelines come nearer than the
//! tube's outer diameter `D`. Points less than `pi D / 2` apart along the body are neighbours and are not compared. A
//! tube of this diameter can only make bends with a radius of `D / 2` or more. The ends of a longer part that turns by
//! at most half a turn are therefore at least `D` apart.
//!
//! The search halves the body repeatedly and only examines pairs of parts that may collide. A part lies within `k l^2 /
//! 8` of its chord (`k` the curvature, `l` the length), so the distance between two chords gives a lower bound of the
//! distance between the parts. Long bodies that stay clear of themselves take a few steps per segment.

mod body_tree;

use std::f64::consts::FRAC_PI_2;

use body_tree::{BodyNode, CollisionBody, Span, bound};
use growbot_core::path::Segment;

/// Closest approach of a body to itself. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// Distance between the two points of the centreline, mm. It is a lower bound of the true minimum distance, with an
    /// error of at most [`TOLERANCE`].
    pub distance: f64,
    /// Lengths along the body up to the two points, mm, the smaller first.
    pub at: [f64; 2],
}

/// Maximum error of a reported distance, as a fraction of the tube's diameter.
pub const TOLERANCE: f64 = 1e-3;
/// Length of the smallest parts into which the body is halved at the limit between neighbours and other points, as a
/// fraction of the length within which points are neighbours.
const FINEST_SHARE: f64 = 1.0 / 16.0;
/// Maximum number of pairs of parts to examine. After that, the lower bound of a pair's distance is reported as its
/// distance. Only a body that passes itself thousands of times needs more pairs.
const MAX_PAIRS: usize = 4_000_000;

/// Returns the closest approach of a body on this path to itself. `None` if it is not nearer than `diameter` (mm,
/// positive). Only the part beyond the length `since` (mm) is compared with all earlier parts; 0 compares the whole
/// body.
pub fn closest_self_approach(path: &[Segment], diameter: f64, since: f64) -> Option<Collision> {
    search(path, diameter, since).0
}

/// Like [`closest_self_approach`], but also returns the number of pairs of parts that were examined.
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

/// State of a search for the closest approach.
struct CollisionSearch<'a> {
    body: &'a CollisionBody,
    /// Length along the body within which two points are neighbours and are not compared, mm.
    neighbourhood: f64,
    /// Maximum distance of a part from its chord at which it is not halved further, mm.
    sag: f64,
    nearest: Collision,
    found: bool,
    /// Number of pairs of parts that may still be examined.
    left: usize,
}

impl CollisionSearch<'_> {
    fn run(&mut self) {
        let Some(root) = self.body.groups.last() else { return };
        // Pairs of parts, the earlier part first. `None` pairs a part with itself, for all pairs of points within it.
        let mut pairs = vec![(*root, None)];
        while let Some((a, b)) = pairs.pop() {
            self.left = self.left.saturating_sub(1);
            match b {
                None => {
                    if !self.may_meet(&a.span, &a.span) {
                        continue;
                    }
                    if self.left == 0 {
                        // The pairs of points within this part were not examined.
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

    /// Reports whether points of these two parts may collide: some are not neighbours, and the body turns by more than
    /// a right angle between them. The ends of a curve that turns by a right angle at most are at least `cos(pi / 4)`
    /// of its length apart.
    fn may_meet(&self, a: &Span, b: &Span) -> bool {
        b.to > self.body.since && b.to - a.from > self.neighbourhood && b.turned[1] - a.turned[0] > FRAC_PI_2
    }

    /// Records a pair of points if their distance is the smallest so far.
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
            // The points are at the limit of the neighbourhood, where they cannot be near each other.
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
        // Examine the nearer pair first, because its result may exclude the other pair.
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
