//! A plan as a table with rounded numbers.

use std::fmt::Write;

use growbot_core::angle::degrees;
use growbot_core::path::{Segment, length};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_plan::degrees::{shortest_degrees, shortest_heading};
use growbot_plan::figures::direction_text;
use growbot_plan::plan::{Plan, SceneClearance, SearchSummary, path_type};
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};
use growbot_plan::warning::Warning;
use time::{Duration, OffsetDateTime};

use crate::clock_text::clock_text;
use crate::duration::duration_text;

/// Start of the second line of an entry and of those after it.
const INDENT: &str = "            ";

/// Returns the table, within 80 columns. If `now` is given, the table contains the finish time of a growth that
/// starts then. `warning_text` returns the message of a warning with its remedy.
pub fn table(plan: &Plan, now: Option<OffsetDateTime>, warning_text: fn(&Warning) -> String) -> String {
    let mut text = format!("Plan for {}, bends of radius {} mm\n", plan.robot, plan.radius);
    let start = if plan.existing_layers.is_empty() { pose(&plan.start) } else { tip(&plan.start) };
    text += &format!("  from      {start}\n");
    for (index, (leg, free)) in plan.legs.iter().zip(&plan.free_directions).enumerate() {
        let name = if index + 1 < plan.legs.len() { "via" } else { "to" };
        let goal = if *free { position_with_direction(&leg.goal) } else { pose(&leg.goal) };
        text += &wrap(&goal, TERMINAL_WIDTH, &format!("  {name:<9} "), INDENT);
    }
    if plan.path.is_empty() {
        text += "\nThe tip is already at the goal: nothing to grow.\n";
        return text;
    }
    text += "\nsegment  kind      length, mm  bend, deg  material at, deg\n";
    for (index, segment) in plan.path.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = match segment {
            Segment::Arc { alpha, bend, length } => {
                writeln!(
                    text,
                    "{index:>7}  arc       {length:>10.2}  {:>9.2}  {:>16.2}",
                    degrees(*bend),
                    degrees(*alpha)
                )
            }
            Segment::Straight { length } => writeln!(text, "{index:>7}  straight  {length:>10.2}"),
            Segment::Helicoid { length, .. } => {
                writeln!(
                    text,
                    "{index:>7}  helicoid  {length:>10.2}  {:>9.2}           changing",
                    degrees(segment.bend())
                )
            }
        };
    }
    let needs = &plan.requirements;
    text += "\n";
    let legs: Vec<_> = plan.by_leg().collect();
    for (index, (choice, path)) in legs.iter().enumerate() {
        let name = if legs.len() == 1 { "path type".to_owned() } else { format!("leg {}", index + 1) };
        let length = length(path);
        let measured = if legs.len() == 1 { String::new() } else { format!(" ({length:.1} mm)") };
        let choice = choice.map(|choice| format!(", {}", chosen(plan, &choice, length)));
        let text_of_path = format!("{}{measured}{}", path_type(path), choice.unwrap_or_default());
        text += &wrap(&text_of_path, TERMINAL_WIDTH, &format!("  {name:<9} "), INDENT);
    }
    text += &format!("  length    {:.1} mm\n  layers    {}\n", needs.length, needs.layers);
    let time = duration_text(needs.duration);
    text += &format!("  time      {time}{}\n  filament  {:.2} m\n", done_at(plan, now), needs.filament / 1000.0);
    if let Some(SceneClearance { file, clearance, margin, .. }) = &plan.scene {
        let clear = format!("{clearance:.2} mm clear of everything in {file}");
        text += &wrap(&clear, TERMINAL_WIDTH, "  scene     ", INDENT);
        text += &format!("  margin    {margin:.2} mm\n");
    }
    for warning in &plan.warnings {
        let warning = format!("warning ({}): {}", warning.code, warning_text(warning));
        text += &format!("\n{}", wrap(&warning, TERMINAL_WIDTH, "", "  "));
    }
    text
}

/// Returns a text with the finish time of a growth whose first layer starts at `now`. Empty if `now` is not given.
fn done_at(plan: &Plan, now: Option<OffsetDateTime>) -> String {
    let finish =
        now.and_then(|now| Some((now, now.checked_add(Duration::checked_seconds_f64(plan.requirements.duration)?)?)));
    finish.map_or_else(String::new, |(now, finish)| format!(", from now until {}", clock_text(now, finish)))
}

/// Returns a text about the candidates from which a path of this length (mm) was chosen.
fn chosen(plan: &Plan, choice: &SearchSummary, length: f64) -> String {
    if plan.planner == Planner::TwoPlane {
        return plan.planner.name().to_owned();
    }
    let &SearchSummary { candidates, rejected: passed_over, .. } = choice;
    let rank = match (candidates, passed_over) {
        (1, _) => "the only path found".to_owned(),
        (_, 0) => format!("the shortest of {candidates} paths"),
        (_, 1) if plan.scene.is_some() => {
            format!("the shortest of {candidates} paths, except 1 that is not clear")
        }
        _ if plan.scene.is_some() => {
            format!("the shortest of {candidates} paths, except {passed_over} that are not clear")
        }
        (_, 1) => format!("the shortest of {candidates} paths, except 1 that runs into the body"),
        _ => format!("the shortest of {candidates} paths, except {passed_over} that run into the body"),
    };
    let percent = choice.two_plane_longer_percent(length);
    let compared = match (format!("{:.1}", percent.abs()).as_str(), percent > 0.0) {
        ("0.0", _) => "as long".to_owned(),
        (percent, true) => format!("{percent} % longer"),
        (percent, false) => format!("{percent} % shorter"),
    };
    format!("{rank}; two-plane is {compared}")
}

fn pose(pose: &Pose) -> String {
    let position = pose.position();
    format!(
        "{}, {}, {} mm, heading {}, pitch {} deg",
        position.x,
        position.y,
        position.z,
        shortest_heading(pose.heading()),
        shortest_degrees(pose.pitch())
    )
}

/// Returns the tip of a body as text. It is rounded, because the user did not type it.
fn tip(pose: &Pose) -> String {
    // Rounding gives -0 for a small negative number, and adding 0 converts it to 0.
    let [x, y, z, heading, pitch] = pose.to_degrees().map(|number| (10.0 * number).round() / 10.0 + 0.0);
    format!("tip of a body: {x:.1}, {y:.1}, {z:.1} mm, heading {heading:.1}, pitch {pitch:.1} deg")
}

/// Returns a position as text, with the direction that the planner chose for it. The direction is rounded, because
/// the user did not type it.
fn position_with_direction(pose: &Pose) -> String {
    let position = pose.position();
    format!("{}, {}, {} mm, {} (direction free)", position.x, position.y, position.z, direction_text(pose, 2))
}
