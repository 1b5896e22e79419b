//! One polynomial whose roots are all paths of this kind.
//!
//! With `tau = tan(a/2)` and `sigma = tan(b/2)` of the two arcs, the corners where their tangents meet are `tau t0` and
//! `p - sigma t1`, and the line between them has the length `l = s + tau + sigma`. That the start's arc is tangent to
//! the goal's line is quadratic in `sigma`; that `l` is the same from both ends is cubic. Eliminating `sigma` leaves a
//! polynomial of degree 14 in `tau`, of which the points at which the line turns straight back, `u = -t0` and `u =
//! -t1`, take the factor `((1 + c) - (1 - c) tau^2)^2`: degree 10 is left. The book derives it.
//!
//! All terms have one of the invariants `k`, `chi` and `r`, which vanish for goals straight ahead, so that nothing is
//! lost for goals nearly so. Each coefficient comes with the sum of the magnitudes of what was added up for it: this
//! times the rounding unit bounds its error.

use nalgebra::Vector3;

/// Degree of the polynomial.
pub(super) const DEGREE: usize = 10;
/// Coefficients before the division by the factor of degree 4.
const SIZE: usize = DEGREE + 5;

/// A polynomial in `tau`, coefficients ascending.
pub(super) struct Form {
    /// The coefficients, in units of the largest magnitude.
    pub coefficients: [f64; DEGREE + 1],
    /// The magnitudes of what was added up for each.
    pub magnitudes: [f32; DEGREE + 1],
}

/// A coefficient, and the magnitudes of what was added up for it.
#[derive(Clone, Copy)]
struct Term {
    value: f64,
    magnitude: f64,
}

const NOTHING: Term = Term { value: 0.0, magnitude: 0.0 };

/// Coefficients ascending, as many as are not 0 for certain.
#[derive(Clone, Copy)]
struct Polynomial {
    terms: [Term; SIZE],
    count: usize,
}

impl Polynomial {
    const ZERO: Self = Self { terms: [NOTHING; SIZE], count: 0 };

    /// Of sums of numbers, one for each coefficient.
    #[inline(never)]
    fn of(sums: &[[f64; 2]]) -> Self {
        let mut new = Self::ZERO;
        new.count = sums.len();
        for (term, [a, b]) in new.terms.iter_mut().zip(sums) {
            *term = Term { value: a + b, magnitude: a.abs() + b.abs() };
        }
        new
    }

    /// Adds `factor a b`.
    #[inline(never)]
    fn add(&mut self, factor: f64, a: &Self, b: &Self) {
        self.count = self.count.max((a.count + b.count).saturating_sub(1));
        let size = factor.abs();
        for (i, term) in a.terms.iter().enumerate().take(a.count) {
            if term.magnitude == 0.0 {
                continue;
            }
            let (value, magnitude) = (factor * term.value, size * term.magnitude);
            for (sum, other) in self.terms.iter_mut().skip(i).zip(b.terms.iter().take(b.count)) {
                sum.value += value * other.value;
                sum.magnitude += magnitude * other.magnitude;
            }
        }
    }

    fn product(a: &Self, b: &Self) -> Self {
        let mut new = Self::ZERO;
        new.add(1.0, a, b);
        new
    }
}

impl Form {
    /// The polynomial of a goal at `p` (radii) in the direction `d` (a unit vector), seen from a tip at the origin that
    /// grows along z.
    #[inline(never)]
    pub fn of(p: &Vector3<f64>, d: &Vector3<f64>) -> Self {
        let mut both = Polynomial::ZERO;
        numerator(p, d, &mut both);
        divided(&mut both.terms, d.z)
    }
}

/// The polynomial of degree 14.
#[inline(never)]
fn numerator(p: &Vector3<f64>, d: &Vector3<f64>, all: &mut Polynomial) {
    let (z, c) = (p.z, d.z);
    let k = d.x * d.x + d.y * d.y;
    let chi = p.x * d.x + p.y * d.y;
    let r = p.x * p.x + p.y * p.y;
    let twist = p.x * d.y - p.y * d.x;
    let theta = -twist * twist;
    let (across_x, across_y) = (c * p.x - z * d.x, c * p.y - z * d.y);
    const O: [f64; 2] = [0.0; 2];
    let n = |number: f64| [number, 0.0];

    let one = Polynomial::of(&[n(1.0)]);
    let x = Polynomial::of(&[n(1.0), O, n(-1.0)]);
    let x2 = Polynomial::of(&[n(1.0), O, n(-2.0), O, n(1.0)]);
    let four_t2 = Polynomial::of(&[O, O, n(4.0)]);
    let big_r = Polynomial::of(&[[across_x * across_x, across_y * across_y], [2.0 * c * chi, -2.0 * k * z], n(k)]);
    let big_k = Polynomial::of(&[[c * chi, -k * z], n(k)]);
    let a0 = Polynomial::of(&[n(-r), O, [4.0 * z * z, 2.0 * r], n(-8.0 * z), [4.0, -r]]);
    let a2 = Polynomial::of(&[n(-k), O, [4.0 * c * c, 2.0 * k], O, n(-k)]);

    let mut big_d = Polynomial::product(&four_t2, &big_r);
    big_d.add(theta, &one, &x2);
    let x2d = Polynomial::product(&x2, &big_d);

    // -R (N^2 - 4 g0 g2 x2 D), N = g0 A2 - g2 A0
    let mut big_n = Polynomial::product(&Polynomial::of(&[n(1.0 - c), O, n(1.0 + c)]), &a2);
    big_n.add(-1.0, &Polynomial::of(&[n(1.0 + c), O, n(1.0 - c)]), &a0);
    let mut part = Polynomial::product(&big_n, &big_n);
    part.add(-4.0, &Polynomial::of(&[n(k), O, [4.0, -2.0 * k], O, n(k)]), &x2d);
    all.add(-1.0, &big_r, &part);

    // -2 c theta x (S N - 4 c x x2 D), S = A0 + A2
    let mut big_s = Polynomial::product(&one, &a0);
    big_s.add(1.0, &one, &a2);
    part = Polynomial::product(&big_s, &big_n);
    part.add(-4.0 * c, &x, &x2d);
    all.add(-2.0 * c * theta, &x, &part);

    // 4 (1 - t^4) K A1 D
    let a1 = Polynomial::of(&[n(2.0 * chi), O, [-4.0 * chi, -8.0 * c * z], n(8.0 * c), n(2.0 * chi)]);
    part = Polynomial::product(&big_k, &Polynomial::product(&a1, &big_d));
    all.add(1.0, &Polynomial::of(&[n(4.0), O, O, O, n(-4.0)]), &part);

    // L (S^2 + 4 x2 D), L = k theta x2 + 4 t^2 K^2
    let mut big_l = Polynomial::product(&four_t2, &Polynomial::product(&big_k, &big_k));
    big_l.add(k * theta, &one, &x2);
    part = Polynomial::product(&big_s, &big_s);
    part.add(4.0, &one, &x2d);
    all.add(1.0, &big_l, &part);
}

/// Divides twice by `(1 + c) - (1 - c) t^2`, from the end at which that is stable.
#[inline(never)]
fn divided(terms: &mut [Term; SIZE], c: f64) -> Form {
    if c < 0.0 {
        // The divisor reversed is its own negative, with `|c|` for `c`; and its square is the same.
        terms.reverse();
    }
    let (inverse, small) = (1.0 / (1.0 + c.abs()), 1.0 - c.abs());
    for _ in 0..2 {
        let mut before = [NOTHING; 2];
        for term in terms.iter_mut() {
            let [two_before, last] = before;
            term.value = (term.value + small * two_before.value) * inverse;
            term.magnitude = (term.magnitude + small * two_before.magnitude) * inverse;
            before = [last, *term];
        }
    }
    let largest = terms.iter().take(DEGREE + 1).fold(f64::MIN_POSITIVE, |max, term| max.max(term.magnitude));
    let unit = 1.0 / largest;
    let mut form = Form { coefficients: [0.0; DEGREE + 1], magnitudes: [0.0; DEGREE + 1] };
    for ((value, magnitude), term) in form.coefficients.iter_mut().zip(&mut form.magnitudes).zip(terms.iter()) {
        (*value, *magnitude) = (term.value * unit, (term.magnitude * unit) as f32);
    }
    if c < 0.0 {
        form.coefficients.reverse();
        form.magnitudes.reverse();
    }
    form
}
