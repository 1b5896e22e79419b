//! Growth without a robot: layers with errors, in open and in closed loop, and bodies that sag.

mod disturbance;
mod growth;
mod imperfection;
mod sag;
mod sensors;

pub use disturbance::{Disturbance, Laid};
pub use growth::{Grown, Task, grow_closed, grow_closed_while, grow_open};
pub use imperfection::Imperfection;
pub use sag::{Hanging, RootStress};
pub use sensors::{DirectionSensor, Sensors};
