//! Warnings: reasons against growing a plan. A plan with warnings is returned nevertheless.

use growbot_core::angle::degrees;
use growbot_core::layer::LayerError;
use growbot_core::path::Segment;
use growbot_core::plan::Requirements;
use growbot_core::robot::Robot;
use growbot_core::slicing::{LIMIT_SLACK, Slicing, layers};
use serde::{Deserialize, Serialize};

use crate::self_collision::{Collision, closest_self_approach};

/// A reason against growing a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Warning {
    /// Kind of the warning, for scripts: `thin-layer`, `self-collision`, `filament-short`, `layer-limit`,
    /// `near-obstacle`, `continues-body`. After a growth: `far-from-plan`, `touches-obstacle`. After a simulation:
    /// `root-fails`.
    pub code: String,
    /// Message for users.
    pub message: String,
    /// Value that violates the limit.
    pub value: f64,
    /// Limit that the value violates.
    pub limit: f64,
}

/// Code of the warning for layers that are too thin on the inner side of the bend to print well. The value is their
/// smallest height, the limit the minimum height of the robot, mm.
pub const THIN_LAYER: &str = "thin-layer";
/// Code of the warning for a body that would collide with itself. The value is the smallest distance between two parts
/// of its centreline, the limit is the outer diameter of the tube, mm.
pub const SELF_COLLISION: &str = "self-collision";
/// Code of the warning for a body that needs more filament than the spool holds. Value and limit are
/// lengths, mm.
pub const FILAMENT_SHORT: &str = "filament-short";
/// Code of the warning for a body that begins at the tip of another one, which must be in place. The value is the
/// number of layers of that body.
pub const CONTINUES_BODY: &str = "continues-body";
/// Code of the warning for layers that the robot cannot lay. The units of value and limit depend on the reason: too
/// high (mm), too tilted (degrees), without material at a point (mm, the limit is 0), or too much acceleration of a
/// motor (turns/s^2 for the head, mm/s^2 for the feed). Both are 0 if the layer needs too many steps per second.
pub const LAYER_LIMIT: &str = "layer-limit";

/// Code of the warning for a plan whose clearance from obstacles is smaller than the expected deviation of the robot.
/// The value is the clearance, the limit is the expected deviation, mm.
pub const NEAR_OBSTACLE: &str = "near-obstacle";
/// Code of the warning for a grown body that is too far from its plan. The value is the greatest distance from the
/// planned path, the limit is the distance above which growbot warns, mm.
pub const FAR_FROM_PLAN: &str = "far-from-plan";
/// Code of the warning for a grown body that touches an obstacle. The value is the clearance (mm, negative), the limit
/// is 0.
pub const TOUCHES_OBSTACLE: &str = "touches-obstacle";

/// Codes of the warnings because of which growbot refuses to grow a plan, unless the user forces it.
pub const BLOCKING: [&str; 3] = [SELF_COLLISION, FILAMENT_SHORT, LAYER_LIMIT];

/// Maximum number of layers of the helicoidal arcs of a path that are checked. All layers of another segment are alike,
/// so only one of them is checked.
const MAX_LAYERS: usize = 100_000;

/// Returns all warnings for growing a path on a robot. `needs` are the requirements of the path: its length, layers,
/// time and filament.
pub fn warnings(path: &[Segment], needs: &Requirements, robot: &Robot) -> Vec<Warning> {
    let mut left = MAX_LAYERS;
    let mut found: Vec<Warning> = self_collision(path, robot, 0.0).into_iter().collect();
    found.extend(filament_short(needs, robot));
    for (index, segment) in path.iter().enumerate() {
        found.extend(layer_limit(index, segment, robot, &mut left));
        found.extend(thin_layer(index, segment, robot));
    }
    found
}

/// Returns the warning for a body that collides with itself. Only the part beyond the length `since` (mm) is compared
/// with all earlier parts.
pub(crate) fn self_collision(path: &[Segment], robot: &Robot, since: f64) -> Option<Warning> {
    let limit = robot.outer_diameter();
    let Collision { distance: value, at: [from, to] } = closest_self_approach(path, limit, since)?;
    let (obstacle, other, from) = if from < since {
        ("the existing body", "that of the existing body", from)
    } else {
        ("itself", "its centreline", from - since)
    };
    let to = to - since;
    let message = format!(
        "the body runs into {obstacle}: at {to:.0} mm of its length its centreline is {value:.1} mm from {other} at \
         {from:.0} mm, less than the tube's width of {limit:.1} mm; plan another path"
    );
    Some(Warning { code: SELF_COLLISION.to_owned(), message, value, limit })
}

/// Returns the warning for a plan that begins at the tip of a body with this number of layers.
pub(crate) fn continues_body(layers: usize) -> Warning {
    let message = format!(
        "the body begins at the tip of another one of {layers} layers: leave that one in place, with the robot at its \
         tip"
    );
    Warning { code: CONTINUES_BODY.to_owned(), message, value: layers as f64, limit: 0.0 }
}

fn filament_short(needs: &Requirements, robot: &Robot) -> Option<Warning> {
    let (value, limit) = (needs.filament, robot.description().filament.spool_mm);
    (value > limit).then(|| {
        let (takes, holds) = (value / 1000.0, limit / 1000.0);
        let enough = needs.length * limit / value;
        let message = format!(
            "the body takes {takes:.1} m of filament, but the spool holds {holds:.1} m, which is enough for \
             {enough:.0} mm of {:.0} mm of body; be ready to change the spool",
            needs.length
        );
        Warning { code: FILAMENT_SHORT.to_owned(), message, value, limit }
    })
}

/// Returns the warning for the first layer of a segment that the robot cannot lay. `index` is the index of the segment.
/// `left` is the number of layers of helicoidal arcs that may still be checked.
fn layer_limit(index: usize, segment: &Segment, robot: &Robot, left: &mut usize) -> Option<Warning> {
    let all_alike = !matches!(segment, Segment::Helicoid { .. });
    let looked_at = if all_alike { 1 } else { *left };
    let error = layers(std::slice::from_ref(segment), robot, Slicing::Exact).take(looked_at).find_map(|sliced| {
        *left = left.saturating_sub(usize::from(!all_alike));
        robot.check_layer(&sliced.layer, 2.0 * LIMIT_SLACK).err()
    })?;
    let (value, limit) = match error {
        LayerError::TooHigh { height, limit } => (height, limit),
        LayerError::Tilt { tilt, limit } => (degrees(tilt), degrees(limit)),
        LayerError::NoMaterial { height } => (height, 0.0),
        LayerError::Acceleration { value, limit, .. } => (value, limit),
        LayerError::NotFinite | LayerError::StepRate => (0.0, 0.0),
    };
    let message = format!("segment {index} of the plan ({}) cannot be laid: {error}", kind(segment));
    Some(Warning { code: LAYER_LIMIT.to_owned(), message, value, limit })
}

/// Returns the name of a segment's kind for messages.
fn kind(segment: &Segment) -> &'static str {
    match segment {
        Segment::Arc { .. } => "arc",
        Segment::Straight { .. } => "straight",
        Segment::Helicoid { .. } => "helicoid",
    }
}

/// Returns the warning for a segment whose layers are too thin to print well. Only the first layer of the segment is
/// checked. `index` is the index of the segment.
fn thin_layer(index: usize, segment: &Segment, robot: &Robot) -> Option<Warning> {
    let mut layers = layers(std::slice::from_ref(segment), robot, Slicing::Exact);
    let count = layers.size_hint().0;
    let value = layers.next()?.layer.min_height(robot.tip_radius());
    let limit = robot.description().layer.height_min_mm;
    if value >= limit * (1.0 - LIMIT_SLACK) {
        return None;
    }
    let kind = kind(segment);
    let side = if matches!(segment, Segment::Straight { .. }) { "" } else { " on the inner side of the bend" };
    let layers = if count == 1 { "1 layer" } else { &format!("{count} layers") };
    let (length, thinnest) = (readable(segment.length()), readable(value));
    let message = format!(
        "segment {index} of the plan ({kind}, {length} mm) takes {layers} of {thinnest} mm{side}, thinner than the \
         {limit} mm that can be printed well"
    );
    Some(Warning { code: THIN_LAYER.to_owned(), message, value, limit })
}

/// Formats a length (mm): with two significant digits if it is below 0.01 mm, and otherwise with three decimals.
fn readable(length: f64) -> String {
    if length.abs() < 0.01 { format!("{length:.1e}") } else { format!("{length:.3}") }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use growbot_core::plan::requirements;

    use super::*;
    use crate::robot_file;

    fn codes(path: &[Segment], robot: &str) -> Vec<String> {
        let robot = robot_file::load(robot.as_ref()).unwrap();
        warnings(path, &requirements(path, &robot), &robot).into_iter().map(|warning| warning.code).collect()
    }

    fn arc(alpha: f64, bend: f64, radius: f64) -> Segment {
        Segment::Arc { alpha, bend, length: bend * radius }
    }

    #[test]
    fn a_loop_collides_with_itself_and_a_bend_does_not() {
        let straight = Segment::Straight { length: 200.0 };
        assert_eq!(codes(&[straight, arc(1.0, TAU, 100.0), straight], "growbot-a"), [SELF_COLLISION]);
        assert!(codes(&[straight, arc(1.0, PI, 100.0), straight], "growbot-a").is_empty());
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let path = [straight, arc(1.0, TAU, 100.0), straight];
        let warnings = warnings(&path, &requirements(&path, &robot), &robot);
        let found = &warnings[0];
        assert_eq!((found.value, found.limit), (0.0, 45.6));
        assert!(found.message.contains("at 8") && found.message.contains("width of 45.6 mm"), "{}", found.message);
    }

    #[test]
    fn a_body_that_needs_more_filament_than_a_spool_gives_a_warning() {
        // Robot A: 330 m of filament are 3589 mm of body.
        assert!(codes(&[Segment::Straight { length: 3588.0 }], "growbot-a").is_empty());
        assert_eq!(codes(&[Segment::Straight { length: 3590.0 }], "growbot-a"), [FILAMENT_SHORT]);
    }

    #[test]
    fn layers_beyond_limits_give_a_warning_for_each_segment() {
        // Tighter than the nozzle can lay: there would be no material on the inner side.
        let path = [arc(0.0, 0.1, 100.0), arc(0.0, 0.1, 15.0), arc(1.0, 0.1, 15.0)];
        assert_eq!(codes(&path, "growbot-a"), [LAYER_LIMIT, THIN_LAYER, LAYER_LIMIT, THIN_LAYER]);
    }

    #[test]
    fn only_segments_with_thin_layers_are_named() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let path = [
            Segment::Straight { length: 100.0 },
            Segment::Straight { length: 0.2 },
            Segment::Arc { alpha: 1.0, bend: 0.5, length: 50.0 },
            Segment::Arc { alpha: 1.0, bend: 0.003, length: 0.3 },
            Segment::Straight { length: 0.3 },
        ];
        let warnings = warnings(&path, &requirements(&path, &robot), &robot);
        assert!(warnings.iter().all(|warning| warning.code == "thin-layer" && warning.limit == 0.3));
        let [line, arc] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(line.message.starts_with("segment 1 of the plan (straight") && line.value == 0.2, "{line:?}");
        assert!(arc.message.starts_with("segment 3 of the plan (arc"), "{arc:?}");
        assert!((arc.value - (0.3 - 22.0 * 0.003)).abs() < 1e-15);
    }
}
