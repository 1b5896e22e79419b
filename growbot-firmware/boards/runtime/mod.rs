//! The parts that the images of all boards share.
//!
//! Each board has a function `reset::reset_on_crash`, which makes the tip safe and resets the board.

pub mod crash;
mod no_panic;
pub mod retained;
mod rtt;
pub mod seal;
pub mod stack;
pub mod word_flash;
