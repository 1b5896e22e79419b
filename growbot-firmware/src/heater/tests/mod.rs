//! Tests of the heater on a nozzle with lag, noise and spread.

mod faults;
mod plant;
mod proof;
mod regulating;
mod sound;
mod times;
