//! The firmware of a robot that moves by growing. It heats, homes the head, lays layer after layer, and answers its
//! host's requests.
//!
//! The crate is generic over embedded-hal 1.0 traits, so that the same code runs on the robot, in an emulator and in a
//! simulation on the desktop. A layer takes this path through it:
//!
//! 1. [`link`] and [`controller`]: it arrives in an `AppendLayers` message, is checked, and is stored in the
//!    [`layer_store`];
//! 2. [`stepping::TurnPlanner`] and [`stepping::Turn`]: it is converted to the steps and ticks of 64 sectors of a turn;
//! 3. [`stepping::Mailbox`]: it passes to the step interrupt;
//! 4. [`stepping::Engine`]: it becomes step pulses, tick by tick;
//! 5. on the way back, the steps made become the layer as built, which the board reports in a `LayerLaid` message.
//!
//! [`heater`] and [`thermistor`] keep the nozzle hot. [`safety`] has the table of states and the reactions to faults.
//! After a loss of power the [`journal`] has the progress of a growth. [`hal`] has the traits of a board. The boards
//! themselves are the binaries in `boards/`: `an386` (emulated), `stm32f405` (the robot's) and `pico`.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bmi160_sensor;
#[cfg(any(feature = "an386", feature = "pico", feature = "stm32f405"))]
pub mod board_robot;
pub mod byte_queue;
pub mod controller;
pub mod description_store;
pub mod emulated_tip;
pub mod guarded_flash;
pub mod hal;
pub mod heater;
pub mod image_seal;
pub mod invertible_pin;
pub mod journal;
pub mod layer_store;
pub mod link;
pub mod link_mux;
pub mod oversampler;
pub mod safety;
pub mod soft_i2c;
pub mod stepping;
#[cfg(test)]
mod testing;
pub mod thermistor;
pub mod tmc2209;
pub mod usb_serial;
