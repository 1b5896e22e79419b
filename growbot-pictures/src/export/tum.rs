//! The path of the tip as a TUM trajectory, which `evo` and other programs read. Each pose is a line
//! `timestamp tx ty tz qx qy qz qw`, in seconds and metres.

use std::fmt::Write;

use growbot_core::layer::Layer;
use growbot_core::pose::Frame;
use growbot_plan::plan::Plan;
use nalgebra::UnitQuaternion;

use super::body::ExportedBody;
use crate::view::plot::series::Timeline;

/// Returns the time (s) at which each layer of a body was laid, by the board's clock according to the run log `log`.
/// Without a log, returns the planned times.
pub fn times(body: &ExportedBody, plan: &Plan, log: Option<&[u8]>) -> Vec<f64> {
    let layers: Vec<Layer> = body.layers.iter().map(|laid| laid.layer).collect();
    let timeline = log.map_or_else(|| Timeline::planned(&layers, plan), |log| Timeline::from_log(log, &layers, plan));
    timeline.laid
}

/// Returns the trajectory of a body as text. `name` is part of its header, and `laid` are the times (s) at which the
/// layers were laid. The start comes first, unless the first layer was laid at time 0.
pub fn write(name: &str, body: &ExportedBody, laid: &[f64]) -> String {
    let mut text = format!(
        "# growbot {}, {}, {name}: tip after each layer, s and m\n# timestamp tx ty tz qx qy qz qw\n",
        env!("CARGO_PKG_VERSION"),
        body.robot
    );
    if laid.first().is_none_or(|first| *first > 0.0) {
        row(&mut text, 0.0, &body.base_from_start);
    }
    for (layer, at) in body.layers.iter().zip(laid) {
        row(&mut text, *at, &layer.base_from_tip);
    }
    text
}

/// Appends a row for a pose at the time `at` (s). Each number has the shortest text that is read back as the same
/// number.
fn row(text: &mut String, at: f64, frame: &Frame) {
    let [x, y, z] = <[f64; 3]>::from(frame.translation.vector).map(|mm| mm / 1000.0);
    let turn = UnitQuaternion::from_rotation_matrix(&frame.rotation);
    // Writing to a String does not fail.
    let _ = writeln!(text, "{at} {x} {y} {z} {} {} {} {}", turn.i, turn.j, turn.k, turn.w);
}

#[cfg(test)]
mod tests {
    use growbot_plan::robot_file;

    use super::super::body::LayerSource;
    use super::*;

    #[test]
    fn rows_for_the_start_and_each_layer() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let layer = Layer { alpha: 0.0, height: 0.5, tilt: 0.0 };
        let body = ExportedBody::of_layers(&robot, [(layer, LayerSource::Planned), (layer, LayerSource::Planned)]);
        let text = write("planned", &body, &[18.0, 36.5]);
        let rows: Vec<Vec<f64>> = text
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect())
            .collect();
        assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), [0.0, 18.0, 36.5]);
        assert_eq!((rows[2][3], rows[2].len()), (0.001, 8));
        assert!(text.starts_with("# growbot ") && text.contains("planned"));
        // The board's time may begin with the first layer.
        assert_eq!(write("planned", &body, &[0.0, 18.0]).lines().count(), 4);
    }
}
