//! Layers as rows of a table.

use growbot_core::angle::degrees;
use growbot_core::layer::Layer;
use growbot_core::path::Segment;
use growbot_core::robot::Robot;
use growbot_core::slicing::{SlicedLayer, Slicing, layers};
use serde::{Deserialize, Serialize};

use crate::degrees::degrees_below_turn;

/// A row of the table of layers. Layers and segments count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LayerRow {
    /// Index of the segment that the layer belongs to.
    pub segment: usize,
    /// Angle of most material in the tip's frame, degrees, in `[0, 360)`. 0 if the layer is straight.
    pub alpha_deg: f64,
    /// Height of the layer, mm.
    pub height_mm: f64,
    /// Angle by which the tip bends away from the most material, degrees.
    pub tilt_deg: f64,
}

impl LayerRow {
    /// Returns the row of a layer.
    pub fn new(segment: usize, layer: Layer) -> Self {
        let [alpha_deg, height_mm, tilt_deg] = layer_values(layer);
        Self { segment, alpha_deg, height_mm, tilt_deg }
    }
}

/// Returns alpha (degrees), height (mm) and tilt (degrees) of a layer. Alpha is in `[0, 360)`, and 0 if the layer is
/// straight.
pub fn layer_values(Layer { alpha, height, tilt }: Layer) -> [f64; 3] {
    [if tilt > 0.0 { degrees_below_turn(alpha) } else { 0.0 }, height, degrees(tilt)]
}

/// Returns the rows of the layers of a path, by exact slicing.
pub fn layer_rows<'a>(path: &'a [Segment], robot: &'a Robot) -> impl Iterator<Item = LayerRow> + 'a {
    layers(path, robot, Slicing::Exact).map(|SlicedLayer { segment, layer }| LayerRow::new(segment, layer))
}
