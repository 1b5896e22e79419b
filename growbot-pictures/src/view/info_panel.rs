//! The numbers next to a picture, as text: groups of names and values.

use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::pose::Pose;
use growbot_plan::arrival::Arrival;
use growbot_plan::plan_deviation::{PlanDeviation, centreline};
use growbot_plan::run_log::BodyKind;

use super::scene_view::SceneView;
use super::self_clearance::self_clearance;
use super::{Layers, SimulatedBody, Subject, measured_end};
use crate::duration::duration_text;

/// A heading, with the names and values below it.
pub type InfoGroup = (String, Vec<(String, String)>);

/// Returns the groups of names and values that describe a body.
pub fn of(subject: &Subject, layers: &Layers, around: Option<&SceneView>) -> Vec<InfoGroup> {
    let Subject { robot, plan, .. } = subject;
    let needs = &plan.requirements;
    let mut groups = Vec::new();
    if let Some(built) = &layers.built {
        if let Some((reached, by)) = subject.run.and_then(measured_end) {
            let mut rows = arrival(subject, &Arrival::of(&reached.frame(), &plan.goal, needs.length));
            rows.extend(strayed(subject));
            groups.push(group(format!("Arrived, as the {by} {}", if by == "steps" { "say" } else { "says" }), rows));
        }
        match &layers.commanded {
            Some(commanded) => {
                groups.push(group(layers.built_name(), body(subject, built)));
                groups
                    .push(group("Commanded, computed from the steps that the board reports", body(subject, commanded)));
            }
            None if subject.laid.is_some() => {
                groups.push(group(layers.built_name(), body(subject, built).into_iter().chain(strayed(subject))));
            }
            None => groups.push(group(
                format!("{}, computed from the steps that the board reports", layers.built_name()),
                body(subject, built),
            )),
        }
    }
    let mut rows = vec![
        ("Length", format!("{:.1} mm", needs.length)),
        ("Layers", needs.layers.to_string()),
        ("Time", duration_text(needs.duration)),
        ("Filament", format!("{:.2} m", needs.filament / 1000.0)),
        ("Planner", plan.planner.name().to_owned()),
    ];
    if !plan.path.is_empty() {
        rows.push(("Path type", plan.path_type()));
    }
    rows.push(("Radius of bends", format!("{:.1} mm", plan.radius)));
    if layers.built.is_none() {
        rows.extend(nearness(subject, &layers.planned));
    }
    groups.push(group("Plan", rows));
    groups.extend(around.map(scene));
    let mut poses = vec![("Start".to_owned(), pose(&plan.start))];
    poses.extend(plan.via().iter().enumerate().map(|(index, via)| (format!("Via {}", index + 1), pose(via))));
    poses.push(("Goal".to_owned(), pose(&plan.goal)));
    groups.push(group("Poses: x, y, z, heading, pitch", poses));
    groups.push(group(
        "Robot",
        [
            ("Name", robot.name().to_owned()),
            ("Tube over its wall", format!("{:.1} mm", robot.outer_diameter())),
            ("Least radius", format!("{:.1} mm", robot.min_radius())),
        ],
    ));
    groups
}

/// Returns the group of the scene around a body, with the smallest clearance of the body from the obstacles.
fn scene(around: &SceneView) -> InfoGroup {
    let narrowest = around.clearance_text().zip(around.closest_approach_text());
    let mut rows = vec![("File", around.file.clone()), ("Obstacles", around.obstacles.summary())];
    rows.extend(narrowest.into_iter().flat_map(|(clearance, place)| [("Clearance", clearance), ("Narrowest", place)]));
    group("Scene", rows)
}

fn group<N: Into<String>>(heading: impl Into<String>, rows: impl IntoIterator<Item = (N, String)>) -> InfoGroup {
    (heading.into(), rows.into_iter().map(|(name, value)| (name.into(), value)).collect())
}

/// Returns a line that describes a body: the planner of its path, the types of its segments, its length and its number
/// of layers. The planner is left out if its name equals `called`.
pub fn caption(subject: &Subject, layers: &Layers, called: &str) -> String {
    let plan = subject.plan;
    let grown = layers.kind.map(|kind| match kind {
        BodyKind::AsBuilt => "grown".to_owned(),
        BodyKind::Laid | BodyKind::Commanded => kind.name().to_owned(),
    });
    let planner = Some(plan.planner.name()).filter(|planner| *planner != called);
    let pieces = Some(plan.path_type()).filter(|pieces| !pieces.is_empty());
    let path = match (planner, pieces) {
        (Some(planner), Some(pieces)) => Some(format!("{planner} ({pieces})")),
        (planner, pieces) => pieces.or(planner.map(str::to_owned)),
    };
    let (length, count) = (layers.length(), layers.body().len());
    let total = subject.run.map_or(count, |run| run.total as usize);
    let count = if count < total { format!("{count} of {total} layers") } else { format!("{count} layers") };
    let parts = [grown, path, Some(format!("{length:.1} mm")), Some(count)];
    parts.into_iter().flatten().collect::<Vec<_>>().join(" · ")
}

/// Returns a line with the distance of a growth's end from its goal, according to its log. Returns `None` without a
/// log.
pub fn measured(subject: &Subject) -> Option<String> {
    let (reached, by) = subject.run.and_then(measured_end)?;
    let Arrival { position_error_mm: mm, direction_error_deg: deg, .. } =
        Arrival::of(&reached.frame(), &subject.plan.goal, subject.plan.requirements.length);
    let says = if by == "steps" { "say" } else { "says" };
    let strayed =
        deviation(subject).map_or_else(String::new, |found| format!("; up to {:.2} mm off the plan", found.max_mm));
    Some(format!("arrived {mm:.2} mm and {deg:.2}° off the goal, as the {by} {says}{strayed}"))
}

/// Returns the row with the greatest distance of a grown body from its plan. Returns `None` for a plan.
fn strayed(subject: &Subject) -> Option<(&'static str, String)> {
    let PlanDeviation { max_mm, at_mm, .. } = deviation(subject)?;
    Some(("Off the plan", format!("{max_mm:.3} mm at most, {at_mm:.0} mm along")))
}

/// Returns the greatest distance of a grown body from its plan. The distance of a run is that in its log. Returns
/// `None` for a plan.
fn deviation(subject: &Subject) -> Option<PlanDeviation> {
    let Subject { robot, plan, run, laid, .. } = subject;
    let of_laid = |body: &SimulatedBody| {
        PlanDeviation::of(plan, robot, &centreline(&plan.start.frame(), body.layers.iter().copied()))
    };
    match run {
        Some(run) => run.result.as_ref()?.plan_deviation,
        None => laid.as_ref().map(of_laid),
    }
}

/// Returns the rows of numbers that describe a grown body, computed from its layers.
fn body(subject: &Subject, built: &[LayerBytes]) -> Vec<(&'static str, String)> {
    let Subject { robot, run, .. } = subject;
    let layers: Vec<Layer> = built.iter().map(decode).collect();
    let length: f64 = layers.iter().map(|layer| layer.height).sum();
    let tightest = layers.iter().filter(|layer| layer.tilt > 0.0).map(|layer| layer.height / layer.tilt);
    let tightest = tightest.fold(f64::INFINITY, f64::min);
    let mut rows = vec![
        ("Length", format!("{length:.1} mm")),
        ("Layers", format!("{} of {}", layers.len(), run.map_or(layers.len(), |run| run.total as usize))),
        ("Time to lay them", duration_text(layers.len() as f64 * robot.description().layer.period_s)),
    ];
    if tightest.is_finite() {
        rows.push(("Tightest bend", format!("{tightest:.1} mm")));
    }
    rows.extend(nearness(subject, built));
    rows
}

/// Returns the rows with the distance of a body's end from the goal, and with the clearance of the body from itself.
fn nearness(subject: &Subject, layers: &[LayerBytes]) -> Vec<(&'static str, String)> {
    let Subject { robot, plan, .. } = subject;
    let start = plan.start.frame();
    let tip = match subject.laid {
        Some(body) => body.tip.frame(),
        None => grow(&start, layers.iter().map(decode)),
    };
    let mut rows = arrival(subject, &Arrival::of(&tip, &plan.goal, plan.requirements.length));
    let clearance = match self_clearance(&start, layers, robot.outer_diameter()) {
        None => "not near itself anywhere".to_owned(),
        Some(clearance) if clearance < 0.0 => format!("runs into itself by {:.1} mm", -clearance),
        Some(clearance) => format!("{clearance:.1} mm"),
    };
    rows.push(("Clearance to itself", clearance));
    rows
}

/// Returns the rows with the distance of a tip from the goal.
fn arrival(subject: &Subject, arrival: &Arrival) -> Vec<(&'static str, String)> {
    let mut rows = vec![("From the goal", format!("{:.3} mm", arrival.position_error_mm))];
    if subject.run.is_some() || subject.laid.is_some() {
        rows.push(("Of the length", format!("{:.4} %", 100.0 * arrival.normalized_position_error)));
    }
    rows.push(("Off its direction", format!("{:.3}°", arrival.direction_error_deg)));
    rows
}

fn pose(pose: &Pose) -> String {
    let parts = pose.to_degrees().map(|part| {
        // Adding 0 turns -0 into 0.
        let tenths = (10.0 * part).round() / 10.0 + 0.0;
        tenths.to_string()
    });
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let text = pose(&Pose::from_degrees([-0.01, 12.34, -0.6, -179.96, 45.0]).unwrap());
        assert_eq!(text, "0, 12.3, -0.6, -180, 45");
    }
}
