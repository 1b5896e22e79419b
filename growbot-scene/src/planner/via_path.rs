//! Bodies that lead from the start through some via positions to the goal, with the shortest arc and line between two
//! of them.
//!
//! An arc and a line to a position have a closed form that takes 0.1 us. A body is therefore described by the positions
//! that it passes, and shortening it is a search over few numbers.

use nalgebra::Vector3;

use crate::centreline::ArcSegment;

/// A body that leads to the goal, and the via positions through which it leads.
#[derive(Debug, Clone, PartialEq)]
pub struct ViaPath {
    /// Via positions: the positions through which the body leads, in their order, mm.
    pub via: Vec<Vector3<f64>>,
    /// Arcs and lines of the body.
    pub segments: Vec<ArcSegment>,
    /// Length of the body, mm.
    pub length: f64,
}
