//! Proof that a body is clear of a scene along its whole length, without sampling.
//!
//! The distance from a point to the obstacles changes by no more than the point moves. So if a point of a curve has the
//! distance `d`, the part of the curve within the length `d - required` of this point keeps the distance `required`.
//! The rest of the curve is halved repeatedly, until the whole curve is proven to be clear, or a point is too near.

use std::time::Instant;

use crate::centreline::Curve;
use crate::scene::Scene;

/// Number of distance queries, as a measure of the work of a search.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DistanceQueries(pub u64);

/// Clearance that a body needs, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RequiredClearance {
    /// Minimum distance of the centreline from obstacles, mm: half the tube's diameter and the margin.
    pub distance: f64,
    /// Tolerance of the proof, mm. A curve whose clearance is below `distance + tolerance` may be rejected, so that
    /// grazing contact need not be resolved.
    pub tolerance: f64,
}

/// Returns true if a curve is proven to keep the required clearance from the obstacles. Adds the number of distance
/// queries to `work`.
pub fn is_clear(scene: &Scene, stretch: &impl Curve, required: &RequiredClearance, work: &mut DistanceQueries) -> bool {
    is_clear_between(scene, stretch, [0.0, stretch.length()], required, work)
}

/// Like [`is_clear`], but for the part between two lengths along the curve, mm.
pub fn is_clear_between(
    scene: &Scene,
    stretch: &impl Curve,
    between: [f64; 2],
    required: &RequiredClearance,
    work: &mut DistanceQueries,
) -> bool {
    // Parts that are not proven yet. Halving leaves one waiting part for each level.
    let mut waiting = [[0.0; 2]; 64];
    waiting[0] = between;
    let mut count = 1_usize;
    while let Some([from, to]) = count.checked_sub(1).and_then(|last| waiting.get(last)).copied() {
        count -= 1;
        let half = 0.5 * (to - from);
        let middle = from + half;
        work.0 += 1;
        let reach = stretch.chord_bound(half);
        let enough = required.distance + reach.max(required.tolerance);
        let distance = scene.distance_within(&stretch.point(middle), enough);
        if distance >= enough {
            continue;
        }
        let spare = distance - required.distance;
        if spare < required.tolerance && spare < reach {
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

/// Proven minimum clearance of a body, with its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// Minimum distance of the centreline from all obstacles, mm.
    pub distance: f64,
    /// Length along the body at which it is nearest to the obstacles, mm.
    pub arc_length: f64,
}

/// Returns the minimum distance of the centreline from the obstacles. The result is never above the true distance, and
/// at most `tolerance` (mm) below it.
pub fn min_clearance(scene: &Scene, stretches: &[impl Curve], tolerance: f64) -> Clearance {
    // Without a deadline it is always found. The fallback proves nothing.
    let unproven = Clearance { distance: f64::NEG_INFINITY, arc_length: 0.0 };
    min_clearance_until(scene, stretches, tolerance, None).unwrap_or(unproven)
}

/// Number of distance queries of [`min_clearance_until`] between two checks of the clock.
const QUERIES_PER_CLOCK_CHECK: u32 = 512;

/// Like [`min_clearance`], but returns `None` if the result is not found before `deadline`. For a long body beside a
/// wall, a distance query is needed for each two tolerances of its length.
pub fn min_clearance_until(
    scene: &Scene,
    stretches: &[impl Curve],
    tolerance: f64,
    deadline: Option<Instant>,
) -> Option<Clearance> {
    let mut nearest = Clearance { distance: f64::INFINITY, arc_length: 0.0 };
    let mut waiting = Vec::new();
    let (mut before, mut looked_up) = (0.0, 0_u32);
    for stretch in stretches {
        waiting.push([0.0, stretch.length()]);
        while let Some([from, to]) = waiting.pop() {
            looked_up = looked_up.wrapping_add(1);
            if looked_up.is_multiple_of(QUERIES_PER_CLOCK_CHECK)
                && deadline.is_some_and(|deadline| Instant::now() >= deadline)
            {
                return None;
            }
            let half = 0.5 * (to - from);
            let middle = from + half;
            let reach = stretch.chord_bound(half);
            // An obstacle that is farther away does not matter.
            let enough = nearest.distance + reach;
            let distance = scene.distance_within(&stretch.point(middle), enough);
            if distance >= enough {
                continue;
            }
            if distance - tolerance < nearest.distance {
                nearest = Clearance { distance: distance - tolerance, arc_length: before + middle };
            }
            // Points within this length are proven to be no nearer than the minimum so far.
            let proven = distance - nearest.distance;
            if proven < reach {
                waiting.extend([[from, middle - proven], [middle + proven, to]]);
            }
        }
        before += stretch.length();
    }
    Some(nearest)
}
