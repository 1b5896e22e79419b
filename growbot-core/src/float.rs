//! Functions for `f32` and `f64` that give the same bits on every machine. A search may begin in `f32`, which a
//! microcontroller computes in hardware.

use nalgebra::RealField;

use crate::trigonometry;

/// A float with functions that give the same bits on every machine. The functions of [`RealField`] may be those of the
/// standard library, which differ between machines.
pub trait PortableFloat: RealField + Copy {
    /// Returns the float of this type that is nearest to `number`.
    fn literal(number: f64) -> Self;
    /// Returns the square root of this number.
    fn root(self) -> Self;
    /// Returns `e` to the power of this number.
    fn exponential(self) -> Self;
    /// Returns the natural logarithm of this number.
    fn logarithm(self) -> Self;
    /// Returns the sine of this angle in radians, which must be at most a quarter turn.
    fn sine_of_quarter(self) -> Self;
    /// Returns the sine and the cosine of this angle in radians.
    fn sine_cosine(self) -> (Self, Self);
}

/// Number that rounds an `f64` to an integer when it is added and subtracted again, 1.5 * 2^52. An `f64` of this size
/// has no fractional digits.
const SHIFT_F64: f64 = 6_755_399_441_055_744.0;
/// Leading bits of `ln 2` as an `f64`. [`LOG_2_REST_F64`] is the remainder.
const LOG_2_F64: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LOG_2_REST_F64: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);
/// Coefficients of `(e^x - 1 - x) / x^2` in powers of `x`.
const EXPONENTIAL: [f64; 11] = [
    0.5,
    0.16666666666666666,
    0.041666666666666664,
    0.008333333333333333,
    0.001388888888888889,
    0.0001984126984126984,
    2.48015873015873e-05,
    2.7557319223985893e-06,
    2.755731922398589e-07,
    2.505210838544172e-08,
    2.08767569878681e-09,
];
/// Coefficients of `(sin x - x) / x^3` in powers of `x^2`.
const SINE: [f64; 9] = [
    -0.16666666666666666,
    0.008333333333333333,
    -0.0001984126984126984,
    2.7557319223985893e-06,
    -2.505210838544172e-08,
    1.6059043836821613e-10,
    -7.647163731819816e-13,
    2.8114572543455206e-15,
    -8.22063524662433e-18,
];

impl PortableFloat for f64 {
    fn literal(number: f64) -> Self {
        number
    }

    fn root(self) -> Self {
        libm::sqrt(self)
    }

    fn exponential(self) -> Self {
        let shifted = self * core::f64::consts::LOG2_E + SHIFT_F64;
        let whole = shifted - SHIFT_F64;
        let x = (self - whole * LOG_2_F64) - whole * LOG_2_REST_F64;
        let series = EXPONENTIAL.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient);
        let series = 1.0 + (x + x * x * series);
        series * f64::from_bits((shifted.to_bits() << 52).wrapping_add(1023 << 52))
    }

    fn logarithm(self) -> Self {
        libm::log(self)
    }

    fn sine_of_quarter(self) -> Self {
        let square = self * self;
        let series = SINE.iter().rev().fold(0.0, |sum, coefficient| sum * square + coefficient);
        self + self * square * series
    }

    fn sine_cosine(self) -> (Self, Self) {
        trigonometry::sin_cos(self)
    }
}

/// Leading bits of a quarter turn, `pi / 2`, as an `f32`. [`QUARTER_REST`] is the remainder.
const QUARTER: f32 = 1.570_312_5;
const QUARTER_REST: f32 = 4.838_268e-4;

/// Leading bits of `ln 2` as an `f32`. [`LOG_2_REST`] is the remainder.
const LOG_2: f32 = 0.693_359_4;
const LOG_2_REST: f32 = -2.121_944_4e-4;

/// Number that rounds an `f32` to an integer when it is added and subtracted again, 1.5 * 2^23. An `f32` of this size
/// has no fractional digits.
const SHIFT: f32 = 12_582_912.0;

/// Returns the integer that is nearest to a number of magnitude below 2^22.
fn nearest(number: f32) -> f32 {
    (number + SHIFT) - SHIFT
}

impl PortableFloat for f32 {
    fn literal(number: f64) -> Self {
        number as f32
    }

    fn root(self) -> Self {
        libm::sqrtf(self)
    }

    fn exponential(self) -> Self {
        // The lowest bits of a float of this size are an integer.
        let shifted = self * core::f32::consts::LOG2_E + SHIFT;
        let whole = shifted - SHIFT;
        let x = (self - whole * LOG_2) - whole * LOG_2_REST;
        let series = 1.0
            + x * (1.0
                + x * (0.5 + x * (1.666_666_6e-1 + x * (4.166_579_6e-2 + x * (8.333_452e-3 + x * 1.398_199_9e-3)))));
        series * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
    }

    fn logarithm(self) -> Self {
        libm::logf(self)
    }

    fn sine_of_quarter(self) -> Self {
        let square = self * self;
        self * (1.0
            + square
                * (-1.666_666_7e-1
                    + square
                        * (8.333_316e-3
                            + square * (-1.984_008_8e-4 + square * (2.752_556_2e-6 - square * 2.388_985_9e-8)))))
    }

    fn sine_cosine(self) -> (Self, Self) {
        let quarters = nearest(self * core::f32::consts::FRAC_2_PI);
        let x = (self - quarters * QUARTER) - quarters * QUARTER_REST;
        let square = x * x;
        let sine = x + x * square * (-1.666_665_5e-1 + square * (8.332_161e-3 - square * 1.951_529_6e-4));
        let cosine = 1.0 - 0.5 * square
            + square * square * (4.166_664_6e-2 - square * (1.388_731_6e-3 - square * 2.443_315_7e-5));
        match quarters as i32 & 3 {
            0 => (sine, cosine),
            1 => (cosine, -sine),
            2 => (-sine, -cosine),
            _ => (-cosine, sine),
        }
    }
}
