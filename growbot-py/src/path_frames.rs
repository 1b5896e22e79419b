//! Frames of the tip at lengths along a path.

use growbot_core::helicoid::HelicoidIntegrator;
use growbot_core::path::Segment;
use growbot_core::pose::Frame;

/// Returns the tip's frames (base from tip, mm) at lengths along a path that begins at the frame `start`. The lengths
/// (mm) must be within the path, and are processed fastest in ascending order.
pub fn frames(path: &[Segment], start: &Frame, lengths: &[f64]) -> Vec<Frame> {
    let mut cursor = PathCursor { path, index: 0, begun: 0.0, base: *start, start: *start, walk: None };
    lengths.iter().map(|length| cursor.at(*length)).collect()
}

/// Position on a path, which is moved to increasing lengths.
struct PathCursor<'a> {
    path: &'a [Segment],
    /// Index of the current segment. `begun` is the length at which this segment begins (mm), and `base` is the frame
    /// there.
    index: usize,
    begun: f64,
    base: Frame,
    start: Frame,
    /// Integrator of the current helicoidal arc, and the length that it has reached, radii. `None` in other segments.
    walk: Option<(HelicoidIntegrator, f64)>,
}

impl PathCursor<'_> {
    fn at(&mut self, length: f64) -> Frame {
        if length < self.begun {
            (self.index, self.begun, self.base, self.walk) = (0, 0.0, self.start, None);
        }
        while let Some(segment) = self.path.get(self.index) {
            if length < self.begun + segment.length() {
                let within = length - self.begun;
                return self.base * self.part(segment, within);
            }
            self.base *= segment.step();
            self.begun += segment.length();
            self.index += 1;
            self.walk = None;
        }
        self.base
    }

    /// Returns the frame of the tip after `within` mm of a segment, relative to the frame at the segment's start.
    fn part(&mut self, segment: &Segment, within: f64) -> Frame {
        match *segment {
            Segment::Arc { alpha, bend, length } => {
                Segment::Arc { alpha, bend: bend * (within / length), length: within }.step()
            }
            Segment::Straight { .. } => Segment::Straight { length: within }.step(),
            Segment::Helicoid { curve, radius, .. } => {
                let to = within / radius;
                if self.walk.as_ref().is_none_or(|(_, gone)| *gone > to) {
                    self.walk = Some((HelicoidIntegrator::new(&curve), 0.0));
                }
                let mut frame = Frame::identity();
                if let Some((walk, gone)) = &mut self.walk {
                    walk.advance(to - *gone);
                    *gone = to;
                    frame = walk.frame();
                }
                frame.translation.vector *= radius;
                frame
            }
        }
    }
}
