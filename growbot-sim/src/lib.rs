//! Simulated growing robots.
//!
//! - [`tip`]: a simulated tip that reacts to the signals of its board;
//! - [`port`]: boards that drive it: the real controller in this process, or its image in QEMU; and every port by its
//!   name;
//! - [`ground_truth`]: the true position of the plastic;
//! - [`simulation`]: disturbed growths without a board, once or a million times, on all cores ([`parallel`]);
//! - [`image_seal`]: seals of firmware images.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod ground_truth;
pub mod image_seal;
pub mod parallel;
pub mod port;
pub mod sim_daemon;
pub mod simulation;
pub mod tip;
pub mod uf2;
