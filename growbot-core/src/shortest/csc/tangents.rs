//! The paths that belong to a root of the polynomial: tangents from the first corner to the circles that end in the
//! goal.

use core::f64::consts::TAU;

use nalgebra::Vector3;

use super::isolation::{Part, Root, TauRange};
use super::polynomial::CscPolynomial;
use super::{CscLine, CscSearch, MAX_NEWTON_START_ERROR, MAX_OVERLAP, NEAR, cosine};

/// Max residual of a branch that counts as a path at a root that the polynomial certainly has.
const FITS: f64 = 1e-6;
/// Max residual of a branch that counts as a path at a root that rounding leaves open.
const MAY_FIT: f64 = 1e-2;
/// Max ratio of a branch's residual to that of the best branch at the same root. Within this ratio the branch counts as
/// a path in any case.
const NEARLY_BEST: f64 = 4.0;
/// Max amount by which rounding may make the squared length of a tangent negative (radii squared), if the corner is
/// close to the circle.
const INSIDE: f64 = 1e-4;

/// One of the four tangents from the corner of the first arc to the two circles that end in the goal.
#[derive(Clone, Copy)]
struct Branch {
    /// True if the centre of the circle is on the same side of the line along the goal's direction as the corner
    /// ([`Corner::across`]). False if it is on the opposite side.
    towards: bool,
    /// True if the path follows the tangent forwards, false if backwards.
    forwards: bool,
}

const BRANCHES: [Branch; 4] = [
    Branch { towards: true, forwards: true },
    Branch { towards: true, forwards: false },
    Branch { towards: false, forwards: true },
    Branch { towards: false, forwards: false },
];

/// Returns the number if `positive`, and its negative otherwise. A multiplication by 1 or -1 would be slow on the
/// microcontroller.
fn signed(positive: bool, number: f64) -> f64 {
    if positive { number } else { -number }
}

/// Values that are common to the four branches at one corner. The corner is the point in which the tangents at both
/// ends of the first arc meet.
struct Corner {
    /// Component of the vector from the corner to the goal along the goal's direction, radii.
    along: f64,
    /// Distance of the corner from the line along the goal's direction, radii.
    distance: f64,
    /// Unit vector from the line along the goal's direction to the corner, perpendicular to the line.
    across: Vector3<f64>,
}

/// One of the two circles that end in the goal, with values that are common to both tangents from the corner to it.
#[derive(Clone, Copy)]
struct Circle {
    towards: bool,
    /// Position of the centre relative to the corner, radii: `x` along the goal's direction, `y` along
    /// [`Corner::across`].
    x: f64,
    y: f64,
    /// Length of the tangents from the corner to the circle, radii.
    length: f64,
    /// Inverse square of the distance from the corner to the centre.
    scale: f64,
}

impl Circle {
    /// Creates a circle. `None` if the corner is within the circle, because then there are no tangents.
    fn new(corner: &Corner, towards: bool) -> Option<Self> {
        let (x, y) = (corner.along, signed(towards, 1.0) - corner.distance);
        let squared = x * x + y * y - 1.0;
        if squared < -INSIDE {
            return None;
        }
        let squared = squared.max(0.0);
        Some(Self { towards, x, y, length: libm::sqrt(squared), scale: 1.0 / (squared + 1.0) })
    }

    /// Returns the components of a tangent's direction along the goal's direction and along [`Corner::across`], and the
    /// tangent's signed length (radii).
    fn line(&self, forwards: bool) -> (f64, f64, f64) {
        let &Self { towards, x, y, scale, .. } = self;
        let length = signed(forwards, self.length);
        // The centre is a radius to the side of the line: centre = length u + side left(u).
        ((x * length + signed(towards, y)) * scale, (y * length - signed(towards, x)) * scale, length)
    }
}

impl CscSearch<'_> {
    fn corner(&self, tau: f64) -> Corner {
        let to_goal = self.problem.goal - Vector3::z() * tau;
        let along = to_goal.dot(&self.problem.direction);
        let off = self.problem.direction * along - to_goal;
        let distance = off.norm();
        Corner { along, distance, across: off / distance.max(f64::MIN_POSITIVE) }
    }

    /// Returns the residual of a branch, `h / (1 + tau^2) = f - cos(a)`, where `h` and `f` are those of the module
    /// `csc`. The division by `1 + tau^2` keeps the value finite and the roots unchanged.
    fn misfit_at(&self, corner: &Corner, circle: &Circle, forwards: bool, cosine: f64) -> f64 {
        let (cos, sin, _) = circle.line(forwards);
        cos * self.problem.direction.z + sin * corner.across.z - cosine
    }

    /// Finds the roots of the polynomial, and inserts the paths that belong to them.
    #[inline(never)]
    pub(super) fn roots(&mut self, keep_alive: &mut dyn FnMut()) {
        let form = CscPolynomial::of(&self.problem.goal, &self.problem.direction);
        for range in TauRange::ALL {
            keep_alive();
            let part = Part::of(&form, range);
            part.roots(&mut |root| self.tangents(range.tau(root.x), root));
        }
    }

    /// Inserts the paths that belong to one root of the polynomial.
    fn tangents(&mut self, tau: f64, root: Root) {
        let (corner, cosine) = (self.corner(tau), cosine(tau));
        let circles = [true, false].map(|towards| Circle::new(&corner, towards));
        let misfits = BRANCHES.map(|branch| {
            let [towards, away] = &circles;
            let circle = if branch.towards { towards } else { away };
            circle.as_ref().map(|circle| self.misfit_at(&corner, circle, branch.forwards, cosine).abs())
        });
        let best = misfits.iter().flatten().fold(f64::INFINITY, |best, misfit| best.min(*misfit));
        let fits = if root.certain { FITS } else { MAY_FIT };
        let max = (fits * (1.0 + tau.abs()) / (1.0 + tau * tau)).max(NEARLY_BEST * best);
        for (branch, misfit) in BRANCHES.into_iter().zip(misfits) {
            if misfit.is_some_and(|misfit| misfit <= max) {
                self.consider(branch, tau);
            }
        }
    }

    /// Inserts the path of one branch at a root. A path whose line is too short is dropped, and a path whose arcs
    /// overlap is also inserted into the list of overlapping paths.
    fn consider(&mut self, branch: Branch, tau: f64) {
        let corner = self.corner(tau);
        let Some(circle) = Circle::new(&corner, branch.towards) else { return };
        let (cos, sin, length) = circle.line(branch.forwards);
        let straight = length - tau;
        if straight < -MAX_OVERLAP {
            return;
        }
        let across = corner.across;
        let u = self.problem.direction * cos + across * sin;
        // The angle from the line's direction to the goal's, in the direction of the circle's centre.
        let turned = libm::atan2(signed(branch.towards, -sin), cos);
        let towards = across * cos - self.problem.direction * sin;
        let towards = if branch.towards { towards } else { -towards };
        let last_angle = if turned < 0.0 { turned + TAU } else { turned };
        let line = CscLine { u, tau, straight, towards, last_angle };
        let path = line.path();
        let is_overlapping = straight < 0.0 && self.problem.goal.norm() < NEAR;
        if is_overlapping && !self.overlapping.iter().any(|other| other.is(&path)) {
            // The list cannot be full, because there are at most seven.
            let _ = self.overlapping.push(path);
        }
        if straight > -MAX_NEWTON_START_ERROR {
            self.keep(path);
            // Because of rounding, an arc of nearly a whole turn may in truth have an angle of nearly 0.
            if turned < 0.0 && turned > -MAX_NEWTON_START_ERROR {
                self.keep(CscLine { last_angle: -turned, ..line }.path());
            }
        }
    }
}
