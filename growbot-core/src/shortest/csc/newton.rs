//! Newton's method on the five numbers of a path.

use core::f64::consts::PI;

use nalgebra::{Matrix5, Rotation3, Vector3, Vector5};

use super::{Csc, NEARLY};
use crate::kinematics::step;
use crate::linalg5::Cholesky;
use crate::shortest::{ARRIVED, Problem};
use crate::trigonometry;

/// Max steps.
const MAX_ROUNDS: u32 = 8;
/// A length may be below 0 by this much from rounding.
const ROUNDING: f64 = 1e-9;

impl Problem {
    /// A path that ends at the goal to within [`ARRIVED`], after Newton's method if necessary. None if it does not
    /// converge.
    pub(super) fn polished(&self, mut path: Csc) -> Option<Csc> {
        for _ in 0..MAX_ROUNDS {
            let chain = Chain::new(&path);
            let lack = self.lack(&chain);
            let miss = lack.amax();
            if miss <= ARRIVED * self.scale {
                let min = path.first.min(path.straight).min(path.last);
                if min >= 0.0 {
                    return Some(path);
                }
                if min < -ROUNDING {
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

    /// The smallest change of the five numbers that makes up for what is missing. The matrix is singular where an arc
    /// has no length: its direction then has no effect.
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

    /// An offset, and a change of direction in the two axes across the goal's direction.
    pub(in crate::shortest) fn column(&self, offset: &Vector3<f64>, turned: &Vector3<f64>) -> Vector5<f64> {
        let [e1, e2] = &self.across;
        Vector5::new(offset.x, offset.y, offset.z, turned.dot(e1), turned.dot(e2))
    }

    /// What is missing to the goal at the end of a path.
    fn lack(&self, chain: &Chain) -> Vector5<f64> {
        // For a direction opposite to the goal's the components across it would be small too.
        let direction = if chain.direction.dot(&self.direction) > 0.0 { -chain.direction } else { self.across[0] };
        self.column(&(self.goal - chain.end), &direction)
    }

    /// Derivatives of the end with respect to the five numbers.
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

/// The joints of a path.
struct Chain {
    /// The axes of the tip after the first arc.
    first: Rotation3<f64>,
    /// Where the first arc ends.
    corner: Vector3<f64>,
    /// Where the last arc begins.
    joint: Vector3<f64>,
    /// Where the path ends...
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
