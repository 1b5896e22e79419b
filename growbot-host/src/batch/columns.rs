//! The header of a batch: the place of each column. Any order; two columns are optional.

use csv::ByteRecord;
use growbot_client::suggest::did_you_mean;

/// The columns that every batch has: `id`, then the start, then the goal.
pub const REQUIRED: [&str; 11] = [
    "id",
    "from_x_mm",
    "from_y_mm",
    "from_z_mm",
    "from_heading_deg",
    "from_pitch_deg",
    "to_x_mm",
    "to_y_mm",
    "to_z_mm",
    "to_heading_deg",
    "to_pitch_deg",
];
/// The columns that a batch may have; where one is absent or empty, the command's own setting applies.
pub const OPTIONAL: [&str; 2] = ["radius_mm", "planner"];

/// Why a header is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeaderError {
    /// A column that no batch has.
    #[error(
        "the header has an unknown column {name:?}{}; there may be {}, {}",
        suggestion(.name), REQUIRED.join(","), OPTIONAL.join(",")
    )]
    Unknown {
        /// Its name.
        name: String,
    },
    /// A column is not there.
    #[error("the header has no column {name}; it must have {}", REQUIRED.join(","))]
    Missing {
        /// Its name.
        name: &'static str,
    },
    /// A column is there twice.
    #[error("the header has column {name} twice: remove one")]
    Twice {
        /// Its name.
        name: &'static str,
    },
}

fn suggestion(name: &str) -> String {
    did_you_mean(name, REQUIRED.into_iter().chain(OPTIONAL))
}

/// Where each column stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// How many there are.
    pub count: usize,
    /// `id`.
    pub id: usize,
    /// The start: x, y, z, heading, pitch.
    pub from: [Column; 5],
    /// The goal: x, y, z, heading, pitch.
    pub to: [Column; 5],
    /// `radius_mm`.
    pub radius: Option<Column>,
    /// `planner`.
    pub planner: Option<Column>,
}

/// A column: its name and where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column {
    /// As in the header.
    pub name: &'static str,
    /// From 0.
    pub index: usize,
}

impl Columns {
    /// Finds the columns in a header.
    ///
    /// # Errors
    /// A column that is unknown, missing, or there twice.
    pub fn find(header: &ByteRecord) -> Result<Self, HeaderError> {
        let names: Vec<String> = header.iter().map(|name| String::from_utf8_lossy(name).trim().to_owned()).collect();
        let mut found = Vec::with_capacity(names.len());
        for (index, name) in names.iter().enumerate() {
            let known = REQUIRED.into_iter().chain(OPTIONAL).find(|known| known == name);
            let name = known.ok_or_else(|| HeaderError::Unknown { name: name.clone() })?;
            if found.iter().any(|column: &Column| column.name == name) {
                return Err(HeaderError::Twice { name });
            }
            found.push(Column { name, index });
        }
        let optional = |name: &str| found.iter().copied().find(|column| column.name == name);
        let required = |name: &'static str| optional(name).ok_or(HeaderError::Missing { name });
        let [id, fx, fy, fz, fh, fp, tx, ty, tz, th, tp] = REQUIRED;
        Ok(Self {
            count: names.len(),
            id: required(id)?.index,
            from: [required(fx)?, required(fy)?, required(fz)?, required(fh)?, required(fp)?],
            to: [required(tx)?, required(ty)?, required(tz)?, required(th)?, required(tp)?],
            radius: optional(OPTIONAL[0]),
            planner: optional(OPTIONAL[1]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(names: &[&str]) -> Result<Columns, HeaderError> {
        Columns::find(&ByteRecord::from(names.to_vec()))
    }

    #[test]
    fn columns_stand_in_any_order() {
        let mut names: Vec<&str> = REQUIRED.into_iter().chain([" planner "]).collect();
        names.reverse();
        let columns = find(&names).unwrap();
        assert_eq!((columns.count, columns.id, columns.radius), (12, 11, None));
        assert_eq!(columns.planner, Some(Column { name: "planner", index: 0 }));
        assert_eq!(columns.to[4], Column { name: "to_pitch_deg", index: 1 });
    }

    #[test]
    fn wrong_columns_are_named() {
        let mut names = REQUIRED;
        names[3] = "from_z";
        let message = find(&names).unwrap_err().to_string();
        assert!(message.contains("unknown column \"from_z\" (did you mean from_z_mm?)"), "{message}");
        names[3] = "radius_mm";
        assert_eq!(find(&names), Err(HeaderError::Missing { name: "from_z_mm" }));
        names[3] = "to_x_mm";
        assert_eq!(find(&names), Err(HeaderError::Twice { name: "to_x_mm" }));
        assert!(matches!(find(&[]), Err(HeaderError::Missing { name: "id" })));
    }
}
