//! What is measured of a layer once it is laid.

use nalgebra::Vector3;

/// What the sensors say after a layer. None where a robot does not have the sensor, or where it gave nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measurement {
    /// By odometry: how far the tip has grown since the last layer with such a measurement, mm.
    pub growth: Option<f64>,
    /// The direction of growth in the base's frame.
    pub direction: Option<Vector3<f64>>,
    /// The direction upwards in the tip's frame, as a resting accelerometer shows it. It says nothing of the heading.
    pub up: Option<Vector3<f64>>,
}

/// How far measurements are off: zero-mean, normal, independent from layer to layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Standard deviation of the odometry, a share of the layer's height.
    pub odometry: f64,
    /// Standard deviation of a direction, the tip's or gravity's, about each of the two axes across it, radians.
    pub direction: f64,
}
