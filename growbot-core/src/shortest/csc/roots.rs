//! The general paths: the roots of `h`, bracketed by probes and refined.

use core::f64::consts::TAU;

use nalgebra::Vector3;

use super::{Csc, MAX_OVERLAP, NEAR, NEARLY, Search, cosine, in_tip};
use crate::shortest::axes_after;

/// Probes in each half of the range of the first arc's angle...
const PROBES_FAR: u32 = 36;
/// ...and for goals nearer than [`NEAR`], where the roots are close to each other.
const PROBES_NEAR: u32 = 256;

/// A tangent from the corner to the goal's circles.
#[derive(Clone, Copy)]
struct Branch {
    /// The circle's centre lies towards `across` from the line along the goal's direction, else away from it.
    towards: bool,
    /// The path follows the tangent forwards, else backwards.
    forwards: bool,
}

const BRANCHES: [Branch; 4] = [
    Branch { towards: true, forwards: true },
    Branch { towards: true, forwards: false },
    Branch { towards: false, forwards: true },
    Branch { towards: false, forwards: false },
];

/// A number or its negative. A multiplication by 1 or -1 would be slow on the microcontroller.
fn signed(positive: bool, number: f64) -> f64 {
    if positive { number } else { -number }
}

/// A probe: the place in the range, and `h / (1 + tau^2)` there.
type Probe = (f64, f64);

/// `tau` of a number `q` in (-1, 1). It is 0 at 0 and infinite at both ends, where the first arc is half a turn. Even
/// steps of `q` give angles that are dense near half a turn.
fn tau_of(q: f64) -> f64 {
    let left = (1.0 - q.abs()) * (1.0 - q.abs());
    let tau = (1.0 - left) / left.max(1e-6);
    if q < 0.0 { -tau } else { tau }
}

/// What the four branches at one corner have in common.
struct Corner {
    /// Component along the goal's direction of the way from the corner to the goal.
    along: f64,
    /// Distance of the corner from the line along the goal's direction.
    distance: f64,
    /// Unit vector from that line to the corner.
    across: Vector3<f64>,
}

/// One of the goal's circles, and what both tangents from the corner to it have in common.
#[derive(Clone, Copy)]
struct Circle {
    towards: bool,
    /// The centre relative to the corner, in the axes (direction, across).
    x: f64,
    y: f64,
    /// Length of the tangents from the corner to the circle.
    length: f64,
    /// Inverse square of the distance from the corner to the centre.
    scale: f64,
}

impl Circle {
    /// None if the corner lies within the circle: then there are no tangents.
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
    pub(super) fn half(&mut self, sign: f64, keep_alive: &mut dyn FnMut()) {
        let mut last: [[Option<Probe>; 2]; 4] = [[None; 2]; 4];
        let probes = if self.problem.goal.norm() < NEAR { PROBES_NEAR } else { PROBES_FAR };
        for probe in 0..=probes {
            keep_alive();
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

    /// Refines a root and keeps its path, if `h` has different signs at two places.
    fn bracket(&mut self, branch: Branch, a: Probe, b: Probe) {
        if (a.1 <= 0.0) != (b.1 <= 0.0) {
            let q = self.refine(branch, a, b);
            self.consider(branch, q);
        }
    }

    /// Looks for a root between a place where the branch exists and one where it does not.
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

    /// Looks for the min of `|h|` between three probes of one sign. If the sign changes there, it has a root on each
    /// side.
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

    /// The root between two places where `h` has different signs: regula falsi (Illinois), with bisections in between.
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

    /// Keeps the path of a root, if its line is not too short.
    fn consider(&mut self, branch: Branch, q: f64) {
        let tau = tau_of(q);
        let corner = self.corner(tau);
        let Some(circle) = Circle::new(&corner, branch.towards) else { return };
        let (cos, sin, length) = circle.line(branch.forwards);
        let straight = length - tau;
        if straight < -MAX_OVERLAP {
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
        // The first arc bends towards the line, or away from it if it is more than half a turn.
        let (x, y) = if tau < 0.0 { (-u.x, -u.y) } else { (u.x, u.y) };
        let first_towards = libm::atan2(y, x);
        let last_towards = in_tip(&axes_after(first_towards, first), &towards);
        let path = Csc { first_towards, first, straight, last_towards, last };
        if straight < 0.0 && self.problem.goal.norm() < NEAR {
            // The list has room for all: there are at most seven.
            let _ = self.overlapping.push(path);
        }
        if straight > -NEARLY {
            self.keep(path);
        }
    }
}
