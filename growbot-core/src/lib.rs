//! Geometry, planning, layers and link messages of robots that move by growing.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod angle;
pub mod curvature;
pub mod dubins2;
pub mod hash;
pub mod job;
pub mod kinematics;
pub mod layer;
pub mod layer_bytes;
pub mod link;
pub mod path;
pub mod plan;
pub mod pose;
pub mod robot;
pub mod slicing;
#[cfg(test)]
mod testing;
pub mod two_plane;
