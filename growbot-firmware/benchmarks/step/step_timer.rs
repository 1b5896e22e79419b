//! The step interrupt in the board's vector table. It is never started here, because the ticks are called one by one.

/// Does nothing.
pub fn on_tick() {}
