//! What pictures and charts are drawn with: SVG, written here, and pixels from it.
//!
//! - [`canvas`]: a drawing in progress; [`colours`], between others; [`chart`], scales and axes;
//! - [`png`], [`pdf`]: a drawing as pixels, or as PDF, with a font that comes with the program.

pub mod canvas;
pub mod chart;
pub mod colours;
#[cfg(feature = "raster")]
pub mod pdf;
#[cfg(feature = "raster")]
pub mod png;
