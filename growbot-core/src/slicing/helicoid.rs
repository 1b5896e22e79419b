//! Slicing of a helicoidal arc into layers that end where the arc ends.
//!
//! Each layer is a short circular arc that bends in the direction in which the curve bends along the layer. The error
//! of a chain of such arcs is of the order of the square of a layer's tilt. So the angles of deposition and the height
//! of all layers are corrected, and also the tilts where these do not help (a curve that stays in a plane). The
//! correction is the smallest, in the sense of least squares, that moves the end of the chain to the end of the curve.
//! A few rounds make it exact to the last digits.
//!
//! A path cuts an arc at its necks into several segments, and some are shorter than a layer. So successive segments are
//! corrected together.

use heapless::Vec;
use nalgebra::{Matrix5, Vector3, Vector5};

use crate::angle::wrap_positive;
use crate::helicoid::{Helicoid, HelicoidIntegrator};
use crate::layer::Layer;
use crate::linalg5::Cholesky;
use crate::path::{MAX_SEGMENTS, Segment};
use crate::pose::{Frame, column, tip_direction};

/// Max distance between the ends of the corrected layers and of the curve, radii, and max angle between their
/// directions, radians (`docs/decisions/0010-exact-slicing.md`).
const CORRECTION_TOLERANCE: f64 = 1e-13;
/// Max number of rounds of the correction. Each round reduces the error by a factor of about 1/tilt, so some seven
/// rounds suffice for a tilt of 0.01. The other rounds are for steps that are reversed.
const ROUNDS: usize = 30;
/// Weight of a relative change of a tilt against a change of alpha (radians) in the correction, so that tilts change
/// only where alpha cannot help. With 1 and with 0.01 the tests of [`crate::slicing`] pass too.
const TILT_WEIGHT: f64 = 0.1;
/// Damping of the normal equations of the correction, as a fraction of their trace, so that they can always be solved.
/// It is larger than the rounding of `f64`. With 1e-9 and with 1e-17 the tests of [`crate::slicing`] pass too.
const DAMPING: f64 = 1e-13;

/// The correction of alpha, height and tilt of the layers of a chain.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SlicingCorrection {
    /// Vector `force` in `u = tilt (force x (end - x) + moment)`. The alpha of a layer at `x` that bends in the
    /// direction `n` about the axis `b` changes by `n . u` (radians). Its tilt changes by the fraction `-TILT_WEIGHT^2
    /// b . u`.
    force: Vector3<f64>,
    /// Vector `moment` in the formula `u = tilt (force x (end - x) + moment)` of the field `force`.
    moment: Vector3<f64>,
    /// Factor by which the heights and tilts of all layers are multiplied.
    scale: f64,
}

/// The equal layers into which one segment is divided, before the correction.
#[derive(Debug, Clone, Copy)]
pub(super) struct EqualLayers {
    /// Length of a layer along the curve, before correction, radii. It is also the tilt, radians.
    pub(super) tilt: f64,
    pub(super) count: u32,
}

/// Max number of segments that are corrected together.
pub(super) const MAX_TOGETHER: usize = MAX_SEGMENTS;

/// The layers of successive helicoidal segments, in the frame of the tip at the start of the first segment. Lengths are
/// in radii.
#[derive(Debug, Clone)]
pub(super) struct HelicoidLayers<'a> {
    segments: &'a [Segment],
    layers: Vec<EqualLayers, MAX_TOGETHER>,
    /// Frame of the tip at the end of the last segment.
    end: Frame,
    correction: SlicingCorrection,
    /// Position at which the next layer begins.
    at: Cursor,
}

/// A position on a sequence of helicoidal segments.
#[derive(Debug, Clone)]
struct Cursor {
    /// Index of the present segment. `left` is the number of its remaining layers.
    segment: usize,
    left: u32,
    /// Frame of the tip at the start of the present segment.
    from: Frame,
    walk: HelicoidIntegrator,
    /// Frame of the tip at the present position.
    here: Frame,
}

impl<'a> HelicoidLayers<'a> {
    /// Returns layers that are corrected so that they end at the end of the curve. `layers` contains the number of
    /// layers of each segment.
    pub(super) fn exact(
        segments: &'a [Segment],
        layers: Vec<EqualLayers, MAX_TOGETHER>,
        keep_alive: &mut dyn FnMut(),
    ) -> Self {
        let mut layers = Self::steps(segments, layers);
        layers.end = segments.iter().fold(Frame::identity(), |tip, segment| match segment {
            Segment::Helicoid { curve, radius, length } => {
                keep_alive();
                tip * curve.frame_after(length / radius)
            }
            _ => tip,
        });
        layers.correct(keep_alive);
        layers
    }

    /// Returns layers without a correction.
    pub(super) fn steps(segments: &'a [Segment], layers: Vec<EqualLayers, MAX_TOGETHER>) -> Self {
        let correction = SlicingCorrection { force: Vector3::zeros(), moment: Vector3::zeros(), scale: 1.0 };
        let at = Cursor::first(segments, &layers);
        Self { segments, layers, end: Frame::identity(), correction, at }
    }

    /// Returns the number of layers of all segments.
    pub(super) fn count(&self) -> u64 {
        self.layers.iter().map(|layers| u64::from(layers.count)).sum()
    }

    /// Returns the number of helicoidal segments that the layers cover.
    pub(super) fn segments(&self) -> usize {
        self.segments.len()
    }

    /// Returns the next layer and the index of its segment. Beyond the last layer the curve continues.
    pub(super) fn next(&mut self, radius: f64) -> (usize, Layer) {
        let (bend, tilt, before) = self.advance();
        let arm = self.end.translation.vector - before.translation.vector;
        let on_layer = (self.correction.force.cross(&arm) + self.correction.moment) * tilt;
        let axis = tip_direction(&before).cross(&bend);
        let in_tip = before.rotation.inverse() * bend;
        let alpha = libm::atan2(in_tip.y, in_tip.x) + core::f64::consts::PI + bend.dot(&on_layer);
        let height = tilt * self.correction.scale;
        let tilt = height * (1.0 - TILT_WEIGHT * TILT_WEIGHT * axis.dot(&on_layer));
        (self.at.segment, Layer { alpha: wrap_positive(alpha), height: height * radius, tilt })
    }

    /// Returns the layer with the max tilt.
    pub(super) fn steepest(&self, radius: f64, keep_alive: &mut dyn FnMut()) -> Layer {
        let mut layers = self.rewound();
        let all = (0..self.count()).map(|_| {
            keep_alive();
            layers.next(radius).1
        });
        all.fold(Layer::default(), |steepest, layer| if layer.tilt > steepest.tilt { layer } else { steepest })
    }

    /// Returns the roll of the tip at the end of the layers relative to the tip at the end of the curve, radians.
    pub(super) fn roll(&self, keep_alive: &mut dyn FnMut()) -> f64 {
        let end_from_tip = self.end.rotation.inverse() * self.chain_end(keep_alive).rotation;
        let x = column::<0>(end_from_tip.matrix());
        libm::atan2(x.y, x.x)
    }

    /// Advances along the curve by one layer. Returns the direction in which the curve bends along the layer
    /// (perpendicular to the tip's direction), the tilt, and the frame of the tip before the layer.
    fn advance(&mut self) -> (Vector3<f64>, f64, Frame) {
        let at = &mut self.at;
        if at.left == 0
            && let Some(Segment::Helicoid { curve, .. }) = self.segments.get(at.segment + 1)
        {
            at.segment += 1;
            at.left = self.layers.get(at.segment).map_or(0, |layers| layers.count);
            at.walk = HelicoidIntegrator::new(curve);
            at.from = at.here;
        }
        at.left = at.left.saturating_sub(1);
        let tilt = self.layers.get(at.segment).map_or(0.0, |layers| layers.tilt);
        let before = at.here;
        at.walk.advance(tilt);
        at.here = at.from * at.walk.frame();
        let (here, next) = (tip_direction(&before), tip_direction(&at.here));
        let bend = (next - here * here.dot(&next)).try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::zeros);
        (bend, tilt, before)
    }

    fn rewound(&self) -> Self {
        Self { at: Cursor::first(self.segments, &self.layers), ..self.clone() }
    }

    /// Returns the frame at the end of the chain of layers.
    fn chain_end(&self, keep_alive: &mut dyn FnMut()) -> Frame {
        let mut layers = self.rewound();
        (0..self.count()).fold(Frame::identity(), |start_from_tip, _| {
            keep_alive();
            start_from_tip * layers.next(1.0).1.step()
        })
    }

    /// Returns the error of the end of the layers relative to the end of the curve: the position in the axes of the
    /// curve's start, and the direction in the axes of the curve's end.
    fn residual(&self, keep_alive: &mut dyn FnMut()) -> Vector5<f64> {
        let chain = self.chain_end(keep_alive);
        let offset = self.end.translation.vector - chain.translation.vector;
        let turn = self.end.rotation.inverse() * tip_direction(&chain);
        Vector5::new(offset.x, offset.y, offset.z, -turn.x, -turn.y)
    }

    /// Finds the correction that moves the end of the layers to the end of the curve. Each round solves the
    /// least-squares problem `sum J J^T lambda = lack` for `lambda`, where `lack` is the remaining error. There is one
    /// `J` for the alpha of each layer and one for its tilt, the derivatives of the end with respect to them. One more
    /// `J` is the derivative with respect to the scale of all layers.
    fn correct(&mut self, keep_alive: &mut dyn FnMut()) {
        let end_axes = self.end.rotation.matrix();
        let (end_x, end_y) = (column::<0>(end_axes), column::<1>(end_axes));
        let end_direction = tip_direction(&self.end);
        let moved = |turn: &Vector3<f64>, arm: &Vector3<f64>| {
            let (offset, turned) = (turn.cross(arm), turn.cross(&end_direction));
            Vector5::new(offset.x, offset.y, offset.z, turned.dot(&end_x), turned.dot(&end_y))
        };

        let mut layers = self.rewound();
        let (mut sum, mut by_scale) = (Matrix5::zeros(), Vector5::zeros());
        for _ in 0..self.count() {
            keep_alive();
            let (bend, tilt, before) = layers.advance();
            let direction = tip_direction(&before);
            let arm = self.end.translation.vector - before.translation.vector;
            let by_alpha = moved(&(-bend * tilt), &arm);
            let by_tilt = moved(&(direction.cross(&bend) * tilt), &arm);
            let weighted = by_tilt * TILT_WEIGHT;
            sum += by_alpha * by_alpha.transpose() + weighted * weighted.transpose();
            let axial = direction * tilt;
            by_scale += by_tilt + Vector5::new(axial.x, axial.y, axial.z, 0.0, 0.0);
        }
        sum += by_scale * by_scale.transpose();
        let damping = sum.trace() * DAMPING;
        for index in 0..5 {
            sum[(index, index)] += damping;
        }
        let Some(normal_equations) = Cholesky::new(&sum) else { return };

        let (mut best, mut min_miss, mut best_lack) = (self.correction, f64::INFINITY, Vector5::zeros());
        let mut share = 1.0;
        for _ in 0..ROUNDS {
            let lack = self.residual(keep_alive);
            let miss = lack.norm();
            if miss < min_miss {
                (best, min_miss, best_lack) = (self.correction, miss, lack);
                share = f64::min(2.0 * share, 1.0);
            } else {
                share *= 0.25;
            }
            if min_miss <= CORRECTION_TOLERANCE || miss.is_nan() {
                break;
            }
            let lambda = normal_equations.solve(&best_lack) * share;
            // `J . lambda` for any layer. The terms that do not depend on the layer are computed once.
            let on_position = Vector3::new(lambda[0], lambda[1], lambda[2]);
            let on_direction = end_x * lambda[3] + end_y * lambda[4];
            self.correction = SlicingCorrection {
                force: best.force + on_position,
                moment: best.moment + on_direction.cross(&end_direction),
                scale: best.scale + by_scale.dot(&lambda),
            };
        }
        self.correction = best;
    }
}

impl Cursor {
    /// Returns the position at the start of the first segment.
    fn first(segments: &[Segment], layers: &[EqualLayers]) -> Self {
        let curve = match segments.first() {
            Some(Segment::Helicoid { curve, .. }) => *curve,
            _ => Helicoid { m0: Vector3::x(), p: Vector3::zeros() },
        };
        let left = layers.first().map_or(0, |layers| layers.count);
        Self {
            segment: 0,
            left,
            from: Frame::identity(),
            walk: HelicoidIntegrator::new(&curve),
            here: Frame::identity(),
        }
    }
}
