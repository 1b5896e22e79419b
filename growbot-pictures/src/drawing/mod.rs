//! Tools for pictures and charts, which growbot writes as SVG and converts to pixels.
//!
//! - [`canvas`]: an unfinished drawing
//! - [`colours`]: colours and their interpolation
//! - [`chart`]: scales and axes
//! - [`png`], [`pdf`]: conversion of a drawing to pixels and to PDF, with a font that is part of the program

pub mod canvas;
pub mod chart;
pub mod colours;
#[cfg(feature = "raster")]
pub mod pdf;
#[cfg(feature = "raster")]
pub mod png;
