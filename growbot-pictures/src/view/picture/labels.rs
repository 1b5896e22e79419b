//! Labels of a picture: numbers, names and the narrowest clearance. Each is placed where it covers no other label, and
//! rather beside the body than on it.

use std::f64::consts::TAU;

use super::projection::Rect;
use crate::drawing::canvas::{Canvas, escape};

/// Height of a line, and approximate width of a letter of a number and of a name, units of the drawing.
const LINE: f64 = 16.0;
const DIGIT: f64 = 7.0;
const LETTER: f64 = 7.8;
/// Least distance between two labels in one direction.
const GAP: f64 = 2.0;
/// Distances from a point to its label that are tried, units of the drawing. Beyond `LEADER`, a line leads to a label.
const FAR: [f64; 6] = [7.0, 16.0, 30.0, 52.0, 80.0, 120.0];
const LEADER: f64 = 40.0;
/// Costs of a place that covers another label or a part of the body, and of each unit by which it leaves the frame.
const COVERED: f64 = 1e4;
const ON_BODY: f64 = 60.0;
const BEYOND: f64 = 0.5;
/// Cost of a place on the side that is opposite to the preferred one.
const BEHIND: f64 = 30.0;

/// Kind of a label.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Number or name of an axis.
    Axis,
    /// Name of a mark, in this colour.
    Mark(&'static str),
}

/// A label in its place.
#[derive(Debug)]
struct Label {
    kind: Kind,
    lines: Vec<String>,
    rect: Rect,
    /// Line from a point to the label.
    leader: Option<[[f64; 2]; 2]>,
}

/// All labels of a body.
#[derive(Debug)]
pub struct Labels {
    placed: Vec<Label>,
    /// Points of the body and its arrows in the drawing, each with the radius that labels leave free.
    body: Vec<([f64; 2], f64)>,
    /// Rectangle that labels rather do not leave.
    frame: Rect,
    /// Greatest width of a label, units of the drawing.
    max_width: f64,
}

impl Labels {
    /// Returns an empty list for a body that has these points in the drawing, each with a radius.
    pub fn new(body: Vec<([f64; 2], f64)>, frame: Rect, max_width: f64) -> Self {
        Self { placed: Vec::new(), body, frame, max_width }
    }

    /// Returns the rectangle that labels rather do not leave.
    pub fn frame(&self) -> &Rect {
        &self.frame
    }

    /// Lets labels leave free a line between two points of the drawing, rather than cover it.
    pub fn avoid(&mut self, from: [f64; 2], to: [f64; 2], radius: f64) {
        let shares = (0..=32).map(|part| f64::from(part) / 32.0);
        self.body.extend(shares.map(|share| ([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])), radius)));
    }

    /// Adds the number of a tick, if there is space for it beside this point in the direction `out`.
    pub fn add_number(&mut self, at: [f64; 2], out: [f64; 2], text: String) {
        let size = [DIGIT * text.chars().count() as f64, LINE];
        let rect = beside(at, out, 3.0, size);
        if !self.is_covered(&rect) {
            self.placed.push(Label { kind: Kind::Axis, lines: vec![text], rect, leader: None });
        }
    }

    /// Adds a label beside a point, rather in the direction `ahead` than elsewhere.
    pub fn add(&mut self, at: [f64; 2], ahead: [f64; 2], text: &str, kind: Kind) {
        let lines = wrapped(text, (self.max_width / LETTER) as usize);
        let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
        let size = [LETTER * longest as f64, LINE * lines.len() as f64];
        let seen = libm::hypot(ahead[0], ahead[1]).max(1e-9);
        let labels = &*self;
        let places = FAR.into_iter().flat_map(|far| {
            (0..16).map(move |side| TAU * f64::from(side) / 16.0).map(move |angle| {
                let out = [libm::cos(angle), libm::sin(angle)];
                let rect = beside(at, out, far, size);
                let turned = 1.0 - (out[0] * ahead[0] + out[1] * ahead[1]) / seen;
                (far + 0.5 * BEHIND * turned + labels.cost(&rect), far, out, rect)
            })
        });
        let Some((_, far, out, rect)) = places.min_by(|a, b| a.0.total_cmp(&b.0)) else { return };
        let leader = (far > LEADER && kind != Kind::Axis).then(|| [at, [at[0] + far * out[0], at[1] + far * out[1]]]);
        self.placed.push(Label { kind, lines, rect, leader });
    }

    fn cost(&self, rect: &Rect) -> f64 {
        let covered = if self.is_covered(rect) { COVERED } else { 0.0 };
        let is_on_body = self.body.iter().any(|(point, radius)| {
            let near = [0, 1].map(|axis| point[axis].clamp(rect[axis], rect[axis + 2]) - point[axis]);
            libm::hypot(near[0], near[1]) < *radius
        });
        let beyond: f64 = beyond(rect, &self.frame).iter().sum();
        covered + if is_on_body { ON_BODY } else { 0.0 } + BEYOND * beyond
    }

    fn is_covered(&self, rect: &Rect) -> bool {
        self.rects()
            .any(|other| (0..2).all(|axis| rect[axis] < other[axis + 2] + GAP && other[axis] < rect[axis + 2] + GAP))
    }

    /// Returns the rectangles that the labels cover.
    pub fn rects(&self) -> impl Iterator<Item = &Rect> {
        self.placed.iter().map(|label| &label.rect)
    }

    /// Returns the space that the labels need beyond the frame: left, top, right, bottom.
    pub fn margins(&self) -> [f64; 4] {
        self.rects().fold([0.0; 4], |most, rect| {
            let beyond = beyond(rect, &self.frame);
            std::array::from_fn(|side| most[side].max(beyond[side]))
        })
    }

    /// Draws all labels, readable on any background.
    pub fn draw(&self, canvas: &mut Canvas) {
        for Label { kind, leader, .. } in &self.placed {
            if let (Kind::Mark(colour), Some(ends)) = (kind, leader) {
                for (stroke, width) in [("#fff", 3.5), (colour, 1.2)] {
                    let style = format!("stroke=\"{stroke}\" stroke-width=\"{width}\"");
                    canvas.line(ends.map(<(f64, f64)>::from), style);
                }
            }
        }
        for Label { kind, lines, rect, .. } in &self.placed {
            for (line, number) in lines.iter().zip(0..) {
                let (x, y) = (0.5 * (rect[0] + rect[2]), rect[1] + LINE * (f64::from(number) + 0.78));
                let (class, style) = match kind {
                    Kind::Axis => ("note mid", String::new()),
                    Kind::Mark(colour) => ("mid", format!(" font-weight=\"600\" style=\"fill:{colour}\"")),
                };
                for halo in [" stroke=\"#fff\" stroke-width=\"3.5\" stroke-linejoin=\"round\"", ""] {
                    canvas.add(format_args!(
                        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\"{style}{halo}>{}</text>",
                        escape(line)
                    ));
                }
            }
        }
    }
}

/// Returns the rectangle of a size that lies beside a point in the direction `out`, at a distance.
fn beside(at: [f64; 2], out: [f64; 2], far: f64, size: [f64; 2]) -> Rect {
    let [x, y] = [0, 1].map(|axis| at[axis] + out[axis] * (far + 0.5 * size[axis]));
    [x - 0.5 * size[0], y - 0.5 * size[1], x + 0.5 * size[0], y + 0.5 * size[1]]
}

/// Returns how far a rectangle extends beyond a frame: left, top, right, bottom.
fn beyond(rect: &Rect, frame: &Rect) -> [f64; 4] {
    std::array::from_fn(|side| ((rect[side] - frame[side]) * if side < 2 { -1.0 } else { 1.0 }).max(0.0))
}

/// Divides a text into lines of at most about `max` letters.
fn wrapped(text: &str, max: usize) -> Vec<String> {
    text.split(' ').fold(Vec::new(), |mut lines: Vec<String>, word| {
        match lines.last_mut().filter(|line| line.chars().count() + word.chars().count() < max) {
            Some(line) => *line = format!("{line} {word}"),
            None => lines.push(word.to_owned()),
        }
        lines
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_cover_neither_each_other_nor_the_body() {
        let body: Vec<_> = (0..20).map(|step| ([100.0, 10.0 * f64::from(step)], 15.0)).collect();
        let mut labels = Labels::new(body.clone(), [0.0, 0.0, 200.0, 200.0], 100.0);
        for number in 0..12 {
            let text = format!("5.0{number} mm to the ball at 0, 0, 150");
            labels.add([100.0, 100.0], [1.0, 0.0], &text, Kind::Mark("#000"));
        }
        labels.add_number([100.0, 100.0], [1.0, 0.0], "250".to_owned());
        let rects: Vec<&Rect> = labels.rects().collect();
        for (index, rect) in rects.iter().enumerate() {
            for other in &rects[..index] {
                assert!(
                    (0..2).any(|axis| rect[axis] >= other[axis + 2] || other[axis] >= rect[axis + 2]),
                    "{rect:?} covers {other:?}"
                );
            }
        }
        assert!(rects[0][0] >= 115.0, "{:?}", rects[0]);
        assert!(labels.margins()[2] > 0.0, "the frame is small");
    }

    #[test]
    fn long_labels_have_several_lines() {
        assert_eq!(wrapped("5.03 mm to the ball at 0, 0, 150", 18), ["5.03 mm to the", "ball at 0, 0, 150"]);
        assert_eq!(wrapped("start", 2), ["start"]);
    }
}
