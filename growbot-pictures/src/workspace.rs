//! The picture of a workspace, a single SVG.

use std::fmt::Write;

use growbot_core::angle::degrees;
use growbot_plan::workspace::{Workspace, WorkspaceQuery, WorkspaceSection};

use crate::drawing::canvas::Canvas;
use crate::drawing::chart::{number, round_step};
use crate::drawing::colours::{VIRIDIS, colour};

/// Width and height of the picture, pixels.
const SIZE: (f64, f64) = (880.0, 780.0);
/// Side of the square that the section fills, pixels.
const SQUARE: f64 = 600.0;
/// Upper left corner of the square that the section fills, pixels.
const CORNER: (f64, f64) = (80.0, 100.0);
/// Left edge of the legend.
const LEGEND: f64 = 720.0;

/// Colours of shares of final directions, from 0 to 1.
const BLUES: [[u8; 3]; 5] = [[247, 251, 255], [198, 219, 239], [107, 174, 214], [33, 113, 181], [8, 48, 107]];
/// Number of steps in the colour scale of shares.
const SHARE_STEPS: usize = 10;

const STYLE: &str = ".gc .line{stroke:#fff;stroke-opacity:.75;stroke-width:.8;fill:none}\
.gc .edge{stroke:#1c2430;stroke-width:1.6;fill:none;stroke-linejoin:round;stroke-linecap:round}\
.gc .ball{stroke:#1c2430;stroke-opacity:.45;stroke-dasharray:5 5;fill:none}\
.gc .tube{fill:#e8590c;stroke:#fff;stroke-width:1}.gc .way{stroke:#e8590c;stroke-width:2;fill:none}";

/// Returns the picture as SVG. The right half shows the length of the shortest body to each position, the left half
/// the share of final directions. With a given final direction, both halves show lengths.
pub fn svg(question: &WorkspaceQuery, workspace: &Workspace) -> String {
    let (width, height) = SIZE;
    let mut canvas = Canvas::new(width, height, &title(question));
    canvas.add(format_args!("<style>{STYLE}</style>"));
    let plot = Plot { scale: SQUARE / (2.0 * question.length), length: question.length };
    plot.texts(&mut canvas, question);
    if let Some(shares) = &workspace.share_section {
        plot.shares(&mut canvas, shares);
    }
    if let Some(lengths) = &workspace.section {
        plot.lengths(&mut canvas, lengths);
    }
    plot.axes(&mut canvas, question);
    plot.legend(&mut canvas, workspace.share_section.is_some());
    canvas.finish()
}

fn title(question: &WorkspaceQuery) -> String {
    // A robot's name holds letters, digits and hyphens only.
    format!(
        "{}: within reach of a body of {} mm, bends of radius {} mm",
        question.robot.name(),
        libm::round(question.length * 10.0) / 10.0,
        question.radius
    )
}

struct Plot {
    /// Pixels per mm.
    scale: f64,
    /// Length of the body, mm.
    length: f64,
}

impl Plot {
    /// Returns the coordinates of a position in the picture.
    fn place(&self, lateral: f64, axial: f64) -> (f64, f64) {
        (CORNER.0 + SQUARE / 2.0 + lateral * self.scale, CORNER.1 + SQUARE / 2.0 - axial * self.scale)
    }

    /// Returns the body lengths at which the colour changes. The last one is the whole length.
    fn levels(&self) -> Vec<f64> {
        let step = round_step(self.length, 12.0);
        let mut levels: Vec<f64> =
            (1..=12).map(|i| step * f64::from(i)).take_while(|level| *level < self.length * (1.0 - 1e-9)).collect();
        levels.push(self.length);
        levels
    }

    fn level_colour(&self, index: usize, count: usize) -> String {
        // Near positions are bright, far ones dark.
        colour(&VIRIDIS, 1.0 - (index as f64 + 0.5) / count as f64)
    }

    /// Draws filled contours, the widest first, and the lines between them.
    fn lengths(&self, canvas: &mut Canvas, section: &WorkspaceSection) {
        let levels = self.levels();
        for (index, level) in levels.iter().enumerate().rev() {
            let (area, line) = self.contour(section, *level);
            let class = if index + 1 == levels.len() { "edge" } else { "line" };
            let fill = self.level_colour(index, levels.len());
            canvas.add(format_args!("<path fill=\"{fill}\" d=\"{area}\"/>\n<path class=\"{class}\" d=\"{line}\"/>"));
        }
    }

    /// Returns the area where the values are up to this level, and the line that bounds it, as paths of SVG.
    fn contour(&self, section: &WorkspaceSection, level: f64) -> (String, String) {
        let (mut area, mut line) = (String::new(), String::new());
        let polygon = |text: &mut String, points: &[(f64, f64)], close: &str| {
            for (index, (lateral, axial)) in points.iter().enumerate() {
                let (x, y) = self.place(*lateral, *axial);
                // Writing to a String cannot fail.
                let _ = write!(text, "{}{x:.1} {y:.1}", if index == 0 { "M" } else { "L" });
            }
            text.push_str(close);
        };
        for row in 0..section.rows().saturating_sub(1) {
            let mut run: Option<[(f64, f64); 2]> = None;
            let close_run = |run: &mut Option<[(f64, f64); 2]>| {
                run.take().map(|[from, to]| [from, (to.0, from.1), to, (from.0, to.1)])
            };
            for column in 0..section.columns.saturating_sub(1) {
                let corners = [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(up, over)| section.at(row + up, column + over));
                let [Some(a), Some(b), Some(c), Some(d)] = corners else { continue };
                let corners = [a, b, c, d];
                if corners.iter().all(|(value, ..)| *value <= level) {
                    let from = run.map_or((a.1, a.2), |[from, _]| from);
                    run = Some([from, (c.1, c.2)]);
                    continue;
                }
                if let Some(rectangle) = close_run(&mut run) {
                    polygon(&mut area, &rectangle, "Z");
                }
                let (inside, crossings) = clip(&corners, level, 4.0 * self.length);
                if !inside.is_empty() {
                    polygon(&mut area, &inside, "Z");
                }
                for pair in crossings.chunks_exact(2) {
                    polygon(&mut line, pair, "");
                }
            }
            if let Some(rectangle) = close_run(&mut run) {
                polygon(&mut area, &rectangle, "Z");
            }
        }
        (area, line)
    }

    /// Draws the shares as squares, mirrored to the left. Neighbours of one colour form one rectangle.
    fn shares(&self, canvas: &mut Canvas, shares: &WorkspaceSection) {
        canvas.add("<g shape-rendering=\"crispEdges\">");
        let half = 0.5 * shares.spacing;
        for row in 0..shares.rows() {
            let mut cells = (0..shares.columns).filter_map(|column| shares.at(row, column)).peekable();
            while let Some((share, from, axial)) = cells.next() {
                if share <= 0.0 {
                    continue;
                }
                let mut to = from;
                while let Some((_, lateral, _)) =
                    cells.next_if(|(next, ..)| *next > 0.0 && share_step(*next) == share_step(share))
                {
                    to = lateral;
                }
                // Coordinates are whole pixels, so that the background does not show between neighbours.
                let [(x, y), (right, bottom)] = [(-to - half, axial + half), (half - from, axial - half)]
                    .map(|(lateral, axial)| self.place(lateral, axial))
                    .map(|(x, y)| (x.round(), y.round()));
                let (width, height) = (right - x, bottom - y);
                let fill = colour(&BLUES, share_step(share));
                rectangle(canvas, [x, y, width, height], &fill);
            }
        }
        canvas.add("</g>");
    }

    fn texts(&self, canvas: &mut Canvas, question: &WorkspaceQuery) {
        let [x, y, z, heading, pitch] = question.start.to_degrees().map(|number| (number * 1e3).round() / 1e3 + 0.0);
        let notes = match question.direction {
            None => [
                format!(
                    "Start at {x}, {y}, {z} mm, heading {heading}, pitch {pitch} deg; the same all round its \
                         direction."
                ),
                "Right: the shortest body, whichever way its tip points. Left: the share of final directions within \
                 reach."
                    .to_owned(),
            ],
            Some((to_heading, to_pitch)) => [
                format!(
                    "Start at {x}, {y}, {z} mm, heading {heading}, pitch {pitch} deg; section in the plane of its x \
                     axis."
                ),
                format!(
                    "The shortest body whose tip points to heading {:.1}, pitch {:.1} deg.",
                    degrees(to_heading),
                    degrees(to_pitch)
                ),
            ],
        };
        let left = CORNER.0;
        canvas.text(left, 36.0, "title", title(question));
        for (line, note) in notes.iter().enumerate() {
            canvas.text(left, 58.0 + 18.0 * line as f64, "note", note);
        }
    }

    fn axes(&self, canvas: &mut Canvas, question: &WorkspaceQuery) {
        let (left, top) = CORNER;
        let (right, bottom) = (left + SQUARE, top + SQUARE);
        let step = round_step(2.0 * self.length, 10.0);
        let count = libm::floor(self.length / step) as i32;
        for i in -count..=count {
            let at = step * f64::from(i);
            let (x, y) = self.place(at, at);
            let across = if question.direction.is_none() { at.abs() } else { at };
            canvas.add(format_args!("<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}M{left} {y:.1}H{right}\"/>"));
            canvas.text(x, bottom + 19.0, "mid", number(across));
            canvas.text(left - 8.0, y + 4.5, "end", number(at));
        }
        let (x, y) = self.place(0.0, 0.0);
        let (middle_x, middle_y) = (left + SQUARE / 2.0, top + SQUARE / 2.0);
        let lateral = if question.direction.is_none() { "lateral, mm" } else { "along the start&#8217;s x axis, mm" };
        canvas.add(format_args!("<circle class=\"ball\" cx=\"{x}\" cy=\"{y}\" r=\"{}\"/>", SQUARE / 2.0));
        let square = format_args!("x=\"{left}\" y=\"{top}\" width=\"{SQUARE}\" height=\"{SQUARE}\"");
        canvas.add(format_args!("<rect class=\"axis\" {square}/>"));
        canvas.text(middle_x, bottom + 42.0, "mid", lateral);
        canvas.add(format_args!(
            "<text class=\"mid\" transform=\"translate({} {middle_y}) rotate(-90)\">axial, mm</text>",
            left - 56.0
        ));
        if question.direction.is_none() {
            canvas.add(format_args!("<path class=\"axis\" d=\"M{x} {top}V{bottom}\"/>"));
        }
        // The robot is drawn as the tube at the start and an arrow in the direction of growth.
        let wide = (question.robot.outer_diameter() * self.scale).max(7.0);
        let long = 1.4 * wide;
        canvas.add(format_args!(
            "<path class=\"way\" d=\"M{x} {y}v{:.1}m-5 7l5 -8l5 8\"/>\
             <rect class=\"tube\" x=\"{:.1}\" y=\"{y}\" width=\"{wide:.1}\" height=\"{long:.1}\" rx=\"2\"/>",
            -1.3 * wide - 12.0,
            x - wide / 2.0
        ));
    }

    fn legend(&self, canvas: &mut Canvas, with_shares: bool) {
        let levels = self.levels();
        let (top, bar) = (CORNER.1 + 28.0, 24.0);
        let labels = LEGEND + bar + 8.0;
        let tall = if with_shares { 250.0 } else { 420.0 };
        canvas.text(LEGEND, top - 14.0, "", "body, mm");
        // The scale of lengths: the height of each band is proportional to its range.
        let mut below = 0.0;
        for (index, level) in levels.iter().enumerate() {
            let (y, height) = (top + tall * (1.0 - level / self.length), tall * (level - below) / self.length);
            rectangle(canvas, [LEGEND, y, bar, height], &self.level_colour(index, levels.len()));
            // The last step may be too short for a label next to the one above it.
            if index + 1 == levels.len() || tall * (self.length - level) / self.length > 15.0 {
                canvas.text(labels, y + 4.5, "", (level * 10.0).round() / 10.0);
            }
            below = *level;
        }
        canvas.text(labels, top + tall + 4.5, "", 0);
        if !with_shares {
            return;
        }
        let (top, tall) = (top + tall + 68.0, 200.0);
        canvas.text(LEGEND, top - 14.0, "", "directions, %");
        for step in 0..SHARE_STEPS {
            let height = tall / SHARE_STEPS as f64;
            let y = top + tall - height * (step + 1) as f64;
            let fill = colour(&BLUES, share_step((step as f64 + 0.5) / SHARE_STEPS as f64));
            rectangle(canvas, [LEGEND, y, bar, height], &fill);
            if step % 2 == 1 {
                canvas.text(labels, y + 4.5, "", 100 * (step + 1) / SHARE_STEPS);
            }
        }
        canvas.text(labels, top + tall + 4.5, "", 0);
        canvas.add(format_args!("<rect class=\"grid\" x=\"{LEGEND}\" y=\"{top}\" width=\"{bar}\" height=\"{tall}\"/>"));
    }
}

/// Draws a filled rectangle. `[x, y, width, height]` are in pixels.
fn rectangle(canvas: &mut Canvas, [x, y, width, height]: [f64; 4], fill: &str) {
    canvas.add(format_args!("<rect x=\"{x}\" y=\"{y:.1}\" width=\"{width}\" height=\"{height:.1}\" fill=\"{fill}\"/>"));
}

/// Returns the upper end of the step of the scale that contains a share.
fn share_step(share: f64) -> f64 {
    let step = libm::ceil(share * SHARE_STEPS as f64).max(1.0);
    step / SHARE_STEPS as f64
}

/// Points of a polygon: lateral and axial, mm.
type Polygon = Vec<(f64, f64)>;

/// Returns the part of a cell where the values are at most `level`, and the points where the sides of the cell cross
/// the level. Values above `max` count as `max`.
fn clip(corners: &[(f64, f64, f64); 4], level: f64, max: f64) -> (Polygon, Polygon) {
    let (mut inside, mut crossings) = (Vec::new(), Vec::new());
    for (index, &(value, lateral, axial)) in corners.iter().enumerate() {
        if value <= level {
            inside.push((lateral, axial));
        }
        let (next, next_aside, next_ahead) = corners[(index + 1) % 4];
        if (value <= level) != (next <= level) {
            let (from, to) = (value.min(max), next.min(max));
            let share = ((level - from) / (to - from)).clamp(0.0, 1.0);
            let point = (lateral + share * (next_aside - lateral), axial + share * (next_ahead - axial));
            inside.push(point);
            crossings.push(point);
        }
    }
    (inside, crossings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_clipped_at_the_level() {
        let corners = [(0.0, 0.0, 0.0), (10.0, 1.0, 0.0), (10.0, 1.0, 1.0), (0.0, 0.0, 1.0)];
        let (inside, crossings) = clip(&corners, 5.0, 100.0);
        assert_eq!(inside, [(0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0)]);
        assert_eq!(crossings, [(0.5, 0.0), (0.5, 1.0)]);
    }
}
