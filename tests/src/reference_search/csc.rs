//! Curves of an arc, a straight line and an arc between two poses, searched from many random starts.
//!
//! The first arc grows forwards from the start, and the last one backwards from the goal. Each is given by a bend
//! vector. It is perpendicular to the tangent, points towards the side to which the arc bends, and is as long as the
//! arc. The unknowns are the two bend vectors (2 + 2) and the length of the line. The residuals are the gap between the
//! line's end and the last arc (3), and the difference of the directions (3, of which 2 are independent).

use core::f64::consts::TAU;

use nalgebra::{SVector, Vector2, Vector3, Vector6};

use super::levenberg;
use super::{Curve, Piece, Problem, Tip, across};
use growbot_core::random::Rng;

type Unknowns = SVector<f64, 5>;

/// Returns the arc of a bend vector, from a tangent whose perpendiculars are `across`.
fn arc(bend: Vector2<f64>, tangent: &Vector3<f64>) -> Piece {
    let (side, other) = across(tangent);
    let angle = bend.norm();
    let towards = if angle > 0.0 { (side * bend.x + other * bend.y) / angle } else { side };
    Piece::Arc { axis: tangent.cross(&towards), angle }
}

fn ends(problem: &Problem, unknowns: &Unknowns) -> (Piece, Piece, Tip, Tip) {
    let first = arc(Vector2::new(unknowns[0], unknowns[1]), &Vector3::z());
    let last = arc(Vector2::new(unknowns[3], unknowns[4]), &-problem.tangent);
    let backwards = Tip { position: problem.goal, tangent: -problem.tangent };
    (first, last, first.walk(&Tip::start()), last.walk(&backwards))
}

fn gap(problem: &Problem, unknowns: &Unknowns) -> Vector6<f64> {
    let (_, _, before, after) = ends(problem, unknowns);
    let across = before.position + before.tangent * unknowns[2] - after.position;
    let turn = before.tangent + after.tangent;
    Vector6::new(across.x, across.y, across.z, turn.x, turn.y, turn.z)
}

/// Curves that the search found.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The shortest curve of an arc, a line and an arc. `None` if none was found.
    pub best: Option<Curve>,
    /// Number of starts that led to the shortest curve.
    pub hits: usize,
    /// Angle of the first arc, length of the line and angle of the last arc, for each solution whose line has a
    /// negative length. Such a solution is not a curve, but if the line is short, a helicoidal arc is close by.
    pub backwards: Vec<[f64; 3]>,
}

/// Searches for curves of an arc, a line and an arc from `starts` random starts.
pub fn search(problem: &Problem, starts: usize, random: &mut Rng) -> Found {
    let mut all = Found::default();
    for _ in 0..starts {
        let mut bend = || {
            let (sin, cos) = libm::sincos(random.uniform_between(0.0, TAU));
            Vector2::new(cos, sin) * random.uniform_between(0.0, TAU)
        };
        let (first, last) = (bend(), bend());
        let line = random.uniform_between(-1.0, problem.goal.norm() + 2.0);
        let start = Unknowns::from([first.x, first.y, line, last.x, last.y]);
        let residual = |at: &Unknowns| Some(gap(problem, at));
        let slopes = |at: &Unknowns, there: &Vector6<f64>| levenberg::differences(at, there, 1e-7, residual);
        let Some(found) = levenberg::solve(start, 1e-13 * (1.0 + problem.goal.norm()), residual, slopes) else {
            continue;
        };
        let (first, last, ..) = ends(problem, &found);
        let (Piece::Arc { axis, angle }, Piece::Arc { axis: back_axis, angle: back_angle }) = (first, last) else {
            continue;
        };
        let (angle, line, back_angle) = (angle % TAU, found[2], back_angle % TAU);
        if line < -1e-12 {
            let extents = [angle, line, back_angle];
            let is_known = |known: &[f64; 3]| known.iter().zip(extents).all(|(a, b)| (a - b).abs() < 1e-6);
            if !all.backwards.iter().any(is_known) {
                all.backwards.push(extents);
            }
            continue;
        }
        let curve = Curve::Pieces(vec![
            Piece::Arc { axis, angle },
            Piece::Line { length: line.max(0.0) },
            Piece::Arc { axis: -back_axis, angle: back_angle },
        ]);
        if !problem.is_reached_by(&curve) {
            continue;
        }
        match &all.best {
            Some(shortest) if (curve.length() - shortest.length()).abs() < 1e-9 => all.hits += 1,
            Some(shortest) if curve.length() > shortest.length() => {}
            _ => (all.best, all.hits) = (Some(curve), 1),
        }
    }
    all
}
