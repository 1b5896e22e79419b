//! Poses as people type them: `X,Y,Z,HEADING,PITCH` in mm and degrees, spaces after the commas or not.

use growbot_core::pose::{Pose, PoseError};

/// Why a text is no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseTextError {
    /// Not five numbers.
    #[error(
        "a pose is five numbers, X,Y,Z,HEADING,PITCH in mm and degrees, and this is {found}: with spaces, put it in \
         quotes"
    )]
    Count {
        /// How many there were.
        found: usize,
    },
    /// Something that is no number.
    #[error("{field} is {text:?}, which is no number: write it like -120 or 0.5")]
    NotANumber {
        /// Which of the five.
        field: &'static str,
        /// What was there.
        text: String,
    },
    /// Five numbers that are no pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
}

const FIELDS: [&str; 5] = ["x", "y", "z", "heading", "pitch"];

/// A pose from its text.
///
/// ```
/// use growbot_client::pose_text::parse_pose;
/// let pose = parse_pose("-120, 0, 350.5, -90, 45").unwrap();
/// assert_eq!(pose.position().x, -120.0);
/// assert!(parse_pose("1,2,3").is_err());
/// assert!(parse_pose("0,0,0,0,90.5").is_err());
/// ```
///
/// # Errors
/// Not five numbers, anything not finite, a pitch beyond +-90 degrees.
pub fn parse_pose(text: &str) -> Result<Pose, PoseTextError> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let found = parts.len();
    let parts: [&str; 5] = parts.try_into().map_err(|_| PoseTextError::Count { found })?;
    let mut numbers = [0.0; 5];
    for ((number, part), field) in numbers.iter_mut().zip(parts).zip(FIELDS) {
        *number = parse_number(part).ok_or_else(|| PoseTextError::NotANumber { field, text: part.to_owned() })?;
    }
    Ok(pose_of_numbers(numbers)?)
}

/// A pose from x, y, z in mm, heading and pitch in degrees. The heading is wrapped while it is still in degrees, where
/// a turn is a whole number: 190 is -170 to the last digit.
///
/// # Errors
/// As [`Pose::from_degrees`].
pub fn pose_of_numbers([x, y, z, heading, pitch]: [f64; 5]) -> Result<Pose, PoseError> {
    // The remainder of two doubles is exact.
    let mut wrapped = heading % 360.0;
    if wrapped > 180.0 {
        wrapped -= 360.0;
    } else if wrapped <= -180.0 {
        wrapped += 360.0;
    }
    // What is not finite must be refused with the value it had.
    Pose::from_degrees([x, y, z, if heading.is_finite() { wrapped } else { heading }, pitch])
}

/// A number from its text; spaces round it are tolerated. `nan` and `inf` pass, so that who checks the range can name
/// them.
#[must_use]
pub fn parse_number(text: &str) -> Option<f64> {
    // Adding zero makes -0 plain 0, so that it is written as people expect.
    text.trim().parse::<f64>().ok().map(|number| number + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::degrees::shortest_heading;

    #[test]
    fn spaces_signs_and_exponents_are_read() {
        let pose = parse_pose(" -1.5 ,+2,\t3e2, -0 ,-90").unwrap();
        assert_eq!(pose.to_degrees()[..3], [-1.5, 2.0, 300.0]);
        assert!(pose.heading().is_sign_positive());
    }

    #[test]
    fn headings_are_wrapped_to_the_last_digit() {
        for (typed, wrapped) in [("190", -170.0), ("-190", 170.0), ("-180", 180.0), ("180", 180.0), ("3600030", 30.0)] {
            let pose = parse_pose(&format!("0,0,0,{typed},0")).unwrap();
            assert_eq!(shortest_heading(pose.heading()), wrapped, "{typed}");
        }
    }

    #[test]
    fn what_is_no_pose_is_refused_with_what_it_was() {
        for (text, part) in [
            ("", "this is 1"),
            ("1,2,3,4", "this is 4"),
            ("1,2,3,4,5,6", "this is 6"),
            ("1,2,3,4,", "pitch is \"\""),
            ("1,two,3,4,5", "y is \"two\""),
            ("1,2,nan,4,5", "z is NaN"),
            ("1,2,3,inf,5", "heading is inf"),
            ("1e999,2,3,4,5", "x is inf"),
            ("1e8,2,3,4,5", "x is 100000000 mm"),
            ("-1e308,2,3,4,5", "x is -1e308 mm: keep coordinates within 10000000 mm"),
            ("1,2,3,4,-1e300", "pitch is -1e300 deg"),
            ("1,2,3,4,90.01", "pitch is 90.01 deg"),
            ("1;2;3;4;5", "this is 1"),
        ] {
            let message = parse_pose(text).unwrap_err().to_string();
            assert!(message.contains(part), "{text:?}: {message}");
        }
    }
}
