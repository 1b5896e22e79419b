//! Centreline and layers as CSV, in full precision.

use std::iter::once;

use growbot_core::layer::Layer;
use growbot_core::pose::{Frame, tip_direction};
use growbot_plan::table::{NumberFormat, Table};

use super::body::{BodyLayer, ExportedBody};
use crate::layer_table::layer_columns;

/// Number of layers laid, the tip after them, the layer laid last, and its source.
type Row = (usize, Frame, Layer, &'static str);

/// Returns the table with a row for the start, which has a layer of height 0, and a row for each layer. Row `n` is the
/// tip after `n` layers, the last of which is layer `n - 1` of `growbot layers`. The position is in mm, and the
/// direction is a unit vector. For a simulated tip, `commanded` is the body that it would have laid if the plastic lay
/// as the steps command. A layer that was not finished has no commanded position.
pub fn write(body: &ExportedBody, commanded: Option<&ExportedBody>) -> String {
    let table = Table::new(NumberFormat::Shortest)
        .column("laid", |(laid, ..): &Row| *laid)
        .columns(["x_mm", "y_mm", "z_mm"], |(_, tip, ..)| <[f64; 3]>::from(tip.translation.vector))
        .columns(["direction_x", "direction_y", "direction_z"], |(_, tip, ..)| <[f64; 3]>::from(tip_direction(tip)));
    let mut table = layer_columns(table, |(.., layer, _)| *layer).column("source", |(.., source)| *source);
    if let Some(commanded) = commanded {
        let tips: Vec<Frame> = commanded.tips().collect();
        table = table.columns(["commanded_x_mm", "commanded_y_mm", "commanded_z_mm"], move |(laid, ..)| {
            [0, 1, 2].map(|axis| tips.get(*laid).map(|tip| tip.translation.vector[axis]))
        });
    }
    let laid = body.layers.iter().map(|BodyLayer { layer, source, .. }| (*layer, source.name()));
    let all = once((Layer::default(), "start")).chain(laid).zip(body.tips()).enumerate();
    table.csv(all.map(|(laid, ((layer, source), tip))| (laid, tip, layer, source)))
}

#[cfg(test)]
mod tests {
    use growbot_plan::figures::shortest;
    use growbot_plan::robot_file;

    use super::super::body::LayerSource;
    use super::*;

    const HEADER: &str = "laid,x_mm,y_mm,z_mm,direction_x,direction_y,direction_z,alpha_deg,height_mm,tilt_deg,source";

    #[test]
    fn rows_contain_the_tip_after_each_layer() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let layer = |tilt| Layer { alpha: 1.5, height: 0.1 + 0.2, tilt };
        let body =
            ExportedBody::of_layers(&robot, [(layer(0.0), LayerSource::Planned), (layer(0.005), LayerSource::AsBuilt)]);
        let text = write(&body, None);
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows[0].join(","), HEADER);
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
