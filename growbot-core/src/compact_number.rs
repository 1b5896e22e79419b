//! Format of numbers in texts for people.

use core::fmt;

/// A number that is displayed in a short form: decimal, or with an exponent if the decimal form would need more than a
/// dozen zeros.
/// ```
/// use growbot_core::compact_number::CompactNumber;
/// assert_eq!(format!("{} {}", CompactNumber(&0.774), CompactNumber(&1e7)), "0.774 10000000");
/// assert_eq!(CompactNumber(&-1e308).to_string(), "-1e308");
/// ```
#[derive(Debug, Clone, Copy)]
pub struct CompactNumber<'a>(pub &'a f64);

impl fmt::Display for CompactNumber<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (number, size) = (self.0, self.0.abs());
        if size == 0.0 || (1e-12..1e12).contains(&size) { write!(f, "{number}") } else { write!(f, "{number:e}") }
    }
}

/// Returns a minimum rounded up to hundredths, so that a user who types the displayed number is not below it.
pub fn rounded_up(minimum: &f64) -> f64 {
    // Numbers such as 98.2 have no exact form and must not become 98.21.
    libm::ceil(minimum * 100.0 - 1e-6) / 100.0
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn minima_are_rounded_up() {
        for (minimum, text) in [(98.2, "98.2"), (594.1071428571429, "594.11"), (38.0, "38"), (0.001, "0.01")] {
            assert_eq!(CompactNumber(&rounded_up(&minimum)).to_string(), text);
        }
    }

    #[test]
    fn numbers_are_formatted_compactly() {
        for (number, text) in [
            (0.0, "0"),
            (98.2, "98.2"),
            (1e8, "100000000"),
            (f64::MAX, "1.7976931348623157e308"),
            (5e-324, "5e-324"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(CompactNumber(&number).to_string(), text);
        }
    }
}
