//! Arriving in spite of noise: where the tip is by what was measured, and the rest of the path planned again from
//! there.
//!
//! After each layer the [`Tracker`] ingests what was measured, and bends the rest of the path so that it still ends at
//! the goal.

mod estimator;
mod measurement;
mod reference;
mod tracker;

pub use estimator::SystematicErrors;
pub use measurement::{Measurement, SensorNoise};
pub use reference::Miss;
pub use tracker::{Estimate, Tracker};
