//! Plans as JSON, in the format `growbot-plan/1`: mm and degrees, numbers in full precision.
//!
//! [`PlanFile::parse`] checks the fields and their types. [`PlanFile::check`] checks that the plan is consistent and
//! was made for a robot. [`open`] does both.

mod check;
mod check_error;
pub(crate) mod json;
mod layer_row;

use std::path::Path as FilePath;

use growbot_core::robot::Robot;
use growbot_scene::scene_file::LoadedScene;
use serde::Deserialize;

pub use self::check::pose_from_json;
pub use self::check_error::PlanCheckError;
pub use self::json::{FORMAT, GoalJson, LegJson, PlanFile, PoseJson, SceneRefJson, SegmentJson, TipPoseJson};
pub use self::layer_row::{LayerRow, layer_rows, layer_values};
use crate::input::{self, InputError};
use crate::margin::near_obstacle;
use crate::plan::Plan;
use crate::robot_file::{self, RobotFileError};
use crate::scene_planning::{self, SceneCheckError};
use crate::warning::NEAR_OBSTACLE;

/// Error of reading a plan file.
#[derive(Debug, thiserror::Error)]
pub enum PlanFileError {
    /// The file cannot be read.
    #[error("{0}")]
    Input(#[from] InputError),
    /// The JSON text ends in the middle of the plan.
    #[error(
        "{file} ends in the middle of the plan, at line {line}: the file is incomplete; copy it again, or plan again"
    )]
    Truncated {
        /// Name of the plan file.
        file: String,
        /// Number of the line at which the text ends, from 1.
        line: usize,
    },
    /// The file is not JSON.
    #[error("{file} is not JSON ({error})")]
    NotJson {
        /// Name of the plan file.
        file: String,
        /// Error of the JSON parser with its position.
        error: serde_json::Error,
    },
    /// The file is the CSV table of the layers of a plan.
    #[error("{file} is a table of layers in CSV, which does not contain the plan")]
    LayerCsv {
        /// Name of the file.
        file: String,
    },
    /// The plan has another version of the format.
    #[error("{file} has format {found:?}, but this version of growbot reads {FORMAT:?}: plan again with this version")]
    OtherFormat {
        /// Name of the plan file.
        file: String,
        /// Format that the file names.
        found: String,
    },
    /// The text is JSON, but not a plan.
    #[error("{file} is not a plan ({error})")]
    NoPlan {
        /// Name of the plan file.
        file: String,
        /// Error of the JSON parser with its position.
        error: serde_json::Error,
    },
    /// The plan does not contain the description of its robot, and that robot is not built in.
    #[error(
        "{file} is a plan for robot {robot:?}, but it contains no description of this robot, and the robot is not \
         built in: give the robot's file"
    )]
    UnknownRobot {
        /// Name of the plan file.
        file: String,
        /// Name of the plan's robot.
        robot: String,
    },
    /// The robot's description is not valid.
    #[error("{0}")]
    Robot(#[from] RobotFileError),
    /// The scene of the plan cannot be loaded, has changed, or the plan is not clear of it.
    #[error("{0}")]
    Scene(#[from] SceneCheckError),
    /// The plan is not consistent, or was made for another robot.
    #[error("{file}: {fault}")]
    Fault {
        /// Name of the plan file.
        file: String,
        /// Error of the failed check.
        #[source]
        fault: PlanCheckError,
    },
}

/// First columns of the CSV table of layers.
pub const LAYER_CSV_BEGIN: &str = "layer,segment,";

/// The field `format` of a plan file. It is parsed alone first, to distinguish a plan of another version from an
/// invalid file.
#[derive(Deserialize)]
struct Version {
    format: String,
}

impl PlanFile {
    /// Parses the JSON text of a plan. `file` is the name of the plan file in error messages.
    ///
    /// # Errors
    /// If the text is incomplete, is not JSON, has another version of the format, or has other fields than a plan.
    pub fn parse(text: &str, file: &str) -> Result<Self, PlanFileError> {
        let file = || file.to_owned();
        let classify = |error: serde_json::Error| match error.classify() {
            serde_json::error::Category::Eof => PlanFileError::Truncated { file: file(), line: error.line() },
            serde_json::error::Category::Data => PlanFileError::NoPlan { file: file(), error },
            // For serde_json, a cut inside a number, such as after `100.`, is not an "end of file".
            _ if text.ends_with(['.', '-', '+', 'e', 'E']) && error.to_string().starts_with("invalid number") => {
                PlanFileError::Truncated { file: file(), line: error.line() }
            }
            _ if text.starts_with(LAYER_CSV_BEGIN) => PlanFileError::LayerCsv { file: file() },
            _ => PlanFileError::NotJson { file: file(), error },
        };
        let Version { format } = serde_json::from_str(text).map_err(classify)?;
        if format != FORMAT {
            return Err(PlanFileError::OtherFormat { file: file(), found: format });
        }
        serde_json::from_str(text).map_err(classify)
    }

    /// Returns the robot of this plan: from the description in the plan, or else the built-in robot of that name.
    /// `file` is the name of the plan file in error messages.
    ///
    /// # Errors
    /// If the description is not valid, or the plan contains none and the robot is not built in.
    pub fn own_robot(&self, file: &str) -> Result<Robot, PlanFileError> {
        let file = || file.to_owned();
        match &self.robot_description {
            Some(described) => {
                let file = format!("{}, robot_description", file());
                Ok(Robot::new((**described).clone()).map_err(|error| RobotFileError::Robot { file, error })?)
            }
            None if robot_file::is_built_in(&self.robot) => Ok(robot_file::load(self.robot.as_ref())?),
            None => Err(PlanFileError::UnknownRobot { file: file(), robot: self.robot.clone() }),
        }
    }
}

/// A plan that was read and checked.
#[derive(Debug)]
pub struct LoadedPlan {
    /// Robot for which the plan was made.
    pub robot: Robot,
    /// The checked plan.
    pub plan: Plan,
    /// Scene from which the plan was proven to be clear. `None` if the plan names no scene.
    pub scene: Option<LoadedScene>,
}

/// Reads a plan file (`-` for standard input), loads its robot, and checks the plan in full. A scene that the plan
/// names is loaded too.
///
/// `robot` is the name or the file of the robot. If it is `None`, the robot of the plan is used
/// ([`PlanFile::own_robot`]).
///
/// # Errors
/// If the file, the robot's description, the plan or its scene is not valid.
pub fn open(path: &FilePath, robot: Option<&FilePath>) -> Result<(Robot, Plan), PlanFileError> {
    read(&input::read_text(path)?, &input::display_name(path), robot)
}

/// Like [`open`], but also returns the scene. `scene` is the scene's file, which must have the hash in the plan. If it
/// is `None`, the file that the plan names is loaded.
///
/// # Errors
/// Like [`open`].
pub fn open_in_scene(
    path: &FilePath,
    robot: Option<&FilePath>,
    scene: Option<&FilePath>,
) -> Result<LoadedPlan, PlanFileError> {
    read_in_scene(&input::read_text(path)?, &input::display_name(path), robot, scene)
}

/// Like [`open`], but takes the text of the plan file. `file` is the name of the plan file in error messages.
///
/// # Errors
/// If the text, the robot's description, the plan or its scene is not valid.
pub fn read(text: &str, file: &str, robot: Option<&FilePath>) -> Result<(Robot, Plan), PlanFileError> {
    read_in_scene(text, file, robot, None).map(|LoadedPlan { robot, plan, .. }| (robot, plan))
}

/// Like [`open_in_scene`], but takes the text of the plan file. `file` is the name of the plan file in error messages.
///
/// # Errors
/// Like [`read`].
pub fn read_in_scene(
    text: &str,
    file: &str,
    robot: Option<&FilePath>,
    scene: Option<&FilePath>,
) -> Result<LoadedPlan, PlanFileError> {
    let written = PlanFile::parse(text, file)?;
    let robot = match robot {
        Some(robot) => robot_file::load(robot)?,
        None => written.own_robot(file)?,
    };
    let mut plan = written.check(&robot).map_err(|fault| PlanFileError::Fault { file: file.to_owned(), fault })?;
    let Some(named) = &written.scene else { return Ok(LoadedPlan { robot, plan, scene: None }) };
    let beside = FilePath::new(file).parent().unwrap_or(FilePath::new(""));
    let (clearance, loaded) = scene_planning::load_verified_scene(named, &plan, &robot, beside, scene)?;
    plan.warnings.retain(|warning| warning.code != NEAR_OBSTACLE);
    plan.warnings.extend(near_obstacle(&plan, &robot, &loaded, clearance.clearance));
    plan.scene = Some(clearance);
    Ok(LoadedPlan { robot, plan, scene: Some(loaded) })
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;

    use super::*;
    use crate::pose_text::parse_pose;

    fn text() -> String {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let (start, goal) = (parse_pose("0,0,0,30,60").unwrap(), parse_pose("-300,200,400,0.1,-12.3").unwrap());
        PlanFile::from(&Plan::new(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap()).to_text()
    }

    fn refused(text: &str) -> PlanFileError {
        PlanFile::parse(text, "plan.json").unwrap_err()
    }

    #[test]
    fn written_plans_read_back_unchanged() {
        let written = PlanFile::parse(&text(), "plan.json").unwrap();
        assert_eq!(written.to_text(), text());
        assert_eq!(PlanFile::parse(&written.to_line(), "plan.json").unwrap(), written);
        assert_eq!((written.start.heading_deg, written.goal.pitch_deg), (30.0, -12.3));
    }

    #[test]
    fn every_truncation_is_detected() {
        let text = text();
        for end in 1..text.trim_end().len() {
            assert!(
                matches!(refused(&text[..end]), PlanFileError::Truncated { .. }),
                "cut at {end}: {}",
                refused(&text[..end])
            );
        }
        assert!(matches!(refused(""), PlanFileError::Truncated { .. }));
    }

    #[test]
    fn non_plan_files_give_distinct_errors() {
        assert!(matches!(refused("solid cube"), PlanFileError::NotJson { .. }));
        assert!(matches!(refused(&(text() + "x")), PlanFileError::NotJson { .. }));
        assert!(matches!(refused("[1, 2]"), PlanFileError::NoPlan { .. }));
        assert!(matches!(refused("{}"), PlanFileError::NoPlan { .. }));
        assert!(matches!(refused(&text().replace("plan/1", "plan/2")), PlanFileError::OtherFormat { .. }));
        for (from, to) in [
            ("\"radius_mm\"", "\"radius\""),
            ("\"beta_deg\"", "\"beta\""),
            ("\"arc\"", "\"helicoid\""),
            ("\"two-plane\"", "\"teleport\""),
            ("\"candidates\": ", "\"candidates\": -"),
            ("\"layers\": ", "\"layers\": -"),
            ("\"x_mm\": ", "\"roll_deg\": 0.0, \"x_mm\": "),
        ] {
            let text = text();
            assert!(text.contains(from));
            assert!(matches!(refused(&text.replace(from, to)), PlanFileError::NoPlan { .. }), "{from} to {to}");
        }
        assert!(matches!(
            refused(&text().replace("\"radius_mm\": 100.0", "\"radius_mm\": 1e999")),
            PlanFileError::NotJson { .. }
        ));
    }
}
