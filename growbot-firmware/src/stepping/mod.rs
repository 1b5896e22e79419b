//! Conversion of layers to step pulses.
//!
//! ```text
//! Layer --TurnPlanner::next_turn--> Turn (steps and ticks of 64 sectors) --Mailbox--> Engine --tick by tick--> step
//! pins
//! ```
//!
//! [`TurnPlanner::next_turn`] does the floating-point work in the controller's time, a layer ahead. The [`Engine`] runs
//! in the step interrupt, where it only adds and compares integers. The controller and the engine exchange data only
//! through the [`Mailbox`].
//!
//! The engine also reads the inputs that need an immediate reaction: the index mark at each step of the head, the
//! filament's encoder, and the emergency stop.

mod axis_move;
mod bresenham;
mod direction;
mod engine;
mod homing;
mod index_monitor;
mod mailbox;
mod moves;
mod ramp;
mod stepper;
#[cfg(test)]
mod tests;
mod turn;
mod turn_planner;

pub use direction::MotorDirection;
pub use engine::{Engine, EngineConfig, EngineInputs};
pub use mailbox::Mailbox;
pub use moves::{AxisMove, HomingMove, Move, Report, TurnReport};
pub use ramp::RampLimits;
pub use stepper::StepperPins;
pub use turn::{Sector, StepRateError, Turn, as_built};
pub use turn_planner::TurnPlanner;
