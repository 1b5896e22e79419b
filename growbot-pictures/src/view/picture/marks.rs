//! Marks around a tube: arrows, the tip's axes, discs, labels and the floor.

use growbot_core::pose::Frame;
use nalgebra::Vector3;

use super::projection::{Projection, ScreenBounds, WIDE, solid};
use crate::drawing::canvas::Canvas;

/// Names and colours of the tip's axes.
const AXES: [(&str, &str); 3] = [("x", "#d93a3a"), ("y", "#2f9e4f"), ("z", "#2f6fe0")];
/// Half the width of a letter, units of the drawing. `WORD` is half the height of a word with the gap above it.
const LETTER: f64 = 4.2;
const WORD: f64 = 14.0;
/// Distance from a point to its word that [`word_at_free_side`] draws, units of the drawing.
const FAR: f64 = 52.0;
/// Space around a point that a word drawn by [`word_at_free_side`] needs, units of the drawing.
pub const FREE_SIDE: f64 = FAR + 2.0 * WORD;

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

/// Returns the shaft and head of an arrow as an SVG path element.
pub fn arrow(place: &Projection, arrow: &Arrow, colour: &str) -> String {
    let Arrow { from, along, length, thick } = arrow;
    let at = |share: f64| from + share * length * along;
    let shaft = solid(place, &[(at(0.0), *along, *thick), (at(0.75), *along, *thick)]);
    let head = solid(place, &[(at(0.7), *along, 3.0 * thick), (at(1.0), *along, 0.0)]);
    format!("<path fill=\"{colour}\" stroke=\"none\" d=\"{shaft}{head}\"/>\n")
}

/// Draws the axes of the tip, x, y and z, over everything. An axis that points at the viewer has no name.
pub fn draw_axes(canvas: &mut Canvas, place: &Projection, base_from_tip: &Frame, length: f64) {
    let mut axes: Vec<_> = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .map(|axis| base_from_tip.rotation * axis)
        .zip(AXES)
        .collect();
    axes.sort_by(|(a, _), (b, _)| place.camera.depth(a).total_cmp(&place.camera.depth(b)));
    let from = base_from_tip.translation.vector;
    let [ahead_right, ahead_down] = place.direction(&(base_from_tip.rotation * Vector3::z()));
    for (along, (name, colour)) in axes {
        let axis = Arrow { from, along, length, thick: 0.035 * length };
        canvas.add(arrow(place, &axis, colour).trim_end());
        let [right, down] = place.direction(&along);
        let seen = libm::hypot(right, down);
        // The goal's arrow continues where z ends.
        let over_z = right * ahead_right + down * ahead_down > 0.8 * seen * libm::hypot(ahead_right, ahead_down);
        if seen > 0.35 && !over_z {
            word_beyond(canvas, place, &(from + length * along), &along, name, colour);
        }
    }
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
    let widths = lines.iter().map(|line| SAMPLE + GAP + 1.7 * LETTER * line.name.len() as f64 + BETWEEN);
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

/// Draws a word centred on a point, moved as far as needed to fit into the drawing, and readable on any background.
pub fn draw_label(canvas: &mut Canvas, [x, y]: [f64; 2], text: &str, colour: &str) {
    let half = LETTER * text.chars().count() as f64 + 4.0;
    let x = x.max(half).min(WIDE - half);
    for style in ["stroke=\"#fff\" stroke-width=\"3.5\" stroke-linejoin=\"round\"", ""] {
        canvas.add(format_args!(
            "<text class=\"mid\" x=\"{x:.1}\" y=\"{y:.1}\" font-weight=\"600\" style=\"fill:{colour}\" \
             {style}>{text}</text>"
        ));
    }
}

/// Draws a word beyond the end of an arrow.
pub fn word_beyond(
    canvas: &mut Canvas,
    place: &Projection,
    end: &Vector3<f64>,
    along: &Vector3<f64>,
    text: &str,
    colour: &str,
) {
    let [x, y] = place.point(end);
    let [right, down] = place.direction(along);
    let seen = libm::hypot(right, down);
    let [right, down] = if seen > 1e-6 { [right / seen, down / seen] } else { [0.0, 1.0] };
    let aside = LETTER * text.chars().count() as f64 + 8.0;
    draw_label(canvas, [x + right * aside, y + down * WORD + 4.5], text, colour);
}

/// Draws a word next to a point, with a line to it, on the side that is farthest from the directions in `taken`.
pub fn word_at_free_side(
    canvas: &mut Canvas,
    place: &Projection,
    [x, y]: [f64; 2],
    taken: &[Vector3<f64>],
    text: &str,
    colour: &str,
) {
    let taken: Vec<[f64; 2]> = taken.iter().map(|along| place.direction(along)).collect();
    // Greatest dot product of a side with the directions in `taken`. A free side has a small one.
    let crowded = |[right, down]: &[f64; 2]| {
        taken.iter().map(|[along, below]| right * along + down * below).fold(f64::NEG_INFINITY, f64::max)
    };
    let sides = (0..16)
        .map(|side| std::f64::consts::TAU * f64::from(side) / 16.0)
        .map(|angle| [libm::cos(angle), libm::sin(angle)]);
    let Some([right, down]) = sides.min_by(|a, b| crowded(a).total_cmp(&crowded(b))) else { return };
    let (end_x, end_y) = (x + FAR * right, y + FAR * down);
    for (stroke, width) in [("#fff", 3.5), (colour, 1.2)] {
        canvas.line([(x, y), (end_x, end_y)], format_args!("stroke=\"{stroke}\" stroke-width=\"{width}\""));
    }
    let aside = LETTER * text.chars().count() as f64 + 4.0;
    draw_label(canvas, [end_x + right * aside, end_y + down * WORD + 4.5], text, colour);
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
