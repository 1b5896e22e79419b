//! Plans as JSON, in the format `growbot-plan/1`: mm and degrees, numbers in full precision.
//!
//! [`PlanFile`] is the text and nothing more: what is read here has the right fields of the right types. Whether it
//! holds together, and for which robot, is [`crate::plan_check`]'s business. [`open`] does both.

use std::path::Path as FilePath;

use growbot_core::path::{Segment, length};
use growbot_core::plan::Planner;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

use crate::degrees::{degrees_below_turn, shortest_degrees, shortest_heading};
use crate::input::{self, InputError};
use crate::plan::{Choice, Plan, word};
use crate::plan_check::PlanFault;
use crate::printable;
use crate::robot_file::{self, RobotFileError};
use crate::warning::Warning;

/// The format that this version writes and reads.
pub const FORMAT: &str = "growbot-plan/1";

/// A plan as written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// Name of the query, in the output of a batch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// [`FORMAT`].
    pub format: String,
    /// The robot's name.
    pub robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    pub robot_hash: String,
    /// How the path was found.
    pub planner: Planner,
    /// Radius of the arcs, mm.
    pub radius_mm: f64,
    /// Where the tip starts.
    pub start: WrittenPose,
    /// Where it is to arrive.
    pub goal: WrittenPose,
    /// Poses on the way, in order. Not written where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub via: Vec<WrittenPose>,
    /// Arc length, mm.
    pub length_mm: f64,
    /// How many layers.
    pub layers: usize,
    /// Time to lay them, s.
    pub duration_s: f64,
    /// Filament, mm.
    pub filament_mm: f64,
    /// The pieces of the path in order: C for an arc, S for a straight line, H for a helicoidal arc. Older plans do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub word: Option<String>,
    /// How many paths were found that reach the goal; of several legs, the sum. Older plans do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidates: Option<usize>,
    /// How many shorter ones were passed over because the body would have run into itself. Not written where that is 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub passed_over: usize,
    /// Length of the two-plane path, mm. Older plans do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_length_mm: Option<f64>,
    /// By how much that is longer than this path, percent; 0 for a path of no length. Older plans do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_longer_percent: Option<f64>,
    /// The legs, where there are poses on the way: one more than those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub legs: Vec<WrittenLeg>,
    /// The path.
    pub segments: Vec<WrittenSegment>,
    /// What speaks against growing it.
    pub warnings: Vec<Warning>,
}

/// A pose as written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrittenPose {
    /// x, mm.
    pub x_mm: f64,
    /// y, mm.
    pub y_mm: f64,
    /// z, mm.
    pub z_mm: f64,
    /// Heading, degrees.
    pub heading_deg: f64,
    /// Pitch, degrees.
    pub pitch_deg: f64,
}

impl From<&Pose> for WrittenPose {
    fn from(pose: &Pose) -> Self {
        let position = pose.position();
        Self {
            x_mm: position.x,
            y_mm: position.y,
            z_mm: position.z,
            heading_deg: shortest_heading(pose.heading()),
            pitch_deg: shortest_degrees(pose.pitch()),
        }
    }
}

/// A leg as written: from the pose before to the next one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrittenLeg {
    /// How many segments of the plan are this leg's.
    pub segments: usize,
    /// Its pieces in order, as in the plan.
    pub word: String,
    /// Its length, mm.
    pub length_mm: f64,
    /// How many paths were found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidates: Option<usize>,
    /// How many shorter ones were passed over.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub passed_over: usize,
    /// Length of the two-plane path, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_length_mm: Option<f64>,
}

impl WrittenLeg {
    fn new(choice: Option<Choice>, path: &[Segment]) -> Self {
        Self {
            segments: path.len(),
            word: word(path),
            length_mm: length(path),
            candidates: choice.map(|choice| choice.candidates),
            passed_over: choice.map_or(0, |choice| choice.passed_over),
            two_plane_length_mm: choice.map(|choice| choice.two_plane_length),
        }
    }
}

/// serde hands over a reference.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the form that serde calls")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// A segment as written.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum WrittenSegment {
    /// A circular arc.
    Arc {
        /// Angle of greatest deposition in the tip's frame, degrees.
        alpha_deg: f64,
        /// Angle of the arc, degrees.
        beta_deg: f64,
        /// Arc length, mm.
        length_mm: f64,
    },
    /// A straight line.
    Straight {
        /// Length, mm.
        length_mm: f64,
    },
    /// A helicoidal arc of the plan's radius: `x'' = w x x'`, `w = m/|m|`, `m = m0 + p x x`, in world axes, with x from the segment's
    /// start and lengths in units of the radius.
    Helicoid {
        /// Length, mm.
        length_mm: f64,
        /// `m` at the segment's start.
        m0: [f64; 3],
        /// How `m` changes.
        p: [f64; 3],
    },
}

impl WrittenSegment {
    /// A segment that grows from a tip of this frame.
    fn new(segment: &Segment, base_from_tip: &Frame) -> Self {
        match *segment {
            Segment::Arc { alpha, bend, length } => {
                Self::Arc { alpha_deg: degrees_below_turn(alpha), beta_deg: shortest_degrees(bend), length_mm: length }
            }
            Segment::Straight { length } => Self::Straight { length_mm: length },
            Segment::Helicoid { curve, length, .. } => Self::Helicoid {
                length_mm: length,
                m0: (base_from_tip.rotation * curve.m0).into(),
                p: (base_from_tip.rotation * curve.p).into(),
            },
        }
    }

    /// A whole path, from a tip of this frame.
    fn path(path: &[Segment], base_from_start: &Frame) -> Vec<Self> {
        let grown = |base_from_tip: &mut Frame, segment: &Segment| {
            let written = Self::new(segment, base_from_tip);
            *base_from_tip *= segment.step();
            Some(written)
        };
        path.iter().scan(*base_from_start, grown).collect()
    }
}

/// A hash as written.
#[must_use]
pub fn written_hash(hash: u64) -> String {
    format!("{hash:016x}")
}

impl From<&Plan> for PlanFile {
    fn from(plan: &Plan) -> Self {
        let choice = plan.choice();
        let via = plan.via();
        let legs = plan.by_leg().map(|(choice, path)| WrittenLeg::new(choice, path));
        Self {
            id: None,
            format: FORMAT.to_owned(),
            robot: plan.robot.clone(),
            robot_hash: written_hash(plan.robot_hash),
            planner: plan.planner,
            radius_mm: plan.radius,
            start: WrittenPose::from(&plan.start),
            goal: WrittenPose::from(&plan.goal),
            legs: if via.is_empty() { Vec::new() } else { legs.collect() },
            via: via.iter().map(WrittenPose::from).collect(),
            length_mm: plan.needs.length,
            layers: plan.needs.layers,
            duration_s: plan.needs.duration,
            filament_mm: plan.needs.filament,
            word: Some(plan.word()),
            candidates: choice.map(|choice| choice.candidates),
            passed_over: choice.map_or(0, |choice| choice.passed_over),
            two_plane_length_mm: choice.map(|choice| choice.two_plane_length),
            two_plane_longer_percent: choice.map(|choice| choice.two_plane_longer_percent(plan.needs.length)),
            segments: WrittenSegment::path(&plan.path, &plan.start.frame()),
            warnings: plan.warnings.clone(),
        }
    }
}

/// Why there is no plan in a file.
#[derive(Debug, thiserror::Error)]
pub enum PlanFileError {
    /// The file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The JSON stops in the middle.
    #[error(
        "{file} stops in the middle of the plan, at line {line}: it was not written whole; copy it again, or plan again"
    )]
    CutShort {
        /// The file.
        file: String,
        /// Where it stops.
        line: usize,
    },
    /// The file is no JSON.
    #[error("{file} is no JSON ({reason}): give a file that `growbot plan -o` wrote")]
    NotJson {
        /// The file.
        file: String,
        /// What is wrong, and where.
        reason: String,
    },
    /// The plan is of another version.
    #[error("{file} has format {found:?}, and this version of growbot reads {FORMAT:?}: plan again with this version")]
    OtherFormat {
        /// The file.
        file: String,
        /// The format that it names.
        found: String,
    },
    /// The JSON is no plan.
    #[error("{file} is no plan ({reason}): give a file that `growbot plan -o` wrote")]
    NoPlan {
        /// The file.
        file: String,
        /// What is wrong, and where.
        reason: String,
    },
    /// Nobody says where to find the plan's robot.
    #[error("{file} is a plan for robot {robot:?}, which is not built in: give its description with --robot FILE")]
    UnknownRobot {
        /// The file.
        file: String,
        /// The plan's robot.
        robot: String,
    },
    /// The robot's description is at fault.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The plan does not hold together, or not for this robot.
    #[error("{file}: {fault}")]
    Fault {
        /// The file.
        file: String,
        /// What does not.
        fault: PlanFault,
    },
}

/// Only the version, so that a plan of another one is told from nonsense.
#[derive(Deserialize)]
struct Version {
    format: String,
}

impl PlanFile {
    /// The JSON in one line, with its newline: what goes to pipes.
    #[must_use]
    pub fn to_line(&self) -> String {
        printable::json_line(self)
    }

    /// The JSON in many lines: what goes to files.
    #[must_use]
    pub fn to_text(&self) -> String {
        // Only maps with keys that are no strings could fail, and there are none.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// Reads a plan's JSON. `file` is how messages call the text.
    ///
    /// # Errors
    /// What is cut short, no JSON, of another version, or has other fields than a plan.
    pub fn parse(text: &str, file: &str) -> Result<Self, PlanFileError> {
        let file = || file.to_owned();
        let classify = |error: serde_json::Error| match error.classify() {
            serde_json::error::Category::Eof => PlanFileError::CutShort { file: file(), line: error.line() },
            serde_json::error::Category::Data => PlanFileError::NoPlan { file: file(), reason: error.to_string() },
            // A cut inside a number, as after `100.`, is no "end of file" to serde_json.
            _ if text.ends_with(['.', '-', '+', 'e', 'E']) && error.to_string().starts_with("invalid number") => {
                PlanFileError::CutShort { file: file(), line: error.line() }
            }
            _ => PlanFileError::NotJson { file: file(), reason: error.to_string() },
        };
        let Version { format } = serde_json::from_str(text).map_err(classify)?;
        if format != FORMAT {
            return Err(PlanFileError::OtherFormat { file: file(), found: format });
        }
        serde_json::from_str(text).map_err(classify)
    }
}

/// Reads a plan (`-`: from standard input), finds its robot, and checks the plan against it in full.
///
/// The robot is the one named here or, if none is, the built-in one that the plan names.
///
/// # Errors
/// Whatever is wrong with the file, the robot's description, or the plan.
pub fn open(path: &FilePath, robot: Option<&FilePath>) -> Result<(Robot, Plan), PlanFileError> {
    read(&input::read_text(path)?, &input::name_of(path), robot)
}

/// As [`open`], from a text that messages call `file`.
///
/// # Errors
/// Whatever is wrong with the text, the robot's description, or the plan.
pub fn read(text: &str, file: &str, robot: Option<&FilePath>) -> Result<(Robot, Plan), PlanFileError> {
    let written = PlanFile::parse(text, file)?;
    let file = file.to_owned();
    let robot = match robot {
        Some(robot) => robot_file::load(robot)?,
        None if robot_file::is_built_in(&written.robot) => robot_file::load(written.robot.as_ref())?,
        None => return Err(PlanFileError::UnknownRobot { file, robot: written.robot }),
    };
    match written.check(&robot) {
        Ok(plan) => Ok((robot, plan)),
        Err(fault) => Err(PlanFileError::Fault { file, fault }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_text::parse_pose;

    fn text() -> String {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let (start, goal) = (parse_pose("0,0,0,30,60").unwrap(), parse_pose("-300,200,400,0.1,-12.3").unwrap());
        PlanFile::from(&Plan::make(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap()).to_text()
    }

    fn refused(text: &str) -> PlanFileError {
        PlanFile::parse(text, "plan.json").unwrap_err()
    }

    #[test]
    fn what_is_written_reads_back_the_same() {
        let written = PlanFile::parse(&text(), "plan.json").unwrap();
        assert_eq!(written.to_text(), text());
        assert_eq!(PlanFile::parse(&written.to_line(), "plan.json").unwrap(), written);
        assert_eq!((written.start.heading_deg, written.goal.pitch_deg), (30.0, -12.3));
    }

    #[test]
    fn every_cut_is_noticed() {
        let text = text();
        for end in 1..text.trim_end().len() {
            assert!(
                matches!(refused(&text[..end]), PlanFileError::CutShort { .. }),
                "cut at {end}: {}",
                refused(&text[..end])
            );
        }
        assert!(matches!(refused(""), PlanFileError::CutShort { .. }));
    }

    #[test]
    fn what_is_no_plan_is_told_apart() {
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
