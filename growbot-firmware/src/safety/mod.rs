//! Safety of a robot that nobody watches.
//!
//! - [`transitions`]: the table of states and events.
//! - [`inputs`]: the inputs that mean danger: supply, drivers, filament; each must persist before it counts.
//! - [`crash`]: the record of a crash of the firmware, for the next start.
//! - [`retained`]: what survives a reset: the latest fault as it was when it came, and what was under way.
//! - [`proof_of_life`]: the conditions for feeding the watchdog.
//!
//! The nozzle's own faults are found in [`crate::heater`], those of head and feed in [`crate::stepping`]. Whatever
//! finds one, the controller switches everything off at once and latches the first.

pub mod crash;
pub mod inputs;
pub mod proof_of_life;
pub mod retained;
pub mod transitions;
