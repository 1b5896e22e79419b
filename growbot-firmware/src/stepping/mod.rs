//! Conversion of layers to step pulses.
//!
//! ```text
//! Layer --Material::lay--> Turn (steps and ticks of 64 sectors) --Handover--> Engine --tick by tick--> step pins
//! ```
//!
//! [`Material::lay`] does the floating-point work in the controller's time, a layer ahead. The [`Engine`] runs in the
//! step interrupt, where it only adds and compares integers. The two exchange data only through the [`Handover`].
//!
//! The engine also reads the inputs that need an immediate reaction: the index mark at each step of the head, the
//! filament's encoder, and the emergency stop.

mod axis;
mod engine;
mod feed_move;
mod handover;
mod homing;
mod index;
mod material;
mod orders;
mod pace;
mod spread;
#[cfg(test)]
mod tests;
mod turn;

pub use axis::Axis;
pub use engine::{Engine, EngineSettings, Inputs};
pub use handover::Handover;
pub use material::Material;
pub use orders::{AxisMove, Homing, Order, Report, TurnReport};
pub use pace::Pace;
pub use turn::{Sector, StepRate, Turn, as_built};
