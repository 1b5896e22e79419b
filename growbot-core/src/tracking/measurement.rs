//! The measurements after a layer.

use nalgebra::Vector3;

/// Measurements of the sensors after a layer. A field is `None` if the robot does not have the sensor, or if the sensor
/// gave no reading.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// Growth of the tip since the latest layer for which the growth was measured, by odometry, mm.
    pub growth: Option<f64>,
    /// Direction of growth in the base's frame. The length of the vector has no meaning.
    pub direction: Option<Vector3<f64>>,
    /// Direction upwards in the tip's frame, as a resting accelerometer measures it. It does not show the heading.
    pub up: Option<Vector3<f64>>,
}

/// The kinds of measurement that exist after a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MeasuredQuantities {
    /// True if the growth is measured.
    pub growth: bool,
    /// True if the direction of growth is measured.
    pub direction: bool,
    /// True if the direction upwards is measured.
    pub up: bool,
}

impl From<&Measurement> for MeasuredQuantities {
    fn from(measured: &Measurement) -> Self {
        let Measurement { growth, direction, up } = measured;
        Self { growth: growth.is_some(), direction: direction.is_some(), up: up.is_some() }
    }
}

/// Noise of the measurements: of mean zero, normally distributed, independent from layer to layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Standard deviation of a measurement of the growth, as a fraction of the layer's height.
    pub odometry: f64,
    /// Standard deviation of a measured direction (of the tip, or of gravity) about each of the two axes perpendicular
    /// to it, radians.
    pub direction: f64,
}
