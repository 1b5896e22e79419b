//! The code that the images of all boards share.
//!
//! Each board provides a function `reset::reset_on_crash`, which switches all outputs of the tip off and resets the
//! board.

pub mod crash;
mod fault_handler;
mod no_panic;
pub mod retained;
mod rtt;
pub mod seal;
pub mod stack;
pub mod word_flash;
