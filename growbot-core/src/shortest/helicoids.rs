//! Helicoidal arcs from one pose to another.
//!
//! Along such a curve `|m| + p . x'` keeps its value, which scales to 1, and `|m|` swings between a least and a greatest value. Where
//! it is least, at the *neck*, the curve is symmetric: half a turn about the direction in which it bends there maps what follows to
//! what came before. So two numbers, `|m|` and the part of `p` along it at the neck, give the whole curve, and one integration
//! from there gives all arcs that begin and end anywhere on it. A grid over the two numbers is searched for arcs whose ends lie to
//! each other nearly as start and goal do, and each is mended by the method of Levenberg and Marquardt in five unknowns: the
//! two numbers, the lengths before and after the neck, and the roll.
//!
//! At a narrow neck the torsion, `-(m . p)/|m|^2`, turns the plane of the bend over within next to no length: there the curve is
//! nearly three arcs of circles. The steps of the search therefore integrate the direction of `m` in closed form.

use core::mem;

use heapless::Vec;
use nalgebra::{Matrix3, Matrix5, Matrix6x5, Vector3, Vector5, Vector6};

use super::csc::Csc;
use super::{Problem, insert_behind, move_last_behind};
use crate::angle::wrap_signed;
use crate::helicoid::{Helicoid, Walk};
use crate::linalg5::{self, Cholesky};
use crate::pose::{Frame, tip_direction};
use crate::trigonometry;

/// A piece of a helicoidal arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The curve, in the frame of the tip that starts the piece.
    pub curve: Helicoid,
    /// Length, radii.
    pub length: f64,
}

impl Piece {
    /// `start_from_end`, lengths in radii.
    fn frame(&self) -> Frame {
        self.curve.frame_after(self.length)
    }
}

/// A helicoidal arc. One with a narrow neck comes in two pieces that meet there: grown from its start, the least rounding before the neck
/// would turn all that follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidalArc {
    /// The first piece, or the only one.
    pub first: Piece,
    /// What follows the neck.
    pub second: Option<Piece>,
}

impl HelicoidalArc {
    /// The pieces in order.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + use<> {
        [Some(self.first), self.second].into_iter().flatten()
    }

    /// Length, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.pieces().map(|piece| piece.length).sum()
    }
}

/// The most arcs that are kept.
pub const MOST: usize = 3;
/// No helicoidal arc of this length or more is a shortest path: the longest of 753 in `tests/best_known.csv` is 7.27.
const LONGEST: f64 = 8.4;

/// Step of the grid along the curve.
const GRID_STEP: f64 = 0.4;
/// An arc may end this many steps of the grid before the neck, or begin after it.
const OUTSIDE: usize = 5;
/// Steps of the longest arc.
const LONGEST_STEPS: usize = 21;
/// Points of the grid: from the neck either way, and the neck.
const POINTS: usize = 2 * SIDE + 1;
const SIDE: usize = LONGEST_STEPS + OUTSIDE;
/// The grid over the logarithms of the two numbers at the neck: from, to, how many.
const NARROWNESS: (f64, f64, u32) = (-9.5, 1.2, 20);
const TWIST: (f64, f64, u32) = (-2.5, 1.9, 11);
/// Arcs of the grid that are mended: those whose ends fit best.
const SEEDS: usize = 80;
/// Arcs of the grid that fit worse than this (square of radii and radians) are not mended.
const WORST_FIT: f32 = 0.6;

/// Seeds nearer to each other than this (in the two logarithms and the two lengths) are one.
const BESIDE: (f32, f32, f32) = (0.6, 0.5, 0.5);

/// Step of the integration while an arc is mended.
const STEP: f64 = 0.15;
/// Rounds of mending, coarse and fine.
const ROUNDS: usize = 15;
const FINE_ROUNDS: usize = 12;
/// An arc is mended coarsely to this, which the length of the steps allows...
const MENDED: f64 = 3e-3;
/// ...and then finely to this.
const ARRIVED: f64 = 1e-11;
/// Every third round the square of the misfit must have fallen to this share.
const FALL: f64 = 0.5;
/// Mending changes the length of an arc by this at most, mostly: seeds longer than the best arc so far by more are left.
const MARGIN: f64 = 0.5;
/// Arcs whose coarse lengths differ by less than this are taken for one...
const SAME_LENGTH: f64 = 2e-3;
/// ...and remembered, so many of them.
const MOST_TRIED: usize = 24;
/// So many of about one length are given up on finely before that length is.
const MOST_FAILED: usize = 5;
/// Arcs that overlap by less than this are mended finely at once.
const LITTLE_OVERLAP: f64 = 0.02;
/// Below this logarithm of narrowness a neck divides its arc in two pieces...
const NARROW: f64 = -3.0;
/// ...if both are longer than this.
const SHORTEST_PIECE: f64 = 1e-3;
/// Grown from its start, an arc ends within this of the goal, radii and radians.
const GROWN_TO_GOAL: f64 = 3e-10;
/// The share by which a neck is widened to see what that does.
const WIDER: f64 = 1e-4;
/// Narrowness of a neck where two arcs meet that overlap, as a share of what is expected.
const AT_JOINT: [f64; 3] = [0.2, 1.0, 5.0];
/// Coarse and fine length of an arc differ by less than this.
const COARSE_LENGTH: f64 = 0.02;

/// A point of a curve: position and direction.
#[derive(Debug, Clone, Copy)]
struct Point {
    position: Vector3<f64>,
    direction: Vector3<f64>,
}

/// A curve, seen from its neck: there it is at the origin and grows along z, and `m` points along x.
#[derive(Debug, Clone, Copy)]
struct Neck {
    /// `|m|`.
    narrowness: f64,
    /// The part of `p` along `m`; what is left of `p` points along z and is `1 - |m|`.
    twist: f64,
}

impl Neck {
    fn curve(&self) -> Helicoid {
        Helicoid {
            m0: Vector3::new(self.narrowness, 0.0, 0.0),
            p: Vector3::new(self.twist, 0.0, 1.0 - self.narrowness),
        }
    }

    /// The axis about which the tip turns at a point.
    fn axis(&self, point: &Point) -> Vector3<f64> {
        let m = self.curve().m(&point.position);
        m / m.norm().max(f64::MIN_POSITIVE)
    }

    /// One step: half of it straight, then all of the turn, then the other half. Within the step `m` changes evenly.
    fn step(&self, point: &Point, length: f64) -> Point {
        let curve = self.curve();
        let middle = point.position + point.direction * (0.5 * length);
        let turn = mean_direction(&curve.m(&middle), &(curve.p.cross(&point.direction) * length)) * length;
        // Cayley's form of the rotation, with the tangent of half the angle from its series.
        let half = turn * (0.5 + turn.norm_squared() * (1.0 / 24.0));
        let across = half.cross(&point.direction);
        let direction = point.direction + (across + half.cross(&across)) * (2.0 / (1.0 + half.norm_squared()));
        Point { position: middle + direction * (0.5 * length), direction }
    }

    /// From a point at one distance from the neck to one further on, in steps that are short where the neck is narrow.
    fn walk(&self, mut point: Point, from: f64, to: f64) -> Point {
        // A power of 2, so that the steps stay the same while the narrowness changes a little.
        let width = f64::from_bits(libm::sqrt(self.narrowness).to_bits() & f64::INFINITY.to_bits());
        let mut at = from;
        while at < to {
            let step = STEP.min((0.5 * width).max(0.4 * at));
            // The last step takes in what would be less than half a step.
            let step = if at + 1.5 * step > to { to - at } else { step };
            point = self.step(&point, step);
            at += step;
        }
        point
    }

    /// The points at two distances from the neck, negative ones before it.
    fn ends(&self, start: f64, end: f64, fine: bool, meanwhile: &mut dyn FnMut()) -> (Point, Point) {
        let neck = Point { position: Vector3::zeros(), direction: Vector3::z() };
        let (first, second) = (start.abs(), end.abs());
        let (near, far) = if first < second { (first, second) } else { (second, first) };
        let (at_near, at_far) = if fine {
            let mut walk = Walk::new(&self.curve());
            let here = |walk: &Walk| {
                let frame = walk.frame();
                Point { position: frame.translation.vector, direction: frame.rotation * Vector3::z() }
            };
            walk.advance_meanwhile(near, meanwhile);
            let at_near = here(&walk);
            walk.advance_meanwhile(far - near, meanwhile);
            (at_near, here(&walk))
        } else {
            let at_near = self.walk(neck, 0.0, near);
            (at_near, self.walk(at_near, near, far))
        };
        let (at_start, at_end) = if first < second { (at_near, at_far) } else { (at_far, at_near) };
        (before_if(start < 0.0, &at_start), before_if(end < 0.0, &at_end))
    }
}

/// The point before the neck that mirrors one after it.
fn before_if(before: bool, point: &Point) -> Point {
    if !before {
        return *point;
    }
    let Point { position: x, direction: t } = point;
    Point { position: Vector3::new(-x.x, x.y, -x.z), direction: Vector3::new(t.x, -t.y, t.z) }
}

/// The mean of `v/|v|` for `v` from `middle - change/2` to `middle + change/2`.
fn mean_direction(middle: &Vector3<f64>, change: &Vector3<f64>) -> Vector3<f64> {
    let (square, change_square) = (middle.norm_squared(), change.norm_squared());
    if change_square < 0.05 * square {
        return middle / libm::sqrt(square);
    }
    // v = off + change u, with `off` perpendicular to `change`.
    let along = middle.dot(change) / change_square.max(f64::MIN_POSITIVE);
    let off = middle - change * along;
    let (from, to) = (along - 0.5, along + 0.5);
    let off_square = off.norm_squared();
    let norm = |u: f64| libm::sqrt(off_square + change_square * u * u);
    let (norm_from, norm_to) = (norm(from), norm(to));
    let size = libm::sqrt(change_square);
    // |change| u + |v|, without cancellation.
    let sum = |u: f64, norm: f64| if u >= 0.0 { size * u + norm } else { off_square / (norm - size * u) };
    let logarithm = if off_square > 1e-24 { libm::log(sum(to, norm_to) / sum(from, norm_from)) } else { 0.0 };
    change * ((norm_to - norm_from) / change_square) + off * (logarithm / size)
}

/// An arc that nearly leads to the goal.
#[derive(Debug, Clone, Copy)]
struct Seed {
    /// Logarithms of the two numbers at the neck.
    narrowness: f64,
    twist: f64,
    /// Whether the twist is negative: the curve mirrored.
    mirrored: bool,
    /// Length before the neck and after it.
    before: f64,
    after: f64,
}

impl Seed {
    fn neck(&self) -> Neck {
        let twist = libm::exp(self.twist);
        Neck { narrowness: libm::exp(self.narrowness), twist: if self.mirrored { -twist } else { twist } }
    }

    fn length(&self) -> f64 {
        self.before + self.after
    }

    fn in_range(&self, longest: f64) -> bool {
        (0.01..longest + 1.0).contains(&self.length())
            && (-28.0..3.0).contains(&self.narrowness)
            && (-14.0..4.0).contains(&self.twist)
            && self.before.abs() < 12.0
            && self.after.abs() < 12.0
    }
}

/// Helicoidal arcs to the goal that are shorter than `longest`, shortest first. `overlapping` are paths of arc, line and arc whose
/// line is shorter than nothing. `meanwhile` is called every few milliseconds of a microcontroller.
#[inline(never)] // Its room on the stack is not the caller's.
pub(super) fn search(
    problem: &Problem,
    overlapping: &[Csc],
    longest: f64,
    found: &mut Vec<HelicoidalArc, MOST>,
    meanwhile: &mut dyn FnMut(),
) {
    let longest = longest.min(LONGEST);
    let mut search = Search { problem, longest, found, mended: Tried::default(), failed: Tried::default() };
    for path in overlapping {
        for seed in at_joint(path) {
            meanwhile();
            if path.straight > -LITTLE_OVERLAP {
                // Coarse steps would not see so little.
                search.mend_finely(&seed, meanwhile);
            } else {
                search.mend(&seed, meanwhile);
            }
        }
    }
    let mut seeds = Vec::new();
    Grid::new(problem).seeds(longest, &mut seeds, meanwhile);
    // Short ones first: what is found bounds what is worth mending.
    while let Some(seed) = take_shortest(&mut seeds) {
        meanwhile();
        search.mend(&seed.seed(), meanwhile);
    }
}

/// Takes the shortest seed out; the last one takes its place.
fn take_shortest(seeds: &mut Vec<GridSeed, SEEDS>) -> Option<GridSeed> {
    let (last, others) = seeds.split_last_mut()?;
    if let Some(shortest) = others.iter_mut().min_by(|a, b| a.length().total_cmp(&b.length()))
        && shortest.length() <= last.length()
    {
        mem::swap(shortest, last);
    }
    seeds.pop()
}

/// Narrow necks where two arcs meet whose line is shorter than nothing: the bend turns over there from the plane of the first arc to that
/// of the last, while two arcs would turn it at once.
///
/// Near such a neck `m'' = m/|m|`. While the plane turns by `psi`, little, the square of `twist` is `narrowness psi^2 2/pi^2`, and the
/// bend lasts for `psi^2 sqrt(2 narrowness)/8` longer than that of two arcs: so much may they overlap. Tangents of half the angle
/// carry both on to greater angles, roughly.
fn at_joint(path: &Csc) -> [Seed; 3] {
    let turned = wrap_signed(path.last_towards - path.first_towards);
    let tangent = trigonometry::tan(0.5 * turned.abs().clamp(0.1, 3.0));
    let overlap = -path.straight;
    AT_JOINT.map(|share| {
        let narrowness = (share * 2.0 * overlap * overlap / (tangent * tangent * tangent * tangent)).clamp(1e-9, 1.0);
        Seed {
            narrowness: libm::log(narrowness),
            twist: libm::log((0.9 * tangent * libm::sqrt(narrowness)).clamp(1e-5, 3.0)),
            mirrored: turned > 0.0,
            before: (path.first - 0.5 * overlap).max(0.05),
            after: (path.last - 0.5 * overlap).max(0.05),
        }
    })
}

/// Arcs that have been found, and what has been tried.
struct Search<'a> {
    problem: &'a Problem,
    longest: f64,
    found: &'a mut Vec<HelicoidalArc, MOST>,
    /// The arcs that have been mended finely, and those that could not be.
    mended: Tried,
    failed: Tried,
}

/// Coarse lengths of arcs that have been tried, and on which side.
#[derive(Debug, Default)]
struct Tried(Vec<(f32, bool), MOST_TRIED>);

impl Tried {
    /// Full, it only lets an arc be tried again.
    fn push(&mut self, length: f64, mirrored: bool) {
        let _ = self.0.push((length as f32, mirrored));
    }

    /// How many there are of about this length.
    fn about(&self, length: f64, mirrored: bool, off: f64) -> usize {
        let about = |(other, side): &&(f32, bool)| (f64::from(*other) - length).abs() < off && *side == mirrored;
        self.0.iter().filter(about).count()
    }
}

impl Search<'_> {
    /// Mends a seed and keeps the arc, if it may be the shortest.
    #[inline(never)]
    fn mend(&mut self, seed: &Seed, meanwhile: &mut dyn FnMut()) {
        let best = self.found.first().map_or(self.longest, HelicoidalArc::length);
        if seed.length() > best + MARGIN {
            return;
        }
        if let Some(coarse) = mended(self.problem, seed, best, false, meanwhile) {
            self.mend_finely(&coarse, meanwhile);
        }
    }

    /// Mends a seed that is nearly right, and keeps the arc.
    #[inline(never)]
    fn mend_finely(&mut self, coarse: &Seed, meanwhile: &mut dyn FnMut()) {
        let best = self.found.first().map_or(self.longest, HelicoidalArc::length);
        let length = coarse.length();
        let known = self.mended.about(length, coarse.mirrored, SAME_LENGTH) > 0
            || self.failed.about(length, coarse.mirrored, COARSE_LENGTH) > MOST_FAILED;
        if length > best + COARSE_LENGTH || known {
            return;
        }
        if let Some(fine) = mended(self.problem, coarse, best, true, meanwhile)
            && let Some(arc) = arc_of(self.problem, &fine, meanwhile)
        {
            self.mended.push(length, coarse.mirrored);
            if arc.length() >= self.longest {
                return;
            }
            insert_behind(self.found, arc, |other| other.length() <= arc.length());
        } else {
            self.failed.push(length, coarse.mirrored);
        }
    }
}

/// The arc of a seed that has been mended finely, if it arrives when it is grown from its start.
#[inline(never)]
fn arc_of(problem: &Problem, seed: &Seed, meanwhile: &mut dyn FnMut()) -> Option<HelicoidalArc> {
    meanwhile();
    let neck = seed.neck();
    let (start, end) = neck.ends(-seed.before, seed.after, true, meanwhile);
    let start_from_neck = axes(problem, &start, &end).transpose();
    let curve = neck.curve();
    meanwhile();
    let first = in_tip(&start_from_neck, &curve.m(&start.position), &curve.p)?;
    if seed.narrowness >= NARROW || seed.before.min(seed.after) < SHORTEST_PIECE {
        let first = Piece { curve: first, length: seed.length() };
        return lack(problem, &first.frame()).is_none().then_some(HelicoidalArc { first, second: None });
    }
    let tip = first.frame_after(seed.before);
    let tip_from_neck = tip.rotation.inverse().matrix() * start_from_neck;
    let second = in_tip(&tip_from_neck, &curve.m0, &curve.p)?;
    let second = Piece { curve: second, length: seed.after };
    joined(problem, Piece { curve: first, length: seed.before }, second, meanwhile)
}

/// Two pieces that meet at a neck, rolled, lengthened and (the second) narrowed by what rounding before the neck makes necessary.
#[inline(never)]
fn joined(
    problem: &Problem,
    mut first: Piece,
    mut second: Piece,
    meanwhile: &mut dyn FnMut(),
) -> Option<HelicoidalArc> {
    for _ in 0..4 {
        meanwhile();
        let joint = first.frame();
        meanwhile();
        let joint_from_end = second.frame();
        let end = joint * joint_from_end;
        let Some(lack) = lack(problem, &end) else { return Some(HelicoidalArc { first, second: Some(second) }) };
        let (about, tip) = (joint.translation.vector, tip_direction(&joint));
        let (at_end, direction) = (end.translation.vector, tip_direction(&end));
        let turn = |axis: &Vector3<f64>, about: &Vector3<f64>| {
            problem.column(&axis.cross(&(at_end - about)), &axis.cross(&direction))
        };
        let ahead = |direction: &Vector3<f64>| problem.column(direction, &Vector3::zeros());
        // Longer by a little, a piece goes on about its axis at its end.
        let axis_after = |piece: &Piece, frame: &Frame| {
            let m = piece.curve.m(&frame.translation.vector);
            m / m.norm().max(f64::MIN_POSITIVE)
        };
        let end_axis = joint.rotation * axis_after(&second, &joint_from_end);
        let wider = Piece { curve: Helicoid { m0: second.curve.m0 * (1.0 + WIDER), ..second.curve }, ..second };
        meanwhile();
        let wider_end = joint * wider.frame();
        let by_width = problem.column(
            &((wider_end.translation.vector - at_end) / WIDER),
            &((tip_direction(&wider_end) - direction) / WIDER),
        );
        let jacobian = Matrix5::from_columns(&[
            turn(&Vector3::z(), &Vector3::zeros()),
            turn(&axis_after(&first, &joint), &about) + ahead(&tip),
            turn(&tip, &about),
            turn(&end_axis, &at_end) + ahead(&direction),
            by_width,
        ]);
        let step = linalg5::solve(&jacobian, &lack)?;
        if step.amax() > 0.1 {
            return None;
        }
        first = Piece { curve: first.curve.rolled(-step[0]), length: first.length + step[1] };
        let Helicoid { m0, p } = second.curve.rolled(-step[2]);
        second = Piece { curve: Helicoid { m0: m0 * (1.0 + step[4]), p }, length: second.length + step[3] };
    }
    None
}

/// What a path lacks that ends here, none if it arrives.
fn lack(problem: &Problem, end: &Frame) -> Option<Vector5<f64>> {
    let (off, direction) = (problem.goal - end.translation.vector, tip_direction(end));
    let miss = off.norm().max((direction - problem.direction).norm());
    (miss > GROWN_TO_GOAL).then(|| problem.column(&off, &-direction))
}

/// A curve in the frame of a tip. The scale of `m` and `p` is free: the greater of the two is made 1.
fn in_tip(tip_from_neck: &Matrix3<f64>, m: &Vector3<f64>, p: &Vector3<f64>) -> Option<Helicoid> {
    let (m0, p) = (tip_from_neck * m, tip_from_neck * p);
    let scale = m0.norm().max(p.norm());
    (scale > 0.0).then(|| Helicoid { m0: Vector3::new(m0.x / scale, m0.y / scale, 0.0), p: p / scale })
}

/// `neck_from_start`: axes of a start that grows along the curve, rolled so that the goal falls on the end as nearly as it can.
fn axes(problem: &Problem, start: &Point, end: &Point) -> Matrix3<f64> {
    let z = start.direction;
    let mut other = Vector3::zeros();
    if let Some(component) = other.get_mut(z.iamin()) {
        *component = 1.0;
    }
    let x = z.cross(&other).normalize();
    let unrolled = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let (offset, direction) = (unrolled.tr_mul(&(end.position - start.position)), unrolled.tr_mul(&end.direction));
    // Of two pairs of vectors in a plane, the turn of the one that fits the other best.
    let (goal, wanted) = (problem.goal, problem.direction);
    let cos = goal.x * offset.x + goal.y * offset.y + wanted.x * direction.x + wanted.y * direction.y;
    let sin = goal.x * offset.y - goal.y * offset.x + wanted.x * direction.y - wanted.y * direction.x;
    let norm = libm::sqrt(cos * cos + sin * sin);
    let (cos, sin) = if norm > 0.0 { (cos / norm, sin / norm) } else { (1.0, 0.0) };
    unrolled * Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// An arc laid into the problem.
struct Fit {
    start: Point,
    end: Point,
    axes: Matrix3<f64>,
    misfit: Vector6<f64>,
}

impl Fit {
    fn new(problem: &Problem, seed: &Seed, fine: bool, meanwhile: &mut dyn FnMut()) -> Self {
        let (start, end) = seed.neck().ends(-seed.before, seed.after, fine, meanwhile);
        let axes = axes(problem, &start, &end);
        Self { start, end, axes, misfit: misfit(problem, &start, &end, &axes) }
    }

    /// How the misfit changes with the logarithms of the two numbers, the two lengths and the roll.
    fn jacobian(&self, problem: &Problem, seed: &Seed, fine: bool, meanwhile: &mut dyn FnMut()) -> Matrix6x5<f64> {
        let neck = seed.neck();
        let share = if fine { 1e-6 } else { 1e-5 };
        let narrower = Neck { narrowness: neck.narrowness * (1.0 + share), ..neck };
        let twisted = Neck { twist: neck.twist * (1.0 + share), ..neck };
        let [by_narrowness, by_twist] = [narrower, twisted].map(|changed| {
            meanwhile();
            let (start, end) = changed.ends(-seed.before, seed.after, fine, meanwhile);
            let axes = shortest_turn(&self.start.direction, &start.direction) * self.axes;
            (misfit(problem, &start, &end, &axes) - self.misfit) / share
        });
        let (goal, wanted) = (self.axes * problem.goal, self.axes * problem.direction);
        let (start_axis, end_axis) = (neck.axis(&self.start), neck.axis(&self.end));
        let (ahead, direction) = (&self.start.direction, &self.end.direction);
        Matrix6x5::from_columns(&[
            by_narrowness,
            by_twist,
            stacked(&(ahead + start_axis.cross(&goal)), &start_axis.cross(&wanted)),
            stacked(direction, &end_axis.cross(direction)),
            stacked(&-ahead.cross(&goal), &-ahead.cross(&wanted)),
        ])
    }
}

fn stacked(offset: &Vector3<f64>, turned: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(offset.x, offset.y, offset.z, turned.x, turned.y, turned.z)
}

/// Where the arc's end lies beside the goal, and how its direction differs.
fn misfit(problem: &Problem, start: &Point, end: &Point, axes: &Matrix3<f64>) -> Vector6<f64> {
    stacked(&(end.position - start.position - axes * problem.goal), &(end.direction - axes * problem.direction))
}

/// The rotation that turns one unit vector into another the shortest way.
fn shortest_turn(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let cross = from.cross(to).cross_matrix();
    Matrix3::identity() + cross + cross * cross / (1.0 + from.dot(to)).max(1e-9)
}

/// The arc next to a seed that leads to the goal.
#[inline(never)]
fn mended(problem: &Problem, seed: &Seed, longest: f64, fine: bool, meanwhile: &mut dyn FnMut()) -> Option<Seed> {
    let arrived = if fine { ARRIVED } else { MENDED };
    let mut seed = *seed;
    let mut fit = Fit::new(problem, &seed, fine, meanwhile);
    let mut damping = if fine { 1e-6 } else { 1e-3 };
    let mut before = f64::INFINITY;
    for round in 0..if fine { FINE_ROUNDS } else { ROUNDS } {
        meanwhile();
        let square = fit.misfit.norm_squared();
        if square <= arrived * arrived {
            return Some(seed);
        }
        if round % 3 == 0 {
            if !fine && square > FALL * before {
                return None;
            }
            before = square;
        }
        let jacobian = fit.jacobian(problem, &seed, fine, meanwhile);
        let normal = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&fit.misfit);
        let mut better = None;
        for _ in 0..5 {
            let damped = normal + Matrix5::identity() * (damping * 0.2 * normal.trace() + 1e-14);
            if let Some(factors) = Cholesky::new(&damped) {
                let step: Vector5<f64> = -factors.solve(&gradient);
                let step = step / step.amax().max(1.0);
                let next = Seed {
                    narrowness: seed.narrowness + step[0],
                    twist: seed.twist + step[1],
                    before: seed.before + step[2],
                    after: seed.after + step[3],
                    ..seed
                };
                if next.in_range(longest) {
                    meanwhile();
                    let next_fit = Fit::new(problem, &next, fine, meanwhile);
                    if next_fit.misfit.norm_squared() < square {
                        better = Some((next, next_fit));
                        break;
                    }
                }
            }
            damping = (damping * 10.0).max(1e-4);
        }
        (seed, fit) = better?;
        damping = if damping < 1e-8 { 0.0 } else { 0.1 * damping };
    }
    None
}

/// A seed from the grid, in few bytes.
#[derive(Debug, Clone, Copy)]
struct GridSeed {
    narrowness: f32,
    twist: f32,
    mirrored: bool,
    before: f32,
    after: f32,
    /// Square of the misfit.
    misfit: f32,
}

impl GridSeed {
    fn length(&self) -> f32 {
        self.before + self.after
    }

    fn seed(&self) -> Seed {
        let Self { narrowness, twist, mirrored, before, after, .. } = *self;
        Seed {
            narrowness: narrowness.into(),
            twist: twist.into(),
            mirrored,
            before: before.into(),
            after: after.into(),
        }
    }
}

/// What start and goal are to each other, whatever the roll. In single precision, which the microcontroller's hardware computes: a grid
/// need not be better.
struct Grid {
    distance_square: f32,
    along_start: f32,
    along_goal: f32,
    cosine: f32,
    /// Positive for a goal that lies to the left of the plane of start and goal's direction, roughly; 0 in a plane.
    handedness: f64,
}

/// A point of a curve of the grid.
#[derive(Debug, Clone, Copy, Default)]
struct GridPoint {
    position: [f32; 3],
    direction: [f32; 3],
}

impl From<Point> for GridPoint {
    fn from(Point { position, direction }: Point) -> Self {
        let single = |vector: Vector3<f64>| [vector.x as f32, vector.y as f32, vector.z as f32];
        Self { position: single(position), direction: single(direction) }
    }
}

impl Grid {
    fn new(problem: &Problem) -> Self {
        let (goal, direction) = (&problem.goal, &problem.direction);
        Self {
            distance_square: goal.norm_squared() as f32,
            along_start: goal.z as f32,
            along_goal: goal.dot(direction) as f32,
            cosine: direction.z as f32,
            handedness: goal.x * direction.y - goal.y * direction.x,
        }
    }

    fn seeds(&self, longest: f64, seeds: &mut Vec<GridSeed, SEEDS>, meanwhile: &mut dyn FnMut()) {
        let at = |(from, to, count): (f64, f64, u32), index: u32| {
            from + (to - from) * (f64::from(index) + 0.5) / f64::from(count)
        };
        for row in 0..NARROWNESS.2 {
            for column in 0..TWIST.2 {
                let (narrowness, twist) = (at(NARROWNESS, row), at(TWIST, column));
                let neck = Neck { narrowness: libm::exp(narrowness), twist: libm::exp(twist) };
                // With less twist `|m|` would be greatest here.
                if neck.twist * neck.twist >= neck.narrowness * (neck.narrowness - 1.0) {
                    self.search(&neck, narrowness, twist, longest, seeds);
                    meanwhile();
                }
            }
        }
    }

    /// Points of a curve, from before the neck to after it.
    fn points(&self, neck: &Neck) -> [GridPoint; POINTS] {
        let mut points = [GridPoint::default(); POINTS];
        let mut point = Point { position: Vector3::zeros(), direction: Vector3::z() };
        for index in 0..=SIDE {
            for (before, at) in [(false, SIDE + index), (true, SIDE - index)] {
                if let Some(place) = points.get_mut(at) {
                    *place = before_if(before, &point).into();
                }
            }
            point = if index == 0 {
                neck.walk(point, 0.0, GRID_STEP)
            } else {
                neck.step(&neck.step(&point, 0.5 * GRID_STEP), 0.5 * GRID_STEP)
            };
        }
        points
    }

    /// Finds the arcs of one curve that fit better than those next to them.
    #[inline(never)]
    fn search(&self, neck: &Neck, narrowness: f64, twist: f64, longest: f64, seeds: &mut Vec<GridSeed, SEEDS>) {
        let points = self.points(neck);
        let steps = ((longest / GRID_STEP) as usize).min(LONGEST_STEPS);
        let mut rows = [[f32::INFINITY; LONGEST_STEPS + 2]; 3];
        // Arcs by their first point and their number of steps; a row is judged when the next one is there.
        for next in 0..POINTS {
            // Not `rotate_left`, whose shift of any slice by any way takes 1.5 kB of a microcontroller's flash.
            rows.swap(0, 1);
            rows.swap(1, 2);
            rows[2] = self.misfits(points.get(next..).unwrap_or_default(), steps);
            let Some(first) = next.checked_sub(1) else { continue };
            let [row_before, row, row_after] = &rows;
            let beside = row_before.windows(3).zip(row.windows(3)).zip(row_after.windows(3));
            for (length, beside) in (1..=steps).zip(beside) {
                let ((&[_, a, b], &[c, misfit, d]), &[e, f, _]) = beside else { continue };
                if misfit > WORST_FIT || [a, b, c, d, e, f].iter().any(|other| *other < misfit) {
                    continue;
                }
                let (Some(start), Some(end)) = (points.get(first), points.get(first + length)) else { continue };
                let handedness = handedness(start, end);
                let twisted = 0.3 * (handedness.abs() - self.handedness.abs());
                let before = (SIDE as f64 - first as f64) * GRID_STEP;
                let seed = GridSeed {
                    narrowness: narrowness as f32,
                    twist: twist as f32,
                    mirrored: handedness * self.handedness < 0.0,
                    before: before as f32,
                    after: (length as f64 * GRID_STEP - before) as f32,
                    misfit: misfit + (twisted * twisted) as f32,
                };
                keep(seeds, seed);
                // Near a plane either hand will do.
                if self.handedness.abs() < 0.1 || handedness.abs() < 0.1 {
                    keep(seeds, GridSeed { mirrored: !seed.mirrored, ..seed });
                }
            }
        }
    }

    /// The misfits of all arcs from the first of these points on, by number of steps.
    fn misfits(&self, points: &[GridPoint], steps: usize) -> [f32; LONGEST_STEPS + 2] {
        let mut misfits = [f32::INFINITY; LONGEST_STEPS + 2];
        let Some((start, ends)) = points.split_first() else { return misfits };
        let (&[x0, y0, z0], &[a0, b0, c0]) = (&start.position, &start.direction);
        let per_distance = 1.0 / (1.0 + self.distance_square);
        for (misfit, end) in misfits.iter_mut().skip(1).take(steps).zip(ends) {
            let (&[x, y, z], &[a, b, c]) = (&end.position, &end.direction);
            let (dx, dy, dz) = (x - x0, y - y0, z - z0);
            let distance = dx * dx + dy * dy + dz * dz - self.distance_square;
            let along_start = dx * a0 + dy * b0 + dz * c0 - self.along_start;
            let along_goal = dx * a + dy * b + dz * c - self.along_goal;
            let cosine = a0 * a + b0 * b + c0 * c - self.cosine;
            *misfit = distance * distance * per_distance * 0.5
                + along_start * along_start
                + along_goal * along_goal
                + cosine * cosine;
        }
        misfits
    }
}

/// As [`Grid::handedness`], of two points of a curve.
fn handedness(start: &GridPoint, end: &GridPoint) -> f64 {
    let double = |&[x, y, z]: &[f32; 3]| Vector3::new(f64::from(x), f64::from(y), f64::from(z));
    let offset = double(&end.position) - double(&start.position);
    double(&start.direction).dot(&offset.cross(&double(&end.direction)))
}

/// Keeps the seeds that fit best, of those next to each other in the grid only the best.
fn keep(seeds: &mut Vec<GridSeed, SEEDS>, seed: GridSeed) {
    let beside = |other: &GridSeed| {
        other.mirrored == seed.mirrored
            && (other.narrowness - seed.narrowness).abs() < BESIDE.0
            && (other.twist - seed.twist).abs() < BESIDE.1
            && (other.before - seed.before).abs() < BESIDE.2
            && (other.after - seed.after).abs() < BESIDE.2
    };
    let fits_better = |other: &GridSeed| other.misfit <= seed.misfit;
    let up_to_other = seeds.iter().position(beside).and_then(|other| seeds.get_mut(..=other));
    if let Some(up_to_other) = up_to_other {
        if let Some(other) = up_to_other.last_mut()
            && !fits_better(other)
        {
            *other = seed;
            move_last_behind(up_to_other, fits_better);
        }
    } else {
        insert_behind(seeds, seed, fits_better);
    }
}
