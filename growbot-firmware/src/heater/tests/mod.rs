//! The heater on a nozzle with lag, noise and spread.

mod faults;
mod plant;
mod regulating;
mod sound;
