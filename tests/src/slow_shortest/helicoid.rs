//! Helicoidal arcs (Sussmann 1995): curves of curvature exactly 1 that bend about w = m / |m|, where m = m0 + p x position,
//! with constant vectors m0, perpendicular to the first tangent, and p.
//!
//! Which m0, p and length reach a goal is searched by shooting: from random curves, and from curves that
//! [`super::bent_chain`] has straightened directly, Levenberg and Marquardt's method leads to a curve that arrives, or not.

use nalgebra::{Matrix6, SMatrix, SymmetricEigen, Vector3, Vector6};

use super::bent_chain::{self, Chain};
use super::levenberg;
use super::random::Random;
use super::{Problem, Tip};

/// The error per step that is taken while searching, and in the end, radii.
const ROUGH: f64 = 1e-8;
const FINE: f64 = 1e-13;
/// A curve that needs more steps than this is given up.
const MOST_STEPS: usize = 20_000;

/// A helicoidal arc from the origin along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Helicoid {
    /// What the curve bends about at the start, up to its length; perpendicular to z.
    pub m0: Vector3<f64>,
    /// How that changes with the position.
    pub p: Vector3<f64>,
    /// Arc length, radii.
    pub length: f64,
}

/// (m0 x, m0 y, p x, p y, p z, length).
type Unknowns = Vector6<f64>;

impl Helicoid {
    fn from_unknowns(unknowns: &Unknowns) -> Self {
        let scale = unknowns.fixed_rows::<5>(0).norm();
        Self {
            m0: Vector3::new(unknowns[0], unknowns[1], 0.0) / scale,
            p: Vector3::new(unknowns[2], unknowns[3], unknowns[4]) / scale,
            length: unknowns[5],
        }
    }

    fn to_unknowns(self) -> Unknowns {
        Unknowns::new(self.m0.x, self.m0.y, self.p.x, self.p.y, self.p.z, self.length)
    }

    /// How position and tangent change along the curve.
    fn rate(&self, state: &Vector6<f64>) -> Vector6<f64> {
        let position = Vector3::new(state[0], state[1], state[2]);
        let tangent = Vector3::new(state[3], state[4], state[5]);
        let m = self.m0 + self.p.cross(&position);
        let bend = m.cross(&tangent) / m.norm();
        Vector6::new(tangent.x, tangent.y, tangent.z, bend.x, bend.y, bend.z)
    }

    /// Walks the curve by Dormand and Prince's steps of order 5, each with at most this error; `visit` sees every step.
    fn walk(&self, error: f64, mut visit: impl FnMut(f64, &Vector6<f64>)) -> Option<Vector6<f64>> {
        let mut state = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let mut walked = 0.0;
        let mut step: f64 = 0.01;
        let mut k1 = self.rate(&state);
        for _ in 0..MOST_STEPS {
            if walked >= self.length {
                return Some(state);
            }
            let is_last = step >= self.length - walked;
            let h = if is_last { self.length - walked } else { step };
            let k2 = self.rate(&(state + h * (k1 / 5.0)));
            let k3 = self.rate(&(state + h * (k1 * (3.0 / 40.0) + k2 * (9.0 / 40.0))));
            let k4 = self.rate(&(state + h * (k1 * (44.0 / 45.0) - k2 * (56.0 / 15.0) + k3 * (32.0 / 9.0))));
            let k5 = self.rate(
                &(state
                    + h * (k1 * (19372.0 / 6561.0) - k2 * (25360.0 / 2187.0) + k3 * (64448.0 / 6561.0)
                        - k4 * (212.0 / 729.0))),
            );
            let k6 = self.rate(
                &(state
                    + h * (k1 * (9017.0 / 3168.0) - k2 * (355.0 / 33.0)
                        + k3 * (46732.0 / 5247.0)
                        + k4 * (49.0 / 176.0)
                        - k5 * (5103.0 / 18656.0))),
            );
            let next = state
                + h * (k1 * (35.0 / 384.0) + k3 * (500.0 / 1113.0) + k4 * (125.0 / 192.0) - k5 * (2187.0 / 6784.0)
                    + k6 * (11.0 / 84.0));
            let k7 = self.rate(&next);
            let off = (h
                * (k1 * (71.0 / 57600.0) - k3 * (71.0 / 16695.0) + k4 * (71.0 / 1920.0) - k5 * (17253.0 / 339_200.0)
                    + k6 * (22.0 / 525.0)
                    - k7 / 40.0))
                .norm();
            if off.is_nan() {
                return None;
            }
            if off <= error {
                state = next;
                k1 = k7;
                walked = if is_last { self.length } else { walked + h };
                visit(walked, &state);
            }
            step = (h * (0.9 * libm::pow(error / off.max(1e-30), 0.2)).clamp(0.2, 4.0)).min(0.5);
        }
        None
    }

    /// Where the curve ends, by another method than the search's: the classic Runge-Kutta steps of order 4, halved until
    /// the end stays where it is to 1e-11.
    #[must_use]
    pub fn end(&self) -> Option<Tip> {
        let walk = |steps: u32| {
            let h = self.length / f64::from(steps);
            (0..steps).fold(Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0), |state, _| {
                let k1 = self.rate(&state);
                let k2 = self.rate(&(state + k1 * (h / 2.0)));
                let k3 = self.rate(&(state + k2 * (h / 2.0)));
                let k4 = self.rate(&(state + k3 * h));
                state + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0)
            })
        };
        let mut end = walk(1 << 9);
        for doublings in 10..21 {
            let closer = walk(1 << doublings);
            let moved = (closer - end).norm();
            end = closer;
            if moved < 1e-11 {
                return Some(tip(&end));
            }
        }
        None
    }
}

fn tip(state: &Vector6<f64>) -> Tip {
    Tip { position: Vector3::new(state[0], state[1], state[2]), tangent: Vector3::new(state[3], state[4], state[5]) }
}

fn goal(problem: &Problem) -> Vector6<f64> {
    let Problem { goal, tangent } = problem;
    Vector6::new(goal.x, goal.y, goal.z, tangent.x, tangent.y, tangent.z)
}

/// The curve that arrives, to `tolerance`, nearest to a start; not one longer than `longest`.
fn shoot(problem: &Problem, start: &Helicoid, longest: f64, error: f64, tolerance: f64) -> Option<Helicoid> {
    let goal = goal(problem);
    let residual = |at: &Unknowns| {
        if at[5] <= 0.0 || at[5] > 1.5 * longest {
            return None;
        }
        Some(Helicoid::from_unknowns(at).walk(error, |_, _| {})? - goal)
    };
    let difference = libm::sqrt(error);
    let slopes = |at: &Unknowns, there: &Vector6<f64>| {
        let mut slopes: Matrix6<f64> = levenberg::differences(at, there, difference, residual)?;
        // The slope along the length is known: it is the curve's own direction.
        slopes.set_column(5, &Helicoid::from_unknowns(at).rate(&(there + goal)));
        Some(slopes)
    };
    let found = Helicoid::from_unknowns(&levenberg::solve(start.to_unknowns(), tolerance, residual, slopes)?);
    (found.length <= longest).then_some(found)
}

/// As [`shoot`], first roughly, then finely, then checked by [`Helicoid::end`].
fn arrive(problem: &Problem, start: &Helicoid, longest: f64) -> Option<Helicoid> {
    let rough = shoot(problem, start, longest + 1e-4, ROUGH, 1e-5)?;
    shoot(problem, &rough, longest + 1e-9, FINE, 3e-12)
}

/// The best of so many random curves: the one that passes the goal, in its direction, most closely.
fn random_start(problem: &Problem, longest: f64, among: usize, random: &mut Random) -> Helicoid {
    let goal = goal(problem);
    let mut best = (f64::INFINITY, Helicoid { m0: Vector3::x(), p: Vector3::zeros(), length: longest });
    for _ in 0..among {
        let m0 = random.normal_vector().component_mul(&Vector3::new(1.0, 1.0, 0.0));
        let p = random.normal_vector() * libm::exp(random.normal());
        // What the maximum principle leaves of all curves of this form: |m| + p . tangent, a constant, is not negative.
        let p = if m0.norm() + p.z < 0.0 { -p } else { p };
        let curve = Helicoid { m0, p, length: longest };
        let _ = curve.walk(1e-4, |walked, state| {
            let miss = (state - goal).norm();
            if miss < best.0 && walked > 0.5 * problem.goal.norm() {
                best = (miss, Helicoid { length: walked, ..curve });
            }
        });
    }
    best.1
}

/// The m0 and p that fit best to a chain: those whose m0 + p x position has, in the sum of squares, least across the axes
/// that its arcs bend about.
fn fitted(chain: &Chain) -> Helicoid {
    let mut squares = SMatrix::<f64, 5, 5>::zeros();
    let columns = |position: &Vector3<f64>, axis: &Vector3<f64>| {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let of_p = |unit: &Vector3<f64>| unit.cross(position).cross(axis);
        SMatrix::<f64, 3, 5>::from_columns(&[x.cross(axis), y.cross(axis), of_p(&x), of_p(&y), of_p(&z)])
    };
    for (position, axis) in &chain.arcs {
        let columns = columns(position, axis);
        squares += columns.transpose() * columns;
    }
    let eigen = SymmetricEigen::new(squares);
    let fit = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let m0 = Vector3::new(fit[0], fit[1], 0.0);
    let p = Vector3::new(fit[2], fit[3], fit[4]);
    let along: f64 = chain.arcs.iter().map(|(position, axis)| (m0 + p.cross(position)).dot(axis)).sum();
    let sign = if along < 0.0 { -1.0 } else { 1.0 };
    Helicoid { m0: m0 * sign, p: p * sign, length: chain.length }
}

/// How long to search.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Random shots per round.
    pub shots: usize,
    /// Chains straightened per round.
    pub chains: usize,
    /// Rounds at least.
    pub rounds: usize,
    /// Rounds at most: more than `rounds` only while the best has been found less than `hits` times.
    pub most_rounds: usize,
    /// How often the best has to be found.
    pub hits: usize,
}

/// What a search found.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The shortest curve.
    pub best: Option<Helicoid>,
    /// How many shots from random curves led to it.
    pub by_shots: usize,
    /// How many straightened chains led to it.
    pub by_chains: usize,
    /// Rounds searched.
    pub rounds: usize,
    /// The length of the shortest straightened chain, of whatever kind, radii; infinite if there is none.
    pub least_chain: f64,
}

impl Default for Found {
    fn default() -> Self {
        Self { best: None, by_shots: 0, by_chains: 0, rounds: 0, least_chain: f64::INFINITY }
    }
}

/// The shortest helicoidal arc that a search finds; none longer than `longest`, radii.
pub fn shortest(problem: &Problem, longest: f64, effort: &Effort, random: &mut Random) -> Found {
    let mut found = Found::default();
    let mut refused = Vec::new();
    while found.rounds < effort.rounds
        || (found.rounds < effort.most_rounds && found.best.is_some() && found.by_shots + found.by_chains < effort.hits)
    {
        found.rounds += 1;
        for start in 0..effort.shots + effort.chains {
            let limit = found.best.map_or(longest, |best| best.length);
            let is_shot = start < effort.shots;
            let begin = if is_shot {
                let among = [1, 4, 16][start % 3];
                random_start(problem, limit, among, random)
            } else {
                let Some(chain) = bent_chain::straightened(problem, random) else { continue };
                found.least_chain = found.least_chain.min(chain.length);
                if chain.length > 1.1 * limit {
                    continue;
                }
                fitted(&chain)
            };
            let Some(curve) = arrive(problem, &begin, limit) else { continue };
            if found.best.is_none_or(|best| curve.length < best.length - 1e-9) {
                // Whatever fails the check by the other method is left aside, once.
                if refused.iter().any(|length: &f64| (length - curve.length).abs() < 1e-9) {
                    continue;
                }
                if !curve.end().is_some_and(|end| problem.is_reached_at(&end)) {
                    refused.push(curve.length);
                    continue;
                }
                (found.best, found.by_shots, found.by_chains) = (Some(curve), 0, 0);
            }
            if is_shot {
                found.by_shots += 1;
            } else {
                found.by_chains += 1;
            }
        }
    }
    found
}
