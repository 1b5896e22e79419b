//! Whether a body would run into itself.
//!
//! A body is a tube round its centreline: two stretches of it meet where their centrelines come nearer than the tube's
//! outer diameter `D`. Stretches less than `pi D / 2` apart along the body are neighbours, not strangers: a bend that a
//! tube of this diameter can make at all (a radius of `D / 2` or more) keeps the ends of a longer stretch at least `D`
//! apart as long as it turns by no more than half a turn.
//!
//! The search halves the body again and again and looks only into pairs of pieces that may be near enough. A piece lies within
//! `k l^2 / 8` of its chord (`k` the curvature, `l` the length), so that the distance of two chords bounds that of the pieces;
//! long bodies that keep clear of themselves take a few steps a segment.

use std::f64::consts::FRAC_PI_2;

use growbot_core::helicoid::{Helicoid, Walk};
use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

/// Where a body comes nearest to itself. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// Distance between the two points of the centreline: at most the true least distance, and at least that less [`TOLERANCE`].
    pub distance: f64,
    /// How far along the body the points are, the earlier first.
    pub at: [f64; 2],
}

/// The distance found is this near to the true one, as a share of the diameter.
pub const TOLERANCE: f64 = 1e-3;
/// Pieces of this share of the stretch that counts as neighbourhood are not cut any further where it ends.
const FINEST_SHARE: f64 = 1.0 / 16.0;
/// A helicoidal arc is cut into pieces of this length from the outset, radii: each is one step of the integration.
const HELICOID_PIECE: f64 = 0.25;
/// After so many pairs what is left is taken as near as it may be: only a body that passes itself thousands of times comes here.
const MOST_PAIRS: usize = 4_000_000;

/// Where a body on this path comes nearest to itself, if it comes nearer than `diameter` (mm, positive): the least distance
/// between two points of which the later one lies beyond `since` (mm along the body; 0 for the whole body).
#[must_use]
pub fn first_collision(path: &[Segment], diameter: f64, since: f64) -> Option<Collision> {
    search(path, diameter, since).0
}

/// The same, and how many pairs of stretches were looked into.
fn search(path: &[Segment], diameter: f64, since: f64) -> (Option<Collision>, usize) {
    let body = Body::new(path, since);
    let mut search = Search {
        body: &body,
        neighbourhood: FRAC_PI_2 * diameter,
        sag: 0.5 * TOLERANCE * diameter / 2.0,
        nearest: Collision { distance: diameter, at: [0.0; 2] },
        found: false,
        left: MOST_PAIRS,
    };
    search.run();
    (search.found.then_some(search.nearest), MOST_PAIRS - search.left)
}

/// A stretch of the body that one formula gives: a segment, or a short piece of a helicoidal arc.
struct Piece {
    base_from_start: Frame,
    segment: Segment,
    /// Length of the body, and by how much it has turned, up to the start.
    at: f64,
    turned: f64,
}

impl Piece {
    /// The point after this length along the piece.
    fn point(&self, along: f64) -> Vector3<f64> {
        let part = match self.segment {
            Segment::Arc { alpha, bend, length } => {
                Segment::Arc { alpha, bend: bend * (along / length), length: along }
            }
            Segment::Straight { .. } => Segment::Straight { length: along },
            Segment::Helicoid { curve, radius, .. } => Segment::Helicoid { curve, radius, length: along },
        };
        (self.base_from_start * part.step()).translation.vector
    }

    /// The whole piece, or no more of it than this stretch.
    fn part(&self, index: usize, from: (f64, Vector3<f64>), to: (f64, Vector3<f64>)) -> Node {
        let length = to.0 - from.0;
        let curvature = self.segment.curvature();
        let turned = |along: f64| self.turned + curvature * along;
        Node {
            span: Span { from: self.at + from.0, to: self.at + to.0, turned: [turned(from.0), turned(to.0)] },
            // Within half its length any point is also near one of the ends.
            reach: (curvature * length * length / 8.0).min(0.5 * length),
            kind: Kind::Part { piece: index, along: [from.0, to.0], ends: [from.1, to.1] },
        }
    }
}

/// A stretch of the body: from where to where, mm, and how far the direction has turned up to its ends, radians.
#[derive(Debug, Clone, Copy)]
struct Span {
    from: f64,
    to: f64,
    turned: [f64; 2],
}

impl Span {
    fn length(&self) -> f64 {
        self.to - self.from
    }
}

/// A node of the tree over the body: a stretch, and what it cannot leave.
#[derive(Debug, Clone, Copy)]
struct Node {
    span: Span,
    /// The stretch lies within this of its chord, or of its centre.
    reach: f64,
    kind: Kind,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// Several pieces round a centre: two nodes of [`Body::groups`].
    Group { centre: Vector3<f64>, halves: [usize; 2] },
    /// A part of a piece, between two points along it.
    Part { piece: usize, along: [f64; 2], ends: [Vector3<f64>; 2] },
}

/// A body as a tree of stretches.
struct Body {
    pieces: Vec<Piece>,
    /// All groups and whole pieces; the last is the root.
    groups: Vec<Node>,
    /// Only points beyond this count as the later one of two, mm.
    since: f64,
}

impl Body {
    fn new(path: &[Segment], since: f64) -> Self {
        let mut pieces = Vec::with_capacity(path.len());
        let mut end = Piece {
            base_from_start: Frame::identity(),
            segment: Segment::Straight { length: 0.0 },
            at: 0.0,
            turned: 0.0,
        };
        let mut push = |segment: Segment| {
            let next = Piece {
                base_from_start: end.base_from_start * segment.step(),
                segment,
                at: end.at + segment.length(),
                turned: end.turned + segment.bend(),
            };
            pieces.push(Piece { segment, ..std::mem::replace(&mut end, next) });
        };
        for segment in path {
            match *segment {
                Segment::Helicoid { curve, radius, length } => cut(&curve, radius, length, &mut push),
                plain => push(plain),
            }
        }
        // Sums of many short pieces do not end to the last digit where those of long ones do.
        let mut body = Self { pieces, groups: Vec::new(), since: since * (1.0 + 1e-12) };
        if !body.pieces.is_empty() {
            body.group(0, body.pieces.len());
        }
        body
    }

    /// Makes the tree over these pieces, at least one, and gives the index of its root.
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
                Node {
                    span: Span { from: a.span.from, to: b.span.to, turned: [a.span.turned[0], b.span.turned[1]] },
                    reach: reach[0].max(reach[1]),
                    kind: Kind::Group { centre, halves },
                }
            }
        };
        self.groups.push(node);
        self.groups.len() - 1
    }

    /// The two halves of a node.
    fn halves(&self, node: &Node) -> [Node; 2] {
        match node.kind {
            Kind::Group { halves, .. } => halves.map(|half| self.groups[half]),
            Kind::Part { piece: index, along: [from, to], ends: [start, end] } => {
                let piece = &self.pieces[index];
                let middle = 0.5 * (from + to);
                let at_middle = (middle, piece.point(middle));
                [piece.part(index, (from, start), at_middle), piece.part(index, at_middle, (to, end))]
            }
        }
    }
}

/// Cuts a helicoidal arc into short ones.
fn cut(curve: &Helicoid, radius: f64, length: f64, push: &mut impl FnMut(Segment)) {
    let count = libm::ceil(length / radius / HELICOID_PIECE).max(1.0);
    let short = length / count;
    let mut walk = Walk::new(curve);
    for _ in 0..count as usize {
        // The same curve from here on: m at this point and p, seen from this tip.
        let start_from_tip = walk.frame();
        let tip_from_start = start_from_tip.rotation.inverse();
        let m0 = tip_from_start * curve.m(&start_from_tip.translation.vector);
        push(Segment::Helicoid { curve: Helicoid { m0, p: tip_from_start * curve.p }, radius, length: short });
        walk.advance(short / radius);
    }
}

impl Node {
    /// A ball that holds the stretch: centre and radius.
    fn ball(&self) -> (Vector3<f64>, f64) {
        match self.kind {
            Kind::Group { centre, .. } => (centre, self.reach),
            Kind::Part { ends: [a, b], .. } => ((a + b) * 0.5, 0.5 * (b - a).norm() + self.reach),
        }
    }

    fn is_part(&self) -> bool {
        matches!(self.kind, Kind::Part { .. })
    }
}

/// The least distance between two nodes that their shapes allow, and where on each, 0 to 1.
fn bound(a: &Node, b: &Node) -> (f64, [f64; 2]) {
    if let (Kind::Part { ends: ends_a, .. }, Kind::Part { ends: ends_b, .. }) = (&a.kind, &b.kind) {
        let (distance, at) = between_chords(ends_a, ends_b);
        return ((distance - a.reach - b.reach).max(0.0), at);
    }
    let ((centre_a, reach_a), (centre_b, reach_b)) = (a.ball(), b.ball());
    (((centre_a - centre_b).norm() - reach_a - reach_b).max(0.0), [0.5; 2])
}

/// The distance of two straight lines between points, and where on each they are nearest, 0 to 1.
fn between_chords([a0, a1]: &[Vector3<f64>; 2], [b0, b1]: &[Vector3<f64>; 2]) -> (f64, [f64; 2]) {
    let (along_a, along_b, apart) = (a1 - a0, b1 - b0, a0 - b0);
    let (aa, bb, ab) = (along_a.norm_squared(), along_b.norm_squared(), along_a.dot(&along_b));
    let (a_apart, b_apart) = (along_a.dot(&apart), along_b.dot(&apart));
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 };
    let on_a = |on_b: f64| share(ab * on_b - a_apart, aa);
    let on_b = |on_a: f64| share(ab * on_a + b_apart, bb);
    // The nearest pair is that of the whole lines, or has an end in it.
    let crossing = share(ab * b_apart - a_apart * bb, aa * bb - ab * ab);
    let pairs = [[crossing, on_b(crossing)], [on_a(0.0), 0.0], [on_a(1.0), 1.0], [0.0, on_b(0.0)], [1.0, on_b(1.0)]];
    let distance = |[s, t]: [f64; 2]| (apart + along_a * s - along_b * t).norm();
    pairs
        .into_iter()
        .map(|at| (distance(at), at))
        .fold((f64::INFINITY, [0.0; 2]), |best, next| if next.0 < best.0 { next } else { best })
}

/// A search under way.
struct Search<'a> {
    body: &'a Body,
    /// Points less than this apart along the body do not count, mm.
    neighbourhood: f64,
    /// A part within this of its chord is cut no further, mm.
    sag: f64,
    nearest: Collision,
    found: bool,
    /// Pairs that may still be looked into.
    left: usize,
}

impl Search<'_> {
    fn run(&mut self) {
        let Some(root) = self.body.groups.last() else { return };
        // The earlier stretch first; a stretch and itself stands for all pairs within it.
        let mut pairs = vec![(*root, None)];
        while let Some((a, b)) = pairs.pop() {
            self.left = self.left.saturating_sub(1);
            match b {
                None => {
                    if !self.may_meet(&a.span, &a.span) {
                        continue;
                    }
                    if self.left == 0 {
                        // Nothing is known of the pairs within.
                        self.take(0.0, [a.span.from, a.span.to]);
                        return;
                    }
                    let [first, second] = self.body.halves(&a);
                    pairs.extend([(second, None), (first, None), (first, Some(second))]);
                }
                Some(b) => self.pair(&a, &b, &mut pairs),
            }
        }
    }

    /// Whether points of these stretches may be strangers: far enough along the body, and with a turn between them that can
    /// bring them together. A curve that turns by a right angle at most goes at least `cos(pi / 4)` of its length ahead.
    fn may_meet(&self, a: &Span, b: &Span) -> bool {
        b.to > self.body.since && b.to - a.from > self.neighbourhood && b.turned[1] - a.turned[0] > FRAC_PI_2
    }

    fn take(&mut self, distance: f64, at: [f64; 2]) {
        if distance < self.nearest.distance {
            self.nearest = Collision { distance, at };
            self.found = true;
        }
    }

    fn pair(&mut self, a: &Node, b: &Node, pairs: &mut Vec<(Node, Option<Node>)>) {
        if !self.may_meet(&a.span, &b.span) {
            return;
        }
        let (distance, on) = bound(a, b);
        if distance >= self.nearest.distance {
            return;
        }
        let strangers = b.span.from - a.span.to >= self.neighbourhood;
        let small = |node: &Node| node.is_part() && node.span.length() <= FINEST_SHARE * self.neighbourhood;
        if !strangers && small(a) && small(b) {
            // The end of the neighbourhood, where points are still well apart.
            return;
        }
        let fine = |node: &Node| node.is_part() && node.reach <= self.sag;
        if self.left == 0 || (strangers && fine(a) && fine(b)) {
            let along = |span: &Span, share: f64| span.from + share * span.length();
            self.take(distance, [along(&a.span, on[0]), along(&b.span, on[1])]);
            return;
        }
        // The one that says less of where it is.
        let coarseness = |node: &Node| match (node.is_part(), strangers) {
            (false, _) => f64::INFINITY,
            (true, true) => node.reach,
            (true, false) => node.span.length(),
        };
        let cut_a = match (a.is_part(), b.is_part()) {
            (false, false) => a.reach >= b.reach,
            _ => coarseness(a) >= coarseness(b),
        };
        // The nearer pair is looked into first: what it finds spares the other.
        let mut halves =
            if cut_a { self.body.halves(a).map(|half| (half, *b)) } else { self.body.halves(b).map(|half| (*a, half)) };
        let [near, far] = [0, 1].map(|i| bound(&halves[i].0, &halves[i].1).0);
        if near <= far {
            halves.reverse();
        }
        pairs.extend(halves.map(|(a, b)| (a, Some(b))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_core::path;
    use proptest::prelude::*;
    use std::f64::consts::{PI, TAU};

    const DIAMETER: f64 = 60.0;

    fn segment() -> impl Strategy<Value = Segment> {
        let helicoid = (0.0..TAU, -2.0..0.0, -1.0..1.0, -1.0..1.0, 0.1..1.0, 98.2..200.0, 0.01..7.0).prop_map(
            |(angle, exponent, x, y, along, radius, bend): (f64, f64, f64, f64, f64, f64, f64)| {
                let size = libm::pow(10.0, exponent);
                let axis = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
                let side = Vector3::new(-axis.y, axis.x, 0.0);
                let curve = Helicoid { m0: axis * size, p: axis * along + side * x + Vector3::z() * y };
                Segment::Helicoid { curve, radius, length: bend * radius }
            },
        );
        prop_oneof![
            (0.0..TAU, 1e-9..TAU, 98.2..300.0).prop_map(|(alpha, bend, radius)| Segment::Arc {
                alpha,
                bend,
                length: bend * radius
            }),
            (1e-7..500.0).prop_map(|length| Segment::Straight { length }),
            helicoid,
        ]
    }

    /// Points every `step` mm at most, each with its distance along the body.
    fn points(path: &[Segment], step: f64) -> Vec<(f64, Vector3<f64>)> {
        let (mut points, mut tip, mut at) = (Vec::new(), Frame::identity(), 0.0);
        for segment in path {
            let count = libm::ceil(segment.length() / step);
            for i in 0..count as usize {
                let along = segment.length() * i as f64 / count;
                let part = match *segment {
                    Segment::Arc { alpha, bend, length } => {
                        Segment::Arc { alpha, bend: bend * along / length, length: along }
                    }
                    Segment::Straight { .. } => Segment::Straight { length: along },
                    Segment::Helicoid { curve, radius, .. } => Segment::Helicoid { curve, radius, length: along },
                };
                points.push((at + along, (tip * part.step()).translation.vector));
            }
            tip *= segment.step();
            at += segment.length();
        }
        points.push((at, tip.translation.vector));
        points
    }

    /// The least distance of strangers, by looking at all pairs.
    fn by_looking_at_all(path: &[Segment], since: f64, step: f64) -> f64 {
        let points = points(path, step);
        let mut least = f64::INFINITY;
        for (i, (to, b)) in points.iter().enumerate().filter(|(_, (to, _))| *to > since) {
            let strangers = points[..i].iter().take_while(|(from, _)| to - from >= FRAC_PI_2 * DIAMETER);
            least = strangers.fold(least, |least, (_, a)| least.min((a - b).norm()));
        }
        least
    }

    fn assert_agrees(path: &[Segment], since: f64) {
        let step = 2.5;
        let (found, all) = (first_collision(path, DIAMETER, since), by_looking_at_all(path, since, step));
        match found {
            None => assert!(all >= DIAMETER * (1.0 - 1e-9), "missed {all} in {path:?}"),
            Some(Collision { distance, at: [from, to] }) => {
                assert!(distance <= all + 1e-9, "{distance} is not the least, {all} is: {path:?}");
                // Between sampled points the least distance may be less by as much as they are off.
                assert!(distance >= all - step - TOLERANCE * DIAMETER, "{distance} is no distance: {all} is: {path:?}");
                assert!(to >= since - 1e-6 && to - from >= FRAC_PI_2 * DIAMETER * (1.0 - 1e-9), "{from} to {to}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn the_search_finds_what_looking_at_all_pairs_finds(path in prop::collection::vec(segment(), 0..7)) {
            assert_agrees(&path, 0.0);
        }

        #[test]
        fn only_what_comes_later_counts(path in prop::collection::vec(segment(), 2..6), before in 1_usize..3) {
            let before = path::length(&path[..before.min(path.len())]);
            assert_agrees(&path, before);
        }

        #[test]
        fn points_of_a_collision_are_that_far_apart(path in prop::collection::vec(segment(), 2..7)) {
            let Some(Collision { distance, at }) = first_collision(&path, DIAMETER, 0.0) else { return Ok(()) };
            let [a, b] = at.map(|at| {
                let mut left = at;
                let mut tip = Frame::identity();
                for segment in &path {
                    let piece = Piece { base_from_start: tip, segment: *segment, at: 0.0, turned: 0.0 };
                    if left <= segment.length() {
                        return piece.point(left);
                    }
                    left -= segment.length();
                    tip *= segment.step();
                }
                tip.translation.vector
            });
            prop_assert!(((a - b).norm() - distance).abs() <= TOLERANCE * DIAMETER, "{} is not {distance}", (a - b).norm());
        }
    }

    fn arc(bend: f64, radius: f64) -> Segment {
        Segment::Arc { alpha: 0.0, bend, length: bend * radius }
    }

    #[test]
    fn what_a_bend_brings_together_is_no_collision() {
        for radius in [35.0, 45.0, 100.0, 1e4] {
            assert_eq!(first_collision(&[arc(PI, radius)], DIAMETER, 0.0), None);
        }
        assert_eq!(first_collision(&[Segment::Straight { length: 1e7 }], DIAMETER, 0.0), None);
        assert_eq!(first_collision(&[], DIAMETER, 0.0), None);
    }

    #[test]
    fn a_full_turn_comes_back_to_its_start() {
        let Collision { distance, at: [from, to] } = first_collision(&[arc(TAU, 100.0)], DIAMETER, 0.0).unwrap();
        assert!(distance == 0.0 && from < 1.0 && to > TAU * 100.0 - 1.0, "{distance} at {from}, {to}");
    }

    #[test]
    fn a_way_back_beside_the_way_there_is_measured() {
        for (radius, meets) in [(29.9, true), (29.99, true), (30.01, false), (30.1, false)] {
            let path = [Segment::Straight { length: 3000.0 }, arc(PI, radius), Segment::Straight { length: 2500.0 }];
            let found = first_collision(&path, DIAMETER, 0.0);
            assert_eq!(found.is_some(), meets, "{radius}");
            if let Some(Collision { distance, .. }) = found {
                assert!((distance - 2.0 * radius).abs() < TOLERANCE * DIAMETER);
            }
        }
    }

    #[test]
    fn long_bodies_take_few_steps() {
        // A body of 10 km that keeps clear of itself, one that winds 200 times round, and one that meets itself everywhere.
        let least = |path: &[Segment], most_pairs: usize| {
            let (found, pairs) = search(path, DIAMETER, 0.0);
            println!("{} segments: {pairs} pairs", path.len());
            assert!(pairs <= most_pairs, "{pairs} pairs");
            found.map(|found| found.distance)
        };
        let far = [arc(1.0, 1e6), Segment::Straight { length: 1e7 }, arc(3.0, 1e6)];
        assert_eq!(least(&far, 50), None);
        let pitch = 61.0;
        let turns: Vec<Segment> = (0..400).flat_map(|i| [arc(PI, 100.0 + pitch * f64::from(i) / 2.0)]).collect();
        assert_eq!(least(&turns, 3_000_000), None);
        let ring: Vec<Segment> = (0..5000).map(|_| arc(TAU, 100.0)).collect();
        assert_eq!(least(&ring, 200_000), Some(0.0));
        let nearly: Vec<Segment> =
            (0..300).flat_map(|_| [arc(TAU, 100.0), Segment::Straight { length: 0.37 }]).collect();
        assert!(least(&nearly, 20_000).unwrap() < 0.5);
    }
}
