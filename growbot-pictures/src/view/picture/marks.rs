//! Marks around a tube: arrows, the tip's axes, discs and the floor.

use growbot_core::pose::Frame;
use nalgebra::Vector3;

use super::projection::{Projection, ScreenBounds, solid};
use crate::drawing::canvas::Canvas;

/// Names and colours of the tip's axes.
const AXES: [(&str, &str); 3] = [("x", "#d93a3a"), ("y", "#2f9e4f"), ("z", "#2f6fe0")];
/// An arrow. Lengths are in mm.
pub struct Arrow {
    /// Position of the tail.
    pub from: Vector3<f64>,
    /// Direction, a unit vector.
    pub along: Vector3<f64>,
    /// Length from the tail to the point.
    pub length: f64,
    /// Radius of the shaft.
    pub thick: f64,
}

impl Arrow {
    /// Returns the tail and the point.
    pub fn ends(&self) -> [Vector3<f64>; 2] {
        [self.from, self.from + self.length * self.along]
    }
}

/// Returns the shaft and head of an arrow as an SVG path element.
pub fn arrow(place: &Projection, arrow: &Arrow, colour: &str) -> String {
    let Arrow { from, along, length, thick } = arrow;
    let at = |share: f64| from + share * length * along;
    let shaft = solid(place, &[(at(0.0), *along, *thick), (at(0.75), *along, *thick)]);
    let head = solid(place, &[(at(0.7), *along, 3.0 * thick), (at(1.0), *along, 0.0)]);
    format!("<path fill=\"{colour}\" stroke=\"none\" d=\"{shaft}{head}\"/>\n")
}

/// Returns the axes of the tip, x, y and z, each with its name and colour.
pub fn tip_axes(base_from_tip: &Frame, length: f64) -> [(Arrow, &'static str, &'static str); 3] {
    let from = base_from_tip.translation.vector;
    let along = |axis: usize| base_from_tip.rotation.matrix().column(axis).into_owned();
    [0, 1, 2]
        .map(|axis| (Arrow { from, along: along(axis), length, thick: 0.035 * length }, AXES[axis].0, AXES[axis].1))
}

/// Name and style of a line that is drawn next to a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineStyle {
    /// Name of the line in the key.
    pub name: &'static str,
    /// Style of the line, as SVG attributes.
    pub style: &'static str,
}

impl LineStyle {
    /// Draws the line through these points, mm.
    pub fn draw(&self, canvas: &mut Canvas, place: &Projection, places: impl Iterator<Item = Vector3<f64>>) {
        canvas.line(places.map(|at| place.point(&at).into()), self.style);
    }
}

/// Draws a key of lines: samples with their names, side by side and centred on `middle`.
pub fn key(canvas: &mut Canvas, [middle, y]: [f64; 2], lines: &[LineStyle]) {
    const SAMPLE: f64 = 30.0;
    const GAP: f64 = 7.0;
    const BETWEEN: f64 = 24.0;
    const LETTER: f64 = 7.2;
    let widths = lines.iter().map(|line| SAMPLE + GAP + LETTER * line.name.len() as f64 + BETWEEN);
    let mut left = middle - 0.5 * (widths.clone().sum::<f64>() - BETWEEN);
    for (line, width) in lines.iter().zip(widths) {
        canvas.line([(left, y - 4.5), (left + SAMPLE, y - 4.5)], line.style);
        canvas.text(left + SAMPLE + GAP, y, "", line.name);
        left += width;
    }
}

/// Draws a round mark. Its radius is in units of the drawing, and at least 3.
pub fn disc(canvas: &mut Canvas, [x, y]: [f64; 2], radius: f64, colour: &str) {
    canvas.add(format_args!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\" fill=\"{colour}\" stroke=\"#fff\"/>",
        radius.max(3.0)
    ));
}

/// The floor under a body, drawn as a grid of whole squares.
pub struct Floor {
    /// Corner with the smallest x and y, at the height of the floor, mm.
    corner: Vector3<f64>,
    /// Number of squares along x and y.
    squares: [u32; 2],
    /// Side of a square, mm.
    side: f64,
}

impl Floor {
    /// Returns a floor at a height under these bounds (x and y), with squares of this side, mm.
    pub fn under(bounds: &ScreenBounds, height: f64, side: f64) -> Self {
        let squares = bounds.size().map(|size| libm::ceil(size / side).max(1.0));
        let [x, y] = bounds.centre();
        let corner = Vector3::new(x - 0.5 * side * squares[0], y - 0.5 * side * squares[1], height);
        Self { corner, squares: squares.map(|count| count as u32), side }
    }

    /// Returns the point this many squares from the corner.
    fn at(&self, x: u32, y: u32) -> Vector3<f64> {
        self.corner + self.side * Vector3::new(f64::from(x), f64::from(y), 0.0)
    }

    /// Returns the four corners of the floor, mm.
    pub fn corners(&self) -> [Vector3<f64>; 4] {
        let [x, y] = self.squares;
        [(0, 0), (x, 0), (0, y), (x, y)].map(|(x, y)| self.at(x, y))
    }

    /// Draws the grid lines of the floor.
    pub fn draw(&self, canvas: &mut Canvas, place: &Projection) {
        let [wide, deep] = self.squares;
        let along = (0..=wide).map(|x| [self.at(x, 0), self.at(x, deep)]);
        let across = (0..=deep).map(|y| [self.at(0, y), self.at(wide, y)]);
        let lines: String = along
            .chain(across)
            .map(|ends| {
                let [from, to] = ends.map(|end| place.point(&end));
                format!("M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1])
            })
            .collect();
        canvas.add(format_args!("<path class=\"grid\" d=\"{lines}\"/>"));
    }
}
