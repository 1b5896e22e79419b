//! The errors of a simulated tip's layers and measurements.
//!
//! Growth is off because the filament slips in its drive, or is carried along: while a layer is laid, as much more or
//! less of it moves for each step, and the encoder that it turns sees that, give or take its own noise. The layer is as
//! much higher or lower, its tilt is kept. Tilt, deposition angle and twist are off as [`Disturbance`] says; only
//! gravity shows them.
//!
//! The index of a layer is its place in the tip's body, so that the same seed gives the same errors on `sim` and on the
//! emulated board, and those that `growbot simulate` gives.

use nalgebra::Vector3;

use super::{DirectionSensor, Disturbance, Laid, Sensors};
use crate::layer::Layer;
use crate::pose::Frame;
use crate::tracking::SensorNoise;

/// The errors of a simulated tip. None by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imperfection {
    /// The errors of the layers.
    pub disturbance: Disturbance,
    /// Noise of the filament's encoder, as odometry, and of gravity.
    pub noise: SensorNoise,
    /// The seed of all noise.
    pub seed: u64,
}

impl Default for Imperfection {
    fn default() -> Self {
        let noise = SensorNoise { odometry: 0.0, direction: 0.0 };
        Self { disturbance: Disturbance::default(), noise, seed: 0 }
    }
}

/// A layer of unit height: results for it are shares.
const UNIT: Layer = Layer { alpha: 0.0, height: 1.0, tilt: 0.0 };

impl Imperfection {
    /// The layer of this index as laid.
    #[must_use]
    pub fn lay(&self, index: u64, layer: &Layer) -> Laid {
        self.disturbance.lay(self.seed, index, layer)
    }

    /// The filament that the encoder measures while the layer of this index is laid, as a share of the filament fed.
    #[must_use]
    pub fn seen_per_step(&self, index: u64) -> f64 {
        let laid = self.lay(index, &UNIT);
        self.sensors().measure(self.seed, index, &UNIT, &laid, &Frame::identity()).growth.unwrap_or(1.0)
    }

    /// The direction upwards in the tip's frame, as measured after the layer of this index.
    #[must_use]
    pub fn up(&self, index: u64, base_from_tip: &Frame) -> Vector3<f64> {
        let up = base_from_tip.rotation.inverse() * Vector3::z();
        if self.noise.direction == 0.0 {
            return up;
        }
        self.sensors().measure(self.seed, index, &UNIT, &self.lay(index, &UNIT), base_from_tip).up.unwrap_or(up)
    }

    fn sensors(&self) -> Sensors {
        Sensors { noise: self.noise, odometry_scale: 0.0, direction: DirectionSensor::Gravity }
    }
}
