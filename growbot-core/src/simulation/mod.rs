//! Growth without a robot: layers that come out otherwise than they were asked for, with and without feedback.

mod disturbance;
mod growth;
mod imperfection;
mod sag;
mod sensors;

pub use disturbance::{Disturbance, Laid};
pub use growth::{Grown, Task, grow_closed, grow_open};
pub use imperfection::Imperfection;
pub use sag::{Hanging, RootStress};
pub use sensors::{DirectionSensor, Sensors};
