//! What all figures are drawn with: one palette, one style, axes, clouds of dots.

use std::fmt::{Display, Write};

use super::super::statistics::Summary;

/// Okabe and Ito's colours, told apart by the colour-blind too: steps of the text, of the table, exact slicing, closed loop.
pub const TEXT_STEP: &str = "#0072b2";
/// Steps of the table.
pub const TABLE_STEP: &str = "#e69f00";
/// Exact slicing.
pub const EXACT: &str = "#009e73";
/// Closed loop.
pub const CLOSED: &str = "#b5488f";
/// What the paper has.
pub const PAPER: &str = "#1c2430";
/// Robots A, B and C, where colours tell robots apart.
pub const ROBOT: [&str; 3] = ["#0072b2", "#d55e00", "#009e73"];

/// The rules hold inside charts only, so that they leave the page around them alone.
const STYLE: &str = ".gc text{font-family:system-ui,'Segoe UI','DejaVu Sans',sans-serif;font-size:13px;fill:#1c2430}\
.gc .title{font-size:18px;font-weight:600}.gc .head{font-size:14px;font-weight:600}.gc .note{font-size:12px;fill:#4a5565}\
.gc .mid{text-anchor:middle}.gc .end{text-anchor:end}\
.gc .axis{stroke:#1c2430;stroke-width:1;fill:none}.gc .grid{stroke:#1c2430;stroke-opacity:.12;fill:none}";

/// Half the width of a cloud of dots, in places of the x axis.
const CLOUD: f64 = 0.11;

/// A drawing in progress.
pub struct Canvas(String);

impl Canvas {
    /// An empty one of this size, with a title and lines of notes below it.
    pub fn new(width: f64, height: f64, title: &str, notes: &[String]) -> Self {
        let mut canvas = Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"gc\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" role=\"img\">\n<title>{title}</title>\n<style>{STYLE}</style>\n\
             <rect width=\"{width}\" height=\"{height}\" rx=\"8\" fill=\"#fff\"/>\n"
        ));
        canvas.text(24.0, 34.0, "title", title);
        for (line, note) in notes.iter().enumerate() {
            canvas.text(24.0, 56.0 + 17.0 * line as f64, "note", note);
        }
        canvas
    }

    /// The finished drawing.
    pub fn finish(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }

    /// Anything. Writing to a String cannot fail.
    pub fn add(&mut self, element: impl Display) {
        let _ = writeln!(self.0, "{element}");
    }

    /// A text of these classes.
    pub fn text(&mut self, x: f64, y: f64, class: &str, text: impl Display) {
        self.add(format_args!("<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>"));
    }

    /// A line through points.
    pub fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, style: impl Display) {
        let mut path = String::new();
        for (index, (x, y)) in points.into_iter().enumerate() {
            let _ = write!(path, "{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
        }
        self.add(format_args!("<path fill=\"none\" d=\"{path}\" {style}/>"));
    }

    /// A legend in a row: each entry a mark and a text. Returns where it ends.
    pub fn legend(&mut self, x: f64, y: f64, entries: &[(Mark, &str, String)]) -> f64 {
        let mut x = x;
        for (mark, colour, label) in entries {
            mark.draw(self, (x + 8.0, y - 4.5), colour);
            self.text(x + 22.0, y, "", label);
            x += 44.0 + 6.9 * label.chars().count() as f64;
        }
        x
    }
}

/// What stands for a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A single growth.
    Dot,
    /// A median.
    Square,
    /// A mean, on a dashed line.
    Dash,
    /// A number of the paper's.
    Diamond,
    /// A mean of ours on a line.
    Disc,
    /// A line.
    Line,
    /// A ring, empty.
    Ring,
}

impl Mark {
    /// Draws it.
    pub fn draw(self, canvas: &mut Canvas, (x, y): (f64, f64), colour: &str) {
        match self {
            Self::Dot => canvas.add(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.4\" fill=\"{colour}\" fill-opacity=\".4\"/>")),
            Self::Square => canvas.add(format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"9\" height=\"9\" fill=\"{colour}\" stroke=\"#fff\" stroke-width=\"1.4\"/>",
                x - 4.5,
                y - 4.5
            )),
            Self::Dash => canvas.line([(x - 9.0, y), (x + 9.0, y)], dashed(colour)),
            Self::Diamond => canvas.add(format_args!(
                "<path d=\"M{x:.1} {:.1}l5.5 5.5l-5.5 5.5l-5.5 -5.5Z\" fill=\"{colour}\" stroke=\"#fff\" stroke-width=\"1\"/>",
                y - 5.5
            )),
            Self::Disc => canvas.add(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" fill=\"{colour}\" stroke=\"#fff\"/>")),
            Self::Line => canvas.line([(x - 9.0, y), (x + 9.0, y)], format_args!("stroke=\"{colour}\" stroke-width=\"2.2\"")),
            Self::Ring => canvas.add(format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#fff\" fill-opacity=\".6\" stroke=\"{colour}\" stroke-width=\"1.8\"/>"
            )),
        }
    }
}

/// The style of a dashed line.
pub fn dashed(colour: &str) -> String {
    format!("stroke=\"{colour}\" stroke-width=\"1.8\" stroke-dasharray=\"6 4\"")
}

/// How values become places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Evenly, between these.
    Linear(f64, f64),
    /// By the logarithm, between these, both positive.
    Log(f64, f64),
}

impl Scale {
    /// From 0 to a little above the greatest of these.
    pub fn from_zero(values: impl IntoIterator<Item = f64>) -> Self {
        let greatest = values.into_iter().fold(0.0, f64::max);
        let step = round_step(if greatest > 0.0 { greatest } else { 1.0 });
        Self::Linear(0.0, step * libm::ceil(1.02 * greatest / step).max(1.0))
    }

    /// By the logarithm, from a round number below the positive ones of these to one above.
    pub fn log_around(values: impl IntoIterator<Item = f64>) -> Self {
        let (least, greatest) = values
            .into_iter()
            .filter(|value| *value > 0.0)
            .fold((f64::INFINITY, 0.0_f64), |(least, greatest), value| (least.min(value), greatest.max(value)));
        if greatest == 0.0 {
            return Self::Log(0.1, 1.0);
        }
        let below = |value: f64| libm::pow(10.0, libm::floor(libm::log10(value)));
        let round = |value: f64| [1.0, 2.0, 5.0, 10.0].map(|step| step * below(value));
        let from = round(least).into_iter().rfind(|step| *step <= 0.95 * least).unwrap_or(0.5 * below(least));
        let to = round(greatest).into_iter().find(|step| *step >= 1.05 * greatest).unwrap_or(20.0 * below(greatest));
        Self::Log(from, to)
    }

    /// The place of a value, 0 to 1 within the scale.
    pub fn share(self, value: f64) -> f64 {
        match self {
            Self::Linear(from, to) => (value - from) / (to - from),
            Self::Log(from, to) => libm::log10(value / from) / libm::log10(to / from),
        }
    }

    /// Where to draw lines and labels.
    fn ticks(self) -> Vec<f64> {
        match self {
            Self::Linear(from, to) => {
                let step = round_step(to - from);
                let count = libm::floor((to - from) / step + 1e-9) as i32;
                (0..=count).map(|i| from + step * f64::from(i)).collect()
            }
            Self::Log(from, to) => {
                let (first, last) = (libm::floor(libm::log10(from)) as i32, libm::ceil(libm::log10(to)) as i32);
                // Between whole decades too, where there are few.
                let steps: &[f64] = if to / from < 300.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
                (first..=last)
                    .flat_map(|power| steps.iter().map(move |step| step * libm::pow(10.0, f64::from(power))))
                    .filter(|tick| (0.999 * from..=1.001 * to).contains(tick))
                    .collect()
            }
        }
    }
}

/// A step of 1, 2 or 5 times a power of ten that divides this into no more than 6.
fn round_step(whole: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(whole / 6.0)));
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|step| step * power).find(|step| whole / step <= 6.0).unwrap_or(whole)
}

/// A number on an axis.
pub fn number(value: f64) -> String {
    if value != 0.0 && value.abs() < 0.9e-4 {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A plot in a drawing.
pub struct Panel {
    /// Left, top, width, height, pixels.
    pub area: [f64; 4],
    /// Across.
    pub x: Scale,
    /// Upwards.
    pub y: Scale,
}

impl Panel {
    /// Where a point is drawn. What lies outside is drawn on the edge.
    pub fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let [left, top, width, height] = self.area;
        (left + width * self.x.share(x), top + height * (1.0 - self.y.share(y).clamp(0.0, 1.0)))
    }

    /// Frame, lines, labels and names of the axes; `ticks` are those of the x axis, none to have them by its scale.
    pub fn axes(&self, canvas: &mut Canvas, head: &str, x_name: &str, y_name: &str, ticks: Option<&[(f64, String)]>) {
        let [left, top, width, height] = self.area;
        let (right, bottom) = (left + width, top + height);
        for value in self.y.ticks() {
            let (_, y) = self.place(0.0_f64.max(self.least_x()), value);
            canvas.add(format_args!("<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>"));
            canvas.text(left - 8.0, y + 4.5, "end", number(value));
        }
        let by_scale: Vec<(f64, String)> = match ticks {
            Some(ticks) => ticks.to_vec(),
            None => self.x.ticks().into_iter().map(|value| (value, number(value))).collect(),
        };
        for (value, label) in &by_scale {
            let x = left + width * self.x.share(*value);
            canvas.add(format_args!("<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}\"/>"));
            canvas.text(x, bottom + 19.0, "mid", label);
        }
        canvas
            .add(format_args!("<rect class=\"axis\" x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/>"));
        canvas.text(left, top - 12.0, "head", head);
        canvas.text(left + width / 2.0, bottom + 40.0, "mid", x_name);
        canvas.add(format_args!(
            "<text class=\"mid\" transform=\"translate({:.1} {:.1}) rotate(-90)\">{y_name}</text>",
            left - 64.0,
            top + height / 2.0
        ));
    }

    fn least_x(&self) -> f64 {
        match self.x {
            Scale::Linear(from, _) | Scale::Log(from, _) => from,
        }
    }

    /// Single values round a place of the x axis, spread aside so that they can be told apart, with their median.
    pub fn cloud(&self, canvas: &mut Canvas, x: f64, values: &[f64], colour: &str) {
        /// The golden section: neighbours in order are far from each other aside.
        const SPREAD: f64 = 0.618_033_988_749_895;
        for (index, value) in values.iter().enumerate() {
            let aside = 2.0 * (SPREAD * index as f64).fract() - 1.0;
            if values.len() == 1 {
                Mark::Disc.draw(canvas, self.place(x, *value), colour);
            } else {
                Mark::Dot.draw(canvas, self.place(x + CLOUD * aside, *value), colour);
            }
        }
        if values.len() > 1 {
            Mark::Square.draw(canvas, self.place(x, Summary::of(values).median), colour);
        }
    }

    /// Means, connected by a dashed line.
    pub fn means(&self, canvas: &mut Canvas, means: &[(f64, f64)], colour: &str) {
        canvas.line(means.iter().map(|(x, mean)| self.place(*x, *mean)), dashed(colour));
    }

    /// A mean with its standard deviation to either side.
    pub fn whisker(&self, canvas: &mut Canvas, x: f64, (mean, sd): (f64, f64), mark: Mark, colour: &str) {
        let ((x, low), (_, high)) = (self.place(x, mean - sd), self.place(x, mean + sd));
        let bar = format!("M{x:.1} {low:.1}V{high:.1}M{:.1} {low:.1}h8M{:.1} {high:.1}h8", x - 4.0, x - 4.0);
        canvas.add(format_args!("<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\" d=\"{bar}\"/>"));
        let (_, y) = self.place(self.least_x(), mean);
        mark.draw(canvas, (x, y), colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_hold_their_values_and_end_on_a_tick() {
        let scale = Scale::from_zero([0.011, 0.047]);
        assert_eq!(scale, Scale::Linear(0.0, 0.05));
        assert_eq!(scale.ticks().len(), 6);
        let scale = Scale::log_around([0.0, 3e-5, 0.2]);
        assert!((scale.share(2e-5)).abs() < 1e-12 && (scale.share(0.5) - 1.0).abs() < 1e-12, "{scale:?}");
        assert_eq!(scale.ticks().len(), 4);
        assert!((Scale::Log(1e-5, 1.0).share(1e-5)).abs() < 1e-12);
        assert_eq!(Scale::from_zero([]), Scale::Linear(0.0, 0.2));
    }

    #[test]
    fn numbers_on_axes_are_short() {
        assert_eq!([0.0, 0.05, 20.0, 1e-5, 1e-4].map(number), ["0", "0.05", "20", "1e-5", "0.0001"]);
    }
}
