//! The sensors of a simulated tip.

use nalgebra::Vector3;

use super::disturbance::DisturbedLayer;
use crate::layer::Layer;
use crate::pose::Frame;
use crate::random::Rng;
use crate::tracking::{MeasuredQuantities, Measurement, SensorNoise};

/// The direction that a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DirectionSensor {
    /// The direction of growth, in the base's frame.
    #[default]
    Tip,
    /// The direction of gravity, in the tip's frame. It does not show the heading.
    Gravity,
}

/// The sensors of a simulated tip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedSensors {
    /// The noise of the sensors, which the estimator knows.
    pub noise: SensorNoise,
    /// Scale error of the odometry, as a fraction. No estimator can distinguish it from growth.
    pub odometry_scale: f64,
    /// The direction that a sensor measures.
    pub direction: DirectionSensor,
}

/// Identifiers of the streams of random numbers of a layer's measurements.
const ODOMETRY: u64 = 16;
const DIRECTION: u64 = 17;

impl SimulatedSensors {
    /// Returns the kinds of measurement that these sensors make.
    #[must_use]
    pub fn measured_quantities(&self) -> MeasuredQuantities {
        let direction = self.direction == DirectionSensor::Tip;
        MeasuredQuantities { growth: true, direction, up: !direction }
    }

    /// Returns the measurements after the layer of this index.
    #[must_use]
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
