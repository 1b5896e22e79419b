//! Helicoidal arcs (Sussmann 1995). They are curves of curvature exactly 1 that bend about w = m / |m|, where m = m0 +
//! p x position. The vectors m0 and p are constant, and m0 is perpendicular to the first tangent.
//!
//! Arcs to a goal are searched by shooting: Levenberg and Marquardt's method leads a start to a curve that arrives, or
//! fails. The starts are random curves, curves that [`super::bent_chain`] has shortened directly, and curves near an
//! arc, a line and an arc. The line of these has a small negative length.

use core::f64::consts::PI;

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, SymmetricEigen, Vector3, Vector4, Vector5, Vector6};

use super::bent_chain::{self, Chain};
use super::levenberg;
use super::{Curve, Problem, Tip};
use growbot_core::random::Rng;

/// Tolerances of a search.
struct Precision {
    /// Max error per step of an integration, radii.
    error: f64,
    /// Difference in a parameter for numerical derivatives.
    difference: f64,
    /// Tolerance at the goal, radii and radians.
    arrived: f64,
}

const ROUGH: Precision = Precision { error: 1e-8, difference: 1e-4, arrived: 1e-5 };
const FINE: Precision = Precision { error: 1e-14, difference: 1e-6, arrived: 1e-11 };
/// Max absolute value of a line's negative length for which helicoidal arcs near it are searched, radii.
const LONGEST_LINE: f64 = 1.0;
/// Difference of lengths, radii. A chain that is shorter than the best curve by more than this shows that a better
/// curve exists. The margin is needed because chains do not end exactly at the goal.
pub const BEATEN: f64 = 2e-4;
/// Max number of steps of an integration.
const MAX_STEPS: usize = 20_000;

/// A helicoidal arc from the origin along z, given by its state at one of its points, the anchor. If m is very short,
/// the curve is only accurate if it is integrated from there to both sides. An integration from the start would magnify
/// rounding errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Helicoid {
    /// Position of the anchor, and the tangent there.
    pub anchor: Tip,
    /// The vector m at the anchor. It is perpendicular to the tangent, and the curve bends about it there.
    pub m: Vector3<f64>,
    /// The constant vector p: m changes by p x displacement along the curve.
    pub p: Vector3<f64>,
    /// Arc length from the start to the anchor, radii.
    pub before: f64,
    /// Arc length from the anchor to the end, radii.
    pub after: f64,
}

/// State of an integration: position and tangent.
type State = Vector6<f64>;

fn tip(state: &State) -> Tip {
    Tip { position: Vector3::new(state[0], state[1], state[2]), tangent: Vector3::new(state[3], state[4], state[5]) }
}

fn state(tip: &Tip) -> State {
    let Tip { position, tangent } = tip;
    State::new(position.x, position.y, position.z, tangent.x, tangent.y, tangent.z)
}

/// Returns the derivative of position and tangent along the curve with this m0 and p.
fn rate(m0: &Vector3<f64>, p: &Vector3<f64>, at: &State) -> State {
    let Tip { position, tangent } = tip(at);
    let m = m0 + p.cross(&position);
    state(&Tip { position: tangent, tangent: m.cross(&tangent) / m.norm() })
}

/// Integrates a curve by Dormand and Prince's steps of order 5, each with at most this error. A negative length
/// integrates backwards.
fn walk(m0: &Vector3<f64>, p: &Vector3<f64>, from: State, length: f64, error: f64) -> Option<State> {
    let rate = |state: &State| rate(m0, p, state);
    let mut state = from;
    let mut left = length;
    let mut step: f64 = 0.01;
    let mut k1 = rate(&state);
    for _ in 0..MAX_STEPS {
        if left == 0.0 {
            return Some(state);
        }
        let is_last = step >= left.abs();
        let h = if is_last { left } else { step.copysign(left) };
        let k2 = rate(&(state + h * (k1 / 5.0)));
        let k3 = rate(&(state + h * (k1 * (3.0 / 40.0) + k2 * (9.0 / 40.0))));
        let k4 = rate(&(state + h * (k1 * (44.0 / 45.0) - k2 * (56.0 / 15.0) + k3 * (32.0 / 9.0))));
        let k5 = rate(
            &(state
                + h * (k1 * (19372.0 / 6561.0) - k2 * (25360.0 / 2187.0) + k3 * (64448.0 / 6561.0)
                    - k4 * (212.0 / 729.0))),
        );
        let k6 = rate(
            &(state
                + h * (k1 * (9017.0 / 3168.0) - k2 * (355.0 / 33.0) + k3 * (46732.0 / 5247.0) + k4 * (49.0 / 176.0)
                    - k5 * (5103.0 / 18656.0))),
        );
        let next = state
            + h * (k1 * (35.0 / 384.0) + k3 * (500.0 / 1113.0) + k4 * (125.0 / 192.0) - k5 * (2187.0 / 6784.0)
                + k6 * (11.0 / 84.0));
        let k7 = rate(&next);
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
            left = if is_last { 0.0 } else { left - h };
        }
        step = (h.abs() * (0.9 * libm::pow(error / off.max(1e-30), 0.2)).clamp(0.2, 4.0)).min(0.5);
    }
    None
}

/// Unknowns of a search for a helicoidal arc: m0 x, m0 y, p x, p y, p z, and the length.
type Unknowns = Vector6<f64>;

impl Helicoid {
    fn from_unknowns(unknowns: &Unknowns) -> Self {
        let scale = unknowns.fixed_rows::<5>(0).norm();
        Self {
            anchor: Tip::start(),
            m: Vector3::new(unknowns[0], unknowns[1], 0.0) / scale,
            p: Vector3::new(unknowns[2], unknowns[3], unknowns[4]) / scale,
            before: 0.0,
            after: unknowns[5],
        }
    }

    fn to_unknowns(self) -> Unknowns {
        let m = self.m - self.p.cross(&self.anchor.position);
        Unknowns::new(m.x, m.y, self.p.x, self.p.y, self.p.z, self.length())
    }

    /// Returns the arc length, radii.
    pub fn length(&self) -> f64 {
        self.before + self.after
    }

    /// Returns the start and the end of the curve, integrated from its anchor. `None` if the integration fails.
    pub fn ends(&self) -> Option<(Tip, Tip)> {
        Some((self.walk(-self.before)?, self.walk(self.after)?))
    }

    /// Integrates from the anchor by another method than the search: classic Runge-Kutta steps of order 4. Each step is
    /// as long as two steps of half its length confirm to 1e-14.
    fn walk(&self, length: f64) -> Option<Tip> {
        let rate = |at: &State| rate(&self.m, &self.p, at);
        let step = |state: &State, h: f64| {
            let k1 = rate(state);
            let k2 = rate(&(state + k1 * (h / 2.0)));
            let k3 = rate(&(state + k2 * (h / 2.0)));
            let k4 = rate(&(state + k3 * h));
            state + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0)
        };
        // Positions are relative to the anchor.
        let mut state = state(&Tip { position: Vector3::zeros(), tangent: self.anchor.tangent });
        let mut left = length;
        let mut h: f64 = 1e-3;
        for _ in 0..1_000_000 {
            if left == 0.0 {
                let Tip { position, tangent } = tip(&state);
                return Some(Tip { position: self.anchor.position + position, tangent });
            }
            let is_last = h >= left.abs();
            let length = if is_last { left } else { h.copysign(left) };
            let halves = step(&step(&state, length / 2.0), length / 2.0);
            let off = (halves - step(&state, length)).norm() / 15.0;
            if off.is_nan() {
                return None;
            }
            if off <= 1e-14 {
                state = halves;
                left = if is_last { 0.0 } else { left - length };
                h = length.abs() * 1.3;
            } else {
                h = length.abs() / 2.0;
            }
        }
        None
    }
}

/// Searches from a start for a helicoidal arc that leads from the origin along z to the goal. `None` if the search
/// fails or the curve is longer than `longest`.
fn shoot(problem: &Problem, start: &Helicoid, longest: f64, precision: &Precision) -> Option<Helicoid> {
    let goal = state(&Tip { position: problem.goal, tangent: problem.tangent });
    let residual = |at: &Unknowns| {
        if at[5] <= 0.0 || at[5] > 1.5 * longest {
            return None;
        }
        let curve = Helicoid::from_unknowns(at);
        Some(walk(&curve.m, &curve.p, state(&Tip::start()), curve.after, precision.error)? - goal)
    };
    let slopes = |at: &Unknowns, there: &State| {
        let mut slopes: Matrix6<f64> = levenberg::differences(at, there, precision.difference, residual)?;
        // The slope along the length is known: it is the curve's own direction.
        let curve = Helicoid::from_unknowns(at);
        slopes.set_column(5, &rate(&curve.m, &curve.p, &(there + goal)));
        Some(slopes)
    };
    let found = Helicoid::from_unknowns(&levenberg::solve(start.to_unknowns(), precision.arrived, residual, slopes)?);
    (found.length() <= longest).then_some(found)
}

/// Like [`shoot`], but searches first with rough and then with fine tolerances.
fn arrive(problem: &Problem, start: &Helicoid, longest: f64) -> Option<Helicoid> {
    let rough = shoot(problem, start, longest + 1e-4, &ROUGH)?;
    shoot(problem, &rough, longest + 1e-9, &FINE)
}

/// A helicoidal arc described from its narrow point, where m is shortest. This point may lie outside of the arc. With
/// unit vectors t along the tangent and a along m, m = size a and p = cos psi t + sin psi a at this point. If m is
/// short, the curve turns from one circle to the other within about the square root of `size`. This holds for any
/// `skew` = psi / sqrt(size / (1 + size)).
///
/// A goal pose has as many degrees of freedom as these four numbers, apart from the arc's placement in space.
#[derive(Debug, Clone, Copy)]
struct Narrow {
    log_size: f64,
    skew: f64,
    /// Arc length from the start to the narrow point. `before` and `after` may be negative.
    before: f64,
    after: f64,
}

impl Narrow {
    fn from_unknowns(unknowns: &Vector4<f64>) -> Self {
        Self { log_size: unknowns[0], skew: unknowns[1], before: unknowns[2], after: unknowns[3] }
    }

    fn to_unknowns(self) -> Vector4<f64> {
        Vector4::new(self.log_size, self.skew, self.before, self.after)
    }

    /// Returns m and p at the narrow point, which is the origin, with t = z and a = x.
    fn m_and_p(&self) -> (Vector3<f64>, Vector3<f64>) {
        let size = libm::exp(self.log_size);
        let (sin, cos) = libm::sincos(self.skew * libm::sqrt(size / (1.0 + size)));
        (Vector3::new(size, 0.0, 0.0), Vector3::new(sin, 0.0, cos))
    }

    /// Returns the tips at the start and at the end of the arc, relative to the narrow point. `None` if the
    /// integration fails.
    fn ends(&self, error: f64) -> Option<(Tip, Tip)> {
        let (m, p) = self.m_and_p();
        let narrow = state(&Tip::start());
        Some((tip(&walk(&m, &p, narrow, -self.before, error)?), tip(&walk(&m, &p, narrow, self.after, error)?)))
    }

    /// Places the arc so that it begins at the origin along z and ends as near to the goal as possible.
    fn placed(&self, problem: &Problem, error: f64) -> Option<Helicoid> {
        let (start, end) = self.ends(error)?;
        let turn = turn_onto(&vectors(&start, &end), &goal_vectors(problem))?;
        let (m, p) = self.m_and_p();
        let anchor = Tip { position: -(turn * start.position), tangent: turn * Vector3::z() };
        Some(Helicoid { anchor, m: turn * m, p: turn * p, before: self.before, after: self.after })
    }

    /// Returns a random arc with a length between the distance to the goal and `longest`.
    fn random(problem: &Problem, longest: f64, random: &mut Rng) -> Self {
        let log_size = random.uniform_between(libm::log(1e-8), libm::log(5.0));
        let size = libm::exp(log_size);
        // Half of the arcs have any psi. The other half turn from one circle to another at their narrow point.
        let psi = random.uniform_between(-PI, PI);
        let skew = if random.uniform() < 0.5 && libm::cos(psi) + size > 0.0 {
            psi / libm::sqrt(size / (1.0 + size))
        } else {
            random.normal() * libm::exp(random.uniform_between(-1.0, 2.0))
        };
        let length = random.uniform_between(problem.goal.norm().min(longest), longest);
        let before = length * random.uniform_between(-0.1, 1.1);
        Self { log_size, skew, before, after: length - before }
    }

    /// Returns a random helicoidal arc near a curve of an arc, a line and an arc whose line has a short negative
    /// length.
    fn near([first, line, last]: &[f64; 3], random: &mut Rng) -> Self {
        Self {
            log_size: 2.0 * libm::log(-line) + random.uniform_between(-4.0, 4.0),
            skew: random.normal() * libm::exp(random.uniform_between(-1.0, 2.0)),
            before: first + line / 2.0,
            after: last + line / 2.0,
        }
    }

    /// Returns the closest arc that reaches the goal, compared by its shape. This is fast, but inexact if the shape
    /// hardly distinguishes poses, as for tips in one plane.
    fn shoot_shape(&self, problem: &Problem, longest: f64) -> Option<Self> {
        let goal = shape(&goal_vectors(problem));
        let residual = |at: &Vector4<f64>| {
            let (start, end) = Self::admitted(at, longest)?.ends(ROUGH.error)?;
            Some(shape(&vectors(&start, &end)) - goal)
        };
        let slopes =
            |at: &Vector4<f64>, there: &Vector5<f64>| levenberg::differences(at, there, ROUGH.difference, residual);
        let found = levenberg::solve(self.to_unknowns(), ROUGH.arrived, residual, slopes)?;
        Some(Self::from_unknowns(&found)).filter(|found| found.before + found.after <= longest)
    }

    /// Returns the closest arc that reaches the goal when it is placed by least squares.
    fn shoot_placed(&self, problem: &Problem, longest: f64) -> Option<Self> {
        let goal = goal_vectors(problem);
        let residual = |at: &Vector4<f64>| {
            let (start, end) = Self::admitted(at, longest)?.ends(FINE.error)?;
            let here = vectors(&start, &end);
            let off = turn_onto(&here, &goal)? * here - goal;
            Some(SVector::<f64, 9>::from_column_slice(off.as_slice()))
        };
        let slopes =
            |at: &Vector4<f64>, there: &SVector<f64, 9>| levenberg::differences(at, there, FINE.difference, residual);
        let found = levenberg::solve(self.to_unknowns(), FINE.arrived, residual, slopes)?;
        Some(Self::from_unknowns(&found)).filter(|found| found.before + found.after <= longest)
    }

    /// Returns the arc of these unknowns. `None` if they are out of the range that can be integrated.
    fn admitted(unknowns: &Vector4<f64>, longest: f64) -> Option<Self> {
        let narrow = Self::from_unknowns(unknowns);
        let is_admitted = (-40.0..5.0).contains(&narrow.log_size)
            && (0.0..1.5 * longest).contains(&(narrow.before + narrow.after))
            && narrow.before.abs() < 20.0;
        is_admitted.then_some(narrow)
    }

    /// Returns a helicoidal arc to the goal, searched from this arc: first by the shape, then exactly. `None` if the
    /// search fails.
    fn arrive(&self, problem: &Problem, longest: f64) -> Option<Helicoid> {
        let rough = self.shoot_shape(problem, longest + 1e-4)?;
        rough.shoot_placed(problem, longest + 1e-9)?.placed(problem, FINE.error)
    }
}

/// Returns the vectors that describe the relative pose of two tips: the first tangent, the displacement and the last
/// tangent.
fn vectors(start: &Tip, end: &Tip) -> Matrix3<f64> {
    Matrix3::from_columns(&[start.tangent, end.position - start.position, end.tangent])
}

fn goal_vectors(problem: &Problem) -> Matrix3<f64> {
    vectors(&Tip::start(), &Tip { position: problem.goal, tangent: problem.tangent })
}

/// Returns the rotation that maps three vectors onto three others by least squares (Kabsch 1976).
fn turn_onto(from: &Matrix3<f64>, to: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let parts = (to * from.transpose()).svd(true, true);
    let (u, v) = (parts.u?, parts.v_t?);
    let handed = Vector3::new(1.0, 1.0, (u * v).determinant().signum());
    Some(u * Matrix3::from_diagonal(&handed) * v)
}

/// Returns the invariants of the three vectors under rotation.
fn shape(vectors: &Matrix3<f64>) -> Vector5<f64> {
    let [start, across, end] = [0, 1, 2].map(|index| vectors.column(index));
    Vector5::new(across.norm(), across.dot(&start), across.dot(&end), start.dot(&end), vectors.determinant())
}

/// Returns the best of `among` random arcs: the one whose shape is closest to that of start and goal.
fn random_start(problem: &Problem, longest: f64, among: usize, random: &mut Rng) -> Narrow {
    let goal = shape(&goal_vectors(problem));
    let mut best = (f64::INFINITY, Narrow::random(problem, longest, random));
    for _ in 0..among {
        let arc = Narrow::random(problem, longest, random);
        if let Some((start, end)) = arc.ends(1e-4) {
            let miss = (shape(&vectors(&start, &end)) - goal).norm();
            if miss < best.0 {
                best = (miss, arc);
            }
        }
    }
    best.1
}

/// Returns the helicoidal arc whose m0 and p fit a chain best. It minimizes the sum of squares of the component of m0 +
/// p x position across the axes that the chain's arcs bend about.
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
    Helicoid { anchor: Tip::start(), m: m0 * sign, p: p * sign, before: 0.0, after: chain.length }
}

/// Limits of a search.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Random shots per round.
    pub shots: usize,
    /// Shots per round near each arc, line, arc whose line has a negative length.
    pub lines: usize,
    /// Chains shortened per round.
    pub chains: usize,
    /// Min number of rounds.
    pub rounds: usize,
    /// Max number of rounds. There are more than `rounds` only if the best has been found fewer than `hits` times, or
    /// if a chain is shorter.
    pub max_rounds: usize,
    /// Min number of times that the best has to be found.
    pub hits: usize,
}

/// Result of a search.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The shortest curve. `None` if none was found.
    pub best: Option<Helicoid>,
    /// Number of shots from random curves that led to the shortest curve.
    pub by_shots: usize,
    /// Number of starts near an arc, a line and an arc with a line of negative length that led to the shortest curve.
    pub by_lines: usize,
    /// Number of shortened chains that led to the shortest curve.
    pub by_chains: usize,
    /// Number of rounds that were searched.
    pub rounds: usize,
    /// Number of curves that were rejected because integrating them by the other method did not confirm that they
    /// arrive.
    pub refused: usize,
    /// Length of the shortest chain of any kind, radii. It is infinite without a chain.
    pub min_chain: f64,
}

impl Default for Found {
    fn default() -> Self {
        Self { best: None, by_shots: 0, by_lines: 0, by_chains: 0, rounds: 0, refused: 0, min_chain: f64::INFINITY }
    }
}

impl Found {
    fn hits(&self) -> usize {
        self.by_shots + self.by_lines + self.by_chains
    }
}

/// Kind of start from which a curve was found.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Shot,
    Line([f64; 3]),
    Chain,
}

/// Searches the shortest helicoidal arc with a length of at most `longest`, radii. `backwards` are the solutions of
/// [`super::csc::search`] whose line has a negative length.
pub fn search(problem: &Problem, longest: f64, backwards: &[[f64; 3]], effort: &Effort, random: &mut Rng) -> Found {
    let mut ways = vec![Way::Shot; effort.shots];
    for line in backwards.iter().filter(|[_, line, _]| *line > -LONGEST_LINE) {
        ways.extend(vec![Way::Line(*line); effort.lines]);
    }
    ways.extend(vec![Way::Chain; effort.chains]);

    let mut found = Found::default();
    loop {
        let is_rarely_found = found.best.is_some() && found.hits() < effort.hits;
        let is_beaten = found.min_chain < found.best.map_or(longest, |best| best.length()) - BEATEN;
        let rounds = if is_rarely_found || is_beaten { effort.max_rounds } else { effort.rounds };
        if found.rounds >= rounds {
            return found;
        }
        found.rounds += 1;
        for (index, way) in ways.iter().enumerate() {
            let limit = found.best.map_or(longest, |best| best.length());
            let arrived = match way {
                Way::Shot => random_start(problem, limit, [1, 4, 16][index % 3], random).arrive(problem, limit),
                Way::Line(line) => Narrow::near(line, random).arrive(problem, limit),
                Way::Chain => bent_chain::straightened(problem, random).and_then(|chain| {
                    found.min_chain = found.min_chain.min(chain.length);
                    if chain.length > 1.1 * limit { None } else { arrive(problem, &fitted(&chain), limit) }
                }),
            };
            let Some(curve) = arrived else { continue };
            if found.best.is_none_or(|best| curve.length() < best.length() - 1e-9) {
                if !problem.is_reached_by(&Curve::Helicoid(curve)) {
                    found.refused += 1;
                    continue;
                }
                found = Found { best: Some(curve), by_shots: 0, by_lines: 0, by_chains: 0, ..found };
            }
            match way {
                Way::Shot => found.by_shots += 1,
                Way::Line(_) => found.by_lines += 1,
                Way::Chain => found.by_chains += 1,
            }
        }
    }
}
