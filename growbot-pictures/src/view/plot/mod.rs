//! Plots of layers, error and temperature along a body or over time, for one body or several. Each quantity has a
//! panel, all panels share one axis, and the plot is one SVG.
//!
//! If there are more than 800 layers, each stretch of layers becomes one point: their mean, and for the heights around
//! the wall also the minimum and the maximum. The time of a run log is that of recordings
//! ([`growbot_plan::run_clock`]).

pub(crate) mod series;

use std::fmt::Write;

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_plan::run_log::BodyKind;

use self::series::{LayerSeries, TemperatureReading, Timeline, deviation_from_plan};
use super::info_panel::{caption, measured};
use super::{Layers, Subject, ViewError};
use crate::drawing::canvas::{Canvas, escape};
use crate::drawing::chart::{Panel, Scale, number};
use crate::drawing::colours::{SERIES, series};

/// Quantity that a panel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum PlotKind {
    /// Heights of the layers, mm.
    ///
    /// The plot shows the mean, and the range around the wall.
    Heights,
    /// Tilt of the layers, degrees.
    Tilt,
    /// Deviation of the body from its plan, mm (run logs only).
    Error,
    /// Temperature of the nozzle, C (run logs only).
    ///
    /// The plot also shows the setpoint.
    Temperature,
}

/// Quantity of the horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum XAxis {
    /// Length of the body.
    Path,
    /// Time by the board's clock, or for a plan the planned time.
    Time,
}

/// Width of a drawing, units of the drawing. The constants below are the left and right margin of its panels, the
/// height of a panel, the gap above it, and the space above and below all panels.
const WIDTH: f64 = 960.0;
const LEFT: f64 = 96.0;
const RIGHT: f64 = 28.0;
const HIGH: f64 = 140.0;
const GAP: f64 = 52.0;
const HEAD: f64 = 72.0;
const FOOT: f64 = 62.0;
/// Space above the panels of a body without a title. It is negative, because the gap above the first panel is larger
/// than needed.
const UNTITLED: f64 = -14.0;
/// Left margin of the texts above the panels.
const EDGE: f64 = 28.0;
/// Greatest number of points of a line. If there are more, each stretch of points becomes one point.
const MAX_POINTS: usize = 800;

/// Smallest range of the error's axis, mm. Smaller deviations are rounding errors.
const FINEST: f64 = 0.001;

const BAND: &str = "#c9dbe8";
/// Colour of the dashed lines of the setpoint and of commanded values, in plots of a single body.
const DASHED: &str = "#d55e00";
/// Number of names in a row above the panels. `NAMES_ROW` is the height of a row.
const NAMES_IN_ROW: usize = 3;
const NAMES_ROW: f64 = 20.0;
/// Number of letters of a name that fit into its column.
const NAME_LETTERS: usize = 34;

/// A plan or a run that is plotted, with the bytes of its log if it is a run.
#[derive(Debug, Clone, Copy)]
pub struct PlotInput<'a> {
    /// The plan or run that is plotted.
    pub subject: &'a Subject<'a>,
    /// Bytes of the run log. `None` for a plan.
    pub log: Option<&'a [u8]>,
}

/// Options of a plot.
#[derive(Debug, Clone, Copy)]
pub struct PlotOptions<'a> {
    /// Quantities, each with a panel.
    pub quantities: &'a [PlotKind],
    /// Quantity of the horizontal axis.
    pub along: XAxis,
    /// True to draw names and captions above the panels.
    pub title: bool,
}

/// Returns the plot of a body, or of several bodies in the same panels, as SVG.
///
/// # Errors
/// [`ViewError`] if a body has too many layers or lacks a quantity.
pub fn svg(plotted: &[PlotInput], options: &PlotOptions) -> Result<String, ViewError> {
    let curves = plotted.iter().map(PlotCurve::of).collect::<Result<Vec<_>, _>>()?;
    let axis = Axis::new(options.along, &curves);
    let panels: Vec<Vec<PanelData>> = options
        .quantities
        .iter()
        .map(|quantity| curves.iter().map(|curve| quantity.lines(curve, &axis)).collect())
        .collect::<Result<_, _>>()?;
    let names = names(plotted);
    let head = head_height(&curves, options.title);
    let height = head + (GAP + HIGH) * panels.len() as f64 + FOOT;
    let spoken = |curve: &PlotCurve| format!("{}: {}", curve.subject.name, caption(curve.subject, &curve.layers, ""));
    let spoken: Vec<String> = curves.iter().map(spoken).collect();
    let mut canvas = Canvas::new(WIDTH, height, &escape(&spoken.join("; ")));
    match &curves[..] {
        [one] if options.title => title(&mut canvas, one),
        [_] => {}
        _ => draw_legend(&mut canvas, &names, if options.title { 42.0 } else { 24.0 }),
    }
    for (index, (lines, quantity)) in panels.iter().zip(options.quantities).enumerate() {
        let top = head + GAP + (GAP + HIGH) * index as f64;
        draw(&mut canvas, top, &axis, *quantity, lines, index + 1 == panels.len());
    }
    Ok(canvas.finish())
}

/// Returns the names of bodies: files without their extensions, unless two bodies would then have the same name.
fn names<'a>(plotted: &[PlotInput<'a>]) -> Vec<&'a str> {
    let alike = |one: &Subject| plotted.iter().filter(|other| other.subject.stem() == one.stem()).count() > 1;
    plotted.iter().map(|PlotInput { subject, .. }| if alike(subject) { subject.name } else { subject.stem() }).collect()
}

/// Returns the space above the panels.
fn head_height(curves: &[PlotCurve], title: bool) -> f64 {
    match curves {
        [_] if !title => UNTITLED,
        [one] => HEAD + if measured(one.subject).is_some() { 19.0 } else { 0.0 },
        _ => (if title { 36.0 } else { 18.0 }) + NAMES_ROW * curves.len().div_ceil(NAMES_IN_ROW) as f64 - GAP / 2.0,
    }
}

/// Writes the texts above the panels of one body.
fn title(canvas: &mut Canvas, curve: &PlotCurve) {
    let subject = curve.subject;
    canvas.text(EDGE, 42.0, "title", escape(subject.stem()));
    canvas.text(EDGE, 64.0, "", escape(&caption(subject, &curve.layers, subject.stem())));
    if let Some(measured) = measured(subject) {
        canvas.text(EDGE, 83.0, "note", escape(&measured));
    }
}

/// Draws the names of several bodies with samples of their lines, from this height on.
fn draw_legend(canvas: &mut Canvas, names: &[&str], top: f64) {
    let width = (WIDTH - LEFT - RIGHT) / NAMES_IN_ROW as f64;
    for (index, name) in names.iter().enumerate() {
        let left = LEFT + width * (index % NAMES_IN_ROW) as f64;
        let y = top + NAMES_ROW * (index / NAMES_IN_ROW) as f64;
        canvas.line([(left, y - 4.5), (left + 26.0, y - 4.5)], line_style(index));
        let short: String = name.chars().take(NAME_LETTERS).collect();
        canvas.text(left + 33.0, y, "", escape(&short));
    }
}

/// Returns the style of the line of a body. Beyond the last colour, lines are dashed too.
fn line_style(index: usize) -> String {
    let dashes = ["", " stroke-dasharray=\"9 3\"", " stroke-dasharray=\"3 2\""];
    let dash = dashes[index / SERIES.len() % dashes.len()];
    format!("stroke=\"{}\" stroke-width=\"1.6\" stroke-linejoin=\"round\"{dash}", series(index))
}

/// A body with all values that are plotted of it.
struct PlotCurve<'a> {
    subject: &'a Subject<'a>,
    layers: Layers,
    layered: LayerSeries,
    timeline: Timeline,
}

impl<'a> PlotCurve<'a> {
    fn of(plotted: &PlotInput<'a>) -> Result<Self, ViewError> {
        let PlotInput { subject, log } = *plotted;
        let layers = subject.layers()?;
        let body: Vec<Layer> = layers.body().iter().map(decode).collect();
        let timeline = match (subject.run, log) {
            (Some(_), Some(log)) => Timeline::from_log(log, &body, subject.plan),
            _ => Timeline::planned(&body, subject.plan),
        };
        let layered = LayerSeries::of(layers.body(), subject.robot.tip_radius());
        Ok(Self { subject, layers, layered, timeline })
    }

    /// Returns the time of the last layer or reading, s.
    fn longest(&self) -> f64 {
        let readings = self.timeline.temperatures.iter().map(|reading| reading.at);
        self.timeline.laid.iter().copied().chain(readings).fold(0.0, f64::max)
    }
}

/// The axis that all panels share.
struct Axis {
    scale: Scale,
    name: &'static str,
    along: XAxis,
    /// Seconds per unit of the axis, if its quantity is time.
    unit: f64,
}

impl Axis {
    fn new(along: XAxis, curves: &[PlotCurve]) -> Self {
        let longest = curves.iter().map(PlotCurve::longest).fold(0.0, f64::max);
        let (unit, name) = match along {
            XAxis::Path => (1.0, "along the body, mm"),
            XAxis::Time if longest > 7200.0 => (3600.0, "time, h"),
            XAxis::Time if longest > 120.0 => (60.0, "time, min"),
            XAxis::Time => (1.0, "time, s"),
        };
        let end = match along {
            XAxis::Path => curves.iter().filter_map(|curve| curve.layered.lengths.last().copied()).fold(0.0, f64::max),
            XAxis::Time => longest / unit,
        };
        Self { scale: Scale::Linear(0.0, if end > 0.0 { end } else { 1.0 }), name, along, unit }
    }

    /// Returns the position of the end of each layer on the axis.
    fn layers(&self, curve: &PlotCurve) -> Vec<f64> {
        match self.along {
            XAxis::Path => curve.layered.lengths.clone(),
            XAxis::Time => curve.timeline.laid.iter().map(|at| at / self.unit).collect(),
        }
    }

    /// Returns the position of a temperature reading on the axis.
    fn of(&self, reading: &TemperatureReading, curve: &PlotCurve) -> f64 {
        match self.along {
            XAxis::Path => {
                let lengths = &curve.layered.lengths;
                reading.laid.checked_sub(1).and_then(|last| lengths.get(last)).copied().unwrap_or_default()
            }
            XAxis::Time => reading.at / self.unit,
        }
    }
}

impl PlotKind {
    fn unit(self) -> &'static str {
        match self {
            Self::Heights | Self::Error => "mm",
            Self::Tilt => "deg",
            Self::Temperature => "°C",
        }
    }

    fn lines(self, curve: &PlotCurve, axis: &Axis) -> Result<PanelData, ViewError> {
        match self {
            Self::Heights => Ok(heights(curve, axis)),
            Self::Tilt => Ok(PanelData {
                head: "Tilt of the layers",
                line: means(&axis.layers(curve), &curve.layered.tilts),
                ..PanelData::default()
            }),
            Self::Error => error(curve, axis),
            Self::Temperature => temperature(curve, axis),
        }
    }

    /// Returns the title of a panel of several bodies.
    fn head_of_several(self) -> &'static str {
        match self {
            Self::Heights => "Mean height of the layers",
            Self::Tilt => "Tilt of the layers",
            Self::Error => "Deviation from the plan",
            Self::Temperature => "Temperature of the nozzle",
        }
    }

    /// Returns the vertical scale of the panel for these values.
    fn scale(self, values: impl Iterator<Item = f64>) -> Scale {
        match self {
            Self::Heights | Self::Temperature => Scale::around(values),
            Self::Tilt => Scale::from_zero(values),
            Self::Error => Scale::from_zero(values.chain([FINEST])),
        }
    }
}

/// The lines of a body in a panel.
#[derive(Default)]
struct PanelData {
    head: &'static str,
    /// Min and max at positions on the axis, with the area between them filled.
    band: Vec<(f64, [f64; 2])>,
    line: Vec<(f64, f64)>,
    /// A dashed line with gaps at `None`.
    dashed: Vec<(f64, Option<f64>)>,
}

impl PanelData {
    fn values(&self) -> impl Iterator<Item = f64> + '_ {
        let dashed = self.dashed.iter().filter_map(|(_, value)| *value);
        self.line.iter().map(|(_, value)| *value).chain(dashed)
    }

    fn draw_dashed(&self, canvas: &mut Canvas, panel: &Panel) {
        let mut stretch: Vec<(f64, f64)> = Vec::new();
        for (x, y) in self.dashed.iter().copied().chain([(0.0, None)]) {
            match y {
                Some(y) => stretch.push(panel.place(x, y)),
                None if stretch.len() > 1 => canvas.line(
                    stretch.drain(..),
                    format_args!("stroke=\"{DASHED}\" stroke-width=\"1.3\" stroke-dasharray=\"6 4\""),
                ),
                None => stretch.clear(),
            }
        }
    }
}

/// Draws a panel with the lines of all bodies. Bands and dashed lines are drawn only for a single body.
fn draw(canvas: &mut Canvas, top: f64, axis: &Axis, quantity: PlotKind, lines: &[PanelData], is_last: bool) {
    let (y, head) = match lines {
        [one] => (quantity.scale(one.values().chain(one.band.iter().flat_map(|(_, ends)| *ends))), one.head),
        _ => {
            let values = lines.iter().flat_map(|lines| lines.line.iter().map(|(_, value)| *value));
            (quantity.scale(values), quantity.head_of_several())
        }
    };
    let panel = Panel { area: [LEFT, top, WIDTH - LEFT - RIGHT, HIGH], x: axis.scale, y };
    let labels = |value: f64| if is_last { number(value) } else { String::new() };
    let ticks: Vec<(f64, String)> = axis.scale.ticks().into_iter().map(|tick| (tick, labels(tick))).collect();
    if let [PanelData { band, .. }] = lines
        && !band.is_empty()
    {
        let upper = band.iter().map(|(x, [_, max])| panel.place(*x, *max));
        let lower = band.iter().rev().map(|(x, [min, _])| panel.place(*x, *min));
        canvas.add(format_args!("<path fill=\"{BAND}\" d=\"{}z\"/>", path(upper.chain(lower))));
    }
    panel.axes(canvas, head, if is_last { axis.name } else { "" }, quantity.unit(), Some(&ticks));
    for (index, lines) in lines.iter().enumerate() {
        canvas.line(lines.line.iter().map(|(x, y)| panel.place(*x, *y)), line_style(index));
    }
    if let [one] = lines {
        one.draw_dashed(canvas, &panel);
    }
}

/// Returns a line through points, as the attribute `d` of an SVG path.
fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    points.fold(String::new(), |mut path, (x, y)| {
        // Writing to a String cannot fail.
        let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { "M" } else { " " });
        path
    })
}

fn heights(curve: &PlotCurve, axis: &Axis) -> PanelData {
    let (mut band, mut line) = (Vec::new(), Vec::new());
    for (at, heights) in stretches(&axis.layers(curve), &curve.layered.heights) {
        let min = heights.iter().map(|[min, ..]| *min).fold(f64::INFINITY, f64::min);
        let max = heights.iter().map(|[.., max]| *max).fold(f64::NEG_INFINITY, f64::max);
        band.push((at, [min, max]));
        line.push((at, heights.iter().map(|[_, mean, _]| mean).sum::<f64>() / heights.len() as f64));
    }
    let head = "Height of the layers: mean, and from the lowest to the highest place round the wall";
    PanelData { head, band, line, ..PanelData::default() }
}

fn error(curve: &PlotCurve, axis: &Axis) -> Result<PanelData, ViewError> {
    let PlotCurve { subject, layers, .. } = curve;
    let Some(built) = &layers.built else {
        return Err(ViewError::NotMeasured {
            name: subject.name.to_owned(),
            what: "error, because a planned body lies exactly on its plan",
        });
    };
    let start = subject.plan.start.frame();
    let at = axis.layers(curve);
    let off = |body: &[LayerBytes]| means(&at, &deviation_from_plan(&start, body, &layers.planned));
    let head = match &layers.commanded {
        Some(_) => "Deviation, laid (simulated); dashed, commanded, by the board's steps",
        None if layers.kind == Some(BodyKind::Commanded) => "Deviation, commanded (simulated), by the board's steps",
        None => "Deviation, by the board's steps",
    };
    let commanded = layers.commanded.as_deref().map(off).unwrap_or_default();
    let dashed = commanded.into_iter().map(|(at, off)| (at, Some(off))).collect();
    Ok(PanelData { head, line: off(built), dashed, ..PanelData::default() })
}

fn temperature(curve: &PlotCurve, axis: &Axis) -> Result<PanelData, ViewError> {
    let (subject, readings) = (curve.subject, &curve.timeline.temperatures);
    let name = || subject.name.to_owned();
    if subject.run.is_none() {
        return Err(ViewError::NotMeasured { name: name(), what: "temperature" });
    }
    if readings.is_empty() {
        return Err(ViewError::NoTemperatures { name: name() });
    }
    let at: Vec<f64> = readings.iter().map(|reading| axis.of(reading, curve)).collect();
    let line = means(&at, &readings.iter().map(|reading| reading.celsius).collect::<Vec<_>>());
    // The target changes in steps, so its corners suffice.
    let target = |index: usize| readings.get(index).map(|reading| reading.target);
    let is_corner =
        |index: usize| index == 0 || target(index - 1) != target(index) || target(index + 1) != target(index);
    let dashed: Vec<(f64, Option<f64>)> = at
        .iter()
        .zip(readings)
        .enumerate()
        .filter_map(|(index, (at, reading))| is_corner(index).then_some((*at, reading.target)))
        .collect();
    Ok(PanelData { head: "Temperature of the nozzle; dashed, the setpoint", line, dashed, ..PanelData::default() })
}

/// Returns the mean of each stretch of values, at the end of the stretch.
fn means(at: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    stretches(at, values).map(|(at, stretch)| (at, stretch.iter().sum::<f64>() / stretch.len() as f64)).collect()
}

/// Returns the values in at most [`MAX_POINTS`] stretches, each with its end on the axis.
fn stretches<'a, T>(at: &'a [f64], values: &'a [T]) -> impl Iterator<Item = (f64, &'a [T])> {
    let stride = values.len().div_ceil(MAX_POINTS).max(1);
    at.chunks(stride).zip(values.chunks(stride)).filter_map(|(at, stretch)| Some((*at.last()?, stretch)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_series_are_averaged() {
        let at: Vec<f64> = (0..5000).map(f64::from).collect();
        let line = means(&at, &at);
        assert!(line.len() <= MAX_POINTS && line.len() > MAX_POINTS / 2);
        assert_eq!(line[0], (6.0, 3.0));
        assert!(means(&[], &[]).is_empty());
    }
}
