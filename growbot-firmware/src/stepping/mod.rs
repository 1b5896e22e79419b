//! From a layer to step pulses.
//!
//! ```text
//! Layer --Material::lay--> Turn (steps and ticks of 64 sectors) --Handover--> Engine --tick by tick--> step pins
//! ```
//!
//! [`Material::lay`] does the floating-point work in the controller's time, a layer ahead. The [`Engine`] runs in the step
//! interrupt and adds and compares integers. They meet only in the [`Handover`].

mod engine;
mod handover;
mod material;
mod turn;

pub use engine::{Axis, Engine};
pub use handover::{FeedMove, Handover, Homing, Order, Report, TurnReport};
pub use material::Material;
pub use turn::{Sector, StepRate, Turn, as_built};
