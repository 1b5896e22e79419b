//! Angles: wrapping, and conversion from and to degrees. Only code that reads or writes text uses degrees.
//!
//! Inside the crate every angle is in radians. Counter-clockwise is positive.

use core::f64::consts::{PI, TAU};

/// Wraps an angle to `[0, 2 pi)`.
///
/// An angle that is below zero by a rounding error becomes exactly 0, never `2 pi`. An angle that is too large for
/// `f64` to resolve a turn also becomes 0.
pub fn wrap_positive(angle: f64) -> f64 {
    let wrapped = angle - TAU * libm::floor(angle / TAU);
    if wrapped.is_nan() || (0.0..TAU).contains(&wrapped) { wrapped } else { 0.0 }
}

/// Wraps an angle to `(-pi, pi]`. An angle in that range is returned unchanged, to the last bit.
pub fn wrap_signed(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let wrapped = wrap_positive(angle);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

/// Converts degrees to radians.
pub fn radians(degrees: f64) -> f64 {
    degrees * (PI / 180.0)
}

/// Converts radians to degrees.
pub fn degrees(radians: f64) -> f64 {
    radians * (180.0 / PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_stays_in_range_at_the_edges() {
        for angle in [-1e-300, -1e-17, -TAU, TAU, 3.0 * TAU, -1e6, 1e6, 0.0] {
            let positive = wrap_positive(angle);
            assert!((0.0..TAU).contains(&positive), "{angle} wrapped to {positive}");
            let signed = wrap_signed(angle);
            assert!(signed > -PI && signed <= PI, "{angle} wrapped to {signed}");
        }
        assert_eq!(wrap_positive(-1e-17), 0.0);
        assert_eq!(wrap_signed(radians(-30.0)), radians(-30.0));
        assert_eq!(wrap_signed(PI), PI);
        assert_eq!(wrap_signed(-PI), PI);
    }
}
