//! Header of a batch, which gives the position of each column. The columns can be in any order.

use csv::ByteRecord;

use crate::suggest::did_you_mean;

/// Columns that every batch has: the query's name and the goal's position.
pub const REQUIRED: [&str; 4] = ["id", "to_x_mm", "to_y_mm", "to_z_mm"];
/// Columns of the goal's direction. Without them, or if both are empty, any direction is allowed.
pub const DIRECTION: [&str; 2] = ["to_heading_deg", "to_pitch_deg"];
/// Columns of the start pose. If they are absent or all empty, the start pose of the command line applies.
pub const START: [&str; 5] = ["from_x_mm", "from_y_mm", "from_z_mm", "from_heading_deg", "from_pitch_deg"];
/// Optional columns. If a column is absent or its field is empty, the option of the command line applies.
pub const OPTIONAL: [&str; 2] = ["radius_mm", "planner"];

/// Errors of a header.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeaderError {
    /// A column is unknown.
    #[error(
        "the header of the batch has an unknown column {name:?}{}: it must have {}, and may have {}, {}, {}",
        suggestion(.name), REQUIRED.join(","), DIRECTION.join(","), START.join(","), OPTIONAL.join(",")
    )]
    Unknown {
        /// Name of the column.
        name: String,
    },
    /// A column is missing.
    #[error("the header of the batch has no column {name}: it must have {}{}", REQUIRED.join(","), together(.name))]
    Missing {
        /// Name of the column.
        name: &'static str,
    },
    /// A column occurs twice.
    #[error("the header of the batch has column {name} twice: remove one of them")]
    Twice {
        /// Name of the column.
        name: &'static str,
    },
}

/// Returns all known columns.
fn known() -> impl Iterator<Item = &'static str> {
    REQUIRED.into_iter().chain(DIRECTION).chain(START).chain(OPTIONAL)
}

fn suggestion(name: &str) -> String {
    did_you_mean(name, known())
}

/// Returns the part of an error message that names the columns which are required together with column `name`. It is
/// empty if the column can be given alone.
fn together(name: &&'static str) -> String {
    let group = [&DIRECTION[..], &START].into_iter().find(|group| group.contains(name));
    group.map_or_else(String::new, |group| format!(", and all of {} or none", group.join(",")))
}

/// Positions of the columns in the header of a batch.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchColumns {
    /// Number of columns.
    pub count: usize,
    /// Index of `id`.
    pub id: usize,
    /// Columns of the start: x, y, z, heading, pitch. `None` if the header does not have them.
    pub from: Option<[Column; 5]>,
    /// Columns of the goal's position: x, y, z.
    pub to: [Column; 3],
    /// Columns of the goal's heading and pitch. `None` if the header does not have them.
    pub direction: Option<[Column; 2]>,
    /// Column `radius_mm`. `None` if the header does not have it.
    pub radius: Option<Column>,
    /// Column `planner`. `None` if the header does not have it.
    pub planner: Option<Column>,
}

/// A column with its name and position.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Column {
    /// Name in the header.
    pub name: &'static str,
    /// Index, from 0.
    pub index: usize,
}

impl BatchColumns {
    /// Finds the columns in a header.
    ///
    /// # Errors
    /// A column is unknown, missing, or occurs twice.
    pub fn find(header: &ByteRecord) -> Result<Self, HeaderError> {
        let names: Vec<String> = header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
        let mut found = Vec::with_capacity(names.len());
        for (index, name) in names.iter().enumerate() {
            let known = known().find(|known| known == name);
            let name = known.ok_or_else(|| HeaderError::Unknown { name: name.clone() })?;
            if found.iter().any(|column: &Column| column.name == name) {
                return Err(HeaderError::Twice { name });
            }
            found.push(Column { name, index });
        }
        let optional = |name: &str| found.iter().copied().find(|column| column.name == name);
        let [id, to @ ..] = all(&found, REQUIRED)?;
        Ok(Self {
            count: names.len(),
            id: id.index,
            from: all_or_none(&found, START)?,
            to,
            direction: all_or_none(&found, DIRECTION)?,
            radius: optional(OPTIONAL[0]),
            planner: optional(OPTIONAL[1]),
        })
    }
}

/// Returns the columns with these names. Returns an error if one of them is missing.
fn all<const N: usize>(found: &[Column], names: [&'static str; N]) -> Result<[Column; N], HeaderError> {
    let mut columns = [Column::default(); N];
    for (column, name) in columns.iter_mut().zip(names) {
        let known = found.iter().find(|column| column.name == name);
        *column = *known.ok_or(HeaderError::Missing { name })?;
    }
    Ok(columns)
}

/// Returns the columns with these names, or `None` if all of them are missing. Returns an error if only some are
/// missing.
fn all_or_none<const N: usize>(found: &[Column], names: [&'static str; N]) -> Result<Option<[Column; N]>, HeaderError> {
    if found.iter().any(|column| names.contains(&column.name)) { all(found, names).map(Some) } else { Ok(None) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(names: &[&str]) -> Result<BatchColumns, HeaderError> {
        BatchColumns::find(&ByteRecord::from(names.to_vec()))
    }

    #[test]
    fn columns_may_be_in_any_order() {
        let mut names: Vec<&str> = REQUIRED.into_iter().chain(START).chain(DIRECTION).chain([" planner "]).collect();
        names.reverse();
        let columns = find(&names).unwrap();
        assert_eq!((columns.count, columns.id, columns.radius), (12, 11, None));
        assert_eq!(columns.planner, Some(Column { name: "planner", index: 0 }));
        assert_eq!(columns.direction.unwrap()[1], Column { name: "to_pitch_deg", index: 1 });
        let least = find(&REQUIRED).unwrap();
        assert!(least.from.is_none() && least.direction.is_none());
    }

    #[test]
    fn wrong_columns_are_named() {
        let mut names: Vec<&str> = REQUIRED.into_iter().chain(START).collect();
        names[6] = "from_z";
        let message = find(&names).unwrap_err().to_string();
        assert!(message.contains("unknown column \"from_z\" (did you mean from_z_mm?)"), "{message}");
        names[6] = "radius_mm";
        let message = find(&names).unwrap_err().to_string();
        assert!(message.contains("no column from_z_mm") && message.contains("and all of from_x_mm,"), "{message}");
        names[6] = "to_z_mm";
        assert_eq!(find(&names), Err(HeaderError::Twice { name: "to_z_mm" }));
        assert!(matches!(find(&[]), Err(HeaderError::Missing { name: "id" })));
        assert!(matches!(
            find(&["id", "to_x_mm", "to_y_mm", "to_z_mm", "to_pitch_deg"]),
            Err(HeaderError::Missing { name: "to_heading_deg" })
        ));
    }
}
