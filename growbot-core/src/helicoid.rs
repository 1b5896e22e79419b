//! Helicoidal arcs: curves of constant curvature and varying torsion. They are the third kind of segment of shortest
//! paths in space, beside circular arcs and straight lines.
//!
//! Sussmann 1995 ("Shortest 3-dimensional paths with a prescribed curvature bound", CDC) shows that a shortest path of
//! bounded curvature is made of arcs and lines or is one helicoidal arc. In units of the radius a helicoidal arc is the
//! curve
//!
//! ```text
//! x'' = w x x',   w = m / |m|,   m = m0 + p x (x - x0)
//! ```
//!
//! with constant vectors `m0` and `p`. `x0` is the point at which the curve starts, and `m0` is perpendicular to the
//! direction in which it starts. The common scale of both vectors is arbitrary. The tip turns about `w` by one radian
//! per radius of length, and `w` itself turns about the tip. The body bends as tightly as it may everywhere, and only
//! the angle of deposition changes from layer to layer.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use crate::pose::{Frame, column};
use crate::trigonometry::sin_cos;

/// The curve of a helicoidal arc, without the length of the arc. `m0` and `p` are in the frame of the tip at the start
/// of the curve. The unit of length is the radius of curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Helicoid {
    /// Vector `m` at the start of the curve. It has the direction of the axis about which the tip turns there. The
    /// common scale of `m0` and `p` is arbitrary.
    pub m0: Vector3<f64>,
    /// Vector that gives the rate of change of `m` along the curve, `m' = p x x'`, where `x'` is the direction of
    /// growth.
    pub p: Vector3<f64>,
}

/// Max length of an integration step, radii. The test `integration_agrees_with_small_steps` checks that results are
/// exact to 1e-9 with this length and with the fractions [`SHARE_OF_WAY`] and [`SHARE_OF_TURN`].
const MAX_STEP: f64 = 0.2;
/// Max length of an integration step near a point where `m` vanishes and its direction turns fast, as a fraction of the
/// length in which `m` would vanish at its present rate of change.
const SHARE_OF_WAY: f64 = 0.25;
/// Max length of an integration step near a point where `m` vanishes, as a fraction of the length `sqrt(|m| / |p|)`, in
/// which `m` would vanish at its max second derivative.
const SHARE_OF_TURN: f64 = 0.25;
/// Min length of an integration step, radii. Within a step of this length `w` turns by at most half a turn, which moves
/// the end of the curve by the order of the square of the length.
const MIN_STEP: f64 = 1e-9;
/// Max length of an integration step by the classical Runge-Kutta method, radii. It serves for short steps, such as a
/// layer. The error of a step is of the order of the fifth power of its length.
const SHORT: f64 = 0.01;
/// Numbers of substeps with which the midpoint rule computes each integration step. Extrapolation of the five results
/// gives order 10.
const SUBSTEPS: [u32; 5] = [2, 4, 6, 8, 10];

/// The tip on a helicoidal arc: its position, direction of growth and x axis, as the columns of a matrix. The position
/// is in radii.
type HelicoidState = Matrix3<f64>;

impl Helicoid {
    /// Returns the vector `m` at a position on the curve, radii.
    pub fn m(&self, position: &Vector3<f64>) -> Vector3<f64> {
        self.m0 + self.p.cross(position)
    }

    /// Returns the representation of this curve in the frame of a tip that is turned by `roll` about its direction of
    /// growth (radians, counter-clockwise). The curve in space is the same.
    pub fn rolled(&self, roll: f64) -> Self {
        let (sin, cos) = sin_cos(roll);
        let back = |v: &Vector3<f64>| Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
        Self { m0: back(&self.m0), p: back(&self.p) }
    }

    /// Returns `start_from_tip`, the frame of the tip after this length of the curve. All lengths are in radii.
    #[inline(never)] // Keeps its stack frame out of the caller's.
    pub fn frame_after(&self, length: f64) -> Frame {
        let mut walk = HelicoidIntegrator::new(self);
        walk.advance(length);
        walk.frame()
    }

    fn rate(&self, state: &HelicoidState) -> HelicoidState {
        let m = self.m(&column::<0>(state));
        let norm = m.norm();
        let w = if norm > 0.0 { m / norm } else { Vector3::zeros() };
        let direction = column::<1>(state);
        HelicoidState::from_columns(&[direction, w.cross(&direction), w.cross(&column::<2>(state))])
    }

    /// Returns the state after one integration step by the midpoint rule, in a given number of substeps.
    fn midpoint(&self, state: &HelicoidState, step: f64, substeps: u32) -> HelicoidState {
        let short = step / f64::from(substeps);
        let (mut before, mut here) = (*state, state + self.rate(state) * short);
        for _ in 1..substeps {
            (before, here) = (here, before + self.rate(&here) * (2.0 * short));
        }
        // Gragg's smoothing is not needed, because extrapolation in even powers is valid for an even number of
        // substeps.
        here
    }

    /// Returns the state after one integration step by the classical Runge-Kutta method, which is exact to the last
    /// digits if the step is short.
    fn short_step(&self, state: &HelicoidState, step: f64) -> HelicoidState {
        let first = self.rate(state);
        let second = self.rate(&(state + first * (0.5 * step)));
        let third = self.rate(&(state + second * (0.5 * step)));
        let fourth = self.rate(&(state + third * step));
        state + (first + (second + third) * 2.0 + fourth) * (step / 6.0)
    }

    /// Returns the state after one integration step by the extrapolated midpoint rule (Bulirsch and Stoer 1966, with
    /// polynomials).
    fn step(&self, state: &HelicoidState, step: f64) -> HelicoidState {
        let mut row = [HelicoidState::zeros(); SUBSTEPS.len()];
        for (index, substeps) in SUBSTEPS.into_iter().enumerate() {
            let mut value = self.midpoint(state, step, substeps);
            // Neville's scheme: `row` holds the previous row, from its left end.
            for (column, entry) in row.iter_mut().enumerate().take(index + 1) {
                let next = match index.checked_sub(column + 1).and_then(|earlier| SUBSTEPS.get(earlier)) {
                    Some(earlier) => {
                        let ratio = f64::from(substeps) / f64::from(*earlier);
                        value + (value - *entry) / (ratio * ratio - 1.0)
                    }
                    None => value,
                };
                *entry = value;
                value = next;
            }
        }
        row[SUBSTEPS.len() - 1]
    }
}

/// Integrator of a helicoidal arc: a tip that moves along the curve.
#[derive(Debug, Clone)]
pub struct HelicoidIntegrator {
    curve: Helicoid,
    state: HelicoidState,
}

impl HelicoidIntegrator {
    /// Creates an integrator whose tip is at the start of the curve.
    pub fn new(curve: &Helicoid) -> Self {
        Self { curve: *curve, state: HelicoidState::from_columns(&[Vector3::zeros(), Vector3::z(), Vector3::x()]) }
    }

    /// Moves the tip along the curve by this length, radii.
    pub fn advance(&mut self, length: f64) {
        self.advance_with_keep_alive(length, &mut || ());
    }

    /// Like [`HelicoidIntegrator::advance`], but calls `keep_alive` in each integration step so that a board can feed
    /// its watchdog. Where `m` is nearly zero, the integration takes a second on a microcontroller.
    #[inline(never)]
    pub fn advance_with_keep_alive(&mut self, length: f64, keep_alive: &mut dyn FnMut()) {
        let force = self.curve.p.norm().max(f64::MIN_POSITIVE);
        let mut left = length;
        while left > 0.0 {
            keep_alive();
            let m = self.curve.m(&column::<0>(&self.state)).norm();
            let slope = self.curve.p.cross(&column::<1>(&self.state)).norm().max(f64::MIN_POSITIVE);
            let safe = (SHARE_OF_WAY * m / slope).min(SHARE_OF_TURN * libm::sqrt(m / force));
            let safe = safe.clamp(MIN_STEP, MAX_STEP);
            // The last two steps have equal length, so that no step is only a rounding error.
            let step = if left <= safe {
                left
            } else if left < 2.0 * safe {
                0.5 * left
            } else {
                safe
            };
            let short = step <= SHORT && step <= 0.05 * safe;
            self.state =
                if short { self.curve.short_step(&self.state, step) } else { self.curve.step(&self.state, step) };
            left -= step;
        }
    }

    /// Returns `start_from_tip`, the present frame of the tip, lengths in radii.
    pub fn frame(&self) -> Frame {
        let z = column::<1>(&self.state).normalize();
        let x = column::<2>(&self.state);
        let x = (x - z * z.dot(&x)).normalize();
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
        Frame::from_parts(Translation3::from(column::<0>(&self.state)), rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics;
    use core::f64::consts::TAU;
    use proptest::prelude::*;

    /// Generates curves on which `|m|` stays above about 1e-4, because `w` jumps where `m` passes through 0.
    fn helicoid() -> impl Strategy<Value = Helicoid> {
        (0.0..TAU, -3.0..0.0, -1.0..1.0, -1.0..1.0, 0.1..1.0, any::<bool>()).prop_map(
            |(angle, exponent, x, y, along, up): (f64, f64, f64, f64, f64, bool)| {
                let size = libm::pow(10.0, exponent);
                let (axis, side) = (
                    Vector3::new(libm::cos(angle), libm::sin(angle), 0.0),
                    Vector3::new(-libm::sin(angle), libm::cos(angle), 0.0),
                );
                let along = if up { along } else { -along };
                Helicoid { m0: axis * size, p: axis * along + side * x + Vector3::z() * y }
            },
        )
    }

    /// Returns the state after this length of the curve, integrated in the given number of small steps.
    fn by_small_steps(curve: &Helicoid, length: f64, steps: u32) -> HelicoidState {
        let step = length / f64::from(steps);
        let mut state = HelicoidIntegrator::new(curve).state;
        for _ in 0..steps {
            state = curve.short_step(&state, step);
        }
        state
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn integration_agrees_with_small_steps(curve in helicoid(), length in 0.0..8.0) {
            let mut walk = HelicoidIntegrator::new(&curve);
            walk.advance(length);
            let apart = (walk.state - by_small_steps(&curve, length, 100_000)).amax();
            prop_assert!(apart < 1e-9, "{curve:?} over {length}: {apart:e} apart");
        }

        #[test]
        fn incremental_growth_matches_growth_in_one_step(curve in helicoid(), length in 0.0..8.0) {
            let mut walk = HelicoidIntegrator::new(&curve);
            for _ in 0..1000 {
                walk.advance(length / 1000.0);
            }
            let (pieces, whole) = (walk.frame().to_homogeneous(), curve.frame_after(length).to_homogeneous());
            // The errors of the segments add up along the curve: 1e-9 of its length.
            let (apart, allowed) = ((pieces - whole).amax(), 1e-9 * length.max(1.0));
            prop_assert!(apart < allowed, "{curve:?} over {length}: {apart:e} apart");
        }
    }

    #[test]
    fn a_constant_axis_traces_a_circle() {
        let circle = Helicoid { m0: Vector3::y(), p: Vector3::zeros() };
        // About +y the tip bends towards +x, so the material is laid at alpha = pi.
        let arc = kinematics::step(core::f64::consts::PI, 2.5, 2.5);
        assert!((circle.frame_after(2.5).to_homogeneous() - arc.to_homogeneous()).amax() < 1e-12);
    }
}
