//! A body on a path of arcs, lines and helicoidal arcs, and its clearance in a scene.

use std::time::Instant;

use growbot_core::helicoid::{Helicoid, HelicoidIntegrator};
use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

use crate::centreline::{ArcSegment, Curve, arc_segments};
use crate::clearance::{Clearance, DistanceQueries, RequiredClearance, is_clear, min_clearance_until};
use crate::scene::Scene;

/// Maximum error of a reported clearance, mm. A reported clearance is never above the true one.
pub const CLEARANCE_TOLERANCE_MM: f64 = 1e-3;
/// Maximum length of the pieces into which a helicoidal arc is divided, as a multiple of its radius. The integration of
/// a piece takes one or two steps.
const HELICOID_PIECE: f64 = 0.25;

/// A piece of a body's centreline: an arc, a line or a short helicoidal arc.
#[derive(Debug, Clone, Copy)]
enum PathPiece {
    Stretch(ArcSegment),
    Helicoid { base_from_start: Frame, curve: Helicoid, radius: f64, length: f64 },
}

impl Curve for PathPiece {
    fn length(&self) -> f64 {
        match self {
            Self::Stretch(stretch) => stretch.length,
            Self::Helicoid { length, .. } => *length,
        }
    }

    fn point(&self, along: f64) -> Vector3<f64> {
        match self {
            Self::Stretch(stretch) => stretch.point(along),
            Self::Helicoid { base_from_start, curve, radius, .. } => {
                let segment = Segment::Helicoid { curve: *curve, radius: *radius, length: along };
                (base_from_start * segment.step()).translation.vector
            }
        }
    }

    fn chord_bound(&self, along: f64) -> f64 {
        match self {
            Self::Stretch(stretch) => stretch.chord_bound(along),
            Self::Helicoid { .. } => along,
        }
    }
}

/// Returns the point at the length `along` (mm) of a path that grows from the frame `base_from_start`. For a length
/// before the start or beyond the end of the path, returns the start or the end.
pub fn point_along(path: &[Segment], base_from_start: &Frame, along: f64) -> Vector3<f64> {
    let (mut base_from_tip, mut left) = (*base_from_start, along.max(0.0));
    for segment in path {
        let length = segment.length();
        let part = if left < length { segment.shortened(left) } else { *segment };
        base_from_tip *= part.step();
        left -= length;
        if left <= 0.0 {
            break;
        }
    }
    base_from_tip.translation.vector
}

/// Returns the pieces of a path that grows from a frame.
fn pieces(path: &[Segment], base_from_start: &Frame) -> Vec<PathPiece> {
    let mut base_from_tip = *base_from_start;
    let mut pieces = Vec::with_capacity(path.len());
    for segment in path {
        match *segment {
            Segment::Helicoid { curve, radius, length } => divide(&base_from_tip, &curve, radius, length, &mut pieces),
            plain => {
                pieces.extend(arc_segments(&[plain], &base_from_tip).into_iter().flatten().map(PathPiece::Stretch));
            }
        }
        base_from_tip *= segment.step();
    }
    pieces
}

/// Divides a helicoidal arc into short arcs of the same curve. The vectors m and p of a short arc are in the frame of
/// the tip at its start.
fn divide(base_from_tip: &Frame, curve: &Helicoid, radius: f64, length: f64, pieces: &mut Vec<PathPiece>) {
    let count = (length / radius / HELICOID_PIECE).ceil().max(1.0);
    let short = length / count;
    let mut walk = HelicoidIntegrator::new(curve);
    for _ in 0..count as usize {
        let mut start_from_tip = walk.frame();
        let tip_from_start = start_from_tip.rotation.inverse();
        let m0 = tip_from_start * curve.m(&start_from_tip.translation.vector);
        let curve = Helicoid { m0, p: tip_from_start * curve.p };
        start_from_tip.translation.vector *= radius;
        pieces.push(PathPiece::Helicoid {
            base_from_start: base_from_tip * start_from_tip,
            curve,
            radius,
            length: short,
        });
        walk.advance(short / radius);
    }
}

/// Returns true if a body on this path, which grows from the frame `base_from_start`, is proven to keep the required
/// clearance from all obstacles.
pub fn is_path_clear(scene: &Scene, path: &[Segment], base_from_start: &Frame, need: &RequiredClearance) -> bool {
    let mut work = DistanceQueries::default();
    // A body that begins outside a solid and stays clear of its surface stays outside. A body that begins inside is not
    // clear.
    if scene.contains(&base_from_start.translation.vector) {
        return false;
    }
    pieces(path, base_from_start).iter().all(|piece| is_clear(scene, piece, need, &mut work))
}

/// Returns the minimum distance of the centreline from the obstacles. The result is never above the true distance, and
/// at most [`CLEARANCE_TOLERANCE_MM`] below it. For a body that begins inside a solid mesh, the result is the negative
/// distance of the start from the mesh's surface.
pub fn clearance(scene: &Scene, path: &[Segment], base_from_start: &Frame) -> Clearance {
    // Without a deadline it is always found. The fallback proves nothing.
    let unproven = Clearance { distance: f64::NEG_INFINITY, arc_length: 0.0 };
    clearance_until(scene, path, base_from_start, None).unwrap_or(unproven)
}

/// Like [`clearance`], but returns `None` if the result is not found before the deadline.
pub fn clearance_until(
    scene: &Scene,
    path: &[Segment],
    base_from_start: &Frame,
    deadline: Option<Instant>,
) -> Option<Clearance> {
    let start = base_from_start.translation.vector;
    if scene.contains(&start) {
        return Some(Clearance { distance: scene.distance(&start) - CLEARANCE_TOLERANCE_MM, arc_length: 0.0 });
    }
    min_clearance_until(scene, &pieces(path, base_from_start), CLEARANCE_TOLERANCE_MM, deadline)
}
