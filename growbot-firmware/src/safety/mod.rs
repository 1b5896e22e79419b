//! Safety of an unattended robot.
//!
//! - [`transitions`]: the table of states and events.
//! - [`input_monitor`]: the inputs that indicate danger: supply, drivers, filament. A wrong input must persist before
//!   it counts.
//! - [`crash`]: the record of a crash of the firmware, for the next start.
//! - [`retained`]: the state that survives a reset: the record of the latest fault, and the activity before the reset.
//! - [`liveness`]: the conditions for feeding the watchdog.
//!
//! [`crate::heater`] finds the faults of the nozzle, and [`crate::stepping`] those of head and feed. After any fault
//! the controller switches everything off at once. It latches the first fault.

pub mod crash;
pub mod input_monitor;
pub mod liveness;
pub mod retained;
pub mod transitions;
