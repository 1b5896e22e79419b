//! Centrelines of bodies as arcs and lines in vectors, without the roll of the tip, as the planner uses them.

use std::f64::consts::PI;

use growbot_core::angle::wrap_positive;
use growbot_core::path::Segment;
use growbot_core::pose::{Frame, Pose};
use growbot_core::trigonometry::{sin, sin_cos};
use nalgebra::Vector3;

/// Position and direction of a tip, without its roll.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPose {
    /// Position of the tip, mm.
    pub position: Vector3<f64>,
    /// Direction of growth, a unit vector.
    pub direction: Vector3<f64>,
}

impl From<&Pose> for TipPose {
    fn from(pose: &Pose) -> Self {
        Self { position: pose.position(), direction: pose.direction() }
    }
}

/// A segment of a centreline: an arc or a straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcSegment {
    /// Tip at the start of the segment.
    pub from: TipPose,
    /// Unit vector towards which the segment bends, perpendicular to the direction at its start. Arbitrary for a line.
    pub towards: Vector3<f64>,
    /// Curvature of the segment, 1/mm; 0 for a line.
    pub curvature: f64,
    /// Length of the segment, mm.
    pub length: f64,
}

/// A piece of a centreline, parametrized by arc length.
pub trait Curve {
    /// Returns the length of the curve, mm.
    fn length(&self) -> f64;
    /// Returns the point at the length `along` (mm) from the start of the curve.
    fn point(&self, along: f64) -> Vector3<f64>;
    /// Returns an upper bound of the distance (mm) between two points of the curve that are at most `along` apart along
    /// the curve.
    fn chord_bound(&self, along: f64) -> f64;
}

impl Curve for ArcSegment {
    fn length(&self) -> f64 {
        self.length
    }

    #[inline]
    fn point(&self, along: f64) -> Vector3<f64> {
        let (ahead, aside) = self.offset(along);
        self.from.position + self.from.direction * ahead + self.towards * aside
    }

    #[inline]
    fn chord_bound(&self, along: f64) -> f64 {
        let turn = 0.5 * along * self.curvature;
        if turn > 0.1 && turn < 0.5 * PI { 2.0 * sin(turn) / self.curvature } else { along }
    }
}

impl ArcSegment {
    /// Creates a straight line of this length (mm) from a tip.
    pub fn line(from: TipPose, length: f64) -> Self {
        Self { from, towards: Vector3::zeros(), curvature: 0.0, length }
    }

    fn offset(&self, along: f64) -> (f64, f64) {
        if self.curvature == 0.0 {
            return (along, 0.0);
        }
        let half = 0.5 * along * self.curvature;
        let (sin, cos) = sin_cos(half);
        let chord = 2.0 * sin / self.curvature;
        (chord * cos, chord * sin)
    }

    /// Returns the tip at the length `along` (mm) from the start of the segment.
    pub fn tip(&self, along: f64) -> TipPose {
        let (sin, cos) = sin_cos(along * self.curvature);
        let direction = self.from.direction * cos + self.towards * sin;
        TipPose { position: self.point(along), direction: direction.normalize() }
    }

    /// Returns the tip at the end of the segment.
    pub fn end(&self) -> TipPose {
        self.tip(self.length)
    }
}

/// Returns the total length of some segments, mm.
pub fn length(stretches: &[ArcSegment]) -> f64 {
    stretches.iter().fold(0.0, |length, stretch| length + stretch.length)
}

/// Returns any unit vector perpendicular to this unit vector.
pub fn any_perpendicular(direction: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    direction.cross(&axis).normalize()
}

/// Tolerance with which a position inside a turning circle, such as the end of an arc, counts as on the circle, in
/// squares of the radius.
const ON_CIRCLE: f64 = 1e-12;

/// Returns the arc of this radius and the line that lead from a tip to a position. `None` for a position inside a
/// turning circle.
pub fn arc_and_line_to(from: &TipPose, position: &Vector3<f64>, radius: f64) -> Option<[ArcSegment; 2]> {
    let offset = position - from.position;
    let ahead = offset.dot(&from.direction);
    let aside = offset - from.direction * ahead;
    let across = aside.norm();
    let square = ahead * ahead + across * (across - 2.0 * radius);
    if square < -ON_CIRCLE * radius * radius {
        return None;
    }
    let line = square.max(0.0).sqrt();
    if across <= 1e-12 * (ahead.abs() + radius) && ahead >= 0.0 {
        return Some([ArcSegment { length: 0.0, ..ArcSegment::line(*from, 0.0) }, ArcSegment::line(*from, ahead)]);
    }
    let towards = if across > 0.0 { aside / across } else { any_perpendicular(&from.direction) };
    let above = across - radius;
    let turn = wrap_positive(libm::atan2(ahead * radius + above * line, ahead * line - above * radius));
    let arc = ArcSegment { from: *from, towards, curvature: 1.0 / radius, length: turn * radius };
    Some([arc, ArcSegment::line(arc.end(), line)])
}

/// Returns the path segments of a body that grows from the frame `base_from_start` along these arcs and lines.
///
/// Each segment is computed in the frame in which the previous segment ended, so that small errors do not add up to a
/// roll.
pub fn to_path_segments(stretches: &[ArcSegment], base_from_start: &Frame) -> Vec<Segment> {
    let mut base_from_tip = *base_from_start;
    let mut segments = Vec::new();
    for stretch in stretches {
        let length = stretch.length;
        if length <= 0.0 {
            continue;
        }
        let segment = if stretch.curvature == 0.0 {
            Segment::Straight { length }
        } else {
            let towards = base_from_tip.rotation.inverse() * stretch.towards;
            let alpha = wrap_positive(libm::atan2(towards.y, towards.x) + PI);
            Segment::Arc { alpha, bend: stretch.curvature * length, length }
        };
        base_from_tip *= segment.step();
        match (segments.last_mut(), segment) {
            (Some(Segment::Straight { length }), Segment::Straight { length: more }) => *length += more,
            _ => segments.push(segment),
        }
    }
    segments
}

/// Returns the arcs and lines of a path that grows from the frame `base_from_start`. Returns `None` if the path has
/// helicoidal arcs.
pub fn arc_segments(path: &[Segment], base_from_start: &Frame) -> Option<Vec<ArcSegment>> {
    let mut base_from_tip = *base_from_start;
    let mut stretches = Vec::with_capacity(path.len());
    for segment in path {
        let axes = base_from_tip.rotation.matrix();
        let from = TipPose { position: base_from_tip.translation.vector, direction: axes.column(2).into_owned() };
        stretches.push(match *segment {
            Segment::Straight { length } => ArcSegment::line(from, length),
            Segment::Arc { alpha, bend, length } => {
                let (sin, cos) = sin_cos(alpha + PI);
                let towards = axes.column(0) * cos + axes.column(1) * sin;
                ArcSegment { from, towards, curvature: bend / length, length }
            }
            Segment::Helicoid { .. } => return None,
        });
        base_from_tip *= segment.step();
    }
    Some(stretches)
}

/// Returns the angle between two unit vectors, radians.
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    2.0 * libm::atan2((a - b).norm(), (a + b).norm())
}
