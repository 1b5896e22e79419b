//! Bodies in the formats of other tools: meshes (STL, GLB), tables (CSV), and recordings (MCAP).
//!
//! - [`body`]: the layers of a plan or a run log, and where each of them is;
//! - [`mesh`]: the printed wall as a closed surface, written by [`stl`] and [`glb`];
//! - [`obstacles`]: the scene around it as surfaces;
//! - [`table`]: centreline and layers as CSV;
//! - [`tum`]: the way of the tip as a trajectory;
//! - [`recording`]: what a run log tells, over time, as MCAP: each `message` as JSON ([`messages`]), or in the types of
//!   ROS 2 as CDR (`ros2`).

pub mod body;
pub mod glb;
pub mod mesh;
#[cfg(feature = "mcap")]
mod message;
#[cfg(feature = "mcap")]
pub mod messages;
pub mod obstacles;
#[cfg(feature = "mcap")]
pub mod recording;
#[cfg(feature = "mcap")]
mod ros2;
pub mod stl;
pub mod table;
pub mod tum;
