//! The controller with everything round it: link, step engine, and a tip that warms, turns and breaks.

mod bench;
mod faults;
mod growing;
mod refusals;
mod states;
mod tip;
mod turbulence;
