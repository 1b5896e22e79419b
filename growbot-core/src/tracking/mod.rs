//! Arriving in spite of noise: where the tip is by what was measured, and the rest of the path planned again from there.

mod measurement;

pub use measurement::{Measurement, SensorNoise};
