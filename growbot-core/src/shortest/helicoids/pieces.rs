//! The segments of which a helicoidal arc is grown: the arc is cut at its necks.
//!
//! Growth into a narrow neck magnifies rounding errors, because the plane of the bend turns there within a short
//! length. So the arc is cut at its necks. Each segment begins with the `m` and `p` of the closed form, so that no
//! segment magnifies the error of the previous one. Very narrow necks lie between circles (`hybrid_curve.rs`), which
//! are segments without `p`.

use core::f64::consts::TAU;

use heapless::Vec;
use nalgebra::Vector3;

use super::closed_form::{ClosedFormCurve, CurvePoint};
use super::hybrid_curve::{HybridCurve, Stretch};
use super::seed::Seed;
use super::{HelicoidPiece, HelicoidalArc};
use crate::helicoid::Helicoid;
use crate::trigonometry;

/// Max number of segments of a helicoidal arc.
pub const MAX_PIECES: usize = crate::path::MAX_SEGMENTS;
/// Max number of necks within an arc that may be the shortest path. Successive necks are one turn of the phase apart.
const MAX_NECKS: usize = 2;
/// Logarithm of `|m|` at a neck below which the arc is cut at this neck.
const NARROW: f64 = -3.0;
/// Min length of a segment, radii. Cuts that are closer to an end of the arc are omitted.
const MIN_PIECE: f64 = 1e-6;

impl HelicoidalArc {
    /// Returns the segments of the arc, in order.
    #[inline(never)]
    pub fn pieces(&self) -> Vec<HelicoidPiece, MAX_PIECES> {
        let mut pieces = Vec::new();
        // The list has space for all segments of an arc that may be the shortest.
        let mut add = |curve, length| {
            let _ = pieces.push(HelicoidPiece { curve, length });
        };
        let curve = self.seed.curve();
        if self.seed.uses_circles {
            HybridCurve::new(&curve).stretches(self.seed.start, self.seed.end, &mut |stretch, turned, length| {
                let helicoid = match stretch {
                    Stretch::Circle => self.circle(turned),
                    Stretch::Curve(from) => self.in_tip(&curve, turned, &from),
                };
                add(helicoid, length);
            });
        } else {
            self.cut_at_necks(&curve, &mut add);
        }
        pieces
    }

    fn cut_at_necks(&self, curve: &ClosedFormCurve<f64>, add: &mut dyn FnMut(Helicoid, f64)) {
        let [start, end] = curve.points([self.seed.start, self.seed.end]);
        let mut from = start;
        let mut add = |to: CurvePoint<f64>| {
            add(self.in_tip(curve, from.bend - start.bend, &from), to.length - from.length);
            from = to;
        };
        for neck in necks(&self.seed) {
            let [cut, _] = curve.points([neck; 2]);
            if (cut.length - start.length).min(end.length - cut.length) > MIN_PIECE {
                add(cut);
            }
        }
        add(end);
    }

    /// Returns the circle of a segment, in the frame of the tip at the start of the segment. `turned` is the angle
    /// (radians) by which the axis of the bend has turned about the tip between the start of the arc and the segment.
    fn circle(&self, turned: f64) -> Helicoid {
        let (sin, cos) = trigonometry::sin_cos(self.towards + turned);
        let side = if self.seed.mirrored { -1.0 } else { 1.0 };
        Helicoid { m0: Vector3::new(side * cos, sin, 0.0), p: Vector3::zeros() }
    }

    /// Returns the curve from a point on, in the frame of the tip at this point. `turned` is the angle (radians) by
    /// which the axis `w`, about which the tip turns, has itself turned about the tip since the start of the arc.
    fn in_tip(&self, curve: &ClosedFormCurve<f64>, turned: f64, point: &CurvePoint<f64>) -> Helicoid {
        let (sin, cos) = trigonometry::sin_cos(self.towards + turned);
        let (w, beside) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
        let [along_w, along_beside, ahead] = curve.p(point);
        let (mut m0, mut p) = (w * point.rho, w * along_w + beside * along_beside + Vector3::z() * ahead);
        if self.seed.mirrored {
            // `p` is a vector like a direction, and `m` is a vector like an axis, so they are mirrored differently.
            m0.x = -m0.x;
            p.y = -p.y;
        }
        // The scale is arbitrary, so the longer of the two becomes a unit vector.
        let scale = m0.norm().max(p.norm());
        Helicoid { m0: m0 / scale, p: p / scale }
    }
}

/// Returns the phases of the necks at which an arc is cut, in order.
fn necks(seed: &Seed<f64>) -> Vec<f64, MAX_NECKS> {
    let mut necks = Vec::new();
    for neck in [-TAU, 0.0, TAU] {
        if seed.narrowness < NARROW && seed.start < neck && neck < seed.end {
            let _ = necks.push(neck);
        }
    }
    necks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Frame, tip_direction};
    use crate::shortest::helicoids::fit::{Fit, FitGoal};
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn segments_end_where_the_arc_ends(
            narrowness in -28.0..-0.05_f64, ratio in -1.0..5.0_f64, start in -8.0..0.1, length in 0.2..8.0,
            mirrored in any::<bool>(),
        ) {
            let twist = (0.5 * narrowness + ratio).min(1.5_f64);
            let end = start + length;
            let seed = Seed { narrowness, twist, mirrored, start, end, uses_circles: false }.with_circles();
            let [from, to] = seed.ends(&seed.curve());
            prop_assume!(to.length - from.length < 8.0);
            let side = if mirrored { -1.0 } else { 1.0 };
            let reflected = |v: Vector3<f64>| Vector3::new(v.x, side * v.y, v.z);
            let start_from_curve = Rotation3::rotation_between(&from.direction, &Vector3::z()).unwrap();
            let [position, direction] =
                [start_from_curve * (to.position - from.position), start_from_curve * to.direction];
            let fit = Fit::new(&FitGoal { position, direction }, &seed);
            let arc = HelicoidalArc { seed, towards: fit.towards(), length: fit.length() };
            let grown = |tip: Frame, piece: &HelicoidPiece| tip * piece.curve.frame_after(piece.length);
            let end = arc.pieces().iter().fold(Frame::identity(), grown);
            let off = (end.translation.vector - reflected(position)).norm();
            prop_assert!(off < 1e-9, "{off:e} radii off");
            let off = (tip_direction(&end) - reflected(direction)).norm();
            prop_assert!(off < 1e-9, "{off:e} radians off");
            let length: f64 = arc.pieces().iter().map(|piece| piece.length).sum();
            prop_assert!((length - arc.length()).abs() < 1e-12);
        }
    }
}
