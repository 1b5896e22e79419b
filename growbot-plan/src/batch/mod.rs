//! Planning of many queries from a CSV stream, in the order of the queries.
//!
//! Only one query is in memory at a time, so a stream can have any length. An invalid query gives an error as its
//! result, and the later queries are still planned. An invalid header is rejected before the first query.

mod columns;

use std::io::Read;

pub use columns::HeaderError;
use columns::{BatchColumns, Column};
use csv::{ByteRecord, Reader, ReaderBuilder};
use growbot_core::compact_number::CompactNumber;
use growbot_core::plan::{PlanError, Planner};
use growbot_core::pose::{Pose, PoseError};
use growbot_core::robot::Robot;
use serde::Serialize;
use serde::de::value::{Error as ValueError, StrDeserializer};
use serde::de::{Deserialize, IntoDeserializer};

use crate::plan::{Goal, Plan, PlanOptions};
use crate::plan_file::PlanFile;
use crate::pose_text::pose_of_numbers;
use crate::sanitize;
use crate::table::{NumberFormat, Table, pose_columns};
use crate::via_csv::{LineError, goal_of, number};

/// Errors that end a batch early.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// The header is invalid.
    #[error(transparent)]
    Header(#[from] HeaderError),
    /// Reading the CSV stream failed.
    #[error("cannot read the batch: {0}")]
    Reading(#[source] csv::Error),
}

/// Errors of a single query.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum QueryError {
    /// The line has more or fewer fields than the header.
    #[error("the line of the batch has {found} fields, but the header has {expected}: write a field for each column")]
    Fields {
        /// Number of fields of the line.
        found: usize,
        /// Number of fields of the header.
        expected: usize,
    },
    /// A field is not UTF-8.
    #[error("field {field} of the line is not UTF-8 text (at byte {position} of the field): save the batch as UTF-8")]
    NotText {
        /// Number of the field, from 1.
        field: usize,
        /// Position of the first invalid byte in the field, from 0.
        position: usize,
    },
    /// A field is not a number, or only one of two angles is given.
    #[error(transparent)]
    Field(#[from] LineError),
    /// The planner does not exist. The error lists the planners that exist.
    #[error("planner: {0}")]
    Planner(#[source] ValueError),
    /// The numbers are not a valid pose.
    #[error("{which}: {error}")]
    Pose {
        /// Prefix of the pose's columns: `from` or `to`.
        which: &'static str,
        /// Error of the pose.
        #[source]
        error: PoseError,
    },
    /// No path exists.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The path is longer than allowed.
    #[error("{0}")]
    TooLong(#[from] PathTooLong),
}

/// Error of a path that is longer than allowed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the shortest path found is {found:.1} mm long, but the maximum length is {} mm", CompactNumber(.max))]
pub struct PathTooLong {
    /// Length of the path, mm.
    pub found: f64,
    /// Maximum length, mm.
    pub max: f64,
}

/// Returns the plan if it is not longer than `max_length`, mm.
///
/// # Errors
/// [`PathTooLong`] if it is longer.
pub fn check_length_limit(plan: Plan, max_length: Option<f64>) -> Result<Plan, PathTooLong> {
    let found = plan.requirements.length;
    match max_length.filter(|max| found > *max) {
        Some(max) => Err(PathTooLong { found, max }),
        None => Ok(plan),
    }
}

/// Result of one query.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchResult {
    /// Name of the query, from its column `id`.
    pub id: String,
    /// Plan of the query, or the error.
    pub outcome: Result<Plan, QueryError>,
}

impl BatchResult {
    fn plan(&self) -> Option<&Plan> {
        self.outcome.as_ref().ok()
    }

    /// Returns the result as a row of CSV, with its newline. The row of a query that failed has only `id` and `error`,
    /// which is the text that `message` returns.
    pub fn to_row(&self, message: fn(&QueryError) -> String) -> String {
        answers(message).csv_row(self)
    }

    /// Returns the result as one line of JSON, with its newline: the plan with `"id"`, or `"id"` and `"error"`, which
    /// is the text that `message` returns.
    pub fn to_line(&self, robot: &Robot, message: fn(&QueryError) -> String) -> String {
        #[derive(Serialize)]
        struct FailedQuery<'a> {
            id: &'a str,
            error: String,
        }
        match &self.outcome {
            Ok(plan) => PlanFile { id: Some(self.id.clone()), ..PlanFile::with_robot(plan, robot) }.to_line(),
            Err(error) => {
                let failed = FailedQuery { id: &self.id, error: message(error) };
                sanitize::json_line(&failed)
            }
        }
    }
}

/// Values for fields that a query omits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defaults {
    /// Start pose of the tip.
    pub start: Pose,
    /// Parameters of the path search.
    pub search: PlanOptions<'static>,
    /// Maximum length of the body, mm. `None` for any length.
    pub max_length: Option<f64>,
}

/// Returns the table of results. Numbers have full precision, and codes of warnings are separated by spaces. The text
/// of an error is the one that `message` returns.
pub fn answers(message: fn(&QueryError) -> String) -> Table<'static, BatchResult> {
    Table::new(NumberFormat::Shortest)
        .column("id", |result: &BatchResult| result.id.clone())
        .columns(pose_columns("to"), |result| {
            let goal = result.plan().map(|plan| PlanFile::from(plan).goal);
            let numbers = goal.map(|goal| [goal.x_mm, goal.y_mm, goal.z_mm, goal.heading_deg, goal.pitch_deg]);
            [0, 1, 2, 3, 4].map(|index| numbers.map(|numbers| numbers[index]))
        })
        .column("direction_free", |result| result.plan().map(Plan::has_free_direction))
        .column("planner", |result| result.plan().map(|plan| plan.planner.name()))
        .column("radius_mm", |result| result.plan().map(|plan| plan.radius))
        .column("path_type", |result| result.plan().map(Plan::path_type))
        .column("length_mm", |result| result.plan().map(|plan| plan.requirements.length))
        .column("layers", |result| result.plan().map(|plan| plan.requirements.layers))
        .column("duration_s", |result| result.plan().map(|plan| plan.requirements.duration))
        .column("filament_mm", |result| result.plan().map(|plan| plan.requirements.filament))
        .column("warnings", |result| {
            let warnings = result.plan().map(|plan| plan.warnings.iter());
            warnings.map(|all| all.map(|warning| warning.code.as_str()).collect::<Vec<_>>().join(" "))
        })
        .column("error", move |result| result.outcome.as_ref().err().map(message))
}

/// A batch that is being planned.
pub struct Batch<R> {
    reader: Reader<R>,
    columns: BatchColumns,
    record: ByteRecord,
    defaults: Defaults,
}

impl<R: Read> Batch<R> {
    /// Reads the header of the CSV stream `source`. `defaults` are for fields that a query omits.
    ///
    /// # Errors
    /// The header is missing or invalid, or the source cannot be read.
    pub fn open(source: R, defaults: Defaults) -> Result<Self, BatchError> {
        let mut reader = ReaderBuilder::new().flexible(true).from_reader(source);
        let columns = BatchColumns::find(reader.byte_headers().map_err(BatchError::Reading)?)?;
        Ok(Self { reader, columns, record: ByteRecord::new(), defaults })
    }

    /// Returns the number of bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.reader.position().byte()
    }

    /// Plans the next query. `None` at the end.
    ///
    /// # Errors
    /// [`BatchError::Reading`] if the source fails.
    pub fn next(&mut self, robot: &Robot) -> Result<Option<BatchResult>, BatchError> {
        if !self.reader.read_byte_record(&mut self.record).map_err(BatchError::Reading)? {
            return Ok(None);
        }
        let id = text_of(self.record.get(self.columns.id)).to_owned();
        Ok(Some(BatchResult { id, outcome: self.plan(robot) }))
    }

    fn plan(&self, robot: &Robot) -> Result<Plan, QueryError> {
        let (found, expected) = (self.record.len(), self.columns.count);
        if found != expected {
            return Err(QueryError::Fields { found, expected });
        }
        for (field, bytes) in (1..).zip(&self.record) {
            if let Err(error) = str::from_utf8(bytes) {
                return Err(QueryError::NotText { field, position: error.valid_up_to() });
            }
        }
        let (start, goal) = (self.start()?, self.goal()?);
        let PlanOptions { radius, planner, .. } = self.defaults.search;
        let radius = match self.columns.radius {
            Some(column) if !self.text(column).is_empty() => self.number(column)?,
            _ => radius,
        };
        let planner = match self.columns.planner {
            Some(column) if !self.text(column).is_empty() => planner_of_name(self.text(column))?,
            _ => planner,
        };
        let search = PlanOptions { radius, planner, ..self.defaults.search };
        Ok(check_length_limit(Plan::through_waypoints(robot, &start, &[], &goal, &search)?, self.defaults.max_length)?)
    }

    fn start(&self) -> Result<Pose, QueryError> {
        match self.columns.from {
            Some(columns) if columns.iter().any(|column| !self.text(*column).is_empty()) => {
                let wrong = |error| QueryError::Pose { which: "from", error };
                pose_of_numbers(self.numbers(columns)?).map_err(wrong)
            }
            _ => Ok(self.defaults.start),
        }
    }

    fn goal(&self) -> Result<Goal, QueryError> {
        let [x, y, z] = self.columns.to.map(|column| self.field(column));
        let direction = self.columns.direction.map(|columns| columns.map(|column| self.field(column)));
        let [heading, pitch] = direction.unwrap_or_default();
        goal_of([x, y, z, heading, pitch]).map_err(|error| match error {
            LineError::Pose(error) => QueryError::Pose { which: "to", error },
            error => error.into(),
        })
    }

    fn numbers<const N: usize>(&self, columns: [Column; N]) -> Result<[f64; N], QueryError> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(numbers)
    }

    fn number(&self, column: Column) -> Result<f64, QueryError> {
        Ok(number(self.field(column))?)
    }

    /// Returns the name of a column and the text of its field.
    fn field(&self, column: Column) -> (&'static str, &str) {
        (column.name, self.text(column))
    }

    /// Returns the text of a field without surrounding spaces.
    fn text(&self, column: Column) -> &str {
        text_of(self.record.get(column.index)).trim()
    }
}

/// Returns a field as text. The text is empty if the field is missing or is not UTF-8.
fn text_of(field: Option<&[u8]>) -> &str {
    str::from_utf8(field.unwrap_or_default()).unwrap_or_default()
}

/// Returns the planner with this name, as in plan files.
fn planner_of_name(name: &str) -> Result<Planner, QueryError> {
    let name: StrDeserializer<ValueError> = name.into_deserializer();
    Planner::deserialize(name).map_err(QueryError::Planner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_text::parse_pose;
    use crate::robot_file;

    const HEADER: &str = "id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,\
                          to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg";

    fn defaults() -> Defaults {
        let search =
            PlanOptions { radius: 100.0, planner: Planner::TwoPlane, avoid_self_collision: false, existing: None };
        Defaults { start: parse_pose("0,0,0,0,90").unwrap(), search, max_length: None }
    }

    fn answers(text: &str) -> Vec<BatchResult> {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let mut batch = Batch::open(text.as_bytes(), defaults()).unwrap();
        let mut answers = Vec::new();
        while let Some(answer) = batch.next(&robot).unwrap() {
            answers.push(answer);
        }
        answers
    }

    #[test]
    fn every_query_has_a_result_in_order_and_errors_are_isolated() {
        let answers = answers(&format!(
            "\u{feff}{HEADER},radius_mm,planner\r\n\
             a, 0, 0, 0, 0, 90, 0, 0, 500, 0, 90,,\r\n\
             b,0,0,0,0,90,0,0,500,0,95,,\n\
             \"c, d\",0,0,0,0,90,0,0,500,0,90,150,two-plane\n\
             \n\
             e,0,0,0,0,90,0,0,5oo,0,90,,\n\
             f,0,0,0,0,90\n\
             g,0,0,0,0,90,0,0,500,0,90,50,\n\
             h,0,0,0,0,90,0,0,500,0,90,,teleport\n\
             i,0,0,0,0,90,0,0,nan,0,90,,\n\
             ,0,0,0,0,90,0,0,500,0,90,,\n"
        ));
        let ids: Vec<&str> = answers.iter().map(|answer| answer.id.as_str()).collect();
        assert_eq!(ids, ["a", "b", "c, d", "e", "f", "g", "h", "i", ""]);
        let error = |i: usize| answers[i].outcome.as_ref().unwrap_err().to_string();
        assert_eq!(answers[0].outcome.as_ref().unwrap().radius, 100.0);
        assert_eq!(answers[2].outcome.as_ref().unwrap().radius, 150.0);
        assert!(answers[8].outcome.is_ok());
        for (index, part) in [
            (1, "to: pitch is 95 deg"),
            (3, "to_z_mm is \"5oo\""),
            (4, "6 fields, but the header has 13"),
            (5, "bends is 50 mm, below R_min = 98.2 mm"),
            (6, "unknown variant `teleport`, expected `two-plane`"),
            (7, "to: z is NaN"),
        ] {
            assert!(error(index).contains(part), "{}", error(index));
        }
    }

    #[test]
    fn an_output_line_has_the_plan_and_its_id_or_the_error() {
        let answers = answers(&format!("{HEADER}\n7,0,0,0,0,90,0,0,500,0,90\n8,0\n"));
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let (plan, error) =
            (answers[0].to_line(&robot, ToString::to_string), answers[1].to_line(&robot, ToString::to_string));
        assert!(plan.starts_with("{\"id\":\"7\",\"format\":\"growbot-plan/1\"") && plan.ends_with("}\n"));
        assert_eq!(
            error,
            "{\"id\":\"8\",\"error\":\"the line of the batch has 2 fields, but the header has 11: write a field for \
             each column\"}\n"
        );
        assert_eq!(plan.matches('\n').count(), 1);
    }

    #[test]
    fn starts_and_directions_are_optional() {
        let short = answers("to_x_mm,id,to_y_mm,to_z_mm\n200,a,0,400\n0,b,0,nan\n");
        let plan = short[0].outcome.as_ref().unwrap();
        assert_eq!(plan.start, parse_pose("0,0,0,0,90").unwrap());
        assert!(plan.has_free_direction());
        assert!(short[1].outcome.as_ref().unwrap_err().to_string().contains("to: z is NaN"));
        let mixed = answers(&format!(
            "{HEADER}\n1,,,,,,200,0,400,,\n2,1,2,3,4,5,200,0,400,90,0\n3,1,,,,,200,0,400,,\n4,,,,,,200,0,400,1,\n"
        ));
        let plan = |index: usize| mixed[index].outcome.as_ref().unwrap();
        assert!(plan(0).has_free_direction() && !plan(1).has_free_direction());
        assert_eq!(plan(1).start, parse_pose("1,2,3,4,5").unwrap());
        let error = |index: usize| mixed[index].outcome.as_ref().unwrap_err().to_string();
        assert!(error(2).contains("from_y_mm is \"\""), "{}", error(2));
        assert!(error(3).contains("to_pitch_deg is empty, but the other angle is given"), "{}", error(3));
    }

    #[test]
    fn rows_have_exact_numbers_and_as_many_fields_as_the_header() {
        let answers = answers("id,to_x_mm,to_y_mm,to_z_mm\n\"a, b\",200,1e-14,400.1\nc,0,0,x\n");
        let rows: String = super::answers(ToString::to_string).csv_header()
            + &answers[0].to_row(ToString::to_string)
            + &answers[1].to_row(ToString::to_string);
        let mut reader = ReaderBuilder::new().from_reader(rows.as_bytes());
        let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        let plan = answers[0].outcome.as_ref().unwrap();
        let mut field = |row: usize, name: &str| {
            let index = reader.headers().unwrap().iter().position(|column| column == name).unwrap();
            records[row][index].to_owned()
        };
        assert_eq!(
            (field(0, "id"), field(0, "to_y_mm"), field(0, "to_z_mm")),
            ("a, b".into(), "1e-14".into(), "400.1".into())
        );
        assert_eq!(field(0, "length_mm").parse::<f64>().unwrap(), plan.requirements.length);
        assert_eq!((field(0, "direction_free"), field(0, "error")), ("true".into(), String::new()));
        assert_eq!((field(1, "length_mm"), field(1, "id")), (String::new(), "c".into()));
        assert!(field(1, "error").contains("to_z_mm is"));
    }

    #[test]
    fn invalid_utf8_affects_only_its_line() {
        let mut bytes = format!("{HEADER}\n1,0,0,0,0,90,0,0,5").into_bytes();
        bytes.extend(b"\xff,0,90\n\xc3(,0,0,0,0,90,0,0,500,0,90\n3,0,0,0,0,90,0,0,500,0,90\n");
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let mut batch = Batch::open(&bytes[..], defaults()).unwrap();
        let mut next = || batch.next(&robot).unwrap();
        let (coordinate, id, sound) = (next().unwrap(), next().unwrap(), next().unwrap());
        assert_eq!(coordinate.outcome, Err(QueryError::NotText { field: 9, position: 1 }));
        // A name that is not UTF-8 counts as no name. It is not replaced by another one.
        assert_eq!((id.id.as_str(), id.outcome), ("", Err(QueryError::NotText { field: 1, position: 0 })));
        assert!(sound.outcome.is_ok() && next().is_none());
    }
}
