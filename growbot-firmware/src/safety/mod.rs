//! What keeps a robot safe that nobody watches.
//!
//! - [`transitions`]: which event leads from which state to which other one, as one table.
//! - [`inputs`]: the inputs that mean danger: supply, drivers, filament; each must persist before it counts.
//! - [`crash`]: what a crash of the firmware leaves for the next start.
//! - [`retained`]: what survives a reset: the latest fault as it was when it came, and what was under way.
//! - [`proof_of_life`]: when the watchdog may be fed.
//!
//! The nozzle's own faults are found in [`crate::heater`], those of head and feed in [`crate::stepping`]. Whatever finds one,
//! the controller switches everything off at once and latches the first.

pub mod crash;
pub mod inputs;
pub mod proof_of_life;
pub mod retained;
pub mod transitions;
