//! Slicing of a helicoidal arc into layers that end where it ends.
//!
//! Each layer is a short circular arc that bends towards where the curve goes along the layer. A chain of such arcs
//! strays from the curve by the square of a layer's tilt, so the angles of deposition, the height of all layers and,
//! where these do not help (a curve that stays in a plane), the tilts are corrected by the least (in squares) that
//! brings the chain's end to the curve's: to the last digits, in a few rounds.

use nalgebra::{Matrix5, Vector3, Vector5};

use crate::angle::wrap_positive;
use crate::helicoid::{Helicoid, Walk};
use crate::layer::Layer;
use crate::linalg5::Cholesky;
use crate::pose::{Frame, column, tip_direction};

/// Max error of a correction at the curve's end, radii and radians (`docs/decisions/0005-helicoidal-layers.md`).
const ARRIVED: f64 = 1e-13;
/// Max number of rounds of correction. A round gains a factor of about 1/tilt, so that some seven suffice for a
/// tilt of 0.01; the others are for steps that are taken back.
const ROUNDS: usize = 30;
/// Weight of a relative change of tilt against a radian of alpha, so that tilts change only where alpha cannot
/// help. Trial: with 1 and 0.01 the tests of [`crate::slicing`] pass too.
const TILT_WEIGHT: f64 = 0.1;
/// Damping of the normal equations, as a share of their trace, so that they can always be solved. It lies above the
/// rounding of `f64`. Trial: with 1e-9 and 1e-17 the tests of [`crate::slicing`] pass too.
const DAMPING: f64 = 1e-13;

/// The correction of a chain of layers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Correction {
    /// The force of `u = force x (end - x) + moment`, for a layer at `x` that bends towards `n` about `b`: alpha
    /// changes by `n . u`, and the tilt by its share `-TILT_WEIGHT^2 b . u`.
    force: Vector3<f64>,
    /// The moment of the same formula.
    moment: Vector3<f64>,
    /// Factor of all heights and tilts.
    scale: f64,
}

/// The layers of a helicoidal arc, one after the other, in the frame of the tip that starts it. Lengths in radii.
#[derive(Debug, Clone)]
pub(super) struct HelicoidLayers {
    curve: Helicoid,
    /// How far along the curve a layer leads, before correction: also its tilt, radians.
    tilt: f64,
    count: u64,
    /// The end of the curve.
    end: Frame,
    correction: Correction,
    /// The tip on the curve, at the next layer, and its frame there.
    walk: Walk,
    here: Frame,
}

impl HelicoidLayers {
    /// Layers that end where the curve does after `length` radii, `count` of them.
    pub(super) fn exact(curve: &Helicoid, length: f64, count: u64, keep_alive: &mut dyn FnMut()) -> Self {
        let mut layers = Self::steps(curve, length / count as f64, count);
        layers.end = curve.frame_after(length);
        layers.correct(keep_alive);
        layers
    }

    /// Uncorrected layers of this tilt.
    pub(super) fn steps(curve: &Helicoid, tilt: f64, count: u64) -> Self {
        let none = Correction { force: Vector3::zeros(), moment: Vector3::zeros(), scale: 1.0 };
        let (walk, start) = (Walk::new(curve), Frame::identity());
        Self { curve: *curve, tilt, count, end: start, correction: none, walk, here: start }
    }

    /// The next layer. Beyond the last layer the curve continues.
    pub(super) fn next(&mut self, radius: f64) -> Layer {
        let before = self.here;
        let arm = self.end.translation.vector - before.translation.vector;
        let bend = self.advance();
        let on_layer = self.correction.force.cross(&arm) + self.correction.moment;
        let axis = tip_direction(&before).cross(&bend);
        let in_tip = before.rotation.inverse() * bend;
        let alpha = libm::atan2(in_tip.y, in_tip.x) + core::f64::consts::PI + bend.dot(&on_layer);
        let height = self.tilt * self.correction.scale;
        let tilt = height * (1.0 - TILT_WEIGHT * TILT_WEIGHT * axis.dot(&on_layer));
        Layer { alpha: wrap_positive(alpha), height: height * radius, tilt }
    }

    /// The layer of max tilt.
    pub(super) fn steepest(&self, radius: f64, keep_alive: &mut dyn FnMut()) -> Layer {
        let mut layers = self.rewound();
        let all = (0..self.count).map(|_| {
            keep_alive();
            layers.next(radius)
        });
        all.fold(Layer::default(), |steepest, layer| if layer.tilt > steepest.tilt { layer } else { steepest })
    }

    /// The roll of the chain's tip against the curve's tip at the end, radians.
    pub(super) fn roll(&self, keep_alive: &mut dyn FnMut()) -> f64 {
        let end_from_tip = self.end.rotation.inverse() * self.chain_end(keep_alive).rotation;
        let x = column::<0>(end_from_tip.matrix());
        libm::atan2(x.y, x.x)
    }

    /// Advances along the curve by a layer. Returns the direction, perpendicular to the tip, in which the curve bends
    /// along the layer.
    fn advance(&mut self) -> Vector3<f64> {
        let here = tip_direction(&self.here);
        self.walk.advance(self.tilt);
        self.here = self.walk.frame();
        let next = tip_direction(&self.here);
        (next - here * here.dot(&next)).try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::zeros)
    }

    fn rewound(&self) -> Self {
        Self { walk: Walk::new(&self.curve), here: Frame::identity(), ..self.clone() }
    }

    /// The frame at the end of the chain of layers.
    fn chain_end(&self, keep_alive: &mut dyn FnMut()) -> Frame {
        let mut layers = self.rewound();
        (0..self.count).fold(Frame::identity(), |start_from_tip, _| {
            keep_alive();
            start_from_tip * layers.next(1.0).step()
        })
    }

    /// The error from the chain's end to the curve's end: position in the axes of the start, direction in those of the
    /// end.
    fn lack(&self, keep_alive: &mut dyn FnMut()) -> Vector5<f64> {
        let chain = self.chain_end(keep_alive);
        let offset = self.end.translation.vector - chain.translation.vector;
        let turn = self.end.rotation.inverse() * tip_direction(&chain);
        Vector5::new(offset.x, offset.y, offset.z, -turn.x, -turn.y)
    }

    /// Finds the correction: `lambda` of the least squares `sum J J^T lambda = lack`, where `J` says how the end moves
    /// with one layer's alpha, and one more `J` how it moves with the scale of all layers.
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
        for _ in 0..self.count {
            keep_alive();
            let direction = tip_direction(&layers.here);
            let arm = self.end.translation.vector - layers.here.translation.vector;
            let bend = layers.advance();
            let by_alpha = moved(&(-bend * self.tilt), &arm);
            let by_tilt = moved(&(direction.cross(&bend) * self.tilt), &arm);
            let weighted = by_tilt * TILT_WEIGHT;
            sum += by_alpha * by_alpha.transpose() + weighted * weighted.transpose();
            let axial = direction * self.tilt;
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
            let lack = self.lack(keep_alive);
            let miss = lack.norm();
            if miss < min_miss {
                (best, min_miss, best_lack) = (self.correction, miss, lack);
                share = f64::min(2.0 * share, 1.0);
            } else {
                share *= 0.25;
            }
            if min_miss <= ARRIVED || miss.is_nan() {
                break;
            }
            let lambda = normal_equations.solve(&best_lack) * share;
            // `J . lambda` for any layer, with what does not depend on the layer taken together.
            let on_position = Vector3::new(lambda[0], lambda[1], lambda[2]);
            let on_direction = end_x * lambda[3] + end_y * lambda[4];
            self.correction = Correction {
                force: best.force + on_position * self.tilt,
                moment: best.moment + on_direction.cross(&end_direction) * self.tilt,
                scale: best.scale + by_scale.dot(&lambda),
            };
        }
        self.correction = best;
    }
}
