//! The errors of simulated layers.

use nalgebra::Rotation3;

use crate::angle::wrap_positive;
use crate::layer::Layer;
use crate::pose::Frame;
use crate::random::Rng;
use crate::trigonometry;

/// Greatest error of a layer or a measurement that users can give, percent of its growth or tilt, or degrees.
pub const MAX_ERROR: f64 = 90.0;

/// The errors of simulated layers: noise, and biases that are the same in each layer. All are zero by default.
///
/// Noise is uniform in both directions, of mean 0, and independent from layer to layer. Noise of the growth changes a
/// layer's height and not its tilt, as in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbance {
    /// Noise of the growth: max random change of the height, as a fraction of the layer's height.
    pub growth_noise: f64,
    /// Over-deposition, as a fraction of the layer's height. Negative for under-deposition.
    pub growth_bias: f64,
    /// Noise of the tilt: max random tilt about each axis of the deposition plane, radians.
    pub tilt_noise: f64,
    /// Excess of the tilt, as a fraction of the layer's tilt.
    pub tilt_bias: f64,
    /// Noise of the deposition angle: max random change, radians.
    pub alpha_noise: f64,
    /// Offset of the deposition angle, radians.
    pub alpha_bias: f64,
    /// Noise of the twist: max random twist about the tip's axis in a layer, radians.
    pub twist_noise: f64,
    /// Twist about the tip's axis in each layer, radians, counter-clockwise.
    pub twist_bias: f64,
}

/// A layer as a simulated tip lays it, with errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisturbedLayer {
    /// Alpha, height and tilt of the layer, with errors.
    pub layer: Layer,
    /// Twist of the tip about its axis after the layer, radians, counter-clockwise.
    pub twist: f64,
}

impl DisturbedLayer {
    /// Returns `tip_from_next_tip`, the motion of the tip while this layer is laid: Eq 4, followed by the twist.
    pub fn step(&self) -> Frame {
        let mut step = self.layer.step();
        if self.twist != 0.0 {
            let (sine, cosine) = trigonometry::sin_cos(self.twist);
            #[rustfmt::skip]
            let about_z = nalgebra::Matrix3::new(
                cosine, -sine,  0.0,
                sine,   cosine, 0.0,
                0.0,    0.0,    1.0,
            );
            step.rotation *= Rotation3::from_matrix_unchecked(about_z);
        }
        step
    }
}

/// Source of error for which a random number is drawn. Each source has its own stream of random numbers.
#[derive(Debug, Clone, Copy)]
enum NoiseSource {
    Growth = 1,
    Tilt,
    Alpha,
    Twist,
}

impl Disturbance {
    /// Returns a layer as laid, with the errors of this seed for the layer of this index. The index counts from 0 along
    /// the body. The same seed gives the same errors to the layer of the same index. Each source has its own random
    /// numbers, so noise of one kind does not change the noise of another kind.
    pub fn lay(&self, seed: u64, index: u64, layer: &Layer) -> DisturbedLayer {
        let draw = |what: NoiseSource| Rng::new(&[seed, what as u64, index]);
        let noise = |what: NoiseSource, max: f64| if max == 0.0 { 0.0 } else { max * draw(what).uniform_symmetric() };
        let height = layer.height * (1.0 + self.growth_bias + noise(NoiseSource::Growth, self.growth_noise));
        let mut tilt = layer.tilt * (1.0 + self.tilt_bias);
        let mut alpha = layer.alpha + self.alpha_bias + noise(NoiseSource::Alpha, self.alpha_noise);
        if self.tilt_noise != 0.0 {
            let mut random = draw(NoiseSource::Tilt);
            let x = tilt * trigonometry::cos(alpha) + self.tilt_noise * random.uniform_symmetric();
            let y = tilt * trigonometry::sin(alpha) + self.tilt_noise * random.uniform_symmetric();
            (tilt, alpha) = (trigonometry::hypot(x, y), libm::atan2(y, x));
        }
        let layer = Layer { alpha: wrap_positive(alpha), height, tilt };
        DisturbedLayer { layer, twist: self.twist_bias + noise(NoiseSource::Twist, self.twist_noise) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYER: Layer = Layer { alpha: 2.0, height: 0.77, tilt: 0.0077 };

    #[test]
    fn the_default_disturbance_changes_nothing() {
        let laid = Disturbance::default().lay(7, 3, &LAYER);
        assert_eq!(laid, DisturbedLayer { layer: LAYER, twist: 0.0 });
        assert_eq!(laid.step(), LAYER.step());
    }

    #[test]
    fn growth_noise_is_uniform_and_keeps_the_tilt() {
        let disturbance = Disturbance { growth_noise: 0.1, ..Disturbance::default() };
        let shares: std::vec::Vec<f64> =
            (0..100_000).map(|index| disturbance.lay(1, index, &LAYER).layer.height / LAYER.height - 1.0).collect();
        let mean = shares.iter().sum::<f64>() / 1e5;
        let variance = shares.iter().map(|share| share * share).sum::<f64>() / 1e5;
        assert!(mean.abs() < 0.001 && (variance - 0.01 / 3.0).abs() < 1e-4, "{mean} {variance}");
        assert!(shares.iter().all(|share| share.abs() <= 0.1));
        assert_eq!(disturbance.lay(1, 5, &LAYER).layer.tilt, LAYER.tilt);
    }

    #[test]
    fn noise_sources_are_independent() {
        let one = Disturbance { growth_noise: 0.1, ..Disturbance::default() };
        let more = Disturbance { tilt_noise: 0.001, alpha_noise: 0.1, twist_noise: 0.1, ..one };
        for index in 0..100 {
            assert_eq!(one.lay(9, index, &LAYER).layer.height, more.lay(9, index, &LAYER).layer.height);
        }
        assert!(one.lay(9, 1, &LAYER) != one.lay(9, 2, &LAYER) && one.lay(9, 1, &LAYER) != one.lay(8, 1, &LAYER));
    }

    #[test]
    fn biases_apply_to_every_layer() {
        let disturbance = Disturbance {
            growth_bias: 0.05,
            tilt_bias: -0.1,
            alpha_bias: 0.2,
            twist_bias: 0.01,
            ..Disturbance::default()
        };
        let laid = disturbance.lay(1, 0, &LAYER);
        assert!((laid.layer.height - 1.05 * LAYER.height).abs() < 1e-15);
        assert!((laid.layer.tilt - 0.9 * LAYER.tilt).abs() < 1e-15);
        assert!((laid.layer.alpha - 2.2).abs() < 1e-15);
        let untwisted = laid.layer.step().rotation;
        let twisted = laid.step().rotation;
        assert!(((untwisted.inverse() * twisted).angle() - 0.01).abs() < 1e-12);
        assert!((untwisted * nalgebra::Vector3::z() - twisted * nalgebra::Vector3::z()).norm() < 1e-15);
    }
}
