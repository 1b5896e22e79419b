//! Formats of bodies and drawings in files.

use std::path::Path;

use clap::ValueEnum;
use growbot_host::output::{OutputError, is_standard_output, print, refuse_terminal};
use growbot_pictures::drawing::pdf::svg_to_pdf;
use growbot_pictures::drawing::png::png;
use growbot_plan::atomic_file::{FileError, format_from_extension};
use growbot_plan::file_report::FileReport;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::sanitize::json_line;
use strum::IntoStaticStr;

use super::failure::Failure;

/// Format of a body or a drawing in a file. Those of `growbot export` are values of its option `--format`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum OutputFormat {
    /// The wall: binary STL, mm
    Stl,
    /// The wall: Wavefront OBJ, mm
    Obj,
    /// The wall: 3MF for slicers, mm
    #[value(name = "3mf")]
    #[strum(serialize = "3mf")]
    ThreeMf,
    /// The wall: glTF 2.0 in one file, metres
    Glb,
    /// Centreline and layers
    Csv,
    /// The tip's trajectory: time, position, quaternion
    Tum,
    /// A recording for Foxglove or ROS 2, from a run log
    Mcap,
    /// A page
    #[value(skip)]
    Html,
    /// A drawing
    #[value(skip)]
    Svg,
    /// A drawing in pixels
    #[value(skip)]
    Png,
    /// A drawing with letters as outlines
    #[value(skip)]
    Pdf,
    /// A result
    #[value(skip)]
    Json,
}

/// Prints the report of a written file, which shows a robot of this kind, as one line of JSON.
pub fn print_file_report(path: &Path, format: OutputFormat, bytes: usize, robot: RobotKind) -> Result<(), Failure> {
    let simulated = robot.is_simulated();
    let report = FileReport { file: path.display().to_string(), format: format.ending(), bytes, simulated };
    Ok(print(&json_line(&report))?)
}

impl OutputFormat {
    /// Formats of drawings.
    pub const DRAWINGS: [Self; 3] = [Self::Svg, Self::Png, Self::Pdf];
    /// Default width of a PNG, pixels.
    pub const PNG_WIDTH: u32 = 1600;

    /// Returns the extension of files in this format.
    pub fn ending(self) -> &'static str {
        self.into()
    }

    /// Returns the one of these formats that has the extension of a file. `None` for a name without an extension, and
    /// for standard output.
    pub fn of(file: &Path, formats: &[Self]) -> Result<Option<Self>, FileError> {
        let endings: Vec<_> = formats.iter().map(|format| format.ending()).collect();
        let ending = format_from_extension(file, &endings)?;
        Ok(formats.iter().copied().find(|format| Some(format.ending()) == ending))
    }

    /// Returns an error if the output would go to a terminal that cannot show the format. Without a file, the output
    /// goes to standard output.
    pub fn check_destination(self, file: Option<&Path>) -> Result<(), OutputError> {
        let is_text = matches!(self, Self::Csv | Self::Obj | Self::Tum | Self::Html | Self::Svg | Self::Json);
        if !is_text && file.is_none_or(is_standard_output) { refuse_terminal() } else { Ok(()) }
    }

    /// Converts a drawing from SVG to this format. A PNG has this width, pixels.
    pub fn drawn(self, svg: String, width: u32) -> Result<Vec<u8>, Failure> {
        match self {
            Self::Png => Ok(png(&svg, width)?),
            Self::Pdf => svg_to_pdf(&svg).map_err(Failure::bad_input),
            _ => Ok(svg.into_bytes()),
        }
    }
}
