//! Request for a job or a plan.

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

/// A request to grow or to plan.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GrowRequest {
    /// A plan, in the format that `growbot plan -o` writes. Without it, `to` is required.
    #[cfg_attr(feature = "schema", schemars(with = "Option<serde_json::Value>"))]
    pub plan: Option<Box<RawValue>>,
    /// Goal: X,Y,Z,HEADING,PITCH, or X,Y,Z for any direction.
    pub to: Option<String>,
    /// Start pose. The default is `0,0,0,0,90`.
    pub from: Option<String>,
    /// Poses or positions that the path passes through, in order.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(length(max = 100)))]
    pub via: Vec<String>,
    /// Radius of the bends, mm. The default is the robot's planning radius.
    pub radius_mm: Option<f64>,
    /// Scene to keep clear of: the name of a scene that `/scenes` has stored. On the user's socket it can also be the
    /// absolute path of a file.
    #[serde(default)]
    pub scene: Option<String>,
    /// Minimum distance between the outside of the tube and the scene, mm. The default is `margin_mm` of the scene, or
    /// else the deviation that is expected of the robot.
    #[cfg_attr(feature = "schema", schemars(range(min = 0.0, max = 1e7)))]
    pub margin_mm: Option<f64>,
    /// Measure each layer, and plan the rest of the path again from the measured tip.
    #[serde(default)]
    pub feedback: bool,
    /// Grow despite the warnings self-collision, filament-short and layer-limit.
    #[serde(default)]
    pub force: bool,
    /// Grow although the plan is not clear of the scene, and do not keep corrections clear of it.
    #[serde(default)]
    pub ignore_scene: bool,
    /// Name of the job for users.
    #[cfg_attr(feature = "schema", schemars(length(max = 512)))]
    pub name: Option<String>,
}
