//! A plan as people read it: rounded, in a table.

use std::fmt::Write;

use growbot_core::angle::degrees;
use growbot_core::path::Segment;
use growbot_core::pose::Pose;
use growbot_host::degrees::{shortest_degrees, shortest_heading};
use growbot_host::plan::Plan;

/// The table, some 70 columns wide.
pub fn table(plan: &Plan) -> String {
    let mut text = format!("Plan for {}, arcs of radius {} mm\n", plan.robot, plan.radius);
    text += &format!("  from      {}\n  to        {}\n", pose(&plan.start), pose(&plan.goal));
    if plan.path.is_empty() {
        text += "\nThe tip is there already: nothing to grow.\n";
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
    let needs = &plan.needs;
    text += &format!("\n  length    {:.1} mm\n  layers    {}\n", needs.length, needs.layers);
    text += &format!("  time      {}\n  filament  {:.2} m\n", duration(needs.duration), needs.filament / 1000.0);
    for warning in &plan.warnings {
        text += &format!("\nwarning ({}): {}\n", warning.code, warning.message);
    }
    text
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

/// A time in the two units that matter.
pub fn duration(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round();
    let (minutes, rest) = ((whole / 60.0).floor(), whole % 60.0);
    if minutes < 60.0 {
        return format!("{minutes} min {rest} s");
    }
    let minutes = (seconds / 60.0).round();
    format!("{} h {} min", (minutes / 60.0).floor(), minutes % 60.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_rounded_to_what_matters() {
        for (seconds, text) in [
            (0.0, "0.0 s"),
            (59.94, "59.9 s"),
            (59.96, "1 min 0 s"),
            (60.0, "1 min 0 s"),
            (3599.4, "59 min 59 s"),
            (3599.6, "1 h 0 min"),
            (18_900.0, "5 h 15 min"),
            (1e6, "277 h 47 min"),
        ] {
            assert_eq!(duration(seconds), text);
        }
    }
}
