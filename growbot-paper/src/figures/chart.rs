//! Common parts of all figures: colours, styles, marks, and clouds of dots.

use growbot_pictures::drawing::canvas::Canvas;
use growbot_pictures::drawing::chart::Panel;

use super::super::paper::MeanSd;
use super::super::statistics::SampleSummary;

/// Colour of growths with the step height of the paper's text. All colours here are those of Okabe and Ito, which
/// colour-blind readers can distinguish.
pub const TEXT_STEP: &str = "#0072b2";
/// Colour of growths with the step height of the paper's table.
pub const TABLE_STEP: &str = "#e69f00";
/// Colour of growths with exact slicing.
pub const EXACT: &str = "#009e73";
/// Colour of growths in closed loop.
pub const CLOSED: &str = "#b5488f";
/// Colour of the paper's numbers.
pub const PAPER: &str = "#1c2430";
/// Colours of robots A, B and C, in figures that distinguish robots by colour.
pub const ROBOT: [&str; 3] = ["#0072b2", "#d55e00", "#009e73"];

/// Half the width of a cloud of dots, in units of the x axis.
const CLOUD: f64 = 0.11;

/// Returns a drawing of this size, with a title and lines of notes below it.
pub fn figure(width: f64, height: f64, title: &str, notes: &[String]) -> Canvas {
    let mut canvas = Canvas::new(width, height, title);
    canvas.text(24.0, 34.0, "title", title);
    for (line, note) in notes.iter().enumerate() {
        canvas.text(24.0, 56.0 + 17.0 * line as f64, "note", note);
    }
    canvas
}

/// Drawing of legends.
pub trait CanvasExt {
    /// Draws a legend in a row. Each entry is a mark, its colour and a text. Returns the x coordinate of the legend's
    /// end.
    fn legend(&mut self, x: f64, y: f64, entries: &[(Mark, &str, String)]) -> f64;
}

impl CanvasExt for Canvas {
    fn legend(&mut self, x: f64, y: f64, entries: &[(Mark, &str, String)]) -> f64 {
        let mut x = x;
        for (mark, colour, label) in entries {
            mark.draw(self, (x + 8.0, y - 4.5), colour);
            self.text(x + 22.0, y, "", label);
            x += 44.0 + 6.9 * label.chars().count() as f64;
        }
        x
    }
}

/// Shape that represents a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// Dot: a single growth.
    Dot,
    /// Square: a median.
    Square,
    /// Dashed line: a mean.
    Dash,
    /// Diamond: a number of the paper.
    Diamond,
    /// Disc on a line: one of our means, or a single value.
    Disc,
    /// Line: a curve in a picture of paths.
    Line,
    /// Empty ring: one of our means in the plot of the position error against `k`, the bend of one step (radians).
    Ring,
}

impl Mark {
    /// Draws the mark.
    pub fn draw(self, canvas: &mut Canvas, (x, y): (f64, f64), colour: &str) {
        match self {
            Self::Dot => canvas.add(format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.4\" fill=\"{colour}\" \
                                                  fill-opacity=\".4\"/>"
            )),
            Self::Square => canvas.add(format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"9\" height=\"9\" fill=\"{colour}\" stroke=\"#fff\" \
                 stroke-width=\"1.4\"/>",
                x - 4.5,
                y - 4.5
            )),
            Self::Dash => canvas.line([(x - 9.0, y), (x + 9.0, y)], dashed(colour)),
            Self::Diamond => canvas.add(format_args!(
                "<path d=\"M{x:.1} {:.1}l5.5 5.5l-5.5 5.5l-5.5 -5.5Z\" fill=\"{colour}\" stroke=\"#fff\" \
                 stroke-width=\"1\"/>",
                y - 5.5
            )),
            Self::Disc => canvas.add(format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" fill=\"{colour}\" \
                                                   stroke=\"#fff\"/>"
            )),
            Self::Line => {
                canvas.line([(x - 9.0, y), (x + 9.0, y)], format_args!("stroke=\"{colour}\" stroke-width=\"2.2\""));
            }
            Self::Ring => canvas.add(format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#fff\" fill-opacity=\".6\" stroke=\"{colour}\" \
                 stroke-width=\"1.8\"/>"
            )),
        }
    }
}

/// Returns the style of a dashed line.
pub fn dashed(colour: &str) -> String {
    format!("stroke=\"{colour}\" stroke-width=\"1.8\" stroke-dasharray=\"6 4\"")
}

/// Drawing of samples and means in a panel.
pub trait PanelExt {
    /// Draws single values around a position on the x axis, with their median. The dots are spread sideways, so that
    /// each is visible.
    fn cloud(&self, canvas: &mut Canvas, x: f64, values: &[f64], colour: &str);

    /// Draws means, connected by a dashed line.
    fn means(&self, canvas: &mut Canvas, means: &[(f64, f64)], colour: &str);

    /// Draws a mean with its standard deviation to both sides.
    fn whisker(&self, canvas: &mut Canvas, x: f64, value: MeanSd, mark: Mark, colour: &str);
}

impl PanelExt for Panel {
    fn cloud(&self, canvas: &mut Canvas, x: f64, values: &[f64], colour: &str) {
        /// Golden ratio: with it, dots of neighbouring values are far apart.
        const SPREAD: f64 = 0.618_033_988_749_895;
        for (index, value) in values.iter().enumerate() {
            let spread = 2.0 * (SPREAD * index as f64).fract() - 1.0;
            if values.len() == 1 {
                Mark::Disc.draw(canvas, self.place(x, *value), colour);
            } else {
                Mark::Dot.draw(canvas, self.place(x + CLOUD * spread, *value), colour);
            }
        }
        if values.len() > 1 {
            Mark::Square.draw(canvas, self.place(x, SampleSummary::of(values).median), colour);
        }
    }

    fn means(&self, canvas: &mut Canvas, means: &[(f64, f64)], colour: &str) {
        canvas.line(means.iter().map(|(x, mean)| self.place(*x, *mean)), dashed(colour));
    }

    fn whisker(&self, canvas: &mut Canvas, x: f64, MeanSd { mean, sd }: MeanSd, mark: Mark, colour: &str) {
        let ((x, low), (_, high)) = (self.place(x, mean - sd), self.place(x, mean + sd));
        let bar = format!("M{x:.1} {low:.1}V{high:.1}M{:.1} {low:.1}h8M{:.1} {high:.1}h8", x - 4.0, x - 4.0);
        canvas.add(format_args!("<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" d=\"{bar}\"/>"));
        let (_, y) = self.place(self.min_x(), mean);
        mark.draw(canvas, (x, y), colour);
    }
}
