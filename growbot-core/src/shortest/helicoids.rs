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

use heapless::Vec;
use nalgebra::{Matrix3, Matrix5, Matrix6x5, Vector3, Vector5, Vector6};

use super::Problem;
use crate::helicoid::{Helicoid, Walk};

/// A helicoidal arc and its length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicoidalArc {
    /// The curve, in the frame of the tip that starts it.
    pub curve: Helicoid,
    /// Its length, radii.
    pub length: f64,
}

/// The most arcs that are kept.
pub const MOST: usize = 4;
/// No helicoidal arc of this length or more is a shortest path (the longest found among 10,000 was 7.4).
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
const BESIDE: (f64, f64, f64) = (0.6, 0.5, 0.5);

/// Step of the integration while an arc is mended.
const STEP: f64 = 0.15;
/// Rounds of mending, coarse and fine.
const ROUNDS: usize = 15;
/// An arc is mended coarsely to this, which the length of the steps allows...
const MENDED: f64 = 3e-3;
/// ...and then finely to this.
const ARRIVED: f64 = 1e-11;
/// Every third round the square of the misfit must have fallen to this share.
const FALL: f64 = 0.5;
/// Mending changes the length of an arc by this at most, mostly: seeds longer than the best arc so far by more are left.
const MARGIN: f64 = 0.5;
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

    /// From a point at one distance from the neck to one further on.
    fn walk(&self, mut point: Point, length: f64) -> Point {
        let steps = libm::ceil(length / STEP);
        for _ in 0..steps as u32 {
            point = self.step(&point, length / steps);
        }
        point
    }

    /// The points at two distances from the neck, negative ones before it.
    fn ends(&self, start: f64, end: f64, fine: bool) -> (Point, Point) {
        let neck = Point { position: Vector3::zeros(), direction: Vector3::z() };
        let (first, second) = (start.abs(), end.abs());
        let (near, far) = if first < second { (first, second) } else { (second, first) };
        let (at_near, at_far) = if fine {
            let mut walk = Walk::new(&self.curve());
            let here = |walk: &Walk| {
                let frame = walk.frame();
                Point { position: frame.translation.vector, direction: frame.rotation * Vector3::z() }
            };
            walk.advance(near);
            let at_near = here(&walk);
            walk.advance(far - near);
            (at_near, here(&walk))
        } else {
            let at_near = self.walk(neck, near);
            (at_near, self.walk(at_near, far - near))
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
    /// Square of the misfit.
    misfit: f64,
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
            && (-16.0..3.0).contains(&self.narrowness)
            && (-8.0..4.0).contains(&self.twist)
            && self.before.abs() < 12.0
            && self.after.abs() < 12.0
    }
}

/// Helicoidal arcs to the goal that are shorter than `longest`, shortest first. `meanwhile` is called every few milliseconds of a
/// microcontroller.
pub(super) fn arcs(problem: &Problem, longest: f64, meanwhile: &mut dyn FnMut()) -> Vec<HelicoidalArc, MOST> {
    let longest = longest.min(LONGEST);
    let mut seeds = Grid::new(problem).seeds(longest, meanwhile);
    // Short ones first: what is found bounds what is worth mending.
    seeds.sort_unstable_by(|a, b| a.length().total_cmp(&b.length()));
    let mut found: Vec<HelicoidalArc, MOST> = Vec::new();
    for seed in &seeds {
        meanwhile();
        let best = found.first().map_or(longest, |arc| arc.length);
        if seed.length() > best + MARGIN {
            continue;
        }
        let Some(coarse) = mended(problem, seed, best, false) else { continue };
        let length = coarse.length();
        let known = found.iter().any(|arc| (arc.length - length).abs() < 2e-3);
        if length > best + COARSE_LENGTH || known {
            continue;
        }
        meanwhile();
        if let Some(fine) = mended(problem, &coarse, best, true)
            && let Some(arc) = arc_of(problem, &fine)
            && arc.length < longest
        {
            let at = found.partition_point(|other| other.length <= arc.length);
            if found.is_full() {
                found.pop();
            }
            let _ = found.insert(at.min(found.len()), arc);
        }
    }
    found
}

/// The arc of a seed that has been mended finely.
fn arc_of(problem: &Problem, seed: &Seed) -> Option<HelicoidalArc> {
    let neck = seed.neck();
    let (start, end) = neck.ends(-seed.before, seed.after, true);
    let start_from_neck = axes(problem, &start, &end).transpose();
    let curve = neck.curve();
    let (m0, p) = (start_from_neck * curve.m(&start.position), start_from_neck * curve.p);
    // The scale is free: the larger of the two is made 1.
    let scale = m0.norm().max(p.norm());
    let curve = Helicoid { m0: Vector3::new(m0.x / scale, m0.y / scale, 0.0), p: p / scale };
    let arc = HelicoidalArc { curve, length: seed.length() };
    // What counts is where the curve leads when it is grown from its start.
    let frame = curve.frame_after(arc.length);
    let off = (frame.translation.vector - problem.goal).norm();
    let turned = (frame.rotation * Vector3::z() - problem.direction).norm();
    (off.max(turned) <= super::ARRIVED * 5.0).then_some(arc)
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
    fn new(problem: &Problem, seed: &Seed, fine: bool) -> Self {
        let (start, end) = seed.neck().ends(-seed.before, seed.after, fine);
        let axes = axes(problem, &start, &end);
        Self { start, end, axes, misfit: misfit(problem, &start, &end, &axes) }
    }

    /// How the misfit changes with the logarithms of the two numbers, the two lengths and the roll.
    fn jacobian(&self, problem: &Problem, seed: &Seed, fine: bool) -> Matrix6x5<f64> {
        let neck = seed.neck();
        let share = if fine { 1e-6 } else { 1e-5 };
        let narrower = Neck { narrowness: neck.narrowness * (1.0 + share), ..neck };
        let twisted = Neck { twist: neck.twist * (1.0 + share), ..neck };
        let [by_narrowness, by_twist] = [narrower, twisted].map(|changed| {
            let (start, end) = changed.ends(-seed.before, seed.after, fine);
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
fn mended(problem: &Problem, seed: &Seed, longest: f64, fine: bool) -> Option<Seed> {
    let arrived = if fine { ARRIVED } else { MENDED };
    let mut seed = *seed;
    let mut fit = Fit::new(problem, &seed, fine);
    let mut damping = if fine { 0.0 } else { 1e-3 };
    let mut before = f64::INFINITY;
    for round in 0..ROUNDS {
        let square = fit.misfit.norm_squared();
        if square <= arrived * arrived {
            seed.misfit = square;
            return Some(seed);
        }
        if round % 3 == 0 {
            if !fine && square > FALL * before {
                return None;
            }
            before = square;
        }
        let jacobian = fit.jacobian(problem, &seed, fine);
        let normal = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&fit.misfit);
        let mut better = None;
        for _ in 0..5 {
            let damped = normal + Matrix5::identity() * (damping * 0.2 * normal.trace() + 1e-14);
            if let Some(factors) = damped.cholesky() {
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
                    let next_fit = Fit::new(problem, &next, fine);
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

/// What start and goal are to each other, whatever the roll, in numbers that a hardware of single precision computes: the grid need not be
/// better than that.
struct Grid {
    distance_square: f32,
    along_start: f32,
    along_goal: f32,
    cosine: f32,
    /// Positive for a goal that lies to the left of the plane of start and goal's direction, roughly; 0 in a plane.
    handedness: f64,
}

/// Points of a curve, from before the neck to after it.
struct Points {
    position: [[f32; POINTS]; 3],
    direction: [[f32; POINTS]; 3],
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

    fn seeds(&self, longest: f64, meanwhile: &mut dyn FnMut()) -> Vec<Seed, SEEDS> {
        let mut seeds = Vec::new();
        let at = |(from, to, count): (f64, f64, u32), index: u32| {
            from + (to - from) * (f64::from(index) + 0.5) / f64::from(count)
        };
        for row in 0..NARROWNESS.2 {
            for column in 0..TWIST.2 {
                let (narrowness, twist) = (at(NARROWNESS, row), at(TWIST, column));
                let neck = Neck { narrowness: libm::exp(narrowness), twist: libm::exp(twist) };
                // With less twist `|m|` would be greatest here.
                if neck.twist * neck.twist >= neck.narrowness * (neck.narrowness - 1.0) {
                    self.search(&neck, narrowness, twist, longest, &mut seeds);
                    meanwhile();
                }
            }
        }
        seeds
    }

    fn points(&self, neck: &Neck) -> Points {
        let mut points = Points { position: [[0.0; POINTS]; 3], direction: [[0.0; POINTS]; 3] };
        let mut point = Point { position: Vector3::zeros(), direction: Vector3::z() };
        for index in 0..=SIDE {
            for (before, at) in [(false, SIDE + index), (true, SIDE - index)] {
                let Point { position, direction } = before_if(before, &point);
                for axis in 0..3 {
                    points.position[axis][at] = position[axis] as f32;
                    points.direction[axis][at] = direction[axis] as f32;
                }
            }
            let middle = neck.step(&point, 0.5 * GRID_STEP);
            point = neck.step(&middle, 0.5 * GRID_STEP);
        }
        points
    }

    /// Finds the arcs of one curve that fit better than those next to them.
    fn search(&self, neck: &Neck, narrowness: f64, twist: f64, longest: f64, seeds: &mut Vec<Seed, SEEDS>) {
        let points = self.points(neck);
        let steps = ((longest / GRID_STEP) as usize).min(LONGEST_STEPS);
        let mut rows = [[f32::INFINITY; LONGEST_STEPS + 2]; 3];
        // Arcs by their first point and their number of steps; a row is judged when the next one is there.
        for first in 0..POINTS {
            rows.rotate_left(1);
            rows[2] = self.misfits(&points, first, steps);
            if first == 0 {
                continue;
            }
            let [row_before, row, row_after] = &rows;
            for length in 1..=steps {
                let misfit = row[length];
                let beside = [
                    row[length - 1],
                    row[length + 1],
                    row_before[length],
                    row_after[length],
                    row_before[length + 1],
                    row_after[length - 1],
                ];
                if misfit > WORST_FIT || beside.iter().any(|other| *other < misfit) {
                    continue;
                }
                let handedness = handedness(&points, first - 1, first - 1 + length);
                let twisted = 0.3 * (handedness.abs() - self.handedness.abs());
                let before = (SIDE as f64 - (first - 1) as f64) * GRID_STEP;
                let seed = Seed {
                    narrowness,
                    twist,
                    mirrored: handedness * self.handedness < 0.0,
                    before,
                    after: length as f64 * GRID_STEP - before,
                    misfit: f64::from(misfit) + twisted * twisted,
                };
                keep(seeds, seed);
                // Near a plane either hand will do.
                if self.handedness.abs() < 0.1 || handedness.abs() < 0.1 {
                    keep(seeds, Seed { mirrored: !seed.mirrored, ..seed });
                }
            }
        }
    }

    /// The misfits of all arcs from one point on, by number of steps.
    fn misfits(&self, points: &Points, first: usize, steps: usize) -> [f32; LONGEST_STEPS + 2] {
        let mut misfits = [f32::INFINITY; LONGEST_STEPS + 2];
        let Points { position: [x, y, z], direction: [a, b, c] } = points;
        let (x0, y0, z0, a0, b0, c0) = (x[first], y[first], z[first], a[first], b[first], c[first]);
        let per_distance = 1.0 / (1.0 + self.distance_square);
        for (misfit, last) in misfits.iter_mut().skip(1).take(steps).zip(first + 1..POINTS) {
            let (dx, dy, dz) = (x[last] - x0, y[last] - y0, z[last] - z0);
            let distance = dx * dx + dy * dy + dz * dz - self.distance_square;
            let along_start = dx * a0 + dy * b0 + dz * c0 - self.along_start;
            let along_goal = dx * a[last] + dy * b[last] + dz * c[last] - self.along_goal;
            let cosine = a0 * a[last] + b0 * b[last] + c0 * c[last] - self.cosine;
            *misfit = distance * distance * per_distance * 0.5
                + along_start * along_start
                + along_goal * along_goal
                + cosine * cosine;
        }
        misfits
    }
}

/// As [`Grid::handedness`], of two points of a curve.
fn handedness(points: &Points, first: usize, last: usize) -> f64 {
    let at = |of: &[[f32; POINTS]; 3], index: usize| {
        Vector3::new(f64::from(of[0][index]), f64::from(of[1][index]), f64::from(of[2][index]))
    };
    let offset = at(&points.position, last) - at(&points.position, first);
    at(&points.direction, first).dot(&offset.cross(&at(&points.direction, last)))
}

/// Keeps the seeds that fit best, of those next to each other in the grid only the best.
fn keep(seeds: &mut Vec<Seed, SEEDS>, seed: Seed) {
    let beside = |other: &Seed| {
        other.mirrored == seed.mirrored
            && (other.narrowness - seed.narrowness).abs() < BESIDE.0
            && (other.twist - seed.twist).abs() < BESIDE.1
            && (other.before - seed.before).abs() < BESIDE.2
            && (other.after - seed.after).abs() < BESIDE.2
    };
    if let Some(other) = seeds.iter().position(beside) {
        if seeds[other].misfit <= seed.misfit {
            return;
        }
        seeds.remove(other);
    }
    let at = seeds.partition_point(|other| other.misfit <= seed.misfit);
    if seeds.is_full() {
        if at == SEEDS {
            return;
        }
        seeds.pop();
    }
    let _ = seeds.insert(at, seed);
}
