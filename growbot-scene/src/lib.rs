//! Scenes of obstacles for growing robots.
#![forbid(unsafe_code)]

pub mod clear;
pub mod families;
pub mod file;
pub mod motion;
pub mod planner;
pub mod read;
pub mod scene;
pub mod shapes;
pub mod tree;
