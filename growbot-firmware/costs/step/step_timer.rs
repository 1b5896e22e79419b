//! The step interrupt that the board's vector table leads to. It is never started here: the ticks are called one by
//! one.

/// Nothing.
pub fn on_tick() {}
