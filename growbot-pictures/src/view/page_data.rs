//! The page's data of a body: JSON for its script (growbot-pictures/viewer/src/subject.js). Lengths are in mm.

use growbot_core::layer::grow;
use growbot_core::layer_bytes::decode;
use growbot_core::pose::{Frame, Pose};
use growbot_plan::clock_drift::ClockDrift;
use growbot_plan::hexadecimal::hex_of;
use growbot_plan::plan::Plan;
use growbot_plan::run_log::RecordedRun;
use growbot_scene::obstacle_selection::ObstacleSelection;
use growbot_scene::shapes::Shape;
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::info_panel::caption;
use super::scene_view::{SceneView, hundredths};
use super::{Layers, Subject, measured_end};

/// Returns the data of a body for the page, without the table of numbers.
pub fn page_data(subject: &Subject, layers: &Layers, around: Option<&SceneView>) -> Value {
    let Subject { name, robot, plan, run, laid, .. } = subject;
    let description = robot.description();
    let mut warnings: Vec<String> = plan.warnings.iter().map(|warning| warning.message.clone()).collect();
    let unknown = run.map_or(0, RecordedRun::unknown_layers);
    if unknown > 0 {
        warnings.push(format!("{unknown} layers are unknown, interrupted or lost and are shown as planned"));
    }
    if let Some(drift) = run.and_then(RecordedRun::clock_drift) {
        warnings.push(format!("{drift}; {}", ClockDrift::REMEDY));
    }
    let grown = run.and_then(|run| run.result.as_ref()).map_or(&[][..], |result| &result.warnings);
    warnings.extend(grown.iter().map(|warning| warning.message.clone()));
    match run.map_or(0, RecordedRun::missing_simulated_layers) {
        0 => {}
        layers => warnings
            .push(format!("the run log does not have the positions of {layers} layers, which are shown as commanded")),
    }
    if let Some(words) = run.and_then(|run| run.damage.message(name)) {
        warnings.push(words);
    }
    let about = match run {
        Some(run) => format!("growth of {}: {}", plan.robot, run.outcome()),
        None if laid.is_some() => format!("simulated growth of {}", plan.robot),
        None => format!("plan for {}", plan.robot),
    };
    let is_plan = run.is_none() && laid.is_none();
    let reached = run.and_then(measured_end).map(|(reached, _)| reached).or(laid.map(|body| body.tip));
    json!({
        "name": name,
        "about": about,
        "caption": caption(subject, layers, ""),
        "robot": {
            "outer_radius_mm": 0.5 * robot.outer_diameter(),
            "tip_radius_mm": robot.tip_radius(),
            "wall_mm": description.wall.width_mm,
            "period_s": description.layer.period_s,
        },
        "start": frame(&plan.start.frame()),
        "existing": (!plan.existing_layers.is_empty()).then(|| existing(plan)),
        "goal": {
            "position": plan.goal.position().as_slice(),
            "direction": direction(&plan.goal),
        },
        "via": plan.via().iter().map(|via| json!(via.position().as_slice())).collect::<Vec<_>>(),
        "reached": reached.map(|reached| json!(reached.position().as_slice())),
        "estimated": subject.estimated().map(points),
        "commanded": subject.commanded(layers).map(points),
        "built_name": layers.built_name(),
        "planned": hex_of(&layers.planned),
        "built": layers.built.as_deref().map(hex_of),
        "warnings": warnings,
        "scene": around.map(scene),
        "reach": is_plan.then(|| json!({
            "radius_mm": description.planning_radius_mm,
            "length_mm": plan.requirements.length,
        })),
    })
}

/// Returns the obstacles that are shown, in the format of growbot-pictures/viewer/src/obstacles.js.
fn scene(around: &SceneView) -> Value {
    let ObstacleSelection { shapes, squares, triangles, points, .. } = &around.obstacles;
    let corners = |corners: &[Vector3<f64>]| corners.iter().flat_map(hundredths).collect::<Vec<f64>>();
    let [mut boxes, mut balls, mut capsules] = [vec![], vec![], vec![]];
    for shape in shapes {
        match shape {
            Shape::Box { centre, half_extents: half, rotation } => {
                let axes = rotation.matrix().iter().map(|part| (1e5 * part).round() / 1e5);
                boxes.push(corners(&[*centre, *half]).into_iter().chain(axes).collect::<Vec<f64>>());
            }
            Shape::Ball { centre, radius } => balls.push([corners(&[*centre]), vec![*radius]].concat()),
            Shape::Capsule { from, to, radius } => capsules.push([corners(&[*from, *to]), vec![*radius]].concat()),
        }
    }
    let points = points.iter().flat_map(|(at, radius)| hundredths(at).into_iter().chain([*radius]));
    json!({
        "boxes": boxes,
        "balls": balls,
        "capsules": capsules,
        "squares": squares.iter().map(|square| corners(square)).collect::<Vec<_>>(),
        "triangles": triangles.iter().flat_map(|triangle| corners(&triangle.0)).collect::<Vec<f64>>(),
        "points": points.collect::<Vec<f64>>(),
        "narrowest": around.closest_approach.as_ref().map(|(found, _)| json!({
            "on_body": hundredths(&found.on_body),
            "on_obstacle": hundredths(&found.on_obstacle),
            "label": around.clearance_text(),
        })),
    })
}

/// Returns the body at whose tip the body of a plan begins: the frame at its start, and its layers.
fn existing(plan: &Plan) -> Value {
    let layers = &plan.existing_layers;
    let start_from_tip = grow(&Frame::identity(), layers.iter().map(decode));
    json!({ "start": frame(&(plan.start.frame() * start_from_tip.inverse())), "layers": hex_of(layers) })
}

/// Returns the x, y and z axis of a frame and its origin, 12 numbers.
fn frame(base_from_tip: &Frame) -> Value {
    let axes = base_from_tip.rotation.matrix().iter().chain(base_from_tip.translation.vector.iter());
    axes.copied().collect::<Vec<f64>>().into()
}

/// Returns points, 3 numbers each.
fn points(path: Vec<Vector3<f64>>) -> Vec<[f64; 3]> {
    path.into_iter().map(Into::into).collect()
}

fn direction(pose: &Pose) -> [f64; 3] {
    pose.direction().into()
}
