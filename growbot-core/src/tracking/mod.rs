//! Arriving in spite of noise: where the tip is by what was measured, and the rest of the path planned again from
//! there.
//!
//! After each layer the [`Tracker`] ingests what was measured, and bends the rest of the path so that it still ends at
//! the goal.

mod course;
mod estimator;
mod measurement;
mod tracker;

pub use course::Miss;
pub use estimator::SystematicErrors;
pub use measurement::{Measurement, SensorNoise};
pub use tracker::{Estimate, Tracker};
