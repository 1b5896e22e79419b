//! Colours of the heights of layers: the palette and its range.

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_plan::figures::fixed;

use crate::drawing::canvas::Canvas;
use crate::drawing::colours::{Palette, hex, mixed};

/// Percentiles of the heights of layers at which the scale of colours begins and ends, unless a range is given. So
/// outliers do not stretch the scale.
pub const PERCENTILES: [f64; 2] = [1.0, 99.0];
/// Greatest height of a splinter, as a fraction of the height of the highest layer. A splinter is a thin layer between
/// two segments of a path, and does not stretch the scale.
const SPLINTER: f64 = 0.2;
/// Width of the legend, units of the drawing.
pub const LEGEND: f64 = 220.0;

/// A mapping from heights of layers to colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightScale {
    palette: Palette,
    /// Heights of the first and the last colour, mm. Heights beyond have the same colours.
    range: [f64; 2],
    /// Smallest and greatest height of the layers, mm.
    all: [f64; 2],
    /// True if the range was given, false if it was derived from the heights.
    is_fixed: bool,
}

impl HeightScale {
    /// Returns the scale for these bodies, each with the radius of the middle of its wall, mm. `range` is the range of
    /// the colours, mm. If `None`, it is derived from the heights.
    pub fn of(bodies: &[(&[LayerBytes], f64)], palette: Palette, range: Option<[f64; 2]>) -> Self {
        let layers = |layers: &[LayerBytes]| layers.iter().map(decode).collect::<Vec<Layer>>();
        Self::new(bodies.iter().flat_map(|(bytes, radius)| heights(&layers(bytes), *radius)).collect(), palette, range)
    }

    /// Returns the scale for one body of these layers. `tip_radius` is the radius of the middle of its wall, mm.
    pub fn of_layers(layers: &[Layer], tip_radius: f64) -> Self {
        Self::new(heights(layers, tip_radius), Palette::default(), None)
    }

    fn new(mut heights: Vec<f64>, palette: Palette, range: Option<[f64; 2]>) -> Self {
        heights.sort_by(f64::total_cmp);
        let all = match (heights.first(), heights.last()) {
            (Some(min), Some(max)) => [*min, *max],
            _ => [0.0, 1.0],
        };
        let last = heights.len().saturating_sub(1) as f64;
        let found = PERCENTILES.map(|percent| percent / 100.0 * last);
        let found = [libm::floor(found[0]), libm::ceil(found[1])];
        let found = [0, 1].map(|end| heights.get(found[end] as usize).copied().unwrap_or(all[end]));
        // Layers of equal height are in the middle of the scale.
        let found = if found[1] - found[0] > 1e-3 { found } else { [found[0] - 0.05, found[1] + 0.05] };
        Self { palette, range: range.unwrap_or(found), all, is_fixed: range.is_some() }
    }

    /// Returns the heights of the first and the last colour, mm.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Returns the colour of a height, mm.
    pub fn colour(&self, height: f64) -> [u8; 3] {
        let [min, max] = self.range;
        mixed(self.palette.colours(), (height - min) / (max - min))
    }

    /// Returns two flags: true if heights lie below the range, and true if heights lie above it.
    fn beyond(&self) -> [bool; 2] {
        [self.all[0] < self.range[0] - 1e-6, self.all[1] > self.range[1] + 1e-6]
    }

    /// Draws the scale of colours, with its name above and numbers below. `[left, y]` is its upper left corner.
    pub fn legend(&self, canvas: &mut Canvas, [left, y]: [f64; 2]) {
        let colours = self.palette.colours();
        let last = colours.len().saturating_sub(1).max(1) as f64;
        let stop = |(index, colour): (usize, &[u8; 3])| {
            format!("<stop offset=\"{}\" stop-color=\"{}\"/>", index as f64 / last, hex(*colour))
        };
        let stops: String = colours.iter().enumerate().map(stop).collect();
        canvas.add(format_args!(
            "<defs><linearGradient id=\"gc-heights\">{stops}</linearGradient></defs>\
             <rect x=\"{left}\" y=\"{y}\" width=\"{LEGEND}\" height=\"10\" rx=\"2\" fill=\"url(#gc-heights)\"/>"
        ));
        let beyond = self.beyond();
        let [low, high] = PERCENTILES;
        let name = "Height of the layers, mm";
        if !self.is_fixed && beyond != [false; 2] {
            canvas.text(left, y - 25.0, "", name);
            canvas.text(left, y - 9.0, "note", format_args!("from percentile {low} to {high}"));
        } else {
            canvas.text(left, y - 9.0, "", name);
        }
        let [min, max] = self.range;
        let signs = [if beyond[0] { "&lt; " } else { "" }, "", if beyond[1] { "&gt; " } else { "" }];
        for ((share, class), sign) in [(0.0, "note"), (0.5, "note mid"), (1.0, "note end")].into_iter().zip(signs) {
            let height = min + share * (max - min);
            canvas.text(left + share * LEGEND, y + 26.0, class, format_args!("{sign}{}", fixed(height, 2)));
        }
    }
}

/// Returns the min and max height of each layer on the middle of its wall, mm, without splinters.
fn heights(layers: &[Layer], tip_radius: f64) -> Vec<f64> {
    let splinter = SPLINTER * layers.iter().map(|layer| layer.height).fold(0.0, f64::max);
    let whole = layers.iter().filter(|layer| layer.height >= splinter);
    whole.flat_map(|layer| [layer.min_height(tip_radius), layer.max_height(tip_radius)]).collect()
}

#[cfg(test)]
mod tests {
    use growbot_core::layer_bytes::LayerEncoder;

    use super::*;

    fn scale(heights: &[f64], range: Option<[f64; 2]>) -> HeightScale {
        let mut encoder = LayerEncoder::default();
        let layer = |height: &f64| encoder.encode(&Layer { alpha: 0.0, height: *height, tilt: 0.0 });
        let layers: Vec<LayerBytes> = heights.iter().map(layer).collect();
        HeightScale::of(&[(&layers, 20.0)], Palette::Viridis, range)
    }

    #[test]
    fn an_outlier_does_not_stretch_the_scale_and_is_marked() {
        let mut heights: Vec<f64> = (0..1000).map(|index| 0.7 + 1e-4 * f64::from(index)).collect();
        heights.push(3.0);
        let found = scale(&heights, None);
        assert!(found.range[0] > 0.7 && found.range[1] < 0.8, "{found:?}");
        assert_eq!((found.beyond(), found.colour(3.0), found.colour(0.1)), ([true; 2], [253, 231, 37], [68, 1, 84]));
        let mut canvas = Canvas::new(300.0, 100.0, "");
        found.legend(&mut canvas, [0.0, 50.0]);
        let drawn = canvas.finish();
        assert!(drawn.contains("from percentile 1 to 99") && drawn.contains("&gt; 0.80"), "{drawn}");
        let fixed_scale = scale(&heights, Some([0.5, 4.0]));
        assert_eq!((fixed_scale.range, fixed_scale.beyond()), ([0.5, 4.0], [false; 2]));
    }

    #[test]
    fn equal_heights_are_in_the_middle_of_the_scale() {
        let alike = scale(&[0.774; 20], None);
        assert_eq!(alike.beyond(), [false; 2]);
        assert!((alike.range[1] + alike.range[0] - 2.0 * 0.774).abs() < 1e-4 && alike.range[1] > alike.range[0] + 0.05);
        assert_eq!(scale(&[], None).range, [0.0, 1.0]);
    }
}
