//! The result of a growth: the last line of a run log, and the output of `grow`, `resume` and `replay` with `--json`.

use growbot_core::angle::degrees;
use growbot_core::layer::SECTORS;
use growbot_core::link::message;
use growbot_core::path::length;
use growbot_core::robot::Robot;
use growbot_scene::scene::Scene;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use strum::{Display, IntoStaticStr};

use super::lenient::lenient;
use crate::arrival::Arrival;
use crate::clock_drift::ClockDrift;
use crate::feedback::FeedbackReport;
use crate::growth_report::{GrowthReport, MeasuredBy, Outcome, as_built_hash};
use crate::plan::Plan;
use crate::plan_deviation::{BodyClearance, PlanDeviation};
use crate::plan_file::TipPoseJson;
use crate::robot_kind::RobotKind;
use crate::warning::Warning;

/// Result of a growth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GrowthResult {
    /// Outcome of the growth.
    #[serde(deserialize_with = "outcome_or_unknown")]
    pub outcome: OutcomeKind,
    /// True if the robot was simulated.
    #[serde(default)]
    pub simulated: bool,
    /// Reason of a refusal or of a lost connection.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Code of the reason why the growth was refused before it began. Omitted otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<String>,
    /// Code of the fault that ended the growth. Null if none did.
    pub fault: Option<String>,
    /// Error of the board's clock, if the growth was stopped because of this error.
    #[serde(default, deserialize_with = "lenient")]
    pub clock_drift: Option<ClockDrift>,
    /// Pose of the tip and its errors from the goal. If nothing was grown, the tip is at the start.
    #[serde(flatten)]
    pub arrival: Option<ArrivalJson>,
    /// Number of layers of the body.
    #[serde(default)]
    pub layers: usize,
    /// Length of the body, mm.
    #[serde(default)]
    pub length_mm: f64,
    /// Seed of all noise of a simulated robot. Null if there is none.
    #[serde(default, deserialize_with = "lenient")]
    pub seed: Option<u64>,
    /// Source of `final`. Null if nothing was grown.
    #[serde(default, deserialize_with = "lenient")]
    pub measured_by: Option<MeasuredBy>,
    /// Result of the feedback. Null without feedback.
    #[serde(default, deserialize_with = "lenient")]
    pub feedback: Option<FeedbackResult>,
    /// Greatest distance of the body from the planned path. Its source is `measured_by`. Null if nothing was grown.
    #[serde(default, deserialize_with = "lenient")]
    pub plan_deviation: Option<PlanDeviation>,
    /// Smallest clearance of the body from its scene. Null without a scene.
    #[serde(default, deserialize_with = "lenient")]
    pub scene: Option<BodyClearance>,
    /// Warnings about the body: `far-from-plan`, `touches-obstacle`. Omitted without any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
    /// Time from the first layer to the last on the board's clock, s. Null if unknown.
    pub duration_s: Option<f64>,
    /// Filament that was fed, mm. Null if unknown.
    pub filament_mm: Option<f64>,
    /// Plan id: the hash of the layers, 16 hexadecimal digits. Null if nothing was grown.
    #[serde(default, with = "crate::hexadecimal::hash_or_none")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub plan_id: Option<u64>,
    /// Hash of the layers as built, 16 hexadecimal digits. Null if nothing was grown.
    #[serde(default, with = "crate::hexadecimal::hash_or_none")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub as_built_hash: Option<u64>,
    /// Number of layers of which nothing is known. They count as planned.
    #[serde(default)]
    pub unknown_layers: usize,
    /// The interrupted layer. Null if none was.
    #[serde(default, deserialize_with = "lenient")]
    pub interrupted: Option<InterruptedLayerJson>,
    /// In the output of `replay` for a simulated robot: pose of the tip and its errors if each layer had been laid as
    /// commanded.
    #[serde(default, deserialize_with = "lenient")]
    pub commanded: Option<ArrivalJson>,
    /// In the output of `replay`: number of lines of the log that could not be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skipped_lines: Option<usize>,
    /// Number of lines that are missing in the log because it could not be written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_lines_missing: Option<usize>,
}

/// Outcome of a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Display, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum OutcomeKind {
    /// Every layer is laid.
    Done,
    /// Stopped on request, or by the emergency stop.
    Stopped,
    /// Stopped because the board's clock is wrong.
    ClockDrift,
    /// A fault switched everything off.
    Fault,
    /// A long pause has switched the heater off. The body can be resumed.
    Parked,
    /// The board has restarted, or another host has taken it. The body can be resumed.
    Interrupted,
    /// The board does not respond. It may still be growing.
    Lost,
    /// The growth did not begin.
    Refused,
    /// In the output of `replay`: the log has no end.
    Unfinished,
    /// In a log: an outcome that this version of growbot does not know.
    Unknown,
}

/// Deserializes an outcome. A value that this version does not know becomes `Unknown`.
fn outcome_or_unknown<'de, D: Deserializer<'de>>(deserializer: D) -> Result<OutcomeKind, D::Error> {
    let outcome = Value::deserialize(deserializer)?;
    Ok(serde_json::from_value(outcome).unwrap_or(OutcomeKind::Unknown))
}

impl OutcomeKind {
    /// Returns the name of the outcome in files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl From<&Outcome> for OutcomeKind {
    fn from(outcome: &Outcome) -> Self {
        match outcome {
            Outcome::Done => Self::Done,
            Outcome::Stopped => Self::Stopped,
            Outcome::ClockDrift(_) => Self::ClockDrift,
            Outcome::Fault(_) => Self::Fault,
            Outcome::Parked => Self::Parked,
            Outcome::Interrupted => Self::Interrupted,
            Outcome::Lost => Self::Lost,
        }
    }
}

/// Pose of a tip, and its errors from the goal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ArrivalJson {
    /// Pose of the tip.
    #[serde(rename = "final")]
    pub final_pose: TipPoseJson,
    /// Distance from the goal, mm.
    pub position_error_mm: f64,
    /// Distance from the goal divided by the length of the planned path. 0 if the path has no length.
    pub normalized_position_error: f64,
    /// Difference of the headings, degrees. Null if the tip or its goal is vertical.
    pub heading_error_deg: Option<f64>,
    /// Difference of the pitches, degrees.
    pub pitch_error_deg: f64,
    /// Angle between the directions of tip and goal, degrees.
    pub direction_error_deg: f64,
}

impl From<&Arrival> for ArrivalJson {
    fn from(arrival: &Arrival) -> Self {
        Self {
            final_pose: TipPoseJson::from(&arrival.final_pose),
            position_error_mm: arrival.position_error_mm,
            normalized_position_error: arrival.normalized_position_error,
            heading_error_deg: arrival.heading_error_deg,
            pitch_error_deg: arrival.pitch_error_deg,
            direction_error_deg: arrival.direction_error_deg,
        }
    }
}

/// Result of the feedback.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FeedbackResult {
    /// Number of amendments of the job.
    pub amendments: u32,
    /// Estimated pose of the tip.
    pub estimate: TipPoseJson,
    /// Distance of the estimate from the goal, mm.
    pub estimated_position_error_mm: f64,
    /// Angle between the directions of the estimate and the goal, degrees.
    pub estimated_direction_error_deg: f64,
    /// Standard deviation of the estimated position, mm.
    pub position_sd_mm: f64,
    /// Standard deviation of the estimated direction, degrees.
    pub direction_sd_deg: f64,
    /// Estimated systematic error of the growth, percent.
    pub growth_bias_percent: f64,
    /// For a simulated robot: distance of the estimate from the true tip, mm.
    pub estimate_error_mm: Option<f64>,
    /// For a simulated robot: angle between the directions of the estimate and the true tip, degrees.
    pub estimate_direction_error_deg: Option<f64>,
}

impl FeedbackResult {
    /// Converts the result of the feedback of a growth. `truth` is the arrival of the true tip of a simulated robot,
    /// `None` for a real robot.
    pub fn new(fed_back: &FeedbackReport, plan: &Plan, truth: Option<&Arrival>) -> Self {
        let FeedbackReport { amendments, estimate, .. } = fed_back;
        let estimated = fed_back.arrival(plan);
        let error = truth.map(|truth| estimated.difference_from(truth));
        Self {
            amendments: *amendments,
            estimate: TipPoseJson::from(&estimated.final_pose),
            estimated_position_error_mm: estimated.position_error_mm,
            estimated_direction_error_deg: estimated.direction_error_deg,
            position_sd_mm: estimate.position_sd,
            direction_sd_deg: degrees(estimate.direction_sd),
            growth_bias_percent: 100.0 * estimate.systematic_errors.growth,
            estimate_error_mm: error.map(|error| error.position_mm),
            estimate_direction_error_deg: error.map(|error| error.direction_deg),
        }
    }
}

/// An interrupted layer, with bounds of the completed fraction of its turn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct InterruptedLayerJson {
    /// Index of the layer, from 0.
    pub layer: usize,
    /// Minimum fraction that was completed.
    pub min: f64,
    /// Maximum fraction that was completed. 1 if nothing is known.
    pub max: f64,
}

impl InterruptedLayerJson {
    /// Converts an interrupted layer, whose index is `layer`.
    pub fn new(layer: usize, interrupted: message::InterruptedLayer) -> Self {
        let share = |sectors: u8| f64::from(sectors) / SECTORS as f64;
        Self { layer, min: share(interrupted.min), max: share(interrupted.max) }
    }
}

impl GrowthResult {
    /// Creates the result of a growth in which nothing was grown, or of which nothing is known. The tip is at the
    /// start.
    pub fn nothing_grown(outcome: OutcomeKind, plan: &Plan, seed: Option<u64>, kind: RobotKind) -> Self {
        let arrival = Arrival::of(&plan.start.frame(), &plan.goal, length(&plan.path));
        Self {
            outcome,
            simulated: kind.is_simulated(),
            error: None,
            refusal: None,
            fault: None,
            clock_drift: None,
            arrival: Some((&arrival).into()),
            layers: 0,
            length_mm: 0.0,
            seed,
            measured_by: None,
            feedback: None,
            plan_deviation: None,
            scene: None,
            warnings: Vec::new(),
            duration_s: Some(0.0),
            filament_mm: Some(0.0),
            plan_id: None,
            as_built_hash: None,
            unknown_layers: 0,
            interrupted: None,
            commanded: None,
            skipped_lines: None,
            log_lines_missing: None,
        }
    }

    /// Creates the result of a growth that has ended. With a scene, the clearance of the body from it is computed.
    pub fn new(
        grown: &GrowthReport,
        (robot, plan): (&Robot, &Plan),
        scene: Option<&Scene>,
        seed: Option<u64>,
        kind: RobotKind,
    ) -> Self {
        let body = grown.centreline(&plan.start);
        let plan_deviation = PlanDeviation::of(plan, robot, &body);
        let scene = scene.and_then(|scene| BodyClearance::of(scene, robot, &body));
        let warnings = [plan_deviation.warning(), scene.as_ref().and_then(BodyClearance::warning)];
        let truth = (grown.measured_by == MeasuredBy::Tip).then_some(&grown.arrival);
        let (fault, clock_drift) = match grown.outcome {
            Outcome::Fault(fault) => (Some(fault.code().to_owned()), None),
            Outcome::ClockDrift(drift) => (None, Some(drift)),
            _ => (None, None),
        };
        Self {
            fault,
            clock_drift,
            arrival: Some((&grown.arrival).into()),
            layers: grown.body.len(),
            length_mm: grown.length_mm(),
            measured_by: Some(grown.measured_by),
            feedback: grown.feedback.as_ref().map(|fed_back| FeedbackResult::new(fed_back, plan, truth)),
            plan_deviation: Some(plan_deviation),
            scene,
            warnings: warnings.into_iter().flatten().collect(),
            duration_s: Some(grown.duration_s),
            filament_mm: Some(grown.filament_mm),
            plan_id: Some(grown.plan_id),
            as_built_hash: Some(as_built_hash(&grown.as_built)),
            unknown_layers: grown.unknown_layers(),
            interrupted: grown.interrupted.map(|layer| InterruptedLayerJson::new(grown.as_built.len(), layer)),
            ..Self::nothing_grown((&grown.outcome).into(), plan, seed, kind)
        }
    }
}
