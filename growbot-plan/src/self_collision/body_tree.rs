//! A body as a binary tree of parts, each with a ball or a chord that bounds its position.

use growbot_core::helicoid::{Helicoid, HelicoidIntegrator};
use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

/// Maximum length of the short arcs into which a helicoidal arc is divided, radii. Each is one step of the integration.
const HELICOID_PIECE: f64 = 0.25;

/// A leaf of the tree: a segment of the path, or a short part of a helicoidal arc.
pub(super) struct BodyPiece {
    pub(super) base_from_start: Frame,
    pub(super) segment: Segment,
    /// Length of the body up to the start of the piece, mm. `turned` is the angle by which the body has turned up to
    /// there, radians.
    pub(super) at: f64,
    pub(super) turned: f64,
}

impl BodyPiece {
    /// Returns the point at this length along the piece, mm.
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

    /// Returns the node for a part of this piece. `index` is the index of the piece. `from` and `to` are the ends of
    /// the part: length along the piece (mm), and point.
    fn part(&self, index: usize, from: (f64, Vector3<f64>), to: (f64, Vector3<f64>)) -> BodyNode {
        let length = to.0 - from.0;
        let curvature = self.segment.curvature();
        let turned = |along: f64| self.turned + curvature * along;
        BodyNode {
            span: Span { from: self.at + from.0, to: self.at + to.0, turned: [turned(from.0), turned(to.0)] },
            // Each point of the part is within half its length of one of its ends.
            reach: (curvature * length * length / 8.0).min(0.5 * length),
            kind: NodeKind::Part { piece: index, along: [from.0, to.0], ends: [from.1, to.1] },
        }
    }
}

/// A part of the body: the lengths along the body up to its ends, mm, and the angles by which the body has turned up to
/// its ends, radians.
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

/// A node of the tree: a part of the body, and a bound of its position.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyNode {
    pub(super) span: Span,
    /// Maximum distance of the part from its chord or from the centre of its ball, mm.
    pub(super) reach: f64,
    pub(super) kind: NodeKind,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum NodeKind {
    /// Several pieces within a ball around `centre`. `halves` are the indices of the two child nodes in
    /// [`CollisionBody::groups`].
    Group { centre: Vector3<f64>, halves: [usize; 2] },
    /// A part of the piece of index `piece`. `along` are the lengths along the piece up to its ends, mm, and `ends` are
    /// the points there.
    Part { piece: usize, along: [f64; 2], ends: [Vector3<f64>; 2] },
}

/// A body as a binary tree of parts.
pub(super) struct CollisionBody {
    pieces: Vec<BodyPiece>,
    /// Nodes of all groups and of all whole pieces. The last node is the root.
    pub(super) groups: Vec<BodyNode>,
    /// Length along the body beyond which the later point of each compared pair must lie, mm.
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
        // The sum of many short lengths may differ in its last digit from the sum of a few long ones.
        let mut body = Self { pieces, groups: Vec::new(), since: since * (1.0 + 1e-12) };
        if !body.pieces.is_empty() {
            body.group(0, body.pieces.len());
        }
        body
    }

    /// Builds the tree over the pieces from index `first` up to `end` (exclusive, at least one piece). Returns the
    /// index of its root.
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

    /// Returns the nodes of the two halves of a node.
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

/// Divides a helicoidal arc into short helicoidal arcs, and calls `push` with each. `radius` and `length` are in mm.
fn divide(curve: &Helicoid, radius: f64, length: f64, push: &mut impl FnMut(Segment)) {
    let count = libm::ceil(length / radius / HELICOID_PIECE).max(1.0);
    let short = length / count;
    let mut walk = HelicoidIntegrator::new(curve);
    for _ in 0..count as usize {
        // The rest of the curve is a helicoidal arc with `m` at this point as its `m0` and the same `p`, both in the
        // frame of the tip here.
        let start_from_tip = walk.frame();
        let tip_from_start = start_from_tip.rotation.inverse();
        let m0 = tip_from_start * curve.m(&start_from_tip.translation.vector);
        push(Segment::Helicoid { curve: Helicoid { m0, p: tip_from_start * curve.p }, radius, length: short });
        walk.advance(short / radius);
    }
}

impl BodyNode {
    /// Returns a ball that contains the part: its centre and its radius, mm.
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

/// Returns a lower bound of the distance between the parts of two nodes, mm, and the positions of the two nearest
/// points as fractions of the parts' lengths.
pub(super) fn bound(a: &BodyNode, b: &BodyNode) -> (f64, [f64; 2]) {
    if let (NodeKind::Part { ends: ends_a, .. }, NodeKind::Part { ends: ends_b, .. }) = (&a.kind, &b.kind) {
        let (distance, at) = between_chords(ends_a, ends_b);
        return ((distance - a.reach - b.reach).max(0.0), at);
    }
    let ((centre_a, reach_a), (centre_b, reach_b)) = (a.ball(), b.ball());
    (((centre_a - centre_b).norm() - reach_a - reach_b).max(0.0), [0.5; 2])
}

/// Returns the distance between two line segments, mm, and the positions of their nearest points as fractions of their
/// lengths.
fn between_chords([a0, a1]: &[Vector3<f64>; 2], [b0, b1]: &[Vector3<f64>; 2]) -> (f64, [f64; 2]) {
    let (along_a, along_b, apart) = (a1 - a0, b1 - b0, a0 - b0);
    let (aa, bb, ab) = (along_a.norm_squared(), along_b.norm_squared(), along_a.dot(&along_b));
    let (a_apart, b_apart) = (along_a.dot(&apart), along_b.dot(&apart));
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 };
    let on_a = |on_b: f64| share(ab * on_b - a_apart, aa);
    let on_b = |on_a: f64| share(ab * on_a + b_apart, bb);
    // The nearest points are either those of the two infinite lines, or one of them is an end of a segment.
    let crossing = share(ab * b_apart - a_apart * bb, aa * bb - ab * ab);
    let pairs = [[crossing, on_b(crossing)], [on_a(0.0), 0.0], [on_a(1.0), 1.0], [0.0, on_b(0.0)], [1.0, on_b(1.0)]];
    let distance = |[s, t]: [f64; 2]| (apart + along_a * s - along_b * t).norm();
    pairs
        .into_iter()
        .map(|at| (distance(at), at))
        .fold((f64::INFINITY, [0.0; 2]), |best, next| if next.0 < best.0 { next } else { best })
}
