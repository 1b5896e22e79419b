//! Whether a body is clear of a scene along its whole length, proven and not sampled.
//!
//! The distance from a point to the obstacles changes by no more than the point moves. So all of a curve within the
//! length `d - need` of a point at distance `d` keeps off by `need`. What that leaves of a stretch is halved again,
//! until all is proven, or a point is too near.

use std::time::Instant;

use crate::motion::Curve;
use crate::scene::Scene;

/// What a search may spend: distances looked up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Work(pub u64);

/// What a body needs: mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Need {
    /// The centreline must keep this far from obstacles: half the tube's diameter and the margin.
    pub distance: f64,
    /// What comes nearer than `distance` and this may be refused: a stretch that just touches need not be resolved.
    pub slack: f64,
}

/// Whether a stretch keeps off the obstacles.
#[must_use]
pub fn is_clear(scene: &Scene, stretch: &impl Curve, need: &Need, work: &mut Work) -> bool {
    is_clear_between(scene, stretch, [0.0, stretch.length()], need, work)
}

/// As [`is_clear`], between two lengths.
#[must_use]
pub fn is_clear_between(scene: &Scene, stretch: &impl Curve, between: [f64; 2], need: &Need, work: &mut Work) -> bool {
    // What is left to prove; halving leaves one waiting for each level.
    let mut waiting = [[0.0; 2]; 64];
    waiting[0] = between;
    let mut count = 1_usize;
    while let Some([from, to]) = count.checked_sub(1).and_then(|last| waiting.get(last)).copied() {
        count -= 1;
        let half = 0.5 * (to - from);
        let middle = from + half;
        work.0 += 1;
        let reach = stretch.reach(half);
        let enough = need.distance + reach.max(need.slack);
        let distance = scene.distance_within(&stretch.point(middle), enough);
        if distance >= enough {
            continue;
        }
        let spare = distance - need.distance;
        if spare < need.slack && spare < reach {
            return false;
        }
        if spare < reach && half > 0.0 {
            for next in [[from, middle - spare], [middle + spare, to]] {
                let Some(place) = waiting.get_mut(count) else { return false };
                *place = next;
                count += 1;
            }
        }
    }
    true
}

/// The least clearance of a body: proven, with its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// No point of the centreline is nearer to an obstacle than this, mm.
    pub distance: f64,
    /// How far along the body the nearest point lies, mm.
    pub at: f64,
}

/// The least distance of the centreline from the obstacles: at most the true one, and at least that less `tolerance`.
#[must_use]
pub fn least(scene: &Scene, stretches: &[impl Curve], tolerance: f64) -> Clearance {
    // Without a deadline it is found; nothing would be proven else.
    let unproven = Clearance { distance: f64::NEG_INFINITY, at: 0.0 };
    least_until(scene, stretches, tolerance, None).unwrap_or(unproven)
}

/// Distances that [`least_until`] looks up between two looks at the clock.
const BETWEEN_LOOKS: u32 = 512;

/// As [`least`]. None if it is not found before `deadline`: a long body beside a wall needs a distance for every two
/// tolerances.
#[must_use]
pub fn least_until(
    scene: &Scene,
    stretches: &[impl Curve],
    tolerance: f64,
    deadline: Option<Instant>,
) -> Option<Clearance> {
    let mut nearest = Clearance { distance: f64::INFINITY, at: 0.0 };
    let mut waiting = Vec::new();
    let (mut before, mut looked_up) = (0.0, 0_u32);
    for stretch in stretches {
        waiting.push([0.0, stretch.length()]);
        while let Some([from, to]) = waiting.pop() {
            looked_up = looked_up.wrapping_add(1);
            if looked_up.is_multiple_of(BETWEEN_LOOKS) && deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return None;
            }
            let half = 0.5 * (to - from);
            let middle = from + half;
            let reach = stretch.reach(half);
            // What is farther than this cannot matter.
            let enough = nearest.distance + reach;
            let distance = scene.distance_within(&stretch.point(middle), enough);
            if distance >= enough {
                continue;
            }
            if distance - tolerance < nearest.distance {
                nearest = Clearance { distance: distance - tolerance, at: before + middle };
            }
            // Points within this length are proven to be no nearer than what is known.
            let proven = distance - nearest.distance;
            if proven < reach {
                waiting.extend([[from, middle - proven], [middle + proven, to]]);
            }
        }
        before += stretch.length();
    }
    Some(nearest)
}
