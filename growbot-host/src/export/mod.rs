//! Bodies in the formats of other tools: meshes (STL, GLB), tables (CSV), and recordings (MCAP).
//!
//! - [`body`]: the layers of a plan or a run log, and where each of them is;
//! - [`mesh`]: the printed wall as a closed surface, written by [`stl`] and [`glb`];
//! - [`table`]: centreline and layers as CSV;
//! - [`recording`]: what a run log tells, over time, as MCAP; its messages are those of [`messages`].

pub mod body;
pub mod glb;
pub mod mesh;
pub mod messages;
pub mod recording;
pub mod stl;
pub mod table;
