//! Tests of the controller with a simulation of its surroundings: the link, the step engine, and a tip that warms,
//! turns and breaks.

mod bench;
mod board;
mod configuring;
mod drivers;
mod faults;
mod growing;
mod interleavings;
mod maintaining;
mod pausing;
mod refusals;
mod requests;
mod resets;
mod resuming;
mod sequences;
mod sessions;
mod states;
mod tip;
mod tuning;
mod turbulence;
