//! A slow search of the shortest curve of curvature at most 1 in space, from the origin along z to a goal with a
//! direction. A fast planner is tested against it. The two share neither code nor method.
//!
//! Lengths are in turning radii, angles in radians. The roll of the tip about its tangent is free.
//!
//! A shortest curve is an arc, a straight line and an arc (CSC), or a helicoidal arc (H). If all lies in one plane, it
//! is one of Dubins' path types. Segments may vanish (H. J. Sussmann, "Shortest 3-dimensional paths with a prescribed
//! curvature bound", Proc. 34th IEEE Conference on Decision and Control, 1995). [`csc`] and [`helicoid`] search their
//! kinds from many random starts. [`bent_chain`], which does not depend on kinds, provides starts for [`helicoid`].
//! [`planar`] computes its path types in closed form. Nothing is proven shortest, but each returned curve ends within
//! [`ARRIVED`] of the goal when it is integrated.

pub mod bent_chain;
pub mod csc;
pub mod helicoid;
pub mod levenberg;
pub mod planar;
pub mod table;

use nalgebra::Vector3;

use growbot_core::random::Rng;
use helicoid::Helicoid;

/// Tolerance at the goal, radii and radians.
pub const ARRIVED: f64 = 1e-9;

/// Goal of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Problem {
    /// Position of the goal, radii.
    pub goal: Vector3<f64>,
    /// Direction at the goal, a unit vector.
    pub tangent: Vector3<f64>,
}

impl Problem {
    /// Returns true if an integrated curve begins at the start and ends at the goal.
    pub fn is_reached_by(&self, curve: &Curve) -> bool {
        let goal = Tip { position: self.goal, tangent: self.tangent };
        curve.ends().is_some_and(|(first, last)| first.is_at(&Tip::start()) && last.is_at(&goal))
    }
}

/// A point of a curve: its position and its unit tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tip {
    /// Position, radii.
    pub position: Vector3<f64>,
    /// Direction of growth, a unit vector.
    pub tangent: Vector3<f64>,
}

impl Tip {
    /// Returns the start of every curve: the origin, along z.
    pub fn start() -> Self {
        Self { position: Vector3::zeros(), tangent: Vector3::z() }
    }

    /// Returns true if the tips are equal within [`ARRIVED`].
    pub fn is_at(&self, other: &Self) -> bool {
        (self.position - other.position).norm() <= ARRIVED && (self.tangent - other.tangent).norm() <= ARRIVED
    }
}

/// A segment of a curve, of curvature 1 or 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Piece {
    /// An arc of radius 1.
    Arc {
        /// Unit vector about which the tangent turns. It is perpendicular to the tangent.
        axis: Vector3<f64>,
        /// Angle of the turn, radians.
        angle: f64,
    },
    /// A straight line.
    Line {
        /// Length, radii.
        length: f64,
    },
}

impl Piece {
    /// Returns the arc length, radii.
    pub fn length(&self) -> f64 {
        match self {
            Self::Arc { angle, .. } => *angle,
            Self::Line { length } => *length,
        }
    }

    /// Returns the tip at the end of the segment if it begins at `from`.
    pub fn walk(&self, from: &Tip) -> Tip {
        match self {
            Self::Arc { axis, angle } => {
                let inwards = axis.cross(&from.tangent);
                let (sin, cos) = libm::sincos(*angle);
                Tip {
                    position: from.position + from.tangent * sin + inwards * (1.0 - cos),
                    tangent: from.tangent * cos + inwards * sin,
                }
            }
            Self::Line { length } => Tip { position: from.position + from.tangent * *length, tangent: from.tangent },
        }
    }
}

/// A curve from the origin along z.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// Arcs and straight lines.
    Pieces(Vec<Piece>),
    /// A helicoidal arc.
    Helicoid(Helicoid),
}

impl Curve {
    /// Returns the arc length, radii.
    pub fn length(&self) -> f64 {
        match self {
            Self::Pieces(pieces) => pieces.iter().map(Piece::length).sum(),
            Self::Helicoid(helicoid) => helicoid.length(),
        }
    }

    /// Returns the start and the end of the curve, by integration. `None` if they cannot be computed exactly.
    pub fn ends(&self) -> Option<(Tip, Tip)> {
        match self {
            Self::Pieces(pieces) => {
                Some((Tip::start(), pieces.iter().fold(Tip::start(), |tip, piece| piece.walk(&tip))))
            }
            Self::Helicoid(helicoid) => helicoid.ends(),
        }
    }
}

/// Returns two unit vectors perpendicular to a unit vector and to each other.
pub fn across(unit: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let other = if unit.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let side = unit.cross(&other).normalize();
    (side, unit.cross(&side))
}

/// Limits of a search.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Number of random starts for arc, line, arc.
    pub csc_starts: usize,
    /// Limits of the search for helicoidal arcs. `None` if a helicoidal arc cannot be shortest.
    pub helicoid: Option<helicoid::Effort>,
}

/// Result of a search.
#[derive(Debug, Clone)]
pub struct Best {
    /// The shortest curve.
    pub curve: Curve,
    /// CSC, H, or one of Dubins' path types.
    pub path_type: &'static str,
    /// Number of times that the shortest arc, line, arc was found, even if another kind is shorter.
    pub csc_hits: usize,
    /// Result of the search for helicoidal arcs, even if another kind is shorter.
    pub helicoids: helicoid::Found,
}

/// Searches for the shortest curve to the goal.
///
/// Panics if nothing was found. A greater `csc_starts` corrects this.
pub fn shortest(problem: &Problem, effort: &Effort, random: &mut Rng) -> Best {
    let csc::Found { best: csc, hits: csc_hits, backwards } = csc::search(problem, effort.csc_starts, random);
    let planar = planar::shortest(problem);
    let mut candidates: Vec<(Curve, &'static str)> = planar.into_iter().collect();
    candidates.extend(csc.map(|curve| (curve, "CSC")));
    let shortest = |candidates: Vec<(Curve, &'static str)>| {
        // Of curves that are equal to rounding, the first is taken.
        candidates.into_iter().reduce(|best, next| if next.0.length() < best.0.length() - 1e-9 { next } else { best })
    };
    let Some(best) = shortest(candidates) else {
        panic!("no path of the reference search reaches {problem:?}: give it more starting points")
    };
    let longest = best.0.length();
    let helicoids = effort.helicoid.map_or_else(helicoid::Found::default, |effort| {
        helicoid::search(problem, longest, &backwards, &effort, random)
    });
    let helicoid = helicoids.best.filter(|curve| curve.length() < longest - 1e-9);
    let (curve, path_type) = helicoid.map_or(best, |curve| (Curve::Helicoid(curve), "H"));
    Best { curve, path_type, csc_hits, helicoids }
}
