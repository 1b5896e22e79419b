//! The measurements after a layer.

use nalgebra::Vector3;

/// The sensors' measurements after a layer. `None` where the robot does not have the sensor, or where it gave nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// Growth of the tip since the latest layer with such a measurement, by odometry, mm.
    pub growth: Option<f64>,
    /// The direction of growth in the base's frame; its length does not matter.
    pub direction: Option<Vector3<f64>>,
    /// The direction upwards in the tip's frame, as a resting accelerometer shows it. It does not depend on the
    /// heading.
    pub up: Option<Vector3<f64>>,
}

/// Which measurements there are after a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Seen {
    /// The growth.
    pub growth: bool,
    /// The direction of growth.
    pub direction: bool,
    /// The direction upwards.
    pub up: bool,
}

impl From<&Measurement> for Seen {
    fn from(measured: &Measurement) -> Self {
        let Measurement { growth, direction, up } = measured;
        Self { growth: growth.is_some(), direction: direction.is_some(), up: up.is_some() }
    }
}

/// The noise of measurements: zero-mean, normal, independent from layer to layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Standard deviation of the odometry, a share of the layer's height.
    pub odometry: f64,
    /// Standard deviation of a direction, the tip's or gravity's, about each of the two axes across it, radians.
    pub direction: f64,
}
