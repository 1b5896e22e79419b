//! Conversion of radians to degrees for texts: the shortest decimal number that converts back to exactly the same
//! radians, if there is one.
//!
//! If a user types `30`, the conversion to radians and back gives 29.999999999999996. Of all decimal numbers of degrees
//! that convert to the same radians, [`shortest_degrees`] returns the one with the fewest digits.

use growbot_core::angle::{degrees, radians, wrap_signed};

/// Returns the shortest decimal number of degrees that converts to exactly these radians. If there is none, returns the
/// result of the plain conversion.
///
/// ```
/// use growbot_core::angle::{degrees, radians};
/// use growbot_plan::degrees::shortest_degrees;
/// assert_eq!(degrees(radians(30.0)), 29.999999999999996);
/// assert_eq!(shortest_degrees(radians(30.0)), 30.0);
/// ```
pub fn shortest_degrees(angle: f64) -> f64 {
    shortest(angle, radians)
}

/// Like [`shortest_degrees`], but for headings: the result converts to exactly this heading after the wrapping that
/// [`growbot_core::pose::Pose`] applies. Wrapping changes the last digits of a negative heading.
pub fn shortest_heading(heading: f64) -> f64 {
    shortest(heading, |degrees| wrap_signed(radians(degrees)))
}

/// Returns the shortest decimal number of degrees that `read` converts to exactly this angle (radians). If there is
/// none, returns the result of the plain conversion.
fn shortest(angle: f64, read: impl Fn(f64) -> f64) -> f64 {
    let plain = degrees(angle);
    let gives_the_angle = |candidate: &f64| read(*candidate).to_bits() == angle.to_bits();
    (0..17)
        .filter_map(|digits| format!("{plain:.digits$e}").parse().ok())
        .find(gives_the_angle)
        .or_else(|| [plain.next_down(), plain.next_up()].into_iter().find(gives_the_angle))
        .unwrap_or(plain)
}

/// Converts an angle in `[0, 2 pi)` to degrees in `[0, 360)`. Returns 0 if the conversion rounds up to 360.
pub fn degrees_below_turn(angle: f64) -> f64 {
    let written = degrees(angle);
    if written >= 360.0 { 0.0 } else { written }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn degrees_round_trip_to_the_typed_decimals() {
        for tenths in -1800..=1800 {
            let typed = f64::from(tenths) / 10.0;
            assert_eq!(shortest_degrees(radians(typed)), typed);
            if typed > -180.0 {
                assert_eq!(shortest_heading(wrap_signed(radians(typed))), typed);
            }
        }
    }

    #[test]
    fn any_angle_round_trips_within_a_rounding_error() {
        for i in 0..10_000 {
            let angle = f64::from(i) * 3.14e-4 + 1e-9;
            assert!((radians(shortest_degrees(angle)) - angle).abs() <= f64::EPSILON * angle);
        }
    }

    #[test]
    fn angles_are_formatted_below_a_full_turn() {
        assert_eq!(degrees_below_turn(TAU), 0.0);
        let below = degrees_below_turn(TAU.next_down());
        assert!(below < 360.0 && below > 359.999);
    }
}
