//! Simulated growing robots.
//!
//! - [`tip`]: a simulated tip that reacts to the signals of its board;
//! - [`port`]: boards that drive the simulated tip (the real controller in this process, or the firmware in an
//!   emulator), and [`port::open`], which opens any port by its name;
//! - [`simulated_tip`]: the body that a simulated tip has really laid, and manual actions on it;
//! - [`simulation`]: disturbed growths without a board, once or a million times, on all cores;
//! - [`image_seal`]: seals of firmware images; [`uf2`]: images as UF2 files; [`crash`]: source locations of a firmware
//!   crash, from the image that crashed.
//!
//! The feature `crash` reads the debug information of images.
//!
//! Lengths are in mm. Angles are in radians in computations, and in degrees in texts and files. Names that end in a
//! unit, such as `_deg`, have that unit.
#![forbid(unsafe_code)]

#[cfg(feature = "crash")]
pub mod crash;
pub mod image_seal;
pub mod port;
pub mod sim_daemon;
pub mod simulated_tip;
pub mod simulation;
pub mod tip;
pub mod uf2;
