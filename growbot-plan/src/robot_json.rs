//! Robots as JSON for scripts: overviews, explanations of their fields, and minimum radii.

use growbot_core::robot::Robot;
use schemars::JsonSchema;
use serde::Serialize;

use crate::annotated_robot::{AnnotatedField, AnnotatedRobot};

/// Returns the growth rate, mm/h.
pub fn growth_rate(robot: &Robot) -> f64 {
    let layer = &robot.description().layer;
    layer.height_mm / layer.period_s * 3600.0
}

/// A robot in a list.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RobotOverview {
    /// Name of the robot.
    robot: String,
    /// Text about the robot.
    about: String,
    /// Radius of the tightest possible bend, mm.
    r_min_mm: f64,
    /// Radius of the bends in plans, mm.
    planning_radius_mm: f64,
    /// Height of a layer, mm.
    layer_height_mm: f64,
    /// Time for a layer, s.
    layer_period_s: f64,
    /// Growth rate, mm/h.
    growth_mm_per_h: f64,
}

impl From<&AnnotatedRobot> for RobotOverview {
    fn from(AnnotatedRobot { robot, about, .. }: &AnnotatedRobot) -> Self {
        let description = robot.description();
        Self {
            robot: robot.name().to_owned(),
            about: about.clone(),
            r_min_mm: robot.min_radius(),
            planning_radius_mm: description.planning_radius_mm,
            layer_height_mm: description.layer.height_mm,
            layer_period_s: description.layer.period_s,
            growth_mm_per_h: growth_rate(robot),
        }
    }
}

/// A field of a robot file.
#[derive(Debug, Serialize, JsonSchema)]
struct FieldJson {
    /// Full name of the field.
    field: String,
    /// Value as TOML.
    value: String,
    /// Meaning of the field, with its unit.
    means: String,
    /// True if the file sets the field. False if the value is the default.
    in_file: bool,
    /// True if the value has not been measured.
    assumed: bool,
    /// Comment after the field in the file. Empty if there is none.
    remark: String,
}

impl From<&AnnotatedField> for FieldJson {
    fn from(field: &AnnotatedField) -> Self {
        Self {
            field: field.path.clone(),
            value: field.value.clone(),
            means: field.description.clone(),
            in_file: field.in_file,
            assumed: field.is_assumed(),
            remark: field.comment.clone(),
        }
    }
}

/// A robot with all its fields.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RobotDetails {
    #[serde(flatten)]
    overview: RobotOverview,
    /// Fields of the robot file, in its order.
    fields: Vec<FieldJson>,
}

impl From<&AnnotatedRobot> for RobotDetails {
    fn from(robot: &AnnotatedRobot) -> Self {
        Self { overview: robot.into(), fields: robot.fields().map(FieldJson::from).collect() }
    }
}

/// The tightest bend of a robot.
#[derive(Debug, Serialize, JsonSchema)]
pub struct MinRadius {
    /// Name of the robot.
    pub robot: String,
    /// Radius of the tightest bend, mm: the greater of the two below.
    pub r_min_mm: f64,
    /// Radius that the robot's mechanics allow, mm.
    pub r_min_geometry_mm: f64,
    /// Radius that the range of the layer height allows, mm.
    pub r_min_layers_mm: f64,
}

impl From<&Robot> for MinRadius {
    fn from(robot: &Robot) -> Self {
        Self {
            robot: robot.name().to_owned(),
            r_min_mm: robot.min_radius(),
            r_min_geometry_mm: robot.min_radius_by_packaging(),
            r_min_layers_mm: robot.min_radius_by_layers(),
        }
    }
}
