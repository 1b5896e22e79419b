//! The real roots of the polynomial, each isolated: its Bernstein form is halved until the signs decide.
//!
//! The number of roots in an interval is at most the number of sign changes of the Bernstein coefficients there. The
//! number of extremes is at most the number of sign changes of their differences. The signs are first examined in
//! single precision, which a microcontroller computes in hardware, with a bound of the rounding. If that does not
//! decide, they are examined in double precision. If rounding leaves a sign open even then, the code assumes a root,
//! and the paths at that root decide.

use core::cell::Cell;

use heapless::Vec;

use super::polynomial::{CscPolynomial, DEGREE};

/// The coefficients of the polynomial in powers of `x`, or in Bernstein form.
type Coefficients<T> = [T; DEGREE + 1];

/// Bound of the rounding error of the polynomial's value, as a fraction of the sum of the magnitudes of its summands:
/// nine roundings of half an ulp. With this bound, the search finds constructed paths of all kinds
/// (`tests/constructed_csc_paths.rs`).
const ROUNDING: f64 = 2e-15;
/// Bound of the rounding error by which a halving of an interval changes its Bernstein coefficients in single
/// precision, as a fraction of the largest coefficient: an ulp and a half.
const ROUNDING_F32: f32 = 1.0e-7;
/// Max number of halvings of an interval in single precision. After more halvings the rounding error would exceed the
/// values.
const DEPTH_F32: u32 = 7;
/// Max number of halvings of an interval. Roots that are closer together count as one root.
const DEPTH: u32 = 24;
/// Step size at which the refinement of a root ends, because Newton's method refines the whole path afterwards.
const REFINED: f64 = 3e-8;
/// Max number of iterations of the search for a root or an extreme in an interval.
const MAX_STEPS: u32 = 60;
/// Inverses of the binomial coefficients, `1 / C(10, k)` for `k` from 0 to 10.
const INVERSE_BINOMIALS: Coefficients<f64> = [
    1.0,
    1.0 / 10.0,
    1.0 / 45.0,
    1.0 / 120.0,
    1.0 / 210.0,
    1.0 / 252.0,
    1.0 / 210.0,
    1.0 / 120.0,
    1.0 / 45.0,
    1.0 / 10.0,
    1.0,
];

/// A root of the polynomial, or a point at which rounding leaves open whether there are two roots, one or none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Root {
    /// Position of the root, 0 to 1: `|tau|`, or `1 / |tau|` for `tau` beyond 1 or -1.
    pub x: f64,
    /// True if the polynomial certainly changes its sign at this root. False if rounding leaves that open.
    pub certain: bool,
}

/// The polynomial on one of the four parts of the range of `tau`, written as a polynomial in `x` on `[0, 1]`.
pub(super) struct Part {
    coefficients: Coefficients<f64>,
    magnitudes: Coefficients<f32>,
}

/// An interval of `x`.
#[derive(Clone, Copy)]
struct Interval {
    from: f64,
    to: f64,
    /// Number of halvings of `[0, 1]` that have led to this interval.
    depth: u32,
}

impl Interval {
    fn middle(&self) -> f64 {
        0.5 * (self.from + self.to)
    }

    fn halves(&self) -> [Self; 2] {
        let (middle, depth) = (self.middle(), self.depth + 1);
        [Self { to: middle, depth, ..*self }, Self { from: middle, depth, ..*self }]
    }
}

/// An interval, and the Bernstein coefficients of the polynomial on it in single precision.
#[derive(Clone, Copy)]
struct Rough {
    interval: Interval,
    bernstein: Coefficients<f32>,
    /// Bound of the rounding error of each Bernstein coefficient.
    noise: f32,
}

impl Rough {
    /// Returns both halves of the interval with their Bernstein coefficients, by de Casteljau's algorithm.
    #[inline(never)]
    fn halves(&self) -> [Self; 2] {
        let max = self.bernstein.iter().fold(0.0f32, |max, b| max.max(b.abs()));
        let noise = self.noise + ROUNDING_F32 * max;
        let [left, right] = self.interval.halves();
        let mut right = Self { interval: right, bernstein: self.bernstein, noise };
        let mut left = Self { interval: left, bernstein: self.bernstein, noise };
        let cells = Cell::from_mut(right.bernstein.as_mut_slice()).as_slice_of_cells();
        for (k, to) in left.bernstein.iter_mut().enumerate() {
            *to = cells.first().map_or(0.0, Cell::get);
            for pair in cells.windows(2).take(DEGREE - k) {
                if let [here, next] = pair {
                    here.set(0.5 * (here.get() + next.get()));
                }
            }
        }
        [left, right]
    }
}

/// Number of roots in an interval, as far as the signs of the Bernstein coefficients determine it.
enum Found {
    Nothing,
    /// One root. The polynomial has different signs at the ends of the interval.
    One,
    Open,
}

/// Range of `tau` that a [`Part`] covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TauRange {
    ZeroToOne,
    AboveOne,
    BelowMinusOne,
    MinusOneToZero,
}

impl TauRange {
    pub const ALL: [Self; 4] = [Self::ZeroToOne, Self::AboveOne, Self::BelowMinusOne, Self::MinusOneToZero];

    fn is_positive(self) -> bool {
        matches!(self, Self::ZeroToOne | Self::AboveOne)
    }

    fn is_inverse(self) -> bool {
        matches!(self, Self::AboveOne | Self::BelowMinusOne)
    }

    /// Returns the `tau` of a root of the part, from its position.
    pub fn tau(self, x: f64) -> f64 {
        let size = if self.is_inverse() { 1.0 / x.max(1e-12) } else { x };
        if self.is_positive() { size } else { -size }
    }
}

impl Part {
    /// Creates the polynomial in `x = |tau|`, or in `x = 1 / |tau|` for `tau` beyond 1 or -1.
    pub fn of(form: &CscPolynomial, range: TauRange) -> Self {
        let CscPolynomial { mut coefficients, mut magnitudes } = *form;
        if !range.is_positive() {
            for coefficient in coefficients.iter_mut().skip(1).step_by(2) {
                *coefficient = -*coefficient;
            }
        }
        if range.is_inverse() {
            coefficients.reverse();
            magnitudes.reverse();
        }
        Self { coefficients, magnitudes }
    }

    /// Calls `found` with each root in `[0, 1]`, in ascending order.
    #[inline(never)]
    pub fn roots(&self, found: &mut dyn FnMut(Root)) {
        let mut waiting = Vec::<Rough, { DEPTH_F32 as usize + 2 }>::new();
        let _ = waiting.push(self.rough());
        while let Some(rough) = waiting.pop() {
            let Rough { interval, bernstein, noise } = &rough;
            match signs(bernstein, *noise) {
                Found::Nothing => {}
                Found::One => found(self.root(*interval)),
                Found::Open if interval.depth < DEPTH_F32 => {
                    // Each halving adds one interval that has still to be examined.
                    let [left, right] = rough.halves();
                    let _ = waiting.push(right);
                    let _ = waiting.push(left);
                }
                Found::Open => self.roots_within(*interval, found),
            }
        }
    }

    /// Returns the interval `[0, 1]` with its Bernstein coefficients in single precision.
    #[inline(never)]
    fn rough(&self) -> Rough {
        let interval = Interval { from: 0.0, to: 1.0, depth: 0 };
        let bernstein = self.bernstein(&interval).map(|b| b as f32);
        let max = bernstein.iter().fold(0.0f32, |max, b| max.max(b.abs()));
        Rough { interval, bernstein, noise: self.noise(1.0) as f32 + ROUNDING_F32 * max }
    }

    /// Calls `found` with each root in an interval, in ascending order. The roots are isolated in double precision.
    #[inline(never)]
    fn roots_within(&self, interval: Interval, found: &mut dyn FnMut(Root)) {
        let mut waiting = Vec::<Interval, { DEPTH as usize + 1 }>::new();
        let _ = waiting.push(interval);
        while let Some(interval) = waiting.pop() {
            if self.look(&interval, found) {
                let [left, right] = interval.halves();
                let _ = waiting.push(right);
                let _ = waiting.push(left);
            }
        }
    }

    /// Returns the Bernstein coefficients of the polynomial on an interval.
    #[inline(never)]
    fn bernstein(&self, interval: &Interval) -> Coefficients<f64> {
        let mut b = self.coefficients;
        let width = interval.to - interval.from;
        let cells = Cell::from_mut(b.as_mut_slice()).as_slice_of_cells();
        if interval.from > 0.0 {
            for k in 0..DEGREE {
                for pair in cells.windows(2).skip(k).rev() {
                    if let [here, next] = pair {
                        here.set(here.get() + interval.from * next.get());
                    }
                }
            }
        }
        let mut power = 1.0;
        for (coefficient, inverse) in cells.iter().zip(&INVERSE_BINOMIALS) {
            coefficient.set(coefficient.get() * (inverse * power));
            power *= width;
        }
        for k in 0..DEGREE {
            for pair in cells.windows(2).skip(k).rev() {
                if let [here, next] = pair {
                    next.set(next.get() + here.get());
                }
            }
        }
        b
    }

    /// Returns a bound of the rounding error of the polynomial's value at `x`.
    fn noise(&self, x: f64) -> f64 {
        let x = x as f32;
        ROUNDING * f64::from(self.magnitudes.iter().rev().fold(0.0f32, |sum, magnitude| sum * x + magnitude))
    }

    /// Examines an interval and calls `found` with its roots. Returns true if the interval must be halved instead.
    #[inline(never)]
    fn look(&self, interval: &Interval, found: &mut dyn FnMut(Root)) -> bool {
        let bernstein = self.bernstein(interval);
        let noise = self.noise(interval.to);
        match signs(&bernstein, noise) {
            Found::Nothing => return false,
            Found::One => {
                found(self.root(*interval));
                return false;
            }
            Found::Open => {}
        }
        let turns = turns(&bernstein);
        if turns > 1 {
            if interval.depth < DEPTH {
                return true;
            }
            found(Root { x: interval.middle(), certain: false });
            return false;
        }
        let [first, .., last] = bernstein;
        if (first < 0.0) != (last < 0.0) {
            found(Root { certain: first.abs().min(last.abs()) > noise, ..self.root(*interval) });
        } else if turns == 1 {
            self.two_roots(interval, first < 0.0, found);
        }
        for (end, x) in [(first, interval.from), (last, interval.to)] {
            if end.abs() <= noise {
                found(Root { x, certain: false });
            }
        }
        false
    }

    /// Calls `found` with the two roots in an interval with one extreme, at whose ends the polynomial has the same
    /// sign. If the extreme has the other sign, there is a root on each side of it. If rounding leaves the sign of the
    /// extreme open, the extreme itself is reported as an uncertain root.
    fn two_roots(&self, interval: &Interval, negative: bool, found: &mut dyn FnMut(Root)) {
        let x = self.extreme(*interval, negative);
        let [value, ..] = self.jet(x);
        let certain = value.abs() > self.noise(x);
        if (value < 0.0) != negative {
            for half in [Interval { to: x, ..*interval }, Interval { from: x, ..*interval }] {
                found(Root { certain, ..self.root(half) });
            }
        }
        if !certain {
            found(Root { x, certain });
        }
    }

    /// Returns the polynomial's value, its slope and half its second derivative at `x`.
    #[inline(never)]
    fn jet(&self, x: f64) -> [f64; 3] {
        self.coefficients.iter().rev().fold([0.0; 3], |[value, slope, bend], coefficient| {
            [value * x + coefficient, slope * x + value, bend * x + slope]
        })
    }

    /// Returns the position of the extreme in an interval at whose ends the slopes have different signs. `negative` is
    /// true if the values at the ends are negative. The search ends early at a position where the value certainly has
    /// the other sign.
    fn extreme(&self, mut interval: Interval, negative: bool) -> f64 {
        // If the values at the ends are negative, the extreme that can be beyond 0 is a maximum.
        let rising = negative;
        let mut x = interval.middle();
        for _ in 0..MAX_STEPS {
            let [value, slope, bend] = self.jet(x);
            if (value < 0.0) != negative && value.abs() > self.noise(x) {
                return x;
            }
            if (slope > 0.0) == rising {
                interval.from = x;
            } else {
                interval.to = x;
            }
            let next = x - slope / (2.0 * bend);
            let next = if interval.from < next && next < interval.to { next } else { interval.middle() };
            if (next - x).abs() <= 1e-12 {
                break;
            }
            x = next;
        }
        x
    }

    /// Returns the root in an interval at whose ends the polynomial has different signs.
    #[inline(never)]
    fn root(&self, mut interval: Interval) -> Root {
        let [at_from, at_to] = [interval.from, interval.to].map(|x| self.value(x));
        let negative = at_from < 0.0;
        let mut next = interval.from + (interval.to - interval.from) * (at_from / (at_from - at_to));
        let mut x = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let inside = interval.from <= next && next <= interval.to;
            let to = if inside { next } else { interval.middle() };
            let step = (to - x).abs();
            x = to;
            if step <= REFINED {
                break;
            }
            let (value, slope) = self.tangent(x);
            if (value < 0.0) == negative {
                interval.from = x;
            } else {
                interval.to = x;
            }
            next = x - value / slope;
        }
        Root { x, certain: true }
    }

    fn value(&self, x: f64) -> f64 {
        self.coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }

    /// Returns the polynomial's value and its slope at `x`.
    #[inline(never)]
    fn tangent(&self, x: f64) -> (f64, f64) {
        let rising = self.coefficients.iter().rev();
        rising.fold((0.0, 0.0), |(value, slope), coefficient| (value * x + coefficient, slope * x + value))
    }
}

/// Returns the number of roots in an interval, as far as the signs of its Bernstein coefficients determine it. Each
/// coefficient has an error of at most `noise`.
fn signs<T: Copy + PartialOrd + core::ops::Neg<Output = T> + Default>(bernstein: &Coefficients<T>, noise: T) -> Found {
    let zero = T::default();
    if bernstein.iter().any(|b| -noise <= *b && *b <= noise) {
        return Found::Open;
    }
    match changes(bernstein.iter().map(|b| *b < zero)) {
        0 => Found::Nothing,
        1 => Found::One,
        _ => Found::Open,
    }
}

/// Returns the number of sign changes among the differences of successive Bernstein coefficients. It bounds the number
/// of extremes.
fn turns(bernstein: &Coefficients<f64>) -> usize {
    changes(bernstein.iter().zip(bernstein.iter().skip(1)).map(|(b, next)| next < b))
}

fn changes(signs: impl Iterator<Item = bool> + Clone) -> usize {
    signs.clone().zip(signs.skip(1)).filter(|(sign, next)| sign != next).count()
}
