//! The errors of a simulated tip's layers and measurements.
//!
//! The error of the growth arises because the filament slips in its drive, or is carried along. While a layer is laid,
//! each step of the feed moves more or less filament than it should. The encoder that the filament turns measures this,
//! with its own noise. The layer is higher or lower by the same fraction, and its tilt does not change. Tilt,
//! deposition angle and twist have the errors of [`Disturbance`], which only the measured direction of gravity shows.
//!
//! The index of a layer is its number in the tip's body, from the root on. So the same seed gives the same errors at
//! the simulated port `sim`, on the emulated board and in `growbot simulate`.

use nalgebra::Vector3;

use super::{DirectionSensor, Disturbance, DisturbedLayer, SimulatedSensors};
use crate::layer::Layer;
use crate::pose::Frame;
use crate::tracking::SensorNoise;

/// The errors of the layers and the measurements of a simulated tip. By default all errors are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorModel {
    /// The errors of the layers.
    pub disturbance: Disturbance,
    /// Noise of the sensors: `odometry` is that of the filament's encoder, and `direction` is that of the direction of
    /// gravity.
    pub noise: SensorNoise,
    /// Seed of the random numbers of all noise.
    pub seed: u64,
}

impl Default for ErrorModel {
    fn default() -> Self {
        let noise = SensorNoise { odometry: 0.0, direction: 0.0 };
        Self { disturbance: Disturbance::default(), noise, seed: 0 }
    }
}

/// A layer of height 1, so that heights and growth computed for it are fractions.
const UNIT: Layer = Layer { alpha: 0.0, height: 1.0, tilt: 0.0 };

impl ErrorModel {
    /// Returns a layer as laid, with the errors for the layer of this index.
    pub fn lay(&self, index: u64, layer: &Layer) -> DisturbedLayer {
        self.disturbance.lay(self.seed, index, layer)
    }

    /// Returns the length of filament that the encoder measures while the layer of this index is laid, as a fraction of
    /// the length fed.
    pub fn encoder_ratio(&self, index: u64) -> f64 {
        let laid = self.lay(index, &UNIT);
        self.sensors().measure(self.seed, index, &UNIT, &laid, &Frame::identity()).growth.unwrap_or(1.0)
    }

    /// Returns the direction upwards in the tip's frame, as measured with noise after the layer of this index.
    pub fn up(&self, index: u64, base_from_tip: &Frame) -> Vector3<f64> {
        let up = base_from_tip.rotation.inverse() * Vector3::z();
        if self.noise.direction == 0.0 {
            return up;
        }
        self.sensors().measure(self.seed, index, &UNIT, &self.lay(index, &UNIT), base_from_tip).up.unwrap_or(up)
    }

    fn sensors(&self) -> SimulatedSensors {
        SimulatedSensors { noise: self.noise, odometry_scale: 0.0, direction: DirectionSensor::Gravity }
    }
}
