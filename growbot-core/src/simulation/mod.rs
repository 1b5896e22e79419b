//! Growth without a robot: layers that come out otherwise than they were asked for.

mod disturbance;
pub mod sag;

pub use disturbance::{Disturbance, Laid};
