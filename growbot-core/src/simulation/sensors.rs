//! The sensors of a simulated tip.

use nalgebra::Vector3;

use super::disturbance::DisturbedLayer;
use crate::layer::Layer;
use crate::pose::Frame;
use crate::random::Rng;
use crate::tracking::{MeasuredQuantities, Measurement, SensorNoise};

/// The direction that the sensor of direction measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DirectionSensor {
    /// The direction of growth, in the base's frame.
    #[default]
    Tip,
    /// The direction of gravity in the tip's frame, which does not show the heading.
    Gravity,
}

/// The sensors of a simulated tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedSensors {
    /// Noise of the sensors. The estimator is given the same values.
    pub noise: SensorNoise,
    /// Scale error of the odometry, as a fraction of the growth. No estimator can distinguish it from an error of the
    /// growth.
    pub odometry_scale: f64,
    /// Direction that is measured.
    pub direction: DirectionSensor,
}

/// Identifier of the stream of random numbers for the odometry of a layer. [`DIRECTION`] is that for its measured
/// direction.
const ODOMETRY: u64 = 16;
const DIRECTION: u64 = 17;

impl SimulatedSensors {
    /// Returns the kinds of measurement that these sensors make.
    pub fn measured_quantities(&self) -> MeasuredQuantities {
        let direction = self.direction == DirectionSensor::Tip;
        MeasuredQuantities { growth: true, direction, up: !direction }
    }

    /// Returns the measurements of the sensors after a layer. `commanded` and `laid` are this layer as commanded and as
    /// laid, and `base_from_tip` is the true frame of the tip after it. `seed` and the layer's `index` determine the
    /// noise.
    pub fn measure(
        &self,
        seed: u64,
        index: u64,
        commanded: &Layer,
        laid: &DisturbedLayer,
        base_from_tip: &Frame,
    ) -> Measurement {
        let odometry = commanded.height * self.noise.odometry * Rng::new(&[seed, ODOMETRY, index]).normal();
        let mut random = Rng::new(&[seed, DIRECTION, index]);
        let (about_x, about_y) = (self.noise.direction * random.normal(), self.noise.direction * random.normal());
        let mut measured = Measurement {
            growth: Some(laid.layer.height * (1.0 + self.odometry_scale) + odometry),
            ..Measurement::default()
        };
        match self.direction {
            DirectionSensor::Tip => {
                measured.direction = Some(base_from_tip.rotation * Vector3::new(about_x, about_y, 1.0).normalize());
            }
            DirectionSensor::Gravity => {
                let up = base_from_tip.rotation.inverse() * Vector3::z();
                let lateral = up.cross(&if up.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() }).normalize();
                measured.up = Some((up + lateral * about_x + up.cross(&lateral) * about_y).normalize());
            }
        }
        measured
    }
}
