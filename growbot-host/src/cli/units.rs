//! Lengths and angles of the command line, with units or without, and warnings about units that may be mistaken.

use std::f64::consts::TAU;

use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::plan::Goal;
use growbot_plan::pose_text::{TypedGoal, parse_angle, parse_length};

/// Maximum time limit, s: a day.
const MAX_SECONDS: u64 = 86_400;

/// Parses a length, mm.
pub fn mm(text: &str) -> Result<f64, String> {
    parse_length(text).map(|length| length.value).map_err(|error| format!("the value is {text:?}, {error}"))
}

/// Parses an angle, degrees.
pub fn deg(text: &str) -> Result<f64, String> {
    parse_angle(text).map(|angle| angle.value).map_err(|error| format!("the value is {text:?}, {error}"))
}

/// Parses a number of whole seconds, with the unit s or without.
pub fn seconds(text: &str) -> Result<u64, String> {
    let number = text.strip_suffix('s').map_or(text, str::trim_end);
    number
        .parse()
        .ok()
        .filter(|seconds| (1..=MAX_SECONDS).contains(seconds))
        .ok_or_else(|| format!("give whole seconds, 1 to {MAX_SECONDS}"))
}

/// Warns if all goals are so near the start that their coordinates may be metres. The caller has checked that no
/// coordinate was typed with a unit.
pub fn warn_of_metres<'a>(start: &Pose, goals: impl Iterator<Item = &'a Goal>, robot: &Robot) {
    let width = robot.outer_diameter();
    let farthest = goals.map(|goal| (goal.position() - start.position()).norm()).fold(0.0, f64::max);
    // A path that leads back to its start is intended.
    if farthest > 0.0 && farthest < width {
        growbot_host::warning!(
            "the goal is {farthest:.2} mm from the start, but the tube is {width:.1} mm wide: did you mean metres? \
             Write them as 0.6m"
        );
    }
}

/// Warns if all angles that were typed without a unit may be radians.
pub fn warn_of_radians(typed: &[&TypedGoal]) {
    let angles: Vec<f64> = typed.iter().flat_map(|typed| typed.bare_angles.iter().copied()).collect();
    if look_like_radians(&angles) {
        growbot_host::warning!("all angles are small and fractional: did you mean radians? Write them as 1.57rad");
    }
}

/// Returns true if every angle except 0 is fractional and at most one turn in radians (2 pi). Returns false if all
/// angles are 0.
fn look_like_radians(angles: &[f64]) -> bool {
    let mut others = angles.iter().filter(|angle| **angle != 0.0).peekable();
    others.peek().is_some() && others.all(|angle| angle.abs() <= TAU && angle.fract() != 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_fractional_angles_look_like_radians() {
        for (angles, are) in [
            (&[][..], false),
            (&[0.0, 0.0], false),
            (&[0.0, 1.57], true),
            (&[-2.25, 0.785], true),
            (&[0.0, 1.0], false),
            (&[0.5, 45.0], false),
            (&[6.3, 0.5], false),
        ] {
            assert_eq!(look_like_radians(angles), are, "{angles:?}");
        }
    }
}
