//! The layers of a plan as CSV, in the order in which the head lays them.

use std::io::{self, Write};

use growbot_core::layer::Layer;
use growbot_core::path::Segment;
use growbot_core::robot::Robot;
use growbot_core::slicing::{SlicedLayer, Slicing, layers};
use growbot_plan::plan_file::{LAYER_CSV_BEGIN, layer_values};
use growbot_plan::table::{NumberFormat, Table};

/// Adds the columns of a layer's values. `alpha_deg` is in `[0, 360)`, and 0 if the layer is straight.
pub fn layer_columns<'a, R>(table: Table<'a, R>, layer: impl Fn(&R) -> Layer + 'a) -> Table<'a, R> {
    table.columns(["alpha_deg", "height_mm", "tilt_deg"], move |row| layer_values(layer(row)))
}

/// Writes the layers of a path, by exact slicing, in full precision. Layers and segments count from 0. `alpha_deg` is
/// in `[0, 360)`, and 0 if a layer is straight.
///
/// # Errors
/// Errors of `out`.
pub fn write_layers(out: &mut impl Write, path: &[Segment], robot: &Robot) -> io::Result<()> {
    let table = layer_columns(Table::new(NumberFormat::Shortest), |layer: &Layer| *layer);
    write!(out, "{LAYER_CSV_BEGIN}{}", table.csv_header())?;
    // The layers of a segment are equal, so each text is formatted once.
    let mut last = Layer::default();
    let mut row = String::new();
    for (index, SlicedLayer { segment, layer }) in layers(path, robot, Slicing::Exact).enumerate() {
        if row.is_empty() || layer != last {
            row = table.csv_row(&layer);
            last = layer;
        }
        write!(out, "{index},{segment},{row}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use growbot_core::angle::degrees;
    use growbot_plan::robot_file;

    use super::*;

    #[test]
    fn rows_are_numbered_from_0_with_values_in_range() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let path = [
            Segment::Straight { length: 1.0 },
            Segment::Arc { alpha: TAU, bend: 0.005, length: 0.5 },
            Segment::Arc { alpha: 2.0, bend: 0.0, length: 0.5 },
        ];
        let mut out = Vec::new();
        write_layers(&mut out, &path, &robot).unwrap();
        let tilt = degrees(0.005);
        assert_eq!(
            String::from_utf8(out).unwrap(),
            format!(
                "layer,segment,alpha_deg,height_mm,tilt_deg\n0,0,0,0.5,0\n1,0,0,0.5,0\n2,1,0,0.5,{tilt}\n3,2,0,0.5,0\n"
            )
        );
    }
}
