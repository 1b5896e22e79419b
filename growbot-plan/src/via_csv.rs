//! Intermediate poses and positions from a CSV file: `x,y,z` in mm and optionally `heading,pitch` in degrees.

use csv::{ReaderBuilder, StringRecord};
use growbot_core::pose::{PoseError, Position};
use nalgebra::Vector3;

use crate::plan::Goal;
use crate::pose_text::{parse_number, pose_of_numbers};
use crate::suggest::did_you_mean;

/// Names of the columns in the header, without and with the unit. The last two columns are optional.
pub const COLUMNS: [[&str; 2]; 5] =
    [["x", "x_mm"], ["y", "y_mm"], ["z", "z_mm"], ["heading", "heading_deg"], ["pitch", "pitch_deg"]];
/// Maximum number of lines after the header.
pub const MAX_GOALS: usize = 1000;

/// Errors of a file.
#[derive(Debug, thiserror::Error)]
pub enum ViaError {
    /// A column is unknown.
    #[error(
        "the header of the CSV file has an unknown column {name:?}{}: write x,y,z or x,y,z,heading,pitch",
        suggestion(.name)
    )]
    UnknownColumn {
        /// Name of the column.
        name: String,
    },
    /// A column is missing.
    #[error("the header of the CSV file has no column {name}: write x,y,z or x,y,z,heading,pitch")]
    MissingColumn {
        /// Name of the column.
        name: &'static str,
    },
    /// A column occurs twice.
    #[error("the header of the CSV file has column {name} twice: remove one of them")]
    DuplicateColumn {
        /// Name of the column.
        name: &'static str,
    },
    /// No line follows the header.
    #[error("the CSV file has no line after its header: write a line for each position on the way")]
    NoRows,
    /// The file has more lines than a plan can have legs.
    #[error("the CSV file has more than {MAX_GOALS} lines after its header: remove some, or plan in several parts")]
    TooManyRows,
    /// A line is invalid.
    #[error("line {line}: {error}")]
    InvalidRow {
        /// Number of the line, from 1, including the header.
        line: u64,
        /// Error of the line.
        #[source]
        error: LineError,
    },
    /// A line is not CSV.
    #[error("{0}")]
    Reading(#[source] csv::Error),
}

/// Errors of a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LineError {
    /// The line has more or fewer fields than the header.
    #[error("the line has {found} fields, but the header has {expected}: write a field for each column")]
    Fields {
        /// Number of fields of the line.
        found: usize,
        /// Number of fields of the header.
        expected: usize,
    },
    /// A field is not a number.
    #[error("{column} is {text:?}, which is not a number: write a number like -120 or 0.5")]
    NotANumber {
        /// Name of the column.
        column: &'static str,
        /// Text of the field.
        text: String,
    },
    /// Only one of the two angles is given.
    #[error(
        "{column} is empty, but the other angle is given: write both angles, or leave both empty for any direction"
    )]
    IncompleteDirection {
        /// Name of the column that is empty.
        column: &'static str,
    },
    /// The numbers are not a valid pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
}

fn suggestion(name: &str) -> String {
    did_you_mean(name, COLUMNS.into_iter().flatten())
}

/// Reads the poses and positions in a CSV text. A line without heading and pitch is a position.
///
/// ```
/// use growbot_plan::via_csv::read;
/// assert_eq!(read("x,y,z\n0,0,300\n200,0,400\n").unwrap().len(), 2);
/// let error = read("x,y,z\n0,0,3oo\n").unwrap_err();
/// assert_eq!(error.to_string(), "line 2: z is \"3oo\", which is not a number: write a number like -120 or 0.5");
/// ```
///
/// # Errors
/// The first error in the text.
pub fn read(text: &str) -> Result<Vec<Goal>, ViaError> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let header = record(lines.next().map_or("", |(_, line)| line))?;
    let columns = columns(&header)?;
    let mut goals = Vec::new();
    for (line, text) in lines {
        if goals.len() == MAX_GOALS {
            return Err(ViaError::TooManyRows);
        }
        let goal = goal(&record(text)?, &columns, header.len());
        goals.push(goal.map_err(|error| ViaError::InvalidRow { line, error })?);
    }
    if goals.is_empty() { Err(ViaError::NoRows) } else { Ok(goals) }
}

/// Parses a line into fields.
fn record(line: &str) -> Result<StringRecord, ViaError> {
    let mut record = StringRecord::new();
    let mut reader = ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
    reader.read_record(&mut record).map_err(ViaError::Reading)?;
    Ok(record)
}

/// Returns the index of each of the [`COLUMNS`] in the header. The index of an angle is `None` if the header does not
/// have it.
fn columns(header: &StringRecord) -> Result<[Option<usize>; 5], ViaError> {
    let mut found = [None; 5];
    for (index, name) in header.iter().enumerate() {
        let known = COLUMNS.iter().position(|names| names.contains(&name.trim()));
        let (place, [column, _]) = known
            .and_then(|known| Some((found.get_mut(known)?, COLUMNS.get(known)?)))
            .ok_or_else(|| ViaError::UnknownColumn { name: name.trim().to_owned() })?;
        if place.replace(index).is_some() {
            return Err(ViaError::DuplicateColumn { name: column });
        }
    }
    // The file has both angles or neither of them.
    let required = if found[3].is_some() || found[4].is_some() { 5 } else { 3 };
    for (place, [name, _]) in found.iter().zip(COLUMNS).take(required) {
        if place.is_none() {
            return Err(ViaError::MissingColumn { name });
        }
    }
    Ok(found)
}

fn goal(record: &StringRecord, columns: &[Option<usize>; 5], expected: usize) -> Result<Goal, LineError> {
    let found = record.len();
    if found != expected {
        return Err(LineError::Fields { found, expected });
    }
    let text = |place: Option<usize>| place.and_then(|place| record.get(place)).unwrap_or_default().trim();
    let [x, y, z, heading, pitch] = *columns;
    goal_of([("x", text(x)), ("y", text(y)), ("z", text(z)), ("heading", text(heading)), ("pitch", text(pitch))])
}

/// Returns the goal in five fields x, y, z, heading and pitch, each with the name of its column. If both angles are
/// empty, the goal is a position.
pub(crate) fn goal_of(fields: [(&'static str, &str); 5]) -> Result<Goal, LineError> {
    let [x, y, z, heading, pitch] = fields;
    let (x, y, z) = (number(x)?, number(y)?, number(z)?);
    match [heading.1, pitch.1].map(str::is_empty) {
        [true, true] => Ok(Goal::Position(Position::new(Vector3::new(x, y, z))?)),
        [true, false] => Err(LineError::IncompleteDirection { column: heading.0 }),
        [false, true] => Err(LineError::IncompleteDirection { column: pitch.0 }),
        [false, false] => Ok(Goal::Pose(pose_of_numbers([x, y, z, number(heading)?, number(pitch)?])?)),
    }
}

/// Parses a field with the name of its column.
pub(crate) fn number((column, text): (&'static str, &str)) -> Result<f64, LineError> {
    parse_number(text).ok_or_else(|| LineError::NotANumber { column, text: text.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_read_if_present() {
        let goals = read("\u{feff}heading_deg, pitch_deg,z,y_mm,x\r\n90,-45,3,2,1\n\n,,-3,-2e0,-1\n").unwrap();
        assert_eq!(goals[0], Goal::Pose(pose_of_numbers([1.0, 2.0, 3.0, 90.0, -45.0]).unwrap()));
        assert_eq!(goals[1], Goal::Position(Position::new(Vector3::new(-1.0, -2.0, -3.0)).unwrap()));
    }

    #[test]
    fn errors_are_reported_with_the_line() {
        for (text, part) in [
            ("", "the header of the CSV file has no column x:"),
            ("x,y\n1,2\n", "the header of the CSV file has no column z: write x,y,z or x,y,z,heading,pitch"),
            ("x,y,z,pitch\n", "the header of the CSV file has no column heading"),
            ("x,y,z,headin\n", "unknown column \"headin\" (did you mean heading?)"),
            ("x,y,z,x_mm\n", "the header of the CSV file has column x twice"),
            ("x,y,z\n", "has no line after its header"),
            ("x,y,z\n1,2,3\n\n1,2\n", "line 4: the line has 2 fields, but the header has 3"),
            ("x,y,z\n1,2,\n", "line 2: z is \"\", which is not a number"),
            ("x,y,z\n1,2,inf\n", "line 2: z is inf: give a finite number"),
            ("x,y,z\n1,2,1e8\n", "line 2: z is 100000000 mm: keep coordinates within"),
            ("x,y,z,heading,pitch\n1,2,3,4,91\n", "line 2: pitch is 91 deg"),
            ("x,y,z,heading,pitch\n1,2,3,4,\n", "line 2: pitch is empty, but the other angle is given"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(part), "{text:?}: {message}");
        }
        let long = "x,y,z\n".to_owned() + &"1,2,3\n".repeat(MAX_GOALS + 1);
        assert!(matches!(read(&long), Err(ViaError::TooManyRows)));
    }
}
