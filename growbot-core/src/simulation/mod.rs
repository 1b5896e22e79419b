//! Growth without a robot: layers with errors, in open and in closed loop, and bodies that sag.

mod disturbance;
mod error_model;
mod growth;
mod sag;
mod sensors;

pub use disturbance::{Disturbance, DisturbedLayer, MAX_ERROR};
pub use error_model::ErrorModel;
pub use growth::{GrownBody, GrowthTask, grow_closed_loop, grow_closed_loop_while, grow_open_loop};
pub use sag::{RootStress, SaggingBody};
pub use sensors::{DirectionSensor, SimulatedSensors};
