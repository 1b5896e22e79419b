//! The heater on a nozzle with lag, noise and spread.

mod plant;
mod regulating;

