//! The polynomial whose real roots give all paths of an arc, a line and an arc.
//!
//! The two arcs have the angles `a` and `b`, with `tau = tan(a/2)` and `sigma = tan(b/2)`. Their tangents meet in the
//! corners `tau t0` and `p - sigma t1`, and the line between the corners has the length `l = s + tau + sigma`. The
//! start's arc is tangent to the goal's line: this equation is quadratic in `sigma`. The length `l` is the same from
//! both ends: this equation is cubic. Eliminating `sigma` leaves a polynomial of degree 14 in `tau`. The points at
//! which the line turns straight back, `u = -t0` and `u = -t1`, contribute the factor `((1 + c) - (1 - c) tau^2)^2`.
//! Division by it leaves degree 10. The book derives the polynomial (`book/src/maths/polynomial.md`), and a test
//! derives it in exact rationals.
//!
//! All terms contain one of the invariants `k`, `chi` and `r`, which vanish for goals straight ahead, so that goals
//! nearly straight ahead lose no digits. Each coefficient has the sum of the magnitudes of its summands. This sum times
//! the rounding unit bounds its error.

use nalgebra::Vector3;

/// Degree of the polynomial.
pub(super) const DEGREE: usize = 10;
/// Number of coefficients of the polynomial before the division by the factor of degree 4.
const SIZE: usize = DEGREE + 5;

/// A polynomial in `tau`, coefficients in ascending order.
pub(super) struct CscPolynomial {
    /// The coefficients, divided by the largest of the magnitudes.
    pub coefficients: [f64; DEGREE + 1],
    /// For each coefficient, the sum of the magnitudes of its summands, divided by the largest of these sums.
    pub magnitudes: [f32; DEGREE + 1],
}

/// A coefficient of a polynomial, and the sum of the magnitudes of its summands.
#[derive(Clone, Copy)]
struct Term {
    value: f64,
    magnitude: f64,
}

const NOTHING: Term = Term { value: 0.0, magnitude: 0.0 };

/// A polynomial: its coefficients in ascending order, of which only the first `count` may differ from 0.
#[derive(Clone, Copy)]
struct Polynomial {
    terms: [Term; SIZE],
    count: usize,
}

impl Polynomial {
    const ZERO: Self = Self { terms: [NOTHING; SIZE], count: 0 };

    /// Creates a polynomial in which each coefficient is the sum of two numbers.
    #[inline(never)]
    fn of(sums: &[[f64; 2]]) -> Self {
        let mut new = Self::ZERO;
        new.count = sums.len();
        for (term, [a, b]) in new.terms.iter_mut().zip(sums) {
            *term = Term { value: a + b, magnitude: a.abs() + b.abs() };
        }
        new
    }

    /// Adds the product of a number and two polynomials, `factor * a * b`.
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

impl CscPolynomial {
    /// Returns the polynomial for a goal at `p` (radii) with the direction `d` (a unit vector), as seen from a tip at
    /// the origin that grows along z.
    #[inline(never)]
    pub fn of(p: &Vector3<f64>, d: &Vector3<f64>) -> Self {
        let mut both = Polynomial::ZERO;
        numerator(p, d, &mut both);
        divided(&mut both.terms, d.z)
    }
}

/// Adds the polynomial of degree 14, before its division, to `all`.
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

/// Returns the polynomial after two divisions by `(1 + c) - (1 - c) t^2`. Each division begins at the end at which it
/// is stable.
#[inline(never)]
fn divided(terms: &mut [Term; SIZE], c: f64) -> CscPolynomial {
    if c < 0.0 {
        // The reversed divisor is the negative of the divisor with `|c|` for `c`, and its square is the same.
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
    let mut form = CscPolynomial { coefficients: [0.0; DEGREE + 1], magnitudes: [0.0; DEGREE + 1] };
    for ((value, magnitude), term) in form.coefficients.iter_mut().zip(&mut form.magnitudes).zip(terms.iter()) {
        (*value, *magnitude) = (term.value * unit, (term.magnitude * unit) as f32);
    }
    if c < 0.0 {
        form.coefficients.reverse();
        form.magnitudes.reverse();
    }
    form
}

#[cfg(test)]
mod tests {
    //! An independent derivation of the polynomial, as in the book, in exact rationals.

    use std::vec;
    use std::vec::Vec;

    use super::*;
    use num_rational::BigRational;
    use num_traits::ToPrimitive;
    use proptest::prelude::*;

    /// A polynomial, coefficients in ascending order.
    type Exact = Vec<BigRational>;

    fn number(n: i64) -> BigRational {
        BigRational::from_integer(n.into())
    }

    fn exact(numbers: &[i64]) -> Exact {
        numbers.iter().map(|n| number(*n)).collect()
    }

    fn times(a: &Exact, b: &Exact) -> Exact {
        let mut product = vec![number(0); (a.len() + b.len()).saturating_sub(1)];
        for (i, a) in a.iter().enumerate() {
            for (j, b) in b.iter().enumerate() {
                product[i + j] += a * b;
            }
        }
        product
    }

    fn minus(a: &Exact, b: &Exact) -> Exact {
        let zero = number(0);
        let at = |of: &Exact, i: usize| of.get(i).unwrap_or(&zero).clone();
        (0..a.len().max(b.len())).map(|i| at(a, i) - at(b, i)).collect()
    }

    fn scaled(a: &Exact, factor: &BigRational) -> Exact {
        a.iter().map(|a| a * factor).collect()
    }

    /// Returns the determinant of a matrix of polynomials, by expansion along the first row.
    fn determinant(rows: &[Vec<Exact>]) -> Exact {
        let [first, rest @ ..] = rows else { return exact(&[1]) };
        let mut sum = Vec::new();
        for (column, entry) in first.iter().enumerate().filter(|(_, entry)| !entry.is_empty()) {
            let without = |row: &Vec<Exact>| {
                row.iter().enumerate().filter(|(i, _)| *i != column).map(|(_, e)| e.clone()).collect()
            };
            let minor: Vec<Vec<Exact>> = rest.iter().map(without).collect();
            let part = times(entry, &determinant(&minor));
            sum = minus(&sum, &scaled(&part, &number(if column % 2 == 0 { -1 } else { 1 })));
        }
        sum
    }

    /// Returns the quotient of a division without remainder.
    fn divided_by(a: &Exact, divisor: &Exact) -> Exact {
        let (mut rest, zero) = (a.clone(), number(0));
        let (last, degree) = (divisor.last().unwrap(), divisor.len() - 1);
        let mut quotient = vec![zero.clone(); a.len() - degree];
        for i in (0..quotient.len()).rev() {
            let share = &rest[i + degree] / last;
            for (j, d) in divisor.iter().enumerate() {
                rest[i + j] -= &share * d;
            }
            quotient[i] = share;
        }
        assert!(rest.iter().all(|left| *left == zero), "the division leaves {rest:?}");
        quotient
    }

    /// Returns the polynomial of degree 10 for a goal at `p` with the direction `d`, derived from the two equations of
    /// tangency by elimination of sigma.
    fn derived(p: &[BigRational; 3], d: &[BigRational; 3]) -> Exact {
        let [x, y, z] = p;
        let [dx, dy, c] = d;
        let (one, zero) = (number(1), number(0));
        let (k, chi, r) = (dx * dx + dy * dy, x * dx + y * dy, x * x + y * y);
        let along = &chi + z * c;
        let (less, more) = (exact(&[1, 0, -1]), exact(&[1, 0, 1]));
        let (four_squares, squares) = (exact(&[0, 0, 4]), times(&less, &less));
        // The coefficients of powers of sigma. First equation: 4 tau^2 (t0 . w)^2 = (1 - tau^2)^2 |w across t0|^2.
        let straight: Exact = vec![z.clone(), -one.clone()];
        let first = [
            minus(&times(&four_squares, &times(&straight, &straight)), &scaled(&squares, &r)),
            minus(&scaled(&squares, &(number(2) * &chi)), &scaled(&times(&four_squares, &straight), &(number(2) * c))),
            minus(&scaled(&four_squares, &(c * c)), &scaled(&squares, &k)),
        ];
        // Second equation: (1 + tau^2) (1 - sigma^2) t0 . w = (1 - tau^2) (1 + sigma^2) t1 . w.
        let (from_start, from_goal) = (times(&more, &straight), times(&less, &vec![along, -c.clone()]));
        let second = [
            minus(&from_start, &from_goal),
            minus(&less, &scaled(&more, c)),
            minus(&scaled(&from_start, &-one.clone()), &from_goal),
            minus(&scaled(&more, c), &scaled(&less, &-one.clone())),
        ];
        // Sylvester's matrix.
        let row = |of: &[Exact], shift: usize| -> Vec<Exact> {
            (0..5)
                .map(|i| (i as usize).checked_sub(shift).and_then(|i| of.get(i)).cloned().unwrap_or_default())
                .collect()
        };
        let rows = [row(&first, 0), row(&first, 1), row(&first, 2), row(&second, 0), row(&second, 1)];
        let straight_back: Exact = vec![&one + c, zero, c - &one];
        divided_by(&divided_by(&determinant(&rows), &squares), &times(&straight_back, &straight_back))
    }

    fn float(number: &BigRational) -> f64 {
        number.to_f64().unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn polynomial_is_the_resultant_of_both_tangency_conditions(
            position in prop::array::uniform3(-64_i64..64), [a, b] in prop::array::uniform2(-9_i64..9),
            below in any::<bool>(),
        ) {
            // A unit vector with rational components, by stereographic projection.
            let size = 1 + a * a + b * b;
            let ratio = |n: i64, of: i64| BigRational::new(n.into(), of.into());
            let c = ratio(if below { 1 - a * a - b * b } else { a * a + b * b - 1 }, size);
            let d = [ratio(2 * a, size), ratio(2 * b, size), c];
            let p = position.map(|n| ratio(n, 8));
            prop_assume!(p[0] != number(0) || p[1] != number(0));
            let derived = derived(&p, &d);
            prop_assert!(derived.iter().skip(DEGREE + 1).all(|coefficient| *coefficient == number(0)));

            let vector = |v: &[BigRational; 3]| Vector3::new(float(&v[0]), float(&v[1]), float(&v[2]));
            let form = CscPolynomial::of(&vector(&p), &vector(&d));
            let derived: Vec<f64> = derived.iter().take(DEGREE + 1).map(float).collect();
            let largest = (0..=DEGREE).max_by(|a, b| derived[*a].abs().total_cmp(&derived[*b].abs())).unwrap();
            prop_assume!(derived[largest] != 0.0);
            let scale = form.coefficients[largest] / derived[largest];
            for ((coefficient, magnitude), derived) in form.coefficients.iter().zip(form.magnitudes).zip(derived) {
                let off = (coefficient - scale * derived).abs();
                prop_assert!(off <= 1e-13 * f64::from(magnitude).max(1e-3), "{coefficient} for {}", scale * derived);
            }
        }
    }
}
