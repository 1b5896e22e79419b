//! What speaks against growing a path: said with the plan, which is given all the same.

use growbot_core::path::Segment;
use growbot_core::robot::Robot;
use growbot_core::slicing::{LIMIT_SLACK, Slicing, layers};
use serde::{Deserialize, Serialize};

/// One thing that speaks against growing a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Warning {
    /// What kind of thing, for scripts: `thin-layer`.
    pub code: String,
    /// What it is, for people.
    pub message: String,
    /// The value found.
    pub value: f64,
    /// The limit that it passes.
    pub limit: f64,
}

/// Code of the warning of layers that are thinner, on the inner side of the bend, than what prints well.
pub const THIN_LAYER: &str = "thin-layer";

/// All that speaks against growing this path on this robot.
#[must_use]
pub fn warnings(path: &[Segment], robot: &Robot) -> Vec<Warning> {
    path.iter().enumerate().filter_map(|(index, segment)| thin_layer(index, segment, robot)).collect()
}

/// The layers of a segment are all alike: its first one tells whether they are too thin (value and limit in mm).
fn thin_layer(index: usize, segment: &Segment, robot: &Robot) -> Option<Warning> {
    let mut layers = layers(std::slice::from_ref(segment), robot, Slicing::Exact);
    let count = layers.size_hint().0;
    let value = layers.next()?.layer.least_height(robot.tip_radius());
    let limit = robot.description().layer.height_min_mm;
    if value >= limit * (1.0 - LIMIT_SLACK) {
        return None;
    }
    let (kind, side) = match segment {
        Segment::Arc { .. } => ("arc", " on the inner side of the bend"),
        Segment::Straight { .. } => ("straight", ""),
        Segment::Helicoid { .. } => ("helicoid", " on the inner side of the bend"),
    };
    let layers = if count == 1 { "1 layer" } else { &format!("{count} layers") };
    let (length, thinnest) = (readable(segment.length()), readable(value));
    let message = format!(
        "segment {index} ({kind}, {length} mm) takes {layers} of {thinnest} mm{side}, below the {limit} mm that print well"
    );
    Some(Warning { code: THIN_LAYER.to_owned(), message, value, limit })
}

/// Two digits of a small length, three decimals of others, mm.
fn readable(length: f64) -> String {
    if length.abs() < 0.01 { format!("{length:.1e}") } else { format!("{length:.3}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file;

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
        let warnings = warnings(&path, &robot);
        assert!(warnings.iter().all(|warning| warning.code == "thin-layer" && warning.limit == 0.3));
        let [line, arc] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(line.message.starts_with("segment 1 (straight") && line.value == 0.2, "{line:?}");
        assert!(arc.message.starts_with("segment 3 (arc"), "{arc:?}");
        assert!((arc.value - (0.3 - 22.0 * 0.003)).abs() < 1e-15);
    }
}
