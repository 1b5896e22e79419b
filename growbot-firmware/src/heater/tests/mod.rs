//! Tests of the heater on simulated nozzles with lag, noise, and deviations from the description.

mod faults;
mod plant;
mod proof;
mod regulating;
mod sound;
mod times;
