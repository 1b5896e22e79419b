//! The parts that the images of all boards share.
//!
//! A board has a `reset::on_crash`, which makes the tip safe and starts it anew.

pub mod crash;
mod no_panic;
pub mod retained;
mod rtt;
pub mod seal;
pub mod stack;
pub mod word_flash;
