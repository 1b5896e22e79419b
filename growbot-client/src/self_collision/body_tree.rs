//! A body as a tree of stretches, each with a ball or chord that bounds it.

use growbot_core::helicoid::{Helicoid, HelicoidIntegrator};
use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

/// Length of the pieces into which a helicoidal arc is divided at first, radii. Each is one step of the integration.
const HELICOID_PIECE: f64 = 0.25;

/// A stretch of the body that one formula describes: a segment, or a short piece of a helicoidal arc.
pub(super) struct BodyPiece {
    pub(super) base_from_start: Frame,
    pub(super) segment: Segment,
    /// Length of the body up to the start of the piece. `turned` is the angle by which it has turned there.
    pub(super) at: f64,
    pub(super) turned: f64,
}

impl BodyPiece {
    /// Returns the point after this length along the piece.
    pub(super) fn point(&self, along: f64) -> Vector3<f64> {
        let part = match self.segment {
            Segment::Arc { alpha, bend, length } => {
                Segment::Arc { alpha, bend: bend * (along / length), length: along }
            }
            Segment::Straight { .. } => Segment::Straight { length: along },
            Segment::Helicoid { curve, radius, .. } => Segment::Helicoid { curve, radius, length: along },
        };
        (self.base_from_start * part.step()).translation.vector
    }

    /// Returns the node of a part of this piece, at most the whole.
    fn part(&self, index: usize, from: (f64, Vector3<f64>), to: (f64, Vector3<f64>)) -> BodyNode {
        let length = to.0 - from.0;
        let curvature = self.segment.curvature();
        let turned = |along: f64| self.turned + curvature * along;
        BodyNode {
            span: Span { from: self.at + from.0, to: self.at + to.0, turned: [turned(from.0), turned(to.0)] },
            // Any point of the part is within half its length of one of the ends.
            reach: (curvature * length * length / 8.0).min(0.5 * length),
            kind: NodeKind::Part { piece: index, along: [from.0, to.0], ends: [from.1, to.1] },
        }
    }
}

/// A stretch of the body: its ends, mm, and the turn of the direction up to each end, radians.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) turned: [f64; 2],
}

impl Span {
    pub(super) fn length(&self) -> f64 {
        self.to - self.from
    }
}

/// A node of the tree over the body: a stretch and its bound.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyNode {
    pub(super) span: Span,
    /// Maximum distance of the stretch from its chord or centre.
    pub(super) reach: f64,
    pub(super) kind: NodeKind,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum NodeKind {
    /// Several pieces round a centre, with the indices of two nodes of [`Body::groups`].
    Group { centre: Vector3<f64>, halves: [usize; 2] },
    /// A part of a piece, between two points along it.
    Part { piece: usize, along: [f64; 2], ends: [Vector3<f64>; 2] },
}

/// A body as a tree of stretches.
pub(super) struct CollisionBody {
    pieces: Vec<BodyPiece>,
    /// All groups and whole pieces; the last is the root.
    pub(super) groups: Vec<BodyNode>,
    /// Only points beyond this count as the later one of a pair, mm.
    pub(super) since: f64,
}

impl CollisionBody {
    pub(super) fn new(path: &[Segment], since: f64) -> Self {
        let mut pieces = Vec::with_capacity(path.len());
        let mut end = BodyPiece {
            base_from_start: Frame::identity(),
            segment: Segment::Straight { length: 0.0 },
            at: 0.0,
            turned: 0.0,
        };
        let mut push = |segment: Segment| {
            let next = BodyPiece {
                base_from_start: end.base_from_start * segment.step(),
                segment,
                at: end.at + segment.length(),
                turned: end.turned + segment.bend(),
            };
            pieces.push(BodyPiece { segment, ..std::mem::replace(&mut end, next) });
        };
        for segment in path {
            match *segment {
                Segment::Helicoid { curve, radius, length } => divide(&curve, radius, length, &mut push),
                plain => push(plain),
            }
        }
        // The sum of many short pieces may differ in the last digit from that of long ones.
        let mut body = Self { pieces, groups: Vec::new(), since: since * (1.0 + 1e-12) };
        if !body.pieces.is_empty() {
            body.group(0, body.pieces.len());
        }
        body
    }

    /// Makes the tree over these pieces (at least one) and returns the index of its root.
    fn group(&mut self, first: usize, end: usize) -> usize {
        let node = match self.pieces.get(first) {
            Some(piece) if end - first == 1 => {
                let length = piece.segment.length();
                piece.part(first, (0.0, piece.point(0.0)), (length, piece.point(length)))
            }
            _ => {
                let middle = first + (end - first) / 2;
                let halves = [self.group(first, middle), self.group(middle, end)];
                let [a, b] = halves.map(|half| self.groups[half]);
                let (ball_a, ball_b) = (a.ball(), b.ball());
                let centre = (ball_a.0 + ball_b.0) * 0.5;
                let reach = [ball_a, ball_b].map(|(at, radius)| (at - centre).norm() + radius);
                BodyNode {
                    span: Span { from: a.span.from, to: b.span.to, turned: [a.span.turned[0], b.span.turned[1]] },
                    reach: reach[0].max(reach[1]),
                    kind: NodeKind::Group { centre, halves },
                }
            }
        };
        self.groups.push(node);
        self.groups.len() - 1
    }

    /// Returns the two halves of a node.
    pub(super) fn halves(&self, node: &BodyNode) -> [BodyNode; 2] {
        match node.kind {
            NodeKind::Group { halves, .. } => halves.map(|half| self.groups[half]),
            NodeKind::Part { piece: index, along: [from, to], ends: [start, end] } => {
                let piece = &self.pieces[index];
                let middle = 0.5 * (from + to);
                let at_middle = (middle, piece.point(middle));
                [piece.part(index, (from, start), at_middle), piece.part(index, at_middle, (to, end))]
            }
        }
    }
}

/// Divides a helicoidal arc into short ones.
fn divide(curve: &Helicoid, radius: f64, length: f64, push: &mut impl FnMut(Segment)) {
    let count = libm::ceil(length / radius / HELICOID_PIECE).max(1.0);
    let short = length / count;
    let mut walk = HelicoidIntegrator::new(curve);
    for _ in 0..count as usize {
        // This is the rest of the same curve: m at this point and p, in the frame of this tip.
        let start_from_tip = walk.frame();
        let tip_from_start = start_from_tip.rotation.inverse();
        let m0 = tip_from_start * curve.m(&start_from_tip.translation.vector);
        push(Segment::Helicoid { curve: Helicoid { m0, p: tip_from_start * curve.p }, radius, length: short });
        walk.advance(short / radius);
    }
}

impl BodyNode {
    /// Returns a ball that contains the stretch: centre and radius.
    fn ball(&self) -> (Vector3<f64>, f64) {
        match self.kind {
            NodeKind::Group { centre, .. } => (centre, self.reach),
            NodeKind::Part { ends: [a, b], .. } => ((a + b) * 0.5, 0.5 * (b - a).norm() + self.reach),
        }
    }

    pub(super) fn is_part(&self) -> bool {
        matches!(self.kind, NodeKind::Part { .. })
    }
}

/// Returns a lower bound of the distance between two nodes, and its position on each, 0 to 1.
pub(super) fn bound(a: &BodyNode, b: &BodyNode) -> (f64, [f64; 2]) {
    if let (NodeKind::Part { ends: ends_a, .. }, NodeKind::Part { ends: ends_b, .. }) = (&a.kind, &b.kind) {
        let (distance, at) = between_chords(ends_a, ends_b);
        return ((distance - a.reach - b.reach).max(0.0), at);
    }
    let ((centre_a, reach_a), (centre_b, reach_b)) = (a.ball(), b.ball());
    (((centre_a - centre_b).norm() - reach_a - reach_b).max(0.0), [0.5; 2])
}

/// Returns the distance of two line segments, and the position of the nearest point on each, 0 to 1.
fn between_chords([a0, a1]: &[Vector3<f64>; 2], [b0, b1]: &[Vector3<f64>; 2]) -> (f64, [f64; 2]) {
    let (along_a, along_b, apart) = (a1 - a0, b1 - b0, a0 - b0);
    let (aa, bb, ab) = (along_a.norm_squared(), along_b.norm_squared(), along_a.dot(&along_b));
    let (a_apart, b_apart) = (along_a.dot(&apart), along_b.dot(&apart));
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 };
    let on_a = |on_b: f64| share(ab * on_b - a_apart, aa);
    let on_b = |on_a: f64| share(ab * on_a + b_apart, bb);
    // The nearest pair is either that of the infinite lines, or includes an end of a segment.
    let crossing = share(ab * b_apart - a_apart * bb, aa * bb - ab * ab);
    let pairs = [[crossing, on_b(crossing)], [on_a(0.0), 0.0], [on_a(1.0), 1.0], [0.0, on_b(0.0)], [1.0, on_b(1.0)]];
    let distance = |[s, t]: [f64; 2]| (apart + along_a * s - along_b * t).norm();
    pairs
        .into_iter()
        .map(|at| (distance(at), at))
        .fold((f64::INFINITY, [0.0; 2]), |best, next| if next.0 < best.0 { next } else { best })
}
