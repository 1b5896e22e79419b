//! Loading of robot descriptions: built-in ones by name, or others from TOML files, with any presets of materials.
//!
//! The files in `robots/` are compiled into the program, so that no other files have to be installed. A user's own file
//! may have any name. Each description is checked in full ([`Robot::new`]) before it is used.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use growbot_core::robot::{Robot, RobotDescription, RobotError};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};

use crate::input::{self, InputError};
use crate::suggest::{did_you_mean, suggest};

/// Name of the default robot: robot A of the paper.
pub const DEFAULT: &str = "growbot-a";

/// Built-in robot descriptions: name of the robot, and text of its TOML file.
const BUILT_IN: [(&str, &str); 11] = [
    ("growbot-a", include_str!("../../robots/growbot-a.toml")),
    ("growbot-a1", include_str!("../../robots/growbot-a1.toml")),
    ("growbot-a2", include_str!("../../robots/growbot-a2.toml")),
    ("growbot-a3", include_str!("../../robots/growbot-a3.toml")),
    ("growbot-a4", include_str!("../../robots/growbot-a4.toml")),
    ("growbot-a5", include_str!("../../robots/growbot-a5.toml")),
    ("growbot-a6", include_str!("../../robots/growbot-a6.toml")),
    ("growbot-a7", include_str!("../../robots/growbot-a7.toml")),
    ("growbot-a8", include_str!("../../robots/growbot-a8.toml")),
    ("growbot-b", include_str!("../../robots/growbot-b.toml")),
    ("growbot-c", include_str!("../../robots/growbot-c.toml")),
];

/// Error of loading a robot description.
#[derive(Debug, thiserror::Error)]
pub enum RobotFileError {
    /// The name is neither a built-in name nor a file.
    #[error(
        "no robot or file {name:?}{}; built-in robots are {}",
        did_you_mean(.name, names()), names().collect::<Vec<_>>().join(", ")
    )]
    Unknown {
        /// Name that the user gave.
        name: String,
    },
    /// The file cannot be read.
    #[error("{0}")]
    Input(#[from] InputError),
    /// The file is not TOML, or has unknown or invalid keys.
    #[error("{file}, line {line}, column {column}: {reason}")]
    Toml {
        /// Name of the file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1, in characters.
        column: usize,
        /// Message of the TOML parser, with the likely key if one is misspelt.
        reason: String,
    },
    /// The description has all fields, but a value is beyond its limit.
    #[error("{file}: {error}")]
    Robot {
        /// Name of the file.
        file: String,
        /// The field, its value and its limit.
        #[source]
        error: RobotError,
    },
}

/// Settings of a material: a table `[materials.NAME]` of a robot file.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct MaterialPreset {
    /// Temperature of the nozzle, C. Defaults to `heater.target_c`.
    pub nozzle_c: Option<f64>,
    /// Length of filament that is pushed in to load the material, mm.
    #[serde(deserialize_with = "length")]
    #[cfg_attr(feature = "schema", schemars(range(min = 0)))]
    pub load_mm: f64,
    /// Length of filament that is pulled out to unload the material, mm.
    #[serde(deserialize_with = "length")]
    #[cfg_attr(feature = "schema", schemars(range(min = 0)))]
    pub unload_mm: f64,
    /// Length of filament that is pushed through the nozzle to purge it, mm.
    #[serde(deserialize_with = "length")]
    #[cfg_attr(feature = "schema", schemars(range(min = 0)))]
    pub purge_mm: f64,
}

/// Deserializes a length of filament, mm, which must be 0 or more. The direction of the move depends on the command.
fn length<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    let mm = f64::deserialize(from)?;
    if mm.is_finite() && mm >= 0.0 {
        Ok(mm)
    } else {
        Err(D::Error::custom(format!("{mm} mm is not a length of filament: give 0 mm or more")))
    }
}

impl Default for MaterialPreset {
    fn default() -> Self {
        Self { nozzle_c: None, load_mm: 60.0, unload_mm: 80.0, purge_mm: 30.0 }
    }
}

/// Returns the names of the built-in robots, in alphabetical order.
pub fn names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

/// Reports whether this is the name of a built-in robot.
pub fn is_built_in(name: &str) -> bool {
    names().any(|built_in| built_in == name)
}

/// Loads a built-in robot by its name, or else a robot from a TOML file (`-` for standard input).
///
/// ```
/// use growbot_plan::robot_file;
/// let robot = robot_file::load("growbot-a".as_ref()).unwrap();
/// assert!((robot.min_radius() - 98.2).abs() < 1e-9);
/// ```
///
/// # Errors
/// If the name is neither that of a built-in robot nor that of a file, the file cannot be read, or the description is
/// not valid.
pub fn load(name_or_file: &Path) -> Result<Robot, RobotFileError> {
    let (text, file) = text_of(name_or_file)?;
    parse(&text, &file)
}

/// Returns the TOML text of a built-in robot or else of a file, and the name of this text for error messages.
///
/// # Errors
/// If the name is neither that of a built-in robot nor that of a file, or the file cannot be read.
pub fn text_of(name_or_file: &Path) -> Result<(Cow<'static, str>, String), RobotFileError> {
    if let Some((name, text)) = BUILT_IN.iter().find(|(name, _)| name_or_file.as_os_str() == *name) {
        return Ok(((*text).into(), (*name).to_owned()));
    }
    match input::read_text(name_or_file) {
        Ok(text) => Ok((text.into(), input::display_name(name_or_file))),
        Err(InputError::Unreadable { name, error })
            if error.kind() == std::io::ErrorKind::NotFound && looks_like_a_name(name_or_file) =>
        {
            Err(RobotFileError::Unknown { name })
        }
        Err(error) => Err(error.into()),
    }
}

/// Parses a robot description from TOML. `file` is the name of the text in error messages.
///
/// # Errors
/// [`RobotFileError::Toml`] with line and column, or [`RobotFileError::Robot`].
pub fn parse(text: &str, file: &str) -> Result<Robot, RobotFileError> {
    materials(text, file)?;
    let text = only(text, |header| !is_of_materials(header));
    let description: RobotDescription = from_toml(&text, file)?;
    Robot::new(description).map_err(|error| RobotFileError::Robot { file: file.to_owned(), error })
}

/// Like [`materials`], but refuses temperatures that the board of the robot in this text does not accept. A stop does
/// not depend on them, so [`parse`] accepts them.
///
/// # Errors
/// Like [`parse`], and [`RobotFileError::Toml`] with the line of the temperature.
pub fn checked_materials(text: &str, file: &str) -> Result<BTreeMap<String, MaterialPreset>, RobotFileError> {
    let (materials, allowed) = (materials(text, file)?, parse(text, file)?.description().heater.preheat_range_c());
    for (name, preset) in &materials {
        if let Some(celsius) = preset.nozzle_c.filter(|celsius| !allowed.contains(celsius)) {
            let is_table = |(at, _): &(usize, &str)| {
                let (before, after) = text.split_at(*at);
                let is_name =
                    |after: &str| !after.starts_with(|next: char| next.is_alphanumeric() || "-_".contains(next));
                before.trim_end_matches(['"', '\'']).ends_with("materials.")
                    && after.get(name.len()..).is_some_and(is_name)
            };
            let table = text.match_indices(&**name).find(is_table).map_or(0, |(at, _)| at);
            let at = text.get(table..).and_then(|rest| rest.find("nozzle_c")).map_or(table, |at| table + at);
            let (line, column) = line_and_column(text, at);
            let (min, max) = (allowed.start(), allowed.end());
            let reason = format!(
                "materials.{name}.nozzle_c is {celsius} C: give {min} to {max} C, which the board accepts with this \
                 heater.max_c"
            );
            return Err(RobotFileError::Toml { file: file.to_owned(), line, column, reason });
        }
    }
    Ok(materials)
}

/// Parses a TOML text. `file` is the name of the text in error messages.
///
/// # Errors
/// [`RobotFileError::Toml`] with line and column, and the key that was probably meant.
pub fn from_toml<T: DeserializeOwned>(text: &str, file: &str) -> Result<T, RobotFileError> {
    toml::from_str(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start);
        let (line, column) = line_and_column(text, at);
        RobotFileError::Toml { file: file.to_owned(), line, column, reason: reason(&error) }
    })
}

/// Returns the material presets in the text of a robot file, by name of the material. They are not part of the robot's
/// description, and boards do not get them.
///
/// # Errors
/// [`RobotFileError::Toml`] with line and column.
pub fn materials(text: &str, file: &str) -> Result<BTreeMap<String, MaterialPreset>, RobotFileError> {
    #[derive(Deserialize, Default)]
    #[serde(default)]
    struct Materials {
        materials: BTreeMap<String, MaterialPreset>,
    }
    let text = only(text, is_of_materials);
    Ok(from_toml::<Materials>(&text, file)?.materials)
}

/// Reports whether this is the header of a TOML table with a material preset.
fn is_of_materials(header: &str) -> bool {
    let name = header.trim_start_matches('[').trim_start().strip_prefix("materials");
    header.starts_with('[') && name.is_some_and(|rest| rest.trim_start().starts_with(['.', ']']))
}

/// Returns the TOML text with only the tables for whose header `is_so` returns true. Other lines become empty, so that
/// line numbers in errors stay the same.
fn only(text: &str, is_so: impl Fn(&str) -> bool) -> String {
    let mut keeps = is_so("");
    let mut kept = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        if line.trim_start().starts_with('[') {
            keeps = is_so(line.trim_start());
        }
        let left_out = if line.ends_with('\n') { "\n" } else { "" };
        kept += if keeps { line } else { left_out };
    }
    kept
}

/// Reports whether a path has no directory and no extension, so that it is probably the name of a robot and not a file.
fn looks_like_a_name(path: &Path) -> bool {
    path.components().count() == 1 && path.extension().is_none()
}

/// Returns the message of a TOML error in one line, with the key that the user probably meant.
fn reason(error: &toml::de::Error) -> String {
    let message = error.message().replace('\n', "; ");
    // serde's form: unknown field `a`, expected one of `b`, `c`
    let mut quoted = message.split('`').skip(1).step_by(2);
    let meant = match (message.starts_with("unknown "), quoted.next()) {
        (true, Some(found)) => suggest(found, quoted),
        _ => None,
    };
    match meant {
        Some(meant) => format!("{message}; did you mean {meant}?"),
        None if message.starts_with("unknown field") => format!("{message}: remove or rename it"),
        None => message,
    }
}

/// Returns line and column, both from 1, of the byte at index `at` of a text.
fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before.get(line_start..).unwrap_or_default().chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Robots of the paper (Tables 1 and 3): name, planning radius (mm) and time per layer (s).
    const PAPER: [(&str, f64, f64); 11] = [
        ("growbot-a", 100.0, 18.0),
        ("growbot-a1", 100.0, 1.8),
        ("growbot-a2", 100.0, 0.18),
        ("growbot-a3", 300.0, 18.0),
        ("growbot-a4", 300.0, 1.8),
        ("growbot-a5", 300.0, 0.18),
        ("growbot-a6", 33.3, 18.0),
        ("growbot-a7", 33.3, 1.8),
        ("growbot-a8", 33.3, 0.18),
        ("growbot-b", 680.0, 522.0),
        ("growbot-c", 38.0, 0.002),
    ];

    #[test]
    fn materials_that_the_board_would_refuse_are_refused_where_they_stand() {
        let text = include_str!("../../robots/growbot-a.toml");
        let with = |tables: &str| checked_materials(&format!("{text}\n{tables}"), "mine.toml");
        for table in ["[materials.pla]\nnozzle_c = 210", "[ materials.pla ]\nnozzle_c = 210", "[materials]\npla = {}"] {
            with(table).unwrap();
        }
        for celsius in ["540", "-20", "20", "nan", "inf"] {
            let table =
                format!("[materials.pla-cf]\nnozzle_c = 210\n[materials.\"pla\"]\nload_mm = 10\nnozzle_c = {celsius}");
            let refused = with(&table).unwrap_err();
            let line = text.lines().count() + 6;
            assert!(matches!(refused, RobotFileError::Toml { line: at, .. } if at == line), "{refused:?}");
            assert!(refused.to_string().contains("materials.pla.nozzle_c is "), "{refused}");
            // A stop reads the robot only.
            parse(&format!("{text}\n{table}"), "mine.toml").unwrap();
        }
    }

    #[test]
    fn every_file_in_robots_is_built_in_by_name() {
        let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots");
        let mut files: Vec<String> = std::fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter_map(|name| name.strip_suffix(".toml").map(str::to_owned))
            .collect();
        files.sort();
        assert_eq!(names().collect::<Vec<_>>(), files);
        for (name, text) in BUILT_IN {
            assert_eq!(text, std::fs::read_to_string(format!("{directory}/{name}.toml")).unwrap());
            assert_eq!(parse(text, name).unwrap().name(), name);
        }
    }

    #[test]
    fn built_in_robots_match_the_paper() {
        assert_eq!(PAPER.map(|(name, ..)| name).to_vec(), names().collect::<Vec<_>>());
        for (name, radius, period) in PAPER {
            let robot = load(name.as_ref()).unwrap();
            let description = robot.description();
            assert_eq!(description.planning_radius_mm, radius, "{name}");
            assert_eq!(description.layer.period_s, period, "{name}");
            assert!(radius >= robot.min_radius(), "{name}: R_min is {}", robot.min_radius());
            // As in the paper, a full layer at the planning radius is exactly g * dt high.
            assert_eq!(robot.max_mean_height(1.0 / radius), description.layer.height_mm, "{name}");
        }
    }

    #[test]
    fn min_radius_of_robot_a_by_eq_7_is_98_20_mm() {
        let robot = load(DEFAULT.as_ref()).unwrap();
        assert_eq!(format!("{:.2}", robot.min_radius_by_packaging()), "98.20");
        assert_eq!(robot.min_radius(), robot.min_radius_by_packaging());
    }

    #[test]
    fn a_misspelt_key_is_reported_with_its_line_and_a_suggestion() {
        let (_, good) = BUILT_IN[0];
        let bad = good.replace("height_min_mm", "heigth_min_mm");
        let line = good.lines().position(|line| line.starts_with("height_min_mm")).unwrap() + 1;
        let message = parse(&bad, "my.toml").unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("my.toml, line {line}, column 1: unknown field `heigth_min_mm`")),
            "{message}"
        );
        assert!(message.ends_with("did you mean height_min_mm?"), "{message}");
    }

    #[test]
    fn other_errors_name_their_line() {
        let (_, good) = BUILT_IN[0];
        for (from, to, part) in [
            ("height_max_mm = 0.95", "height_max_mm = \"high\"", "invalid type: string \"high\""),
            ("planning_radius_mm = 100.0", "planning_radius_mm = 90.0", "planning_radius_mm is 90, below 98.2"),
            ("[wall]\nwidth_mm = 1.6", "[wall]\n", "missing field `width_mm`"),
            ("strategy = \"feed\"", "strategy = \"fead\"", "did you mean feed?"),
            ("[wall]", "[wall", "line "),
        ] {
            assert!(good.contains(from));
            let message = parse(&good.replace(from, to), "my.toml").unwrap_err().to_string();
            assert!(message.starts_with("my.toml") && message.contains(part), "{message}");
            assert!(!message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn an_unknown_robot_name_gets_a_suggestion() {
        let message = load("growbot_a".as_ref()).unwrap_err().to_string();
        assert!(message.contains("did you mean growbot-a?") && message.contains("growbot-a8, growbot-b"), "{message}");
        assert!(matches!(load("none.toml".as_ref()), Err(RobotFileError::Input(_))));
    }
}
