//! Numbers as text: rounded for people, exact for programs.

use growbot_core::pose::Pose;

/// Formats a number with `decimals` decimals. A number that is rounded to 0 has no sign.
///
/// ```
/// use growbot_plan::figures::fixed;
/// assert_eq!(fixed(-12.3456, 2), "-12.35");
/// assert_eq!(fixed(-6e-14, 3), "0.000");
/// ```
pub fn fixed(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|digit| matches!(digit, '0' | '.')) => digits.to_owned(),
        _ => text,
    }
}

/// Formats a number as the shortest text that is read back as the same number. 0 has no sign.
///
/// ```
/// use growbot_plan::figures::shortest;
/// assert_eq!(shortest(-0.0), "0");
/// assert_eq!(shortest(0.1 + 0.2), "0.30000000000000004");
/// assert_eq!(shortest(6e-14), "6e-14");
/// ```
pub fn shortest(number: f64) -> String {
    let number = number + 0.0;
    let (plain, exponent) = (number.to_string(), format!("{number:e}"));
    if plain.len() <= exponent.len() { plain } else { exponent }
}

/// Describes a direction by heading and pitch with `decimals` decimals. A vertical direction has no heading, so the
/// text is "straight up" or "straight down".
pub fn direction_text(pose: &Pose, decimals: usize) -> String {
    let [_, _, _, heading, pitch] = pose.to_degrees();
    match (pose.is_vertical(), pitch > 0.0) {
        (true, true) => "straight up".to_owned(),
        (true, false) => "straight down".to_owned(),
        _ => format!("heading {}, pitch {} deg", fixed(heading, decimals), fixed(pitch, decimals)),
    }
}
