//! The closed loop: an estimate of the tip from the measurements, and a reference trajectory from the tip to the goal.
//!
//! After each layer the [`Tracker`] updates the estimate with the measurements, and bends the rest of the path so that
//! it still ends at the goal.

mod estimator;
mod measurement;
mod reference;
mod tracker;

pub use estimator::SystematicErrors;
pub use measurement::{MeasuredQuantities, Measurement, SensorNoise};
pub use tracker::{Estimate, Tracker};
