//! A layer in 12 bytes, the form in which the link carries it and the board stores it.
//!
//! Three little-endian `u32` in fixed point: alpha in 2^-32 turns, height in 2^-24 mm, tilt in 2^-32 rad. Height and
//! tilt of a segment are rarely a whole number of these units. The [`LayerEncoder`] carries the rounding error of each
//! layer to the next layer. So the error of a path of any length is half a unit (30 pm, 0.1 nrad), and not half a unit
//! for each layer.

use crate::angle::wrap_positive;
use crate::layer::{Layer, LayerError};
use crate::robot::Robot;
use crate::slicing::LIMIT_SLACK;

/// The 12 bytes of a layer, as the link carries them.
pub type LayerBytes = [u8; 12];

/// Number of fixed-point units of a layer's height in 1 mm.
pub const HEIGHT_UNITS_PER_MM: f64 = 16_777_216.0;
/// Number of fixed-point units of a layer's tilt in a radian.
pub const TILT_UNITS_PER_RAD: f64 = 4_294_967_296.0;
/// Number of fixed-point units of a layer's alpha in a turn.
const ALPHA_UNITS: f64 = 4_294_967_296.0;

/// Encoder of the successive layers of a path. It adds the rounding error of each layer to the next layer.
#[derive(Debug, Clone, Default)]
pub struct LayerEncoder {
    /// Rounding error of the heights of all layers so far, in fixed-point units. It is added to the next height.
    height_owed: f64,
    /// Rounding error of the tilts of all layers so far, in fixed-point units. It is added to the next tilt.
    tilt_owed: f64,
}

/// Rounds a number to the nearest `u32`, saturating.
fn units(value: f64) -> u32 {
    libm::rint(value) as u32
}

impl LayerEncoder {
    /// Returns the next layer as bytes, and carries its rounding error to the layer after it.
    pub fn encode(&mut self, layer: &Layer) -> LayerBytes {
        self.encode_rounded(layer, units, units)
    }

    /// Returns the next layer as bytes that a board accepts. The height is at least one unit, and the tilt is small
    /// enough to leave material on the inner side of a ring of radius `tip_radius` (mm), even if the layer is only a
    /// few units high. The difference to the exact layer is carried to the next layer.
    pub fn encode_clamped(&mut self, layer: &Layer, tip_radius: f64) -> LayerBytes {
        let height = |exact: f64| units(exact).max(1);
        let mut encoder = self.clone();
        let min_height = RawLayer::from_bytes(&encoder.encode_rounded(layer, height, units)).height;
        let max_tilt = (f64::from(min_height) / HEIGHT_UNITS_PER_MM / tip_radius * TILT_UNITS_PER_RAD - 1.0).max(0.0);
        self.encode_rounded(layer, height, |exact| units(exact.min(max_tilt)))
    }

    fn encode_rounded(&mut self, layer: &Layer, height: impl Fn(f64) -> u32, tilt: impl Fn(f64) -> u32) -> LayerBytes {
        let exact_height = layer.height * HEIGHT_UNITS_PER_MM + self.height_owed;
        let exact_tilt = layer.tilt * TILT_UNITS_PER_RAD + self.tilt_owed;
        let (height, tilt) = (height(exact_height), tilt(exact_tilt));
        self.height_owed = exact_height - f64::from(height);
        self.tilt_owed = exact_tilt - f64::from(tilt);
        // The wrapping cast from u64 turns a full turn into 0.
        let alpha = libm::rint(wrap_positive(layer.alpha) / core::f64::consts::TAU * ALPHA_UNITS) as u64 as u32;
        RawLayer { alpha, height, tilt }.to_bytes()
    }
}

/// The three integers that the 12 bytes of a layer contain, in fixed-point units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawLayer {
    /// Alpha, 2^-32 turns.
    pub alpha: u32,
    /// Mean height, 2^-24 mm.
    pub height: u32,
    /// Tilt, 2^-32 rad.
    pub tilt: u32,
}

impl RawLayer {
    /// Decodes the three integers from the 12 bytes of a layer.
    pub fn from_bytes(bytes: &LayerBytes) -> Self {
        let [a0, a1, a2, a3, h0, h1, h2, h3, t0, t1, t2, t3] = *bytes;
        Self {
            alpha: u32::from_le_bytes([a0, a1, a2, a3]),
            height: u32::from_le_bytes([h0, h1, h2, h3]),
            tilt: u32::from_le_bytes([t0, t1, t2, t3]),
        }
    }

    /// Encodes the three integers as the 12 bytes of a layer.
    pub fn to_bytes(self) -> LayerBytes {
        let ([a0, a1, a2, a3], [h0, h1, h2, h3], [t0, t1, t2, t3]) =
            (self.alpha.to_le_bytes(), self.height.to_le_bytes(), self.tilt.to_le_bytes());
        [a0, a1, a2, a3, h0, h1, h2, h3, t0, t1, t2, t3]
    }

    /// Returns the layer in mm and radians.
    pub fn to_layer(&self) -> Layer {
        Layer {
            alpha: f64::from(self.alpha) / ALPHA_UNITS * core::f64::consts::TAU,
            height: f64::from(self.height) / HEIGHT_UNITS_PER_MM,
            tilt: f64::from(self.tilt) / TILT_UNITS_PER_RAD,
        }
    }
}

/// Decodes a layer, in mm and radians, from its 12 bytes.
pub fn decode(bytes: &LayerBytes) -> Layer {
    RawLayer::from_bytes(bytes).to_layer()
}

/// Decodes a received layer and checks it against the robot's limits, with a tolerance of one unit of rounding.
///
/// # Errors
/// Returns a [`LayerError`] that contains the limit that the layer exceeds.
pub fn decode_checked(bytes: &LayerBytes, robot: &Robot) -> Result<Layer, LayerError> {
    let layer = decode(bytes);
    let height_unit = 1.0 / (HEIGHT_UNITS_PER_MM * robot.description().layer.height_max_mm);
    let tilt_unit = 1.0 / (TILT_UNITS_PER_RAD * robot.max_tilt());
    robot.check_layer(&layer, LIMIT_SLACK + height_unit + tilt_unit)?;
    Ok(layer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    #[test]
    fn rounding_errors_do_not_accumulate() {
        let layer = Layer { alpha: 1.234_567, height: 0.774 / 3.0, tilt: 0.007_74 / 7.0 };
        let mut encoder = LayerEncoder::default();
        let (mut height, mut tilt) = (0.0, 0.0);
        for i in 1..=100_000 {
            let again = decode(&encoder.encode(&layer));
            height += again.height;
            tilt += again.tilt;
            assert!((again.alpha - layer.alpha).abs() < 1e-9);
            if i % 10_000 == 0 {
                assert!((height - f64::from(i) * layer.height).abs() < 1e-7);
                assert!((tilt - f64::from(i) * layer.tilt).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_layer_at_the_limit_is_valid_after_any_rounding() {
        let robot = robot_a();
        let curvature = 1.0 / 98.2;
        let height = robot.max_mean_height(curvature) * (1.0 + LIMIT_SLACK);
        let mut encoder = LayerEncoder::default();
        for _ in 0..1000 {
            let bytes = encoder.encode(&Layer { alpha: 6.25, height, tilt: height * curvature });
            decode_checked(&bytes, &robot).unwrap();
        }
    }

    #[test]
    fn very_thin_layers_stay_valid_when_clamped() {
        let robot = robot_a();
        for height in [1e-12, 3e-8, 6e-8, 1e-7, 2.5e-7, 1e-6] {
            for radius in [98.2, 33.0, 23.0, 1e6] {
                let mut encoder = LayerEncoder::default();
                for _ in 0..10 {
                    let layer = Layer { alpha: 1.0, height, tilt: height / radius };
                    decode_checked(&encoder.encode_clamped(&layer, robot.tip_radius()), &robot).unwrap();
                }
            }
        }
    }

    #[test]
    fn any_bytes_decode_without_panic() {
        for byte in [0x00, 0xff, 0x80] {
            let _ = decode_checked(&[byte; 12], &robot_a());
        }
        assert_eq!(decode(&[0; 12]), Layer::default());
        assert!(decode_checked(&[0; 12], &robot_a()).is_err());
    }

    #[test]
    fn a_full_turn_is_encoded_as_0() {
        let layer = Layer { alpha: core::f64::consts::TAU * (1.0 - 1e-16), height: 0.5, tilt: 0.001 };
        assert_eq!(RawLayer::from_bytes(&LayerEncoder::default().encode(&layer)).alpha, 0);
    }
}
