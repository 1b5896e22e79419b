//! A path: arcs and straight lines, each named by what the tip does (the paper's actions `alpha, beta, S`).

use heapless::Vec;

use crate::kinematics::step;
use crate::pose::Frame;

/// The most segments in a path.
pub const MOST_SEGMENTS: usize = 16;

/// One piece of constant curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Segment {
    /// A circular arc. The radius is `length / bend`.
    Arc {
        /// Angle of greatest deposition from the tip's x axis, `[0, 2 pi)`, radians; the tip bends away from it.
        alpha: f64,
        /// The angle of the arc (`beta`), radians, positive.
        bend: f64,
        /// Arc length (`S`), mm.
        length: f64,
    },
    /// A straight line.
    Straight {
        /// Length, mm.
        length: f64,
    },
}

impl Segment {
    /// Arc length, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        match *self {
            Self::Arc { length, .. } | Self::Straight { length } => length,
        }
    }

    /// Angle of greatest deposition, radians; 0 for a straight line.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        match *self {
            Self::Arc { alpha, .. } => alpha,
            Self::Straight { .. } => 0.0,
        }
    }

    /// Angle of the arc, radians; 0 for a straight line.
    #[must_use]
    pub fn bend(&self) -> f64 {
        match *self {
            Self::Arc { bend, .. } => bend,
            Self::Straight { .. } => 0.0,
        }
    }

    /// Curvature, 1/mm.
    #[must_use]
    pub fn curvature(&self) -> f64 {
        self.bend() / self.length()
    }

    /// `start_from_end` of the segment (Eq 4).
    #[must_use]
    pub fn step(&self) -> Frame {
        step(self.alpha(), self.bend(), self.length())
    }
}

/// Segments in the order in which they grow. At most [`MOST_SEGMENTS`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path(Vec<Segment, MOST_SEGMENTS>);

/// A path has no room for another segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a path holds at most {MOST_SEGMENTS} segments: split the job")]
pub struct PathFull;

impl Path {
    /// A path of no length.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a segment at the end.
    ///
    /// # Errors
    /// [`PathFull`] beyond [`MOST_SEGMENTS`].
    pub fn push(&mut self, segment: Segment) -> Result<(), PathFull> {
        self.0.push(segment).map_err(|_| PathFull)
    }

    /// The segments.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.0
    }

    /// Arc length, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.0.iter().map(Segment::length).sum()
    }

    /// `base_from_tip` at the end of the path (Eq 5).
    #[must_use]
    pub fn end(&self, base_from_start: &Frame) -> Frame {
        self.0.iter().fold(*base_from_start, |base_from_tip, segment| base_from_tip * segment.step())
    }

    /// The path without the segments that `keep` turns down.
    #[must_use]
    pub fn filtered(&self, keep: impl Fn(&Segment) -> bool) -> Self {
        Self(self.0.iter().copied().filter(keep).collect())
    }
}
