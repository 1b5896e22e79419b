//! The heater on a nozzle with lag, noise and spread.

mod faults;
mod times;
mod plant;
mod regulating;
mod sound;
