//! The shortest curve of curvature at most 1 in space, from the origin along z to a goal with a direction, found
//! slowly: evidence to test a fast planner against, sharing neither code nor method with it.
//!
//! Lengths are in turning radii, angles in radians. How the tip rolls about its tangent is left free.
//!
//! A shortest curve is an arc, a straight line and an arc (CSC), or a helicoidal arc (H), or, if all lies in one plane,
//! one of Dubins' path types; parts may vanish (H. J. Sussmann, "Shortest 3-dimensional paths with a prescribed
//! curvature bound", Proc. 34th IEEE Conference on Decision and Control, 1995). Each kind is searched from many random
//! starts ([`csc`], [`helicoid`], helped by [`bent_chain`], which knows nothing of kinds) or written down ([`planar`]).
//! Nothing is proven shortest; whatever is returned arrives to [`ARRIVED`] when it is walked.

pub mod bent_chain;
pub mod csc;
pub mod helicoid;
pub mod levenberg;
pub mod planar;
pub mod table;

use nalgebra::Vector3;

use growbot_core::random::Rng;
use helicoid::Helicoid;

/// A curve arrives if it ends within this of the goal, in radii and radians.
pub const ARRIVED: f64 = 1e-9;

/// Where a curve shall end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Problem {
    /// The position, radii.
    pub goal: Vector3<f64>,
    /// The direction there, a unit vector.
    pub tangent: Vector3<f64>,
}

impl Problem {
    /// Whether a curve, when walked, begins at the start and ends at the goal.
    #[must_use]
    pub fn is_reached_by(&self, curve: &Curve) -> bool {
        let goal = Tip { position: self.goal, tangent: self.tangent };
        curve.ends().is_some_and(|(first, last)| first.is_at(&Tip::start()) && last.is_at(&goal))
    }
}

/// A position, radii, and a unit tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tip {
    /// The position, radii.
    pub position: Vector3<f64>,
    /// The direction of growth, a unit vector.
    pub tangent: Vector3<f64>,
}

impl Tip {
    /// The start of every curve: the origin, along z.
    #[must_use]
    pub fn start() -> Self {
        Self { position: Vector3::zeros(), tangent: Vector3::z() }
    }

    /// Whether this is the other, to [`ARRIVED`].
    #[must_use]
    pub fn is_at(&self, other: &Self) -> bool {
        (self.position - other.position).norm() <= ARRIVED && (self.tangent - other.tangent).norm() <= ARRIVED
    }
}

/// A piece of a curve of curvature 1 or 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Piece {
    /// An arc of radius 1.
    Arc {
        /// The unit vector about which the tangent turns; perpendicular to it.
        axis: Vector3<f64>,
        /// By how much, radians.
        angle: f64,
    },
    /// A straight line.
    Line {
        /// Radii.
        length: f64,
    },
}

impl Piece {
    /// Arc length, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        match self {
            Self::Arc { angle, .. } => *angle,
            Self::Line { length } => *length,
        }
    }

    /// Where it leads from a tip.
    #[must_use]
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
    /// Arc length, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        match self {
            Self::Pieces(pieces) => pieces.iter().map(Piece::length).sum(),
            Self::Helicoid(helicoid) => helicoid.length(),
        }
    }

    /// Where it begins and ends when it is walked; nothing if that cannot be told exactly.
    #[must_use]
    pub fn ends(&self) -> Option<(Tip, Tip)> {
        match self {
            Self::Pieces(pieces) => {
                Some((Tip::start(), pieces.iter().fold(Tip::start(), |tip, piece| piece.walk(&tip))))
            }
            Self::Helicoid(helicoid) => helicoid.ends(),
        }
    }
}

/// Two unit vectors perpendicular to a unit vector and to each other.
#[must_use]
pub fn across(unit: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let other = if unit.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let side = unit.cross(&other).normalize();
    (side, unit.cross(&side))
}

/// How long to search.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Random starts for arc, line, arc.
    pub csc_starts: usize,
    /// For helicoidal arcs; nothing where none can be shortest.
    pub helicoid: Option<helicoid::Effort>,
}

/// The shortest curve that was found.
#[derive(Debug, Clone)]
pub struct Best {
    /// The curve.
    pub curve: Curve,
    /// CSC, H, or a path type of Dubins.
    pub path_type: &'static str,
    /// How often arc, line, arc of min length was found, whether or not it is the best of all.
    pub csc_hits: usize,
    /// What the search for helicoidal arcs found, whether or not it is the best of all.
    pub helicoids: helicoid::Found,
}

/// Searches the shortest curve.
///
/// # Panics
/// If nothing at all was found, which more starts for arc, line, arc would mend.
pub fn shortest(problem: &Problem, effort: &Effort, random: &mut Rng) -> Best {
    let csc::Found { best: csc, hits: csc_hits, backwards } = csc::search(problem, effort.csc_starts, random);
    let planar = planar::shortest(problem);
    let mut candidates: Vec<(Curve, &'static str)> = planar.into_iter().collect();
    candidates.extend(csc.map(|curve| (curve, "CSC")));
    let shortest = |candidates: Vec<(Curve, &'static str)>| {
        // Of the same to rounding, the first.
        candidates.into_iter().reduce(|best, next| if next.0.length() < best.0.length() - 1e-9 { next } else { best })
    };
    let Some(best) = shortest(candidates) else { panic!("nothing reaches {problem:?}: more starts are needed") };
    let longest = best.0.length();
    let helicoids = effort.helicoid.map_or_else(helicoid::Found::default, |effort| {
        helicoid::search(problem, longest, &backwards, &effort, random)
    });
    let helicoid = helicoids.best.filter(|curve| curve.length() < longest - 1e-9);
    let (curve, path_type) = helicoid.map_or(best, |curve| (Curve::Helicoid(curve), "H"));
    Best { curve, path_type, csc_hits, helicoids }
}
