//! Sine, cosine and related functions that need little flash memory.
//!
//! The functions of `libm` accept arguments of any size. The reduction of large arguments is two thirds of the 5 kB of
//! flash that they need on a microcontroller. The angles in this crate are a few turns, so the reduction here is short.
//! The polynomials are those of FreeBSD's msun (`k_sin.c`, `k_cos.c`), as in `libm`. The precision is also that of
//! `libm`: one unit in the last place.

use core::f64::consts::FRAC_2_PI;

use crate::angle::wrap_positive;

/// Max angle, radians, for which the product of [`QUARTER`] and the number of quarter turns is exact. A larger angle is
/// wrapped to one turn before its reduction.
const MAX_ANGLE: f64 = 1e6;
/// Leading 33 bits of a quarter turn, `pi / 2`. [`QUARTER_REST`] is the remainder.
const QUARTER: f64 = f64::from_bits(0x3ff9_21fb_5440_0000);
const QUARTER_REST: f64 = f64::from_bits(0x3dd0_b461_1a62_6331);

/// Coefficients of `(sin x - x) / x^3` in powers of `x^2`, for `x` within an eighth of a turn.
const SINE: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_007e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// Coefficients of `(cos x - 1 + x^2/2) / x^4` in powers of `x^2`, for `x` within an eighth of a turn.
const COSINE: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];
/// Coefficients of the polynomials `E` and `O` in `(x - atan x) / x^3 = E(x^4) + x^2 O(x^4)`, for `x` within 0.4375.
/// The first row holds those of `E`, the second row those of `O`.
#[cfg(feature = "planning")]
const ARC_TANGENT: [[f64; 6]; 2] = [
    [
        3.333_333_333_333_293e-1,
        1.428_571_427_250_346_6e-1,
        9.090_887_133_436_507e-2,
        6.661_073_137_387_531e-2,
        4.976_877_994_615_932_4e-2,
        1.628_582_011_536_578_2e-2,
    ],
    [
        -1.999_999_999_987_648_3e-1,
        -1.111_111_040_546_235_6e-1,
        -7.691_876_205_044_83e-2,
        -5.833_570_133_790_573_5e-2,
        -3.653_157_274_421_691_6e-2,
        0.0,
    ],
];

/// An angle as a number of quarter turns and a remainder, `left + rest`, of at most an eighth of a turn, radians.
/// `rest` holds the digits of the remainder that `left` cannot hold.
struct ReducedAngle {
    quarters: i32,
    left: f64,
    rest: f64,
}

impl ReducedAngle {
    fn new(angle: f64) -> Self {
        let angle = if angle.abs() > MAX_ANGLE { wrap_positive(angle) } else { angle };
        let quarters = libm::rint(angle * FRAC_2_PI);
        let (off, rest) = (angle - quarters * QUARTER, quarters * QUARTER_REST);
        let left = off - rest;
        Self { quarters: quarters as i32, left, rest: (off - left) - rest }
    }

    /// Returns the sine of the sum of this angle and `more` quarter turns.
    #[cfg_attr(target_os = "none", inline(never))]
    fn sine(&self, more: i32) -> f64 {
        let &Self { quarters, left, rest } = self;
        let quarters = quarters.wrapping_add(more);
        let square = left * left;
        let value = if quarters & 1 == 0 {
            left + (rest - square * (0.5 * rest - left * series(&SINE, square)))
        } else {
            let half = 0.5 * square;
            let main = 1.0 - half;
            main + (((1.0 - main) - half) + (square * square * series(&COSINE, square) - left * rest))
        };
        if quarters & 2 == 0 { value } else { -value }
    }
}

#[cfg_attr(target_os = "none", inline(never))]
fn series(coefficients: &[f64; 6], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// Returns the sine of an angle in radians.
pub fn sin(angle: f64) -> f64 {
    ReducedAngle::new(angle).sine(0)
}

/// Returns the cosine of an angle in radians.
pub fn cos(angle: f64) -> f64 {
    ReducedAngle::new(angle).sine(1)
}

/// Returns the sine and the cosine of an angle in radians.
pub fn sin_cos(angle: f64) -> (f64, f64) {
    let reduced = ReducedAngle::new(angle);
    (reduced.sine(0), reduced.sine(1))
}

/// Returns the sine and the cosine of an angle of at most an eighth of a turn, in radians. Such an angle needs no
/// reduction.
#[cfg(feature = "planning")]
pub(crate) fn sin_cos_of_eighth(angle: f64) -> (f64, f64) {
    let reduced = ReducedAngle { quarters: 0, left: angle, rest: 0.0 };
    (reduced.sine(0), reduced.sine(1))
}

/// Returns the angle, radians, with this tangent. The tangent must be within 0.4375, as it is for every angle within a
/// sixteenth of a turn.
#[cfg(feature = "planning")]
pub(crate) fn atan_of_sixteenth(tangent: f64) -> f64 {
    let square = tangent * tangent;
    let fourth = square * square;
    let [even, odd] = &ARC_TANGENT;
    tangent - tangent * (square * series(even, fourth) + fourth * series(odd, fourth))
}

/// Returns the tangent of an angle in radians.
pub fn tan(angle: f64) -> f64 {
    let (sin, cos) = sin_cos(angle);
    sin / cos
}

/// Returns the angle from 0 to `pi`, radians, with this cosine. NaN if the cosine is beyond -1 or 1.
pub fn acos(cosine: f64) -> f64 {
    libm::atan2(libm::sqrt((1.0 - cosine) * (1.0 + cosine)), cosine)
}

/// Returns the length of the vector `(x, y)`. The square of the length must be neither too large nor too small for an
/// `f64`.
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::sqrt(x * x + y * y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{PI, TAU};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sine_and_cosine_are_exact_to_the_last_digits(angle in -MAX_ANGLE..MAX_ANGLE, turns in -3.0..3.0_f64) {
            for angle in [angle, turns * TAU, 1e-9 * turns] {
                let (sin, cos) = sin_cos(angle);
                prop_assert!((sin - libm::sin(angle)).abs() <= f64::EPSILON * libm::sin(angle).abs().max(1e-9), "sin {angle}: {sin}");
                prop_assert!((cos - libm::cos(angle)).abs() <= f64::EPSILON * libm::cos(angle).abs().max(1e-9), "cos {angle}: {cos}");
            }
        }

        #[test]
        fn tan_acos_and_hypot_are_exact_up_to_rounding(angle in -1.5..1.5_f64, cosine in -1.0..=1.0, x in -1e3..1e3, y in -1e3..1e3) {
            prop_assert!((tan(angle) / libm::tan(angle) - 1.0).abs() < 1e-15);
            prop_assert!((acos(cosine) - libm::acos(cosine)).abs() < 1e-15);
            prop_assert!((hypot(x, y) / libm::hypot(x, y) - 1.0).abs() < 1e-15);
        }
    }

    proptest! {
        #[test]
        fn small_arguments_give_the_results_of_libm(angle in -0.25 * PI..0.25 * PI, tangent in -0.4375..0.4375_f64) {
            for scale in [1.0, 1e-9, 1e-300] {
                prop_assert_eq!(sin_cos_of_eighth(scale * angle), sin_cos(scale * angle));
                prop_assert_eq!(atan_of_sixteenth(scale * tangent), libm::atan(scale * tangent));
            }
        }
    }

    #[test]
    fn multiples_of_45_degrees_and_their_neighbours_are_exact() {
        for eighth in -40..=40 {
            let at = f64::from(eighth) * 0.25 * PI;
            for angle in [at.next_down(), at, at.next_up()] {
                let (sin, cos) = sin_cos(angle);
                assert!((sin - libm::sin(angle)).abs() < 3e-16, "{angle}: {sin}");
                assert!((cos - libm::cos(angle)).abs() < 3e-16, "{angle}: {cos}");
            }
        }
        assert_eq!(sin(0.0), 0.0);
        assert_eq!(cos(0.0), 1.0);
    }

    #[test]
    fn large_angles_are_reduced_correctly() {
        for angle in [2e6, 1e15, 1e300, f64::MAX] {
            for angle in [angle, -angle] {
                let (sin, cos) = sin_cos(angle);
                assert!((sin * sin + cos * cos - 1.0).abs() < 1e-12, "{angle}: {sin}, {cos}");
            }
        }
        assert!(sin(f64::NAN).is_nan() && cos(f64::INFINITY).is_nan());
    }
}
