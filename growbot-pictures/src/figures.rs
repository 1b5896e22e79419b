//! Numbers as text: rounded for people, in full for programs.

use growbot_core::pose::Pose;

/// A number with so many decimals; what rounds to 0 has no sign.
///
/// ```
/// use growbot_pictures::figures::fixed;
/// assert_eq!(fixed(-12.3456, 2), "-12.35");
/// assert_eq!(fixed(-6e-14, 3), "0.000");
/// ```
#[must_use]
pub fn fixed(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|digit| matches!(digit, '0' | '.')) => digits.to_owned(),
        _ => text,
    }
}

/// The shortest text that reads back as the very same number; 0 has no sign.
///
/// ```
/// use growbot_pictures::figures::shortest;
/// assert_eq!(shortest(-0.0), "0");
/// assert_eq!(shortest(0.1 + 0.2), "0.30000000000000004");
/// assert_eq!(shortest(6e-14), "6e-14");
/// ```
#[must_use]
pub fn shortest(number: f64) -> String {
    let number = number + 0.0;
    let (plain, exponent) = (number.to_string(), format!("{number:e}"));
    if plain.len() <= exponent.len() { plain } else { exponent }
}

/// A direction in words, with so many decimals: heading and pitch, or that it is vertical and so has no heading.
#[must_use]
pub fn direction(pose: &Pose, decimals: usize) -> String {
    let [_, _, _, heading, pitch] = pose.to_degrees();
    match (pose.is_vertical(), pitch > 0.0) {
        (true, true) => "straight up".to_owned(),
        (true, false) => "straight down".to_owned(),
        _ => format!("heading {}, pitch {} deg", fixed(heading, decimals), fixed(pitch, decimals)),
    }
}
