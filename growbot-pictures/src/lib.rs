//! Pictures of bodies and growths, and exports to other programs. This crate uses plans, run logs and scenes, but no
//! ports, no service and no command line.
//!
//! - [`view`]: a body in three dimensions, as an HTML page or as a picture, and plots along it
//! - [`drawing`]: canvas, colours and charts, and conversion to PNG and PDF (feature `raster`)
//! - [`export`]: STL, OBJ, GLB, CSV and TUM, 3MF (feature `3mf`), and MCAP (feature `mcap`)
//! - [`layer_table`]: the layers of a plan as CSV; [`plan_table`]: a plan as text; [`growth_table`]: the result of a
//!   growth as text
//! - [`duration`], [`clock_text`]: durations and times of day as text
//! - [`workspace`]: goals within reach as a picture
//!
//! Lengths are in mm. Angles are in radians in computations, and in degrees in texts and files.
#![forbid(unsafe_code)]

pub mod clock_text;
pub mod drawing;
pub mod duration;
pub mod export;
pub mod growth_table;
pub mod layer_table;
pub mod plan_table;
pub mod view;
pub mod workspace;
