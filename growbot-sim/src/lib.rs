//! Growing robots without a robot.
//!
//! - [`tip`]: what a simulated tip does with the signals of its board;
//! - [`port`]: boards that drive it: the real controller in this process, or its image in QEMU; and every port by its
//!   name;
//! - [`truth`]: where the plastic really is;
//! - [`simulation`]: growths without a board, with what goes wrong, once or a million times, on all cores
//!   ([`parallel`]);
//! - [`image_seal`]: firmware images get their seal.
//!
//! Lengths are in mm. Angles are in radians inside and in degrees in every text and file; names carry the unit.
#![forbid(unsafe_code)]

pub mod image_seal;
pub mod parallel;
pub mod port;
pub mod resident;
pub mod simulation;
pub mod tip;
pub mod truth;
pub mod uf2;
