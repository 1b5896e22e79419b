//! What the page is given: JSON that its script (growbot-host/viewer/src/main.js) reads. Lengths in mm.

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::{Frame, Pose};
use serde_json::{Value, json};

use super::{Subject, built_layers, measured_end, numbers};
use crate::run_log::hex_of;

/// The JSON, with nothing in it that could end the script element that it stands in.
/// `live`: of a growth under way, whether the page may give orders.
pub fn of(subject: &Subject, planned: &[LayerBytes], live: Option<bool>) -> String {
    let Subject { robot, plan, run, .. } = subject;
    let built = run.map(built_layers);
    let description = robot.description();
    let mut warnings: Vec<String> = plan.warnings.iter().map(|warning| warning.message.clone()).collect();
    let unknown = run.map_or(0, |run| run.as_built.iter().filter(|layer| layer.is_none()).count());
    if unknown > 0 {
        warnings.push(format!("{unknown} layers were cut and let be: they are shown as planned"));
    }
    let about = match run {
        _ if live.is_some() => format!("growth of {}", plan.robot),
        Some(run) => format!("growth of {}: {}", plan.robot, run.outcome.as_deref().unwrap_or("unfinished")),
        None => format!("plan for {}", plan.robot),
    };
    let data = json!({
        "about": about,
        "robot": {
            "outer_radius_mm": 0.5 * robot.outer_diameter(),
            "tip_radius_mm": robot.tip_radius(),
            "wall_mm": description.wall.width_mm,
            "period_s": description.layer.period_s,
        },
        "start": frame(&plan.start.frame()),
        "goal": {
            "position": plan.goal.position().as_slice(),
            "direction": direction(&plan.goal),
        },
        "via": plan.via().iter().map(|via| json!(via.position().as_slice())).collect::<Vec<_>>(),
        "reached": run.and_then(measured_end).map(|(reached, _)| json!(reached.position().as_slice())),
        "planned": hex_of(planned),
        "built": built.as_deref().map(hex_of),
        "numbers": numbers::of(subject, planned, built.as_deref()),
        "warnings": warnings,
        "live": live.map(|control| json!({ "control": control })),
    });
    data.to_string().replace('<', "\\u003c")
}

/// The x, y and z axis of a frame and its origin, 12 numbers.
fn frame(base_from_tip: &Frame) -> Value {
    let axes = base_from_tip.rotation.matrix().iter().chain(base_from_tip.translation.vector.iter());
    axes.copied().collect::<Vec<f64>>().into()
}

fn direction(pose: &Pose) -> [f64; 3] {
    pose.direction().into()
}
