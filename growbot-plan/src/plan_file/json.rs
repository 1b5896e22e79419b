//! JSON form of a plan: fields, units and full precision.

use std::iter;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::path::{Segment, length};
use growbot_core::plan::{Planner, is_within_helicoid_range};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::{Robot, RobotDescription};
use serde::{Deserialize, Serialize};

use super::layer_row::{LayerRow, layer_rows};
use crate::degrees::{degrees_below_turn, shortest_degrees, shortest_heading};
use crate::hexadecimal::format_hash;
use crate::plan::{Plan, SearchSummary, path_type};
use crate::sanitize;
use crate::warning::Warning;

/// Name and version of the format of plan files that this version writes and reads.
pub const FORMAT: &str = "growbot-plan/1";

/// A plan in JSON form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// Name of the query in a batch. Omitted for a single plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Name and version of the format: `growbot-plan/1`.
    pub format: String,
    /// Name of the robot.
    pub robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    pub robot_hash: String,
    /// Planner that found the path.
    pub planner: Planner,
    /// Radius of the arcs, mm.
    pub radius_mm: f64,
    /// Start pose of the tip.
    pub start: PoseJson,
    /// Goal of the tip.
    pub goal: GoalJson,
    /// Waypoints, in order. Omitted if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub via: Vec<GoalJson>,
    /// Length of the path, mm.
    pub length_mm: f64,
    /// Number of layers.
    pub layers: usize,
    /// Time to lay the layers, s.
    pub duration_s: f64,
    /// Length of filament that the body needs, mm.
    pub filament_mm: f64,
    /// Kinds of the segments in order: C for an arc, S for a straight line, H for a helicoidal arc. Missing in older
    /// plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path_type: Option<String>,
    /// Number of paths found that reach the goal. For several legs, the sum. Missing in older plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidates: Option<usize>,
    /// Path types that were searched completely, except for rounding. Omitted for the two-plane planner, which does not
    /// search. Missing in older plans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub complete: Vec<PathFamily>,
    /// Path types that were searched from likely initial values only, so that a shorter path may exist: `H`, if the
    /// goal of a leg is so near that a helicoidal arc may be the shortest. Omitted if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub statistical: Vec<PathFamily>,
    /// Number of shorter paths that were rejected because the body would have collided with itself. Omitted if 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub passed_over: usize,
    /// Length of the path that the two-plane planner finds, mm. Missing in older plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_length_mm: Option<f64>,
    /// Excess length of the path of the two-plane planner over this path, percent. 0 for a path of no length. Missing
    /// in older plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_longer_percent: Option<f64>,
    /// The legs, one more than waypoints. Omitted if there are no waypoints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub legs: Vec<LegJson>,
    /// Segments of the path.
    pub segments: Vec<SegmentJson>,
    /// Reasons against growing the plan.
    pub warnings: Vec<Warning>,
    /// Description of the robot, as in its file. Missing in older plans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_description: Option<Box<RobotDescription>>,
    /// The scene that the plan leads through. Omitted if the path was planned in empty space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<SceneRefJson>,
    /// Layers of the body at whose tip the path begins, 24 hexadecimal digits each, so that the path is checked to stay
    /// clear of that body. Omitted if the path begins a new body.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "crate::hexadecimal::layers")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub existing_layers: Vec<LayerBytes>,
    /// Layers of the path in order. Omitted if empty. The segments determine the layers, so a reader checks the table,
    /// but does not need it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub layer_table: Vec<LayerRow>,
}

/// The scene of a plan in JSON form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SceneRefJson {
    /// Name of the scene's file: a scene file, a mesh or a cloud of points.
    pub file: String,
    /// Hash of the scene's file and of the files that it names, 16 hexadecimal digits.
    pub hash: String,
    /// Proven minimum clearance between the outside of the tube and everything in the scene, mm.
    pub clearance_mm: f64,
    /// Clearance that was required, mm. By default the scene's `margin_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub margin_mm: Option<f64>,
}

/// Path types that a planner searches for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum PathFamily {
    /// An arc, a straight line, an arc, in any planes.
    #[serde(rename = "CSC")]
    Csc,
    /// Dubins' six path types, for start and goal in one plane.
    #[serde(rename = "planar")]
    Planar,
    /// A helicoidal arc.
    H,
}

/// Returns the fields `complete` and `statistical` of the plan's file: the path types that were searched completely,
/// and those that were searched only from likely initial values.
fn searched(plan: &Plan) -> (Vec<PathFamily>, Vec<PathFamily>) {
    // In a scene, the shortest path may have any type, and the search is not complete for any.
    if plan.planner != Planner::Shortest || plan.scene.is_some() {
        return (Vec::new(), Vec::new());
    }
    let goals = plan.legs.iter().map(|leg| leg.goal);
    let starts = iter::once(plan.start).chain(goals.clone());
    let is_near = starts.zip(goals).any(|(start, goal)| is_within_helicoid_range(&start, &goal, plan.radius));
    (vec![PathFamily::Csc, PathFamily::Planar], if is_near { vec![PathFamily::H] } else { Vec::new() })
}

/// A pose in JSON form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PoseJson {
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
    /// Roll of the tip about its direction, degrees. Omitted if 0, as for every pose but the start at the tip of
    /// another body.
    #[serde(default, skip_serializing_if = "is_no_angle")]
    pub roll_deg: f64,
}

/// Reports whether an angle is 0, so that serde omits it.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the form that serde calls")]
fn is_no_angle(angle: &f64) -> bool {
    *angle == 0.0
}

impl From<&Pose> for PoseJson {
    fn from(pose: &Pose) -> Self {
        let position = pose.position();
        let [heading, roll] = [pose.heading(), pose.roll()].map(shortest_heading);
        let numbers = [position.x, position.y, position.z, heading, shortest_degrees(pose.pitch()), roll];
        // Adding 0 converts -0 to 0.
        let [x_mm, y_mm, z_mm, heading_deg, pitch_deg, roll_deg] = numbers.map(|number| number + 0.0);
        Self { x_mm, y_mm, z_mm, heading_deg, pitch_deg, roll_deg }
    }
}

/// Pose of a tip in JSON form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TipPoseJson {
    /// x, mm.
    pub x_mm: f64,
    /// y, mm.
    pub y_mm: f64,
    /// z, mm.
    pub z_mm: f64,
    /// Heading, degrees. Null if the tip is vertical.
    pub heading_deg: Option<f64>,
    /// Pitch, degrees.
    pub pitch_deg: f64,
}

impl From<&Pose> for TipPoseJson {
    fn from(pose: &Pose) -> Self {
        let PoseJson { x_mm, y_mm, z_mm, heading_deg, pitch_deg, .. } = pose.into();
        Self { x_mm, y_mm, z_mm, heading_deg: (!pose.is_vertical()).then_some(heading_deg), pitch_deg }
    }
}

impl TipPoseJson {
    /// Converts to a pose in JSON form, with heading 0 if the tip is vertical.
    pub fn pose(&self) -> PoseJson {
        let &Self { x_mm, y_mm, z_mm, heading_deg, pitch_deg } = self;
        PoseJson { x_mm, y_mm, z_mm, heading_deg: heading_deg.unwrap_or(0.0), pitch_deg, roll_deg: 0.0 }
    }
}

/// A goal in JSON form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GoalJson {
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
    /// True if only the position was given, so that the planner chose heading and pitch. Omitted if a direction was
    /// given.
    #[serde(default, skip_serializing_if = "is_false")]
    pub direction_free: bool,
}

impl GoalJson {
    fn new(pose: &Pose, direction_free: bool) -> Self {
        let PoseJson { x_mm, y_mm, z_mm, heading_deg, pitch_deg, .. } = pose.into();
        Self { x_mm, y_mm, z_mm, heading_deg, pitch_deg, direction_free }
    }

    /// Returns the pose of the goal.
    pub fn pose(&self) -> PoseJson {
        let &Self { x_mm, y_mm, z_mm, heading_deg, pitch_deg, .. } = self;
        PoseJson { x_mm, y_mm, z_mm, heading_deg, pitch_deg, roll_deg: 0.0 }
    }
}

/// Reports whether a field is false, so that serde omits it.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the form that serde calls")]
fn is_false(value: &bool) -> bool {
    !*value
}

/// A leg from one pose to the next, in JSON form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LegJson {
    /// Number of segments of the plan that belong to this leg.
    pub segments: usize,
    /// Kinds of the segments in order, as in the plan.
    pub path_type: String,
    /// Length of the leg, mm.
    pub length_mm: f64,
    /// Number of paths that the planner found for the leg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidates: Option<usize>,
    /// Number of shorter paths of the leg that were rejected because the body would have collided with itself. Omitted
    /// if 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub passed_over: usize,
    /// Length of the leg that the two-plane planner finds, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_plane_length_mm: Option<f64>,
}

impl LegJson {
    fn new(choice: Option<SearchSummary>, path: &[Segment]) -> Self {
        Self {
            segments: path.len(),
            path_type: path_type(path),
            length_mm: length(path),
            candidates: choice.map(|choice| choice.candidates),
            passed_over: choice.map_or(0, |choice| choice.rejected),
            two_plane_length_mm: choice.map(|choice| choice.two_plane_length),
        }
    }
}

/// Reports whether a count is 0, so that serde omits the field.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the form that serde calls")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// A segment in JSON form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum SegmentJson {
    /// A circular arc.
    Arc {
        /// Angle in the tip's frame at which most material is laid, degrees. The tube bends away from it.
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
    /// A helicoidal arc of the plan's radius: `x'' = w x x'`, `w = m/|m|`, `m = m0 + p x x`, in world axes, with x from
    /// the segment's start and lengths in units of the radius.
    Helicoid {
        /// Length, mm.
        length_mm: f64,
        /// Value of the vector `m` (see the segment type `helicoid`) at the segment's start.
        m0: [f64; 3],
        /// Constant rate of change of the vector `m` (see the segment type `helicoid`).
        p: [f64; 3],
    },
}

impl SegmentJson {
    /// Converts a segment to JSON form. `base_from_tip` is the frame of the tip at the segment's start.
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

    /// Converts the segments of a path to JSON form. `base_from_start` is the frame of the tip at the path's start.
    fn path(path: &[Segment], base_from_start: &Frame) -> Vec<Self> {
        let grown = |base_from_tip: &mut Frame, segment: &Segment| {
            let written = Self::new(segment, base_from_tip);
            *base_from_tip *= segment.step();
            Some(written)
        };
        path.iter().scan(*base_from_start, grown).collect()
    }
}

impl From<&Plan> for PlanFile {
    fn from(plan: &Plan) -> Self {
        let choice = plan.search_summary();
        let mut via: Vec<GoalJson> =
            plan.legs.iter().zip(&plan.free_directions).map(|(leg, free)| GoalJson::new(&leg.goal, *free)).collect();
        let goal = via.pop().unwrap_or_else(|| GoalJson::new(&plan.goal, false));
        let legs = plan.by_leg().map(|(choice, path)| LegJson::new(choice, path));
        let (complete, statistical) = searched(plan);
        Self {
            id: None,
            format: FORMAT.to_owned(),
            robot: plan.robot.clone(),
            robot_hash: format_hash(plan.robot_hash),
            planner: plan.planner,
            radius_mm: plan.radius,
            start: PoseJson::from(&plan.start),
            goal,
            legs: if via.is_empty() { Vec::new() } else { legs.collect() },
            via,
            length_mm: plan.requirements.length,
            layers: plan.requirements.layers,
            duration_s: plan.requirements.duration,
            filament_mm: plan.requirements.filament,
            path_type: Some(plan.path_type()),
            candidates: choice.map(|choice| choice.candidates),
            complete,
            statistical,
            passed_over: choice.map_or(0, |choice| choice.rejected),
            two_plane_length_mm: choice.map(|choice| choice.two_plane_length),
            two_plane_longer_percent: choice.map(|choice| choice.two_plane_longer_percent(plan.requirements.length)),
            segments: SegmentJson::path(&plan.path, &plan.start.frame()),
            warnings: plan.warnings.clone(),
            robot_description: None,
            existing_layers: plan.existing_layers.clone(),
            layer_table: Vec::new(),
            scene: plan.scene.as_ref().map(|scene| SceneRefJson {
                file: scene.file.clone(),
                hash: format_hash(scene.hash),
                clearance_mm: scene.clearance,
                margin_mm: Some(scene.margin),
            }),
        }
    }
}

impl PlanFile {
    /// Converts a plan to JSON form and adds the description of its robot, so that a reader needs no other file.
    pub fn with_robot(plan: &Plan, robot: &Robot) -> Self {
        Self { robot_description: Some(Box::new(robot.description().clone())), ..Self::from(plan) }
    }

    /// Adds the table of the layers.
    #[must_use]
    pub fn with_layer_table(self, plan: &Plan, robot: &Robot) -> Self {
        Self { layer_table: layer_rows(&plan.path, robot).collect(), ..self }
    }

    /// Returns the JSON of the plan in one line that ends with a newline, for pipes.
    pub fn to_line(&self) -> String {
        sanitize::json_line(self)
    }

    /// Returns the JSON of the plan in indented lines, for files.
    pub fn to_text(&self) -> String {
        // Serialization fails only for maps whose keys are not strings, which a plan does not contain.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
