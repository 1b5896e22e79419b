//! Paths of an arc, a straight line and an arc, in any planes.
//!
//! Given the angle `a` of the first arc, with `tau = tan(a/2)`, the lines tangent to its two ends meet in the corner
//! `A = tau t0`. The goal's direction and the corner span the plane of the last arc, so the line is one of four: a tangent from `A`,
//! either way, to one of the two circles that end in the goal. For each of these branches the one equation
//!
//! ```text
//! h(a) = tau^2 (1 + f) - (1 - f) = 0,   f = t0 . u
//! ```
//!
//! says that the line's direction `u` turns from `t0` by `a`. Its roots are bracketed by probes and refined; there are up to seven
//! paths. `tau` is negative for arcs beyond half a turn.

use core::f64::consts::{PI, TAU};

use heapless::Vec;
use nalgebra::{Matrix3, Matrix5, Rotation3, Vector3, Vector5};

use super::{Problem, any_perpendicular, axes_after, insert_behind};
use crate::kinematics::step;
use crate::linalg5::Cholesky;
use crate::trigonometry;

/// An arc, a straight line, an arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Csc {
    /// Direction in the tip's frame towards which the first arc bends, radians.
    pub first_towards: f64,
    /// Angle of the first arc, radians.
    pub first: f64,
    /// Length of the line.
    pub straight: f64,
    /// Direction in the tip's frame, there, towards which the last arc bends, radians.
    pub last_towards: f64,
    /// Angle of the last arc, radians.
    pub last: f64,
}

/// Probes in each half of the range of the first arc's angle...
const PROBES_FAR: u32 = 36;
/// ...and for goals nearer than this, radii, where the branches crowd.
const PROBES_NEAR: u32 = 256;
const NEAR: f64 = 3.9;
/// The most paths that are kept.
pub const MOST: usize = 8;
/// The most that is kept of what is nearly a path.
const MOST_OVERLAPPING: usize = 8;
/// How much shorter than nothing a line may be there.
const OVERLAP: f64 = 1.0;
/// A path is worth polishing if it ends within this of the goal.
const NEARLY: f64 = 0.05;
/// Two paths whose numbers all agree to this are one.
const SAME: f64 = 1e-7;

impl Csc {
    /// Length of the whole path.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.first + self.straight + self.last
    }
}

/// A tangent from the corner to the goal's circles.
#[derive(Clone, Copy)]
struct Branch {
    /// Whether the circle's centre lies towards `across`, seen from the goal's direction, or away from it.
    towards: bool,
    /// Along the tangent forwards or backwards.
    forwards: bool,
}

const BRANCHES: [Branch; 4] = [
    Branch { towards: true, forwards: true },
    Branch { towards: true, forwards: false },
    Branch { towards: false, forwards: true },
    Branch { towards: false, forwards: false },
];

/// A number or its negative: a multiplication by 1 or -1, which takes the microcontroller long.
fn signed(positive: bool, number: f64) -> f64 {
    if positive { number } else { -number }
}

/// A probe: where in the range, and `h / (1 + tau^2)` there.
type Probe = (f64, f64);

/// `tau` of a number `q` in (-1, 1): 0 at 0, and both infinities, where the first arc is half a turn, at the ends, around which
/// even steps of `q` crowd.
fn tau_of(q: f64) -> f64 {
    let left = (1.0 - q.abs()) * (1.0 - q.abs());
    let tau = (1.0 - left) / left.max(1e-6);
    if q < 0.0 { -tau } else { tau }
}

/// `cos(a)` of `tau = tan(a/2)`.
fn cosine(tau: f64) -> f64 {
    (1.0 - tau * tau) / (1.0 + tau * tau)
}

/// What is common to the four branches at one corner.
struct Corner {
    /// From the corner to the goal, along the goal's direction and across it.
    along: f64,
    distance: f64,
    across: Vector3<f64>,
}

/// One of the goal's circles, and the tangents from the corner to it: what both have in common.
#[derive(Clone, Copy)]
struct Circle {
    towards: bool,
    /// Its centre in (direction, across), seen from the corner.
    x: f64,
    y: f64,
    /// From the corner to where they touch it.
    length: f64,
    /// The inverse square of the distance of its centre.
    scale: f64,
}

impl Circle {
    /// None round a corner within the circle, from where there are no tangents.
    fn new(corner: &Corner, towards: bool) -> Option<Self> {
        let (x, y) = (corner.along, signed(towards, 1.0) - corner.distance);
        let squared = x * x + y * y - 1.0;
        if squared < 0.0 {
            return None;
        }
        Some(Self { towards, x, y, length: libm::sqrt(squared), scale: 1.0 / (squared + 1.0) })
    }

    /// The direction of a tangent, in (direction, across), and its signed length.
    fn line(&self, forwards: bool) -> (f64, f64, f64) {
        let &Self { towards, x, y, scale, .. } = self;
        let length = signed(forwards, self.length);
        // The centre lies a radius to the side of the line: centre = length u + side left(u).
        ((x * length + signed(towards, y)) * scale, (y * length - signed(towards, x)) * scale, length)
    }
}

/// What would be a path if its line were not a little shorter than nothing: a helicoidal arc is mostly near it.
pub(super) type Overlapping = Vec<Csc, MOST_OVERLAPPING>;

/// Looks for all paths of this kind, shortest first, and what would be. `meanwhile` is called for each probe.
#[inline(never)] // Its room on the stack is not the caller's.
pub(super) fn search(
    problem: &Problem,
    paths: &mut Vec<Csc, MOST>,
    overlapping: &mut Overlapping,
    meanwhile: &mut dyn FnMut(),
) {
    let mut search = Search { problem, paths, overlapping };
    search.half(1.0, meanwhile);
    search.half(-1.0, meanwhile);
    search.special_lines();
    search.crossing_lines();
}

struct Search<'a> {
    problem: &'a Problem,
    paths: &'a mut Vec<Csc, MOST>,
    overlapping: &'a mut Overlapping,
}

impl Search<'_> {
    fn corner(&self, tau: f64) -> Corner {
        let to_goal = self.problem.goal - Vector3::z() * tau;
        let along = to_goal.dot(&self.problem.direction);
        let off = self.problem.direction * along - to_goal;
        let distance = off.norm();
        Corner { along, distance, across: off / distance.max(f64::MIN_POSITIVE) }
    }

    fn misfit(&self, branch: Branch, q: f64) -> Option<f64> {
        let tau = tau_of(q);
        let corner = self.corner(tau);
        let circle = Circle::new(&corner, branch.towards)?;
        Some(self.misfit_at(&corner, &circle, branch.forwards, cosine(tau)))
    }

    /// `h / (1 + tau^2)`, which keeps it finite and its roots where they are: `f - cos(a)`.
    fn misfit_at(&self, corner: &Corner, circle: &Circle, forwards: bool, cosine: f64) -> f64 {
        let (cos, sin, _) = circle.line(forwards);
        cos * self.problem.direction.z + sin * corner.across.z - cosine
    }

    /// Looks for roots of `h` in one half of the range.
    #[inline(never)]
    fn half(&mut self, sign: f64, meanwhile: &mut dyn FnMut()) {
        let mut last: [[Option<Probe>; 2]; 4] = [[None; 2]; 4];
        let probes = if self.problem.goal.norm() < NEAR { PROBES_NEAR } else { PROBES_FAR };
        for probe in 0..=probes {
            meanwhile();
            let q = sign * f64::from(probe) / f64::from(probes);
            let tau = tau_of(q);
            let (corner, cosine) = (self.corner(tau), cosine(tau));
            let (towards, away) = (Circle::new(&corner, true), Circle::new(&corner, false));
            for (branch, last) in BRANCHES.into_iter().zip(&mut last) {
                let circle = if branch.towards { &towards } else { &away };
                let here = circle.as_ref().map(|circle| (q, self.misfit_at(&corner, circle, branch.forwards, cosine)));
                match (last[1], here) {
                    (Some(a), Some(b)) => self.bracket(branch, a, b),
                    // The branch ends or begins between two probes.
                    (Some(inside), None) => self.edge(branch, inside, q),
                    (None, Some(inside)) if probe > 0 => self.edge(branch, inside, q - sign / f64::from(probes)),
                    _ => {}
                }
                // Two roots may hide between three probes of one sign.
                if let (Some(a), Some(b), Some(c)) = (last[0], last[1], here)
                    && (a.1 <= 0.0) == (b.1 <= 0.0)
                    && (b.1 <= 0.0) == (c.1 <= 0.0)
                    && b.1.abs() <= a.1.abs()
                    && b.1.abs() <= c.1.abs()
                {
                    self.dip(branch, a, b, c);
                }
                *last = [last[1], here];
            }
        }
    }

    /// Refines a root if `h` has different signs at two places.
    fn bracket(&mut self, branch: Branch, a: Probe, b: Probe) {
        if (a.1 <= 0.0) != (b.1 <= 0.0) {
            let q = self.refine(branch, a, b);
            self.consider(branch, q);
        }
    }

    /// Looks between a place where the branch exists and one where it does not.
    fn edge(&mut self, branch: Branch, mut inside: Probe, mut outside: f64) {
        let first = inside;
        for _ in 0..40 {
            let q = 0.5 * (inside.0 + outside);
            match self.misfit(branch, q) {
                Some(misfit) => inside = (q, misfit),
                None => outside = q,
            }
        }
        self.bracket(branch, first, inside);
    }

    /// Looks where `|h|` is least between three probes of one sign, for the two roots round a change of sign there.
    fn dip(&mut self, branch: Branch, mut a: Probe, mut b: Probe, mut c: Probe) {
        let (from, to) = (a, c);
        for _ in 0..30 {
            let q = if (b.0 - a.0).abs() > (c.0 - b.0).abs() { 0.5 * (a.0 + b.0) } else { 0.5 * (b.0 + c.0) };
            let Some(misfit) = self.misfit(branch, q) else { return };
            let here = (q, misfit);
            if (misfit <= 0.0) != (b.1 <= 0.0) {
                self.bracket(branch, from, here);
                self.bracket(branch, here, to);
                return;
            }
            let before = (q - a.0) * (b.0 - q) > 0.0;
            match (misfit.abs() < b.1.abs(), before) {
                (true, true) => (b, c) = (here, b),
                (true, false) => (a, b) = (b, here),
                (false, true) => a = here,
                (false, false) => c = here,
            }
        }
    }

    /// The root between two places at which `h` has different signs: regula falsi (Illinois), with bisections between.
    fn refine(&self, branch: Branch, mut a: Probe, mut b: Probe) -> f64 {
        let mut kept = 0;
        for round in 0..60 {
            let width = b.0 - a.0;
            if width.abs() <= 1e-15 {
                break;
            }
            let secant = b.0 - b.1 * width / (b.1 - a.1);
            let inside = (secant - a.0) * (b.0 - secant) > 0.0 && round % 4 != 3;
            let q = if inside { secant } else { a.0 + 0.5 * width };
            let Some(misfit) = self.misfit(branch, q) else { break };
            if misfit.abs() < 1e-15 {
                return q;
            }
            if (misfit <= 0.0) == (a.1 <= 0.0) {
                a = (q, misfit);
                if kept == 1 {
                    b.1 *= 0.5;
                }
                kept = 1;
            } else {
                b = (q, misfit);
                if kept == -1 {
                    a.1 *= 0.5;
                }
                kept = -1;
            }
        }
        0.5 * (a.0 + b.0)
    }

    /// The path of a root.
    fn consider(&mut self, branch: Branch, q: f64) {
        let tau = tau_of(q);
        let corner = self.corner(tau);
        let Some(circle) = Circle::new(&corner, branch.towards) else { return };
        let (cos, sin, length) = circle.line(branch.forwards);
        let straight = length - tau;
        if straight < -OVERLAP {
            return;
        }
        let across = corner.across;
        let u = self.problem.direction * cos + across * sin;
        let half = libm::atan(tau);
        let first = if tau < 0.0 { TAU + 2.0 * half } else { 2.0 * half };
        // From the line's direction to the goal's, turning towards the circle's centre.
        let turned = libm::atan2(signed(branch.towards, -sin), cos);
        let last = if turned < 0.0 { turned + TAU } else { turned };
        let towards = across * cos - self.problem.direction * sin;
        let towards = if branch.towards { towards } else { -towards };
        // The first arc bends towards the line, or the other way round for more than half a turn.
        let (x, y) = if tau < 0.0 { (-u.x, -u.y) } else { (u.x, u.y) };
        let first_towards = libm::atan2(y, x);
        let last_towards = in_tip(&axes_after(first_towards, first), &towards);
        let path = Csc { first_towards, first, straight, last_towards, last };
        if straight < 0.0 && self.problem.goal.norm() < NEAR {
            // Full ones lose nothing: seven is the most that there are.
            let _ = self.overlapping.push(path);
        }
        if straight > -NEARLY {
            self.keep(path);
        }
    }

    /// Where the lines through start and goal cross, or nearly so, the plane of the last arc is open: the corners of both arcs fall
    /// together, and the line leaves the plane to one side or the other.
    #[inline(never)]
    fn crossing_lines(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        let ahead = Vector3::z();
        let cosine_between = direction.z;
        let det = 1.0 - cosine_between * cosine_between;
        let normal = ahead.cross(&direction);
        if det < 1e-6 || goal.dot(&normal).abs() > NEARLY {
            return;
        }
        // Of [1 c; c 1] [x; y] = [a; b].
        let solve = |a: f64, b: f64| ((a - cosine_between * b) / det, (b - cosine_between * a) / det);
        let (first_tau, last_tau) = solve(goal.z, goal.dot(&direction));
        let straight = -(first_tau + last_tau);
        let (first_cosine, last_cosine) = (cosine(first_tau), cosine(last_tau));
        let (along_start, along_goal) = solve(first_cosine, last_cosine);
        let off = 1.0 - (along_start * first_cosine + along_goal * last_cosine);
        if straight < -NEARLY || off < -NEARLY {
            return;
        }
        let angle = |tau: f64| if tau < 0.0 { TAU + 2.0 * libm::atan(tau) } else { 2.0 * libm::atan(tau) };
        let (first, last) = (angle(first_tau), angle(last_tau));
        let off = libm::sqrt(off.max(0.0)) / libm::sqrt(det);
        for side in [off, -off] {
            let u = ahead * along_start + direction * along_goal + normal * side;
            let first_towards = if first_tau < 0.0 { libm::atan2(-u.y, -u.x) } else { libm::atan2(u.y, u.x) };
            let towards = direction - u * last_cosine;
            let towards = if last_tau < 0.0 { -towards } else { towards };
            let last_towards = in_tip(&axes_after(first_towards, first), &towards);
            self.keep(Csc { first_towards, first, straight, last_towards, last });
        }
    }

    /// Lines along the start or the goal, forwards or backwards, where a root has no bracket: an arc of no length, or of half
    /// a turn, whose plane is free.
    #[inline(never)]
    fn special_lines(&mut self) {
        let Problem { goal, direction, .. } = *self.problem;
        let ahead = Vector3::z();
        for arc in arcs_between(&ahead, &direction) {
            let rest = goal - arc.offset;
            let towards = in_tip(&Matrix3::identity(), &arc.towards);
            // Straight on from the start.
            if trigonometry::hypot(rest.x, rest.y) < NEARLY {
                self.keep(Csc {
                    first_towards: 0.0,
                    first: 0.0,
                    straight: rest.z,
                    last_towards: towards,
                    last: arc.angle,
                });
            }
            // Straight into the goal.
            let straight = rest.dot(&direction);
            if (rest - direction * straight).norm() < NEARLY {
                self.keep(Csc { first_towards: towards, first: arc.angle, straight, last_towards: 0.0, last: 0.0 });
            }
        }
        for arc in arcs_between(&-ahead, &direction) {
            // Half a turn first, in the plane that the rest of the way leaves open.
            let rest = goal - arc.offset;
            if (trigonometry::hypot(rest.x, rest.y) - 2.0).abs() < NEARLY {
                let first_towards = libm::atan2(rest.y, rest.x);
                let last_towards = in_tip(&axes_after(first_towards, PI), &arc.towards);
                self.keep(Csc { first_towards, first: PI, straight: -rest.z, last_towards, last: arc.angle });
            }
        }
        for arc in arcs_between(&ahead, &-direction) {
            // Half a turn last.
            let rest = goal - arc.offset;
            let straight = -rest.dot(&direction);
            let towards = rest + direction * straight;
            if (towards.norm() - 2.0).abs() < NEARLY {
                let first_towards = in_tip(&Matrix3::identity(), &arc.towards);
                let last_towards = in_tip(&axes_after(first_towards, arc.angle), &towards);
                self.keep(Csc { first_towards, first: arc.angle, straight, last_towards, last: PI });
            }
        }
        // Two half turns: their planes make up the distance across.
        let across = 0.25 * trigonometry::hypot(goal.x, goal.y);
        if across <= 1.0 && direction.z > 1.0 - NEARLY {
            let (middle, aside) = (libm::atan2(goal.y, goal.x), trigonometry::acos(across));
            for aside in [aside, -aside] {
                let axes = axes_after(middle + aside, PI);
                let (sin, cos) = trigonometry::sin_cos(middle - aside);
                let last_towards = in_tip(&axes, &Vector3::new(cos, sin, 0.0));
                self.keep(Csc { first_towards: middle + aside, first: PI, straight: -goal.z, last_towards, last: PI });
            }
        }
    }

    /// Keeps a path that ends at the goal, if need be after polishing, in order of length.
    #[inline(never)]
    fn keep(&mut self, path: Csc) {
        let Some(path) = self.problem.polished(path) else { return };
        let same = |other: &Csc| {
            (other.length() - path.length()).abs() < SAME
                && (other.first - path.first).abs() < SAME
                && (other.straight - path.straight).abs() < SAME
        };
        if self.paths.iter().any(same) {
            return;
        }
        insert_behind(self.paths, path, |other| other.length() <= path.length());
    }
}

/// An arc from one direction to another.
struct ArcBetween {
    angle: f64,
    offset: Vector3<f64>,
    towards: Vector3<f64>,
}

/// The two arcs from one direction to another: the short and the long way. In any plane if that is open.
fn arcs_between(from: &Vector3<f64>, to: &Vector3<f64>) -> [ArcBetween; 2] {
    let cos = from.dot(to);
    let across = to - from * cos;
    let sin = across.norm();
    let towards = if sin > 1e-14 { across / sin } else { any_perpendicular(from) };
    let angle = libm::atan2(sin, cos);
    let short = ArcBetween { angle, offset: from * sin + towards * (1.0 - cos), towards };
    let long = ArcBetween { angle: TAU - angle, offset: -short.offset, towards: -towards };
    [short, long]
}

/// The angle in the deposition plane of a tip with these axes.
fn in_tip(axes: &Matrix3<f64>, towards: &Vector3<f64>) -> f64 {
    let local = axes.transpose() * towards;
    libm::atan2(local.y, local.x)
}

impl Problem {
    /// A path that ends at the goal to [`super::ARRIVED`], after Newton's method on its five numbers if need be.
    fn polished(&self, mut path: Csc) -> Option<Csc> {
        for _ in 0..8 {
            let chain = Chain::new(&path);
            let lack = self.lack(&chain);
            let miss = lack.amax();
            if miss <= super::ARRIVED * self.scale {
                let least = path.first.min(path.straight).min(path.last);
                if least >= 0.0 {
                    return Some(path);
                }
                // What is nothing may come out a rounding error below it.
                if least < -1e-9 {
                    return None;
                }
                path.first = path.first.max(0.0);
                path.straight = path.straight.max(0.0);
                path.last = path.last.max(0.0);
                continue;
            }
            if miss.is_nan() || miss > NEARLY * (1.0 + 4.0 * self.scale) {
                return None;
            }
            let step = self.newton_step(&path, &chain, &lack)?;
            path.first_towards += step[0];
            path.first += step[1];
            path.straight += step[2];
            path.last_towards += step[3];
            path.last += step[4];
        }
        None
    }

    /// The least change of the five numbers that makes up for a lack: where an arc is nothing, so is the effect of its direction.
    #[inline(never)]
    fn newton_step(&self, path: &Csc, chain: &Chain, lack: &Vector5<f64>) -> Option<Vector5<f64>> {
        let jacobian = self.jacobian(path, chain);
        let mut square = jacobian * jacobian.transpose();
        let damping = square.trace() * 1e-14;
        for index in 0..5 {
            square[(index, index)] += damping;
        }
        Some(jacobian.tr_mul(&Cholesky::new(&square)?.solve(lack)))
    }

    /// Position and direction in the axes across the goal's.
    pub(super) fn column(&self, offset: &Vector3<f64>, turned: &Vector3<f64>) -> Vector5<f64> {
        let [e1, e2] = &self.across;
        Vector5::new(offset.x, offset.y, offset.z, turned.dot(e1), turned.dot(e2))
    }

    /// What a path lacks at its end.
    fn lack(&self, chain: &Chain) -> Vector5<f64> {
        // Opposite to the goal's direction, what lies across it is small too.
        let direction = if chain.direction.dot(&self.direction) > 0.0 { -chain.direction } else { self.across[0] };
        self.column(&(self.goal - chain.end), &direction)
    }

    /// How the end changes with the five numbers.
    fn jacobian(&self, path: &Csc, chain: &Chain) -> Matrix5<f64> {
        let axis = |towards: f64| {
            let (sin, cos) = trigonometry::sin_cos(towards);
            Vector3::new(-sin, cos, 0.0)
        };
        let Chain { first, corner, joint, end, direction } = chain;
        let u = first * Vector3::z();
        let turn = |axis: &Vector3<f64>, about: &Vector3<f64>| {
            self.column(&axis.cross(&(end - about)), &axis.cross(direction))
        };
        let ahead = |direction: &Vector3<f64>| self.column(direction, &Vector3::zeros());
        Matrix5::from_columns(&[
            turn(&Vector3::z(), &Vector3::zeros()),
            turn(&axis(path.first_towards), corner) + ahead(&u),
            ahead(&u),
            turn(&u, joint),
            turn(&(first * axis(path.last_towards)), end) + ahead(direction),
        ])
    }
}

/// A path laid out.
struct Chain {
    /// The axes of the tip after the first arc.
    first: Rotation3<f64>,
    /// Where the first arc ends.
    corner: Vector3<f64>,
    /// Where the last one begins.
    joint: Vector3<f64>,
    /// Where that ends...
    end: Vector3<f64>,
    /// ...and in which direction.
    direction: Vector3<f64>,
}

impl Chain {
    #[inline(never)]
    fn new(path: &Csc) -> Self {
        let first = step(path.first_towards + PI, path.first, path.first);
        let last = step(path.last_towards + PI, path.last, path.last);
        let corner = first.translation.vector;
        let joint = corner + first.rotation * Vector3::z() * path.straight;
        let end = joint + first.rotation * last.translation.vector;
        Self { first: first.rotation, corner, joint, end, direction: first.rotation * (last.rotation * Vector3::z()) }
    }
}
