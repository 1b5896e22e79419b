//! What a growth came to, as scripts read it.

use growbot_client::arrival::Arrival;
use growbot_client::feedback::FedBack;
use growbot_client::growth::{Grown, MeasuredBy, Outcome, as_built_hash};
use growbot_client::plan::Plan;
use growbot_client::plan_file::{WrittenPose, written_hash};
use growbot_core::angle::degrees;
use growbot_core::layer::SECTORS;
use growbot_core::path::length;
use growbot_core::pose::angle_between;
use serde_json::{Value, json};

/// The result as scripts read it. What was not grown is where it started.
pub fn json_of(outcome: &str, grown: Option<&Grown>, plan: &Plan, seed: Option<u64>, simulated: bool) -> Value {
    let arrival =
        grown.map_or_else(|| Arrival::of(&plan.start.frame(), &plan.goal, length(&plan.path)), |grown| grown.arrival);
    let mut value = json_of_arrival(&arrival);
    merge(
        &mut value,
        json!({
            "outcome": outcome,
            "simulated": simulated,
            "fault": grown.and_then(|grown| match grown.outcome {
                Outcome::Fault(fault) => Some(fault.code()),
                _ => None,
            }),
            "clock_drift": grown.and_then(|grown| match &grown.outcome {
                Outcome::ClockDrift(drift) => Some(drift.json()),
                _ => None,
            }),
            "layers": grown.map_or(0, |grown| grown.body.len()),
            "length_mm": grown.map_or(0.0, Grown::length_mm),
            "seed": seed,
            "measured_by": grown.map(|grown| grown.measured_by.name()),
            "feedback": grown.and_then(|grown| {
                let truth = (grown.measured_by == MeasuredBy::Tip).then_some(&grown.arrival);
                Some(json_of_feedback(grown.fed_back.as_ref()?, plan, truth))
            }),
            "duration_s": grown.map_or(0.0, |grown| grown.duration_s),
            "filament_mm": grown.map_or(0.0, |grown| grown.filament_mm),
            "plan_id": grown.map(|grown| written_hash(grown.plan_id)),
            "as_built_hash": grown.map(|grown| written_hash(as_built_hash(&grown.as_built))),
            "unknown_layers": grown.map_or(0, Grown::unknown),
            "cut": grown.and_then(|grown| grown.interrupted).map(|layer| json!({
                "layer": grown.map(|grown| grown.as_built.len()),
                "least": f64::from(layer.min) / SECTORS as f64,
                "most": f64::from(layer.max) / SECTORS as f64,
            })),
        }),
    );
    value
}

/// What feedback came to, as scripts read it; with the truth, how far it was from that.
pub fn json_of_feedback(fed_back: &FedBack, plan: &Plan, truth: Option<&Arrival>) -> Value {
    let FedBack { amendments, estimate } = fed_back;
    let believed = believed(fed_back, plan);
    let error = truth.map(|truth| error_of(&believed, truth));
    json!({
        "amendments": amendments,
        "believed": WrittenPose::from(&believed.reached),
        "believed_position_error_mm": believed.position_error_mm,
        "believed_direction_error_deg": believed.direction_error_deg,
        "position_sd_mm": estimate.position_deviation,
        "direction_sd_deg": degrees(estimate.direction_deviation),
        "growth_bias_percent": 100.0 * estimate.systematic_errors.growth,
        "estimate_error_mm": error.map(|(distance, _)| distance),
        "estimate_direction_error_deg": error.map(|(_, angle)| angle),
    })
}

/// Where feedback takes the tip to be, and how far that is from the goal.
pub fn believed(fed_back: &FedBack, plan: &Plan) -> Arrival {
    Arrival::of(&fed_back.estimate.base_from_tip, &plan.goal, length(&plan.path))
}

/// How far the estimator was from the truth: mm, and degrees between the directions.
pub fn error_of(believed: &Arrival, truth: &Arrival) -> (f64, f64) {
    let angle = angle_between(&believed.reached.direction(), &truth.reached.direction());
    ((believed.reached.position() - truth.reached.position()).norm(), degrees(angle))
}

/// Where a tip arrived, as scripts read it.
pub fn json_of_arrival(arrival: &Arrival) -> Value {
    json!({
        "final": WrittenPose::from(&arrival.reached),
        "position_error_mm": arrival.position_error_mm,
        "normalized_position_error": arrival.normalized_position_error,
        "heading_error_deg": arrival.heading_error_deg,
        "pitch_error_deg": arrival.pitch_error_deg,
        "direction_error_deg": arrival.direction_error_deg,
    })
}

/// Adds the fields of one object to another.
pub fn merge(value: &mut Value, more: Value) {
    if let (Value::Object(fields), Value::Object(more)) = (value, more) {
        fields.extend(more);
    }
}
