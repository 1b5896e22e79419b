//! Centreline and layers as CSV, in full precision.

use std::fmt::Write;

use growbot_core::layer::Layer;
use growbot_core::pose::{Frame, tip_direction};
use nalgebra::Vector3;

use super::body::ExportedBody;
use crate::figures::shortest;
use crate::layer_table::{LAYER_COLUMNS, fields};

/// Header of the columns of the tip: number of layers laid, then the tip's position (mm) and direction (a unit vector).
/// Further columns contain the values of the layer laid last and its source.
pub const TIP: &str = "laid,x_mm,y_mm,z_mm,direction_x,direction_y,direction_z";

/// Header of the columns of the commanded position, which are present for a simulated tip: the position that the tip
/// would have if the plastic lay as the steps command.
pub const COMMANDED: &str = ",commanded_x_mm,commanded_y_mm,commanded_z_mm";

/// Returns the table with a row for the start, which has a layer of height 0, and a row for each layer. Row `n` is the
/// tip after `n` layers, the last of which is layer `n - 1` of `growbot layers`.
pub fn write(body: &ExportedBody, commanded: Option<&ExportedBody>) -> String {
    let mut text = format!("{TIP},{LAYER_COLUMNS},source{}\n", if commanded.is_some() { COMMANDED } else { "" });
    let beside = |laid: usize| {
        commanded.map(|commanded| match laid.checked_sub(1) {
            None => Some(commanded.base_from_start),
            Some(last) => commanded.layers.get(last).map(|layer| layer.base_from_tip),
        })
    };
    row(&mut text, 0, &body.base_from_start, &Layer::default(), "start", beside(0));
    for (index, laid) in body.layers.iter().enumerate() {
        let laid_by_then = index + 1;
        row(&mut text, laid_by_then, &laid.base_from_tip, &laid.layer, laid.source.name(), beside(laid_by_then));
    }
    text
}

/// Appends a row. `beside` is the commanded pose of the tip. It is `None` if the table has no columns for it, and
/// `Some(None)` for a layer that was not finished, whose fields are then empty.
fn row(
    text: &mut String,
    laid: usize,
    base_from_tip: &Frame,
    layer: &Layer,
    source: &str,
    beside: Option<Option<Frame>>,
) {
    let at = base_from_tip.translation.vector;
    let to = tip_direction(base_from_tip);
    let fields = fields(layer);
    // Writing to a String does not fail.
    let _ = write!(text, "{laid},{},{},{fields},{source}", three(&at), three(&to));
    let _ = match beside.map(|tip| tip.map(|tip| tip.translation.vector)) {
        None => writeln!(text),
        Some(None) => writeln!(text, ",,,"),
        Some(Some(at)) => writeln!(text, ",{}", three(&at)),
    };
}

fn three(vector: &Vector3<f64>) -> String {
    [vector.x, vector.y, vector.z].map(shortest).join(",")
}

#[cfg(test)]
mod tests {
    use super::super::body::LayerSource;
    use super::*;
    use growbot_client::robot_file;

    #[test]
    fn rows_contain_the_tip_after_each_layer() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let layer = |tilt| Layer { alpha: 1.5, height: 0.1 + 0.2, tilt };
        let body =
            ExportedBody::of_layers(&robot, [(layer(0.0), LayerSource::Planned), (layer(0.005), LayerSource::AsBuilt)]);
        let text = write(&body, None);
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows[0].join(","), format!("{TIP},{LAYER_COLUMNS},source"));
        let up = shortest(tip_direction(&body.base_from_start).x);
        assert_eq!(rows[1].join(","), format!("0,0,0,0,{up},0,1,0,0,0,start"));
        assert_eq!((rows[2][0], rows[2][3]), ("1", "0.30000000000000004"));
        assert_eq!(rows[2][7..].join(","), "0,0.30000000000000004,0,planned");
        let end = body.layers[1].base_from_tip.translation.vector;
        assert_eq!([1, 2, 3].map(|column| rows[3][column].parse::<f64>().unwrap()), [end.x, end.y, end.z]);
        assert_eq!(rows[3][10], "as-built");
        assert_eq!(rows.len(), 4);
        let commanded = ExportedBody::of_layers(&robot, [(layer(0.0), LayerSource::AsBuilt)]);
        let text = write(&body, Some(&commanded));
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(rows.iter().all(|row| row.len() == 14));
        assert_eq!(
            (&rows[0][11], &rows[2][11..], &rows[3][11..]),
            (&"commanded_x_mm", &rows[2][1..4], &["", "", ""][..])
        );
    }
}
