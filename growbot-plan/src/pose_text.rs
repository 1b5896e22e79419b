//! Text form of poses, positions, lengths and angles: `X,Y,Z,HEADING,PITCH` or `X,Y,Z`, separated by commas or spaces,
//! with or without brackets. Lengths are in mm or have the unit `mm`, `cm`, `m`, `in` or `ft`. Angles are in degrees or
//! have the unit `deg`, `°` or `rad`.

use growbot_core::angle::degrees;
use growbot_core::pose::{Pose, PoseError, Position};
use nalgebra::Vector3;

use crate::plan::Goal;

/// Error of parsing a pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseTextError {
    /// The number of values is not five.
    #[error(
        "a pose is five numbers, X,Y,Z,HEADING,PITCH in mm and degrees, but this is {found}: give five, without spaces \
         or in quotes"
    )]
    Count {
        /// Number of values that the text contains.
        found: usize,
    },
    /// The number of values is neither three nor five.
    #[error(
        "a goal is X,Y,Z,HEADING,PITCH in mm and degrees, or X,Y,Z for any direction, but this is {found}: give \
         five or three, without spaces or in quotes"
    )]
    GoalCount {
        /// Number of values that the text contains, such as "2 numbers".
        found: String,
    },
    /// A value is not a valid length or angle.
    #[error("{field} is {text:?}, {error}")]
    NotANumber {
        /// Name of the field.
        field: &'static str,
        /// Value that the text contains.
        text: String,
        /// Reason why the value is not valid.
        #[source]
        error: QuantityError,
    },
    /// The five numbers are not a valid pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
}

/// Error of parsing a length or an angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum QuantityError {
    /// The text is not a length.
    #[error("which is not a length: write a length like -120, 60cm, 0.6m, 24in or 2ft")]
    Length,
    /// The text is not an angle.
    #[error("which is not an angle: write an angle like -45, 90deg, 90° or 1.57rad")]
    Angle,
}

const FIELDS: [&str; 5] = ["x", "y", "z", "heading", "pitch"];

/// A parsed length in mm, or a parsed angle in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Value in mm or degrees, also if the text has another unit.
    pub value: f64,
    /// True if the text contains a unit.
    pub has_unit: bool,
}

/// Units of lengths: a number of them is multiplied by this power of ten and by this factor to get mm.
const LENGTH_UNITS: [(&str, i32, f64); 5] =
    [("mm", 0, 1.0), ("cm", 1, 1.0), ("m", 3, 1.0), ("in", 0, 25.4), ("ft", 0, 304.8)];

/// Parses a length in mm, or with its unit: `mm`, `cm`, `m`, `in` (25.4 mm) or `ft` (304.8 mm).
///
/// ```
/// use growbot_plan::pose_text::parse_length;
/// assert_eq!(parse_length("600").unwrap().value, 600.0);
/// assert_eq!(parse_length("0.6m").unwrap().value, 600.0);
/// assert!(parse_length("6deg").is_err());
/// ```
///
/// # Errors
/// If the text is not a number, or has another unit.
pub fn parse_length(text: &str) -> Result<Quantity, QuantityError> {
    let text = text.trim();
    let unit = LENGTH_UNITS.iter().find_map(|(unit, power, factor)| Some((text.strip_suffix(unit)?, power, factor)));
    let quantity = match unit {
        Some((number, power, factor)) => parse_decimal(number.trim(), *power).map(|mm| with_unit(mm * factor)),
        None => parse_number(text).map(without_unit),
    };
    quantity.ok_or(QuantityError::Length)
}

/// Parses an angle in degrees, or with its unit: `deg`, `°` or `rad`.
///
/// ```
/// use growbot_plan::pose_text::parse_angle;
/// assert_eq!(parse_angle("-90deg").unwrap().value, -90.0);
/// assert!((parse_angle("1.57rad").unwrap().value - 89.95437383553924).abs() < 1e-12);
/// ```
///
/// # Errors
/// If the text is not a number, or has another unit.
pub fn parse_angle(text: &str) -> Result<Quantity, QuantityError> {
    let text = text.trim();
    let quantity = match (text.strip_suffix("deg").or(text.strip_suffix('°')), text.strip_suffix("rad")) {
        (Some(number), _) => parse_number(number).map(with_unit),
        (None, Some(number)) => parse_number(number).map(degrees).map(with_unit),
        (None, None) => parse_number(text).map(without_unit),
    };
    quantity.ok_or(QuantityError::Angle)
}

fn with_unit(value: f64) -> Quantity {
    Quantity { value, has_unit: true }
}

fn without_unit(value: f64) -> Quantity {
    Quantity { value, has_unit: false }
}

/// Parses a number and multiplies it by this power of ten. The decimal point is shifted in the text, so that 0.55 m
/// gives exactly 550 mm.
fn parse_decimal(number: &str, power: i32) -> Option<f64> {
    let parsed = parse_number(number)?;
    let by_decimals = if number.contains(['e', 'E']) { None } else { parse_number(&format!("{number}e{power}")) };
    by_decimals.or(Some(parsed * libm::pow(10.0, f64::from(power))))
}

/// Splits a text into its values: at commas, or else at spaces. Brackets and quotes around the whole text do not count.
fn split_values(mut text: &str) -> Vec<&str> {
    let inner = |text: &'_ str| -> Option<_> {
        let pairs = [('(', ')'), ('[', ']'), ('"', '"'), ('\'', '\'')];
        pairs.iter().find_map(|(open, close)| Some(text.strip_prefix(*open)?.strip_suffix(*close)?.len()))
    };
    text = text.trim();
    while let Some(length) = inner(text) {
        text = text.get(1..=length).unwrap_or_default().trim();
    }
    if text.contains(',') || text.is_empty() {
        return text.split(',').map(str::trim).collect();
    }
    text.split_whitespace().collect()
}

/// A parsed goal, and the values that were given without a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct TypedGoal {
    /// The goal: a pose or a position.
    pub goal: Goal,
    /// True if x, y and z were all given without a unit.
    pub bare_lengths: bool,
    /// Angles that were given without a unit, degrees.
    pub bare_angles: Vec<f64>,
}

/// Parses a goal: a pose `X,Y,Z,HEADING,PITCH`, or a position `X,Y,Z`.
///
/// ```
/// use growbot_plan::{plan::Goal, pose_text::parse_goal};
/// assert!(matches!(parse_goal("200, 100, 600, 0, 45").unwrap().goal, Goal::Pose(_)));
/// assert!(matches!(parse_goal("0.2m,0.1m,0.6m").unwrap().goal, Goal::Position(_)));
/// ```
///
/// # Errors
/// If the text does not have three or five values, a value has a wrong unit or is not finite, or the pitch is beyond
/// +-90 degrees.
pub fn parse_goal(text: &str) -> Result<TypedGoal, PoseTextError> {
    let parts = split_values(text);
    let count = |found: usize| match found {
        1 => "1 number".to_owned(),
        found => format!("{found} numbers"),
    };
    if ![3, 5].contains(&parts.len()) {
        return Err(PoseTextError::GoalCount { found: count(parts.len()) });
    }
    let mut numbers = [without_unit(0.0); 5];
    for ((number, part), field) in numbers.iter_mut().zip(&parts).zip(FIELDS) {
        *number = quantity(field, part)?;
    }
    let [x, y, z, heading, pitch] = numbers.map(|number| number.value);
    let goal = if parts.len() == 3 {
        Goal::Position(Position::new(Vector3::new(x, y, z))?)
    } else {
        Goal::Pose(pose_of_numbers([x, y, z, heading, pitch])?)
    };
    let typed = numbers.get(..parts.len()).unwrap_or_default();
    let (lengths, angles) = typed.split_at(3);
    Ok(TypedGoal {
        goal,
        bare_lengths: lengths.iter().all(|length| !length.has_unit),
        bare_angles: angles.iter().filter(|angle| !angle.has_unit).map(|angle| angle.value).collect(),
    })
}

/// Parses the value of a field of a pose: a length for x, y and z, an angle for heading and pitch.
fn quantity(field: &'static str, text: &str) -> Result<Quantity, PoseTextError> {
    let parsed =
        if FIELDS.iter().take(3).any(|length| *length == field) { parse_length(text) } else { parse_angle(text) };
    parsed.map_err(|error| PoseTextError::NotANumber { field, text: text.to_owned(), error })
}

/// Parses a pose `X,Y,Z,HEADING,PITCH`.
///
/// ```
/// use growbot_plan::pose_text::parse_pose;
/// let pose = parse_pose("-120, 0, 350.5, -90, 45").unwrap();
/// assert_eq!(pose.position().x, -120.0);
/// assert!(parse_pose("1,2,3").is_err());
/// assert!(parse_pose("0,0,0,0,90.5").is_err());
/// ```
///
/// # Errors
/// Like [`parse_goal`], and if the text does not have five values.
pub fn parse_pose(text: &str) -> Result<Pose, PoseTextError> {
    parse_typed_pose(text).map(|(pose, _)| pose)
}

/// Like [`parse_pose`], but also returns which values were given without a unit.
///
/// # Errors
/// Like [`parse_pose`].
pub fn parse_typed_pose(text: &str) -> Result<(Pose, TypedGoal), PoseTextError> {
    let found = split_values(text).len();
    if found != FIELDS.len() {
        return Err(PoseTextError::Count { found });
    }
    let typed = parse_goal(text)?;
    match typed.goal {
        Goal::Pose(pose) => Ok((pose, typed)),
        Goal::Position(_) => Err(PoseTextError::Count { found }),
    }
}

/// Creates a pose from x, y, z in mm, heading and pitch in degrees. The heading is wrapped to (-180, 180] before the
/// conversion to radians, so that 190 gives exactly the same pose as -170.
///
/// # Errors
/// Like [`Pose::from_degrees`].
pub fn pose_of_numbers([x, y, z, heading, pitch]: [f64; 5]) -> Result<Pose, PoseError> {
    // The remainder of two doubles is exact.
    let mut wrapped = heading % 360.0;
    if wrapped > 180.0 {
        wrapped -= 360.0;
    } else if wrapped <= -180.0 {
        wrapped += 360.0;
    }
    // An error must contain the original value of a heading that is not finite.
    Pose::from_degrees([x, y, z, if heading.is_finite() { wrapped } else { heading }, pitch])
}

/// Parses a temperature in degrees Celsius, or with its unit: `C` or `F`, with or without `°`. Returns degrees Celsius,
/// or `None` if it is not a finite number.
pub fn parse_temperature(text: &str) -> Option<f64> {
    let number = |text: &str| parse_number(text.trim_end().trim_end_matches('°'));
    let celsius = match text.strip_suffix(['F', 'f']) {
        Some(fahrenheit) => number(fahrenheit).map(|fahrenheit| (fahrenheit - 32.0) / 1.8),
        None => number(text.strip_suffix(['C', 'c']).unwrap_or(text)),
    };
    celsius.filter(|celsius| celsius.is_finite())
}

/// Parses a number with optional spaces around it. `None` if the text is not a number. `nan` and `inf` are accepted, so
/// that later checks of the range can report them.
pub fn parse_number(text: &str) -> Option<f64> {
    // Adding zero turns -0 into 0, so that it is printed as users expect.
    text.trim().parse::<f64>().ok().map(|number| number + 0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::degrees::shortest_heading;

    proptest! {
        #[test]
        fn each_spelling_of_a_number_has_the_same_value(hundredths in -1_000_000_i32..1_000_000) {
            let value = f64::from(hundredths) / 100.0;
            let lengths = [
                (format!("{value}mm"), 0.0),
                (format!(" {value} mm "), 0.0),
                (format!("{hundredths}e-3cm"), 1e-15),
                (format!("{hundredths}e-5 m"), 1e-15),
                (format!("{}in", value / 25.4), 1e-15),
                (format!("{}ft", value / 304.8), 1e-15),
            ];
            for (text, tolerance) in lengths {
                let typed = parse_length(&text).unwrap().value;
                prop_assert!((typed - value).abs() <= tolerance * value.abs(), "{text}: {typed}, not {value}");
            }
            let angles = [
                (format!("{value}deg"), 0.0), (format!("{value}°"), 0.0), (format!("{}rad", value.to_radians()), 1e-15),
            ];
            for (text, tolerance) in angles {
                let typed = parse_angle(&text).unwrap().value;
                prop_assert!((typed - value).abs() <= tolerance * value.abs(), "{text}: {typed}, not {value}");
            }
            for text in [format!("{value}C"), format!("{value} °C"), format!("{}F", value * 1.8 + 32.0)] {
                let typed = parse_temperature(&text).unwrap();
                prop_assert!((typed - value).abs() <= 1e-10, "{text}: {typed}, not {value}");
            }
        }
    }

    #[test]
    fn spaces_signs_and_exponents_are_parsed() {
        let pose = parse_pose(" -1.5 ,+2,\t3e2, -0 ,-90").unwrap();
        assert_eq!(pose.to_degrees()[..3], [-1.5, 2.0, 300.0]);
        assert!(pose.heading().is_sign_positive());
    }

    #[test]
    fn headings_are_wrapped_exactly() {
        for (typed, wrapped) in [("190", -170.0), ("-190", 170.0), ("-180", 180.0), ("180", 180.0), ("3600030", 30.0)] {
            let pose = parse_pose(&format!("0,0,0,{typed},0")).unwrap();
            assert_eq!(shortest_heading(pose.heading()), wrapped, "{typed}");
        }
    }

    #[test]
    fn units_give_the_same_numbers_as_mm_and_degrees() {
        for (typed, plain) in [
            ("600mm, 0.55m, -1.1 m, 90deg, 0rad", "600,550,-1100,90,0"),
            ("1e-3m,2 mm,.3m,-3.141592653589793rad,45 deg", "1,2,300,180,45"),
            ("10cm, 4in, 1ft, 90°, -0.5 deg", "100,101.6,304.8,90,-0.5"),
            ("100 0 300 0 45", "100,0,300,0,45"),
            ("100mm 0 30cm 90deg 45", "100,0,300,90,45"),
            ("(100, 0, 300, 0, 45)", "100,0,300,0,45"),
            ("\"(100 0 300 0 45)\"", "100,0,300,0,45"),
        ] {
            assert_eq!(parse_pose(typed), parse_pose(plain), "{typed}");
        }
        let typed = parse_goal("1m,2,3,0.5rad,4").unwrap();
        assert_eq!((typed.bare_lengths, typed.bare_angles), (false, vec![4.0]));
        assert!(parse_goal("1,2,3").unwrap().bare_lengths);
        for (text, part) in [("1,2", "this is 2 numbers"), ("1,2,3,4", "this is 4 numbers"), ("9", "this is 1 number:")]
        {
            let message = parse_goal(text).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        assert!(parse_length("1M").is_err() && parse_length("m").is_err() && parse_length("in").is_err());
        assert!(parse_angle("°").is_err() && parse_angle("1in").is_err());
    }

    #[test]
    fn invalid_poses_are_refused_and_quoted() {
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
            ("1,2mm,3deg,4,5", "z is \"3deg\", which is not a length: write a length like -120, 60cm, 0.6m"),
            ("1,2,3,4m,5", "heading is \"4m\", which is not an angle"),
            ("1,2,3,4,2rad", "pitch is 114.59"),
        ] {
            let message = parse_pose(text).unwrap_err().to_string();
            assert!(message.contains(part), "{text:?}: {message}");
        }
    }
}
