//! A path of circular arcs, straight lines and helicoidal arcs. Each segment is described by the motion of the tip (the
//! paper's actions `alpha, beta, S`).
//!
//! A path is a slice of segments, `&[Segment]`, in the order in which they grow. [`Path`] is the result of a planner.

use core::ops::Deref;

use heapless::Vec;

use crate::angle::wrap_positive;
use crate::helicoid::Helicoid;
use crate::kinematics::step;
use crate::layer::Layer;
use crate::pose::{Frame, Pose};

/// Max number of segments of a planned path. A path of two planar Dubins paths has up to six.
pub const MAX_SEGMENTS: usize = 6;

/// A segment of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Segment {
    /// A circular arc. The radius is `length / bend`.
    Arc {
        /// Angle of max deposition from the tip's x axis, `[0, 2 pi)`, radians. The tip bends away from it.
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
    /// A helicoidal arc: a bend of constant radius whose direction changes along the arc.
    Helicoid {
        /// The curve, in the frame of the tip at its start and in units of the radius.
        curve: Helicoid,
        /// Radius of curvature, mm.
        radius: f64,
        /// Length, mm.
        length: f64,
    },
}

impl From<&Layer> for Segment {
    /// Returns the centreline of a layer.
    fn from(&Layer { alpha, height: length, tilt: bend }: &Layer) -> Self {
        if bend > 0.0 { Self::Arc { alpha, bend, length } } else { Self::Straight { length } }
    }
}

impl Segment {
    /// Returns the length along the segment, mm.
    pub fn length(&self) -> f64 {
        match *self {
            Self::Arc { length, .. } | Self::Straight { length } | Self::Helicoid { length, .. } => length,
        }
    }

    /// Returns the rotation of the direction of growth along the segment, radians. It is the angle of an arc, and 0 for
    /// a straight line.
    pub fn bend(&self) -> f64 {
        match *self {
            Self::Arc { bend, .. } => bend,
            Self::Straight { .. } => 0.0,
            Self::Helicoid { radius, length, .. } => length / radius,
        }
    }

    /// Returns the curvature of the segment, 1/mm. It is 0 for a straight line, also for one without length.
    pub fn curvature(&self) -> f64 {
        let bend = self.bend();
        if bend == 0.0 { 0.0 } else { bend / self.length() }
    }

    /// Returns the frame of the segment's end in the frame of its start, `start_from_end` (Eq 4). For a helicoidal arc
    /// it is integrated.
    pub fn step(&self) -> Frame {
        match *self {
            Self::Arc { alpha, bend, length } => step(alpha, bend, length),
            Self::Straight { length } => step(0.0, 0.0, length),
            Self::Helicoid { curve, radius, length } => {
                let mut start_from_end = curve.frame_after(length / radius);
                start_from_end.translation.vector *= radius;
                start_from_end
            }
        }
    }

    /// Returns the first part of this segment, up to length `to` (mm).
    pub fn shortened(&self, to: f64) -> Self {
        match *self {
            Self::Arc { alpha, bend, length } => Self::Arc { alpha, bend: bend * (to / length), length: to },
            Self::Straight { .. } => Self::Straight { length: to },
            Self::Helicoid { curve, radius, .. } => Self::Helicoid { curve, radius, length: to },
        }
    }

    /// Returns the representation of this segment for a tip that is turned by `roll` about its direction of growth
    /// (radians, counter-clockwise). The curve in space is the same.
    pub fn rolled(&self, roll: f64) -> Self {
        match *self {
            Self::Arc { alpha, bend, length } => Self::Arc { alpha: wrap_positive(alpha - roll), bend, length },
            Self::Straight { .. } => *self,
            Self::Helicoid { curve, radius, length } => Self::Helicoid { curve: curve.rolled(roll), radius, length },
        }
    }
}

/// A part of a path that leads from one pose to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The pose at the end of the leg.
    pub goal: Pose,
    /// Number of the path's segments that belong to the leg.
    pub segment_count: usize,
}

/// Returns the length of a path, mm. (The fold begins with 0, because `sum` gives -0 for a path without segments.)
pub fn length(path: &[Segment]) -> f64 {
    path.iter().fold(0.0, |length, segment| length + segment.length())
}

/// Returns the frame of the tip, `base_from_tip`, at the end of a path that begins at `base_from_start` (Eq 5).
pub fn end(path: &[Segment], base_from_start: &Frame) -> Frame {
    path.iter().fold(*base_from_start, |base_from_tip, segment| base_from_tip * segment.step())
}

/// A path of at most [`MAX_SEGMENTS`] segments.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path(Vec<Segment, MAX_SEGMENTS>);

/// Error of a path that has no space for another segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the planner needed more than {MAX_SEGMENTS} segments, the maximum of a path: this is a bug, please report the \
     poses"
)]
pub struct PathFull;

impl Path {
    /// Creates a path without segments.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a segment at the end.
    ///
    /// # Errors
    /// Returns [`PathFull`] if the path has [`MAX_SEGMENTS`] segments already.
    pub fn push(&mut self, segment: Segment) -> Result<(), PathFull> {
        self.0.push(segment).map_err(|_| PathFull)
    }

    /// Returns a path of those segments for which `keep` returns true.
    pub fn filtered(&self, keep: impl Fn(&Segment) -> bool) -> Self {
        let mut path = Self::new();
        for segment in self.0.iter().filter(|segment| keep(segment)) {
            // The push cannot fail, because the whole path had space for all its segments.
            let _ = path.push(*segment);
        }
        path
    }
}

impl Deref for Path {
    type Target = [Segment];

    fn deref(&self) -> &[Segment] {
        &self.0
    }
}
