//! Layers, error and temperature along a body or over time: one panel each under one axis, as one SVG.

mod series;

use std::fmt::Write;

use growbot_client::run_log::BodyKind;
use growbot_core::layer_bytes::LayerBytes;

use self::series::{Layered, Reading, Timeline, off_the_plan};
use super::numbers::{caption, measured};
use super::{Layers, Subject, ViewError};
use crate::drawing::canvas::{Canvas, escape};
use crate::drawing::chart::{Panel, Scale, number};

/// What a panel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Heights of the layers: mean, and over the wall.
    Heights,
    /// Tilt of the layers.
    Tilt,
    /// How far the body lies off its plan; of a run.
    Error,
    /// Temperature of the nozzle and its setpoint; of a run.
    Temperature,
}

/// What the axis is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Along {
    /// Length of the body.
    Path,
    /// Time.
    Time,
}

/// Width of a drawing, left and right edge of its panels, height of one and the gap above it, and room above and below
/// all.
const WIDE: f64 = 960.0;
const LEFT: f64 = 96.0;
const RIGHT: f64 = 28.0;
const HIGH: f64 = 140.0;
const GAP: f64 = 52.0;
const HEAD: f64 = 72.0;
const FOOT: f64 = 62.0;
/// Left edge of what is written over them.
const EDGE: f64 = 28.0;
/// A line has no more points: of more, those of a stretch become one.
const MAX_POINTS: usize = 800;

/// The axis of the error is never finer than this, mm: what is off by less is rounding.
const FINEST: f64 = 0.001;

const LINE: &str = "#1f5fbf";
const BAND: &str = "#c9d8ef";
const TARGET: &str = "#b3367a";

/// The panels of a body. `log` has the bytes of the log where it is a run.
///
/// # Errors
/// [`ViewError`]: too many layers, or something that it does not have.
pub fn svg(subject: &Subject, log: Option<&[u8]>, quantities: &[Quantity], along: Along) -> Result<String, ViewError> {
    let layers = subject.layers()?;
    let timeline = match (subject.run, log) {
        (Some(_), Some(log)) => Timeline::told(log, layers.body(), subject.plan),
        _ => Timeline::planned(layers.body(), subject.plan),
    };
    let layered = Layered::of(layers.body(), subject.robot.tip_radius());
    let axis = Axis::new(along, &layered, &timeline);
    let panels: Vec<Lines> = quantities
        .iter()
        .map(|quantity| match quantity {
            Quantity::Heights => Ok(heights(&layered, &axis)),
            Quantity::Tilt => Ok(tilt(&layered, &axis)),
            Quantity::Error => error(subject, &layers, &axis),
            Quantity::Temperature => temperature(subject, &timeline.temperatures, &axis),
        })
        .collect::<Result<_, _>>()?;

    let measured = measured(subject);
    let head = HEAD + if measured.is_some() { 19.0 } else { 0.0 };
    let words = caption(subject, &layers, subject.stem());
    let title = format!("{}: {}", subject.name, caption(subject, &layers, ""));
    let mut canvas = Canvas::new(WIDE, head + (GAP + HIGH) * panels.len() as f64 + FOOT, &escape(&title));
    canvas.text(EDGE, 42.0, "title", escape(subject.stem()));
    canvas.text(EDGE, 64.0, "", escape(&words));
    if let Some(measured) = measured {
        canvas.text(EDGE, 83.0, "note", escape(&measured));
    }
    for (index, lines) in panels.iter().enumerate() {
        let top = head + GAP + (GAP + HIGH) * index as f64;
        lines.draw(&mut canvas, top, &axis, index + 1 == panels.len());
    }
    Ok(canvas.finish())
}

/// The axis that all panels share.
struct Axis {
    scale: Scale,
    name: &'static str,
    along: Along,
    /// Where each layer stands on it.
    at: Vec<f64>,
    /// s for a unit of it, where it is time.
    unit: f64,
}

impl Axis {
    fn new(along: Along, layered: &Layered, timeline: &Timeline) -> Self {
        let readings = timeline.temperatures.iter().map(|reading| reading.at);
        let longest = timeline.laid.iter().copied().chain(readings).fold(0.0, f64::max);
        let (unit, name) = match along {
            Along::Path => (1.0, "along the body, mm"),
            Along::Time if longest > 7200.0 => (3600.0, "time, h"),
            Along::Time if longest > 120.0 => (60.0, "time, min"),
            Along::Time => (1.0, "time, s"),
        };
        let (at, end) = match along {
            Along::Path => (layered.lengths.clone(), layered.lengths.last().copied().unwrap_or_default()),
            Along::Time => (timeline.laid.iter().map(|at| at / unit).collect(), longest / unit),
        };
        let scale = Scale::Linear(0.0, if end > 0.0 { end } else { 1.0 });
        Self { scale, name, along, at, unit }
    }

    /// Where a reading stands on it.
    fn of(&self, reading: &Reading) -> f64 {
        match self.along {
            Along::Path => reading.laid.checked_sub(1).and_then(|last| self.at.get(last)).copied().unwrap_or_default(),
            Along::Time => reading.at / self.unit,
        }
    }
}

/// What is in a panel.
struct Lines {
    head: String,
    unit: &'static str,
    y: Scale,
    /// Min and max at places of the axis, filled between.
    band: Vec<(f64, [f64; 2])>,
    line: Vec<(f64, f64)>,
    /// A dashed line; none where there is nothing to draw.
    dashed: Vec<(f64, Option<f64>)>,
}

impl Lines {
    fn draw(&self, canvas: &mut Canvas, top: f64, axis: &Axis, is_last: bool) {
        let panel = Panel { area: [LEFT, top, WIDE - LEFT - RIGHT, HIGH], x: axis.scale, y: self.y };
        let labels = |value: f64| if is_last { number(value) } else { String::new() };
        let ticks: Vec<(f64, String)> = axis.scale.ticks().into_iter().map(|tick| (tick, labels(tick))).collect();
        if !self.band.is_empty() {
            let upper = self.band.iter().map(|(x, [_, max])| panel.place(*x, *max));
            let lower = self.band.iter().rev().map(|(x, [min, _])| panel.place(*x, *min));
            canvas.add(format_args!("<path fill=\"{BAND}\" d=\"{}z\"/>", path(upper.chain(lower))));
        }
        panel.axes(canvas, &self.head, if is_last { axis.name } else { "" }, self.unit, Some(&ticks));
        let line = self.line.iter().map(|(x, y)| panel.place(*x, *y));
        canvas.line(line, format_args!("stroke=\"{LINE}\" stroke-width=\"1.6\" stroke-linejoin=\"round\""));
        let mut stretch: Vec<(f64, f64)> = Vec::new();
        for (x, y) in self.dashed.iter().copied().chain([(0.0, None)]) {
            match y {
                Some(y) => stretch.push(panel.place(x, y)),
                None if stretch.len() > 1 => canvas.line(
                    stretch.drain(..),
                    format_args!("stroke=\"{TARGET}\" stroke-width=\"1.3\" stroke-dasharray=\"6 4\""),
                ),
                None => stretch.clear(),
            }
        }
    }
}

/// A line through points, as the `d` of a path.
fn path(points: impl Iterator<Item = (f64, f64)>) -> String {
    points.fold(String::new(), |mut path, (x, y)| {
        // Writing to a String cannot fail.
        let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { "M" } else { " " });
        path
    })
}

fn heights(layered: &Layered, axis: &Axis) -> Lines {
    let (mut band, mut line) = (Vec::new(), Vec::new());
    for (at, heights) in stretches(&axis.at, &layered.heights) {
        let min = heights.iter().map(|[min, ..]| *min).fold(f64::INFINITY, f64::min);
        let max = heights.iter().map(|[.., max]| *max).fold(f64::NEG_INFINITY, f64::max);
        band.push((at, [min, max]));
        line.push((at, heights.iter().map(|[_, mean, _]| mean).sum::<f64>() / heights.len() as f64));
    }
    let y = Scale::around(band.iter().flat_map(|(_, ends)| *ends));
    let head = "Height of the layers: mean, and from the lowest to the highest place round the wall".to_owned();
    Lines { head, unit: "mm", y, band, line, dashed: Vec::new() }
}

fn tilt(layered: &Layered, axis: &Axis) -> Lines {
    let line = means(&axis.at, &layered.tilts);
    let y = Scale::from_zero(line.iter().map(|(_, tilt)| *tilt));
    Lines { head: "Tilt of the layers".to_owned(), unit: "deg", y, band: Vec::new(), line, dashed: Vec::new() }
}

fn error(subject: &Subject, layers: &Layers, axis: &Axis) -> Result<Lines, ViewError> {
    let Some(built) = &layers.built else {
        return Err(ViewError::NotMeasured {
            name: subject.name.to_owned(),
            what: "error: it lies where it is planned",
        });
    };
    let start = subject.plan.start.frame();
    let off = |body: &[LayerBytes]| means(&axis.at, &off_the_plan(&start, body, &layers.planned));
    let line = off(built);
    let commanded = layers.commanded.as_deref().map(off).unwrap_or_default();
    let y = Scale::from_zero(line.iter().chain(&commanded).map(|(_, off)| *off).chain([FINEST]));
    let head = match &layers.commanded {
        Some(_) => "Deviation, laid (simulated); dashed, commanded, by the board's steps",
        None if layers.kind == Some(BodyKind::Commanded) => "Deviation, commanded (simulated), by the board's steps",
        None => "Deviation, by the board's steps",
    };
    let dashed = commanded.into_iter().map(|(at, off)| (at, Some(off))).collect();
    Ok(Lines { head: head.to_owned(), unit: "mm", y, band: Vec::new(), line, dashed })
}

fn temperature(subject: &Subject, readings: &[Reading], axis: &Axis) -> Result<Lines, ViewError> {
    let name = || subject.name.to_owned();
    if subject.run.is_none() {
        return Err(ViewError::NotMeasured { name: name(), what: "temperature" });
    }
    if readings.is_empty() {
        return Err(ViewError::NotTold { name: name() });
    }
    let at: Vec<f64> = readings.iter().map(|reading| axis.of(reading)).collect();
    let line = means(&at, &readings.iter().map(|reading| reading.celsius).collect::<Vec<_>>());
    // The target is steps: its corners are all of it.
    let target = |index: usize| readings.get(index).map(|reading| reading.target);
    let is_corner =
        |index: usize| index == 0 || target(index - 1) != target(index) || target(index + 1) != target(index);
    let dashed: Vec<(f64, Option<f64>)> = at
        .iter()
        .zip(readings)
        .enumerate()
        .filter_map(|(index, (at, reading))| is_corner(index).then_some((*at, reading.target)))
        .collect();
    let targets = dashed.iter().filter_map(|(_, target)| *target);
    let y = Scale::around(line.iter().map(|(_, celsius)| *celsius).chain(targets));
    let head = "Temperature of the nozzle; dashed, the setpoint".to_owned();
    Ok(Lines { head, unit: "°C", y, band: Vec::new(), line, dashed })
}

/// The mean of each stretch of values, where it ends.
fn means(at: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    stretches(at, values).map(|(at, stretch)| (at, stretch.iter().sum::<f64>() / stretch.len() as f64)).collect()
}

/// The values in stretches, as many as a line has points, and where each ends.
fn stretches<'a, T>(at: &'a [f64], values: &'a [T]) -> impl Iterator<Item = (f64, &'a [T])> {
    let stride = values.len().div_ceil(MAX_POINTS).max(1);
    at.chunks(stride).zip(values.chunks(stride)).filter_map(|(at, stretch)| Some((*at.last()?, stretch)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_many_points_has_their_means() {
        let at: Vec<f64> = (0..5000).map(f64::from).collect();
        let line = means(&at, &at);
        assert!(line.len() <= MAX_POINTS && line.len() > MAX_POINTS / 2);
        assert_eq!(line[0], (6.0, 3.0));
        assert!(means(&[], &[]).is_empty());
    }
}
