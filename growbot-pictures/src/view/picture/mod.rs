//! A body, or several side by side, as a picture for papers: one SVG, drawn here.
//!
//! - `camera`: from where; `place`: where that is in the drawing;
//! - `tube`: the printed wall as shaded faces, far ones first;
//! - `axes`: x, y and z with numbers, round a body;
//! - `marks`: arrows, the tip's frame, poses, the floor;
//! - `obstacles`: the scene around it;
//! - `stage`: one body with all of that.
//!
//! - **Faces.** The tube is rings of flat faces. Each ring is drawn after those farther away (painter's algorithm),
//!   and the faces of one by how much they face the viewer. Two stretches that pass each other are ordered by their
//!   rings. A ring ends with a piece of the path, after 2.9 degrees of bend, or after 0.7 radii of length. Long
//!   bodies have longer rings, so that an SVG stays below 500 kB. Every face has an edge in its own colour, because
//!   renderers leave seams otherwise.
//! - **Around it.** The shadow is the tube's own, straight down onto a floor of whole squares. Arrows are solids,
//!   drawn by their outlines in the order of depth. The tip's axes and the names lie over everything. The planned
//!   tube of a run is two lines where a tube's surface turns away: its centreline, moved by a radius to both sides of
//!   the line of sight.
//! - **Colours of heights** end at percentiles 1 and 99 of all heights shown, so that a few layers do not take the
//!   contrast from all others. The legend names the percentiles if there are heights beyond. Colour-blind readers can
//!   distinguish the scales and series; viridis and cividis suit print in grey.
//! - **Axes** are three edges of a box of whole squares, those that hide least of the body.
//! - **Several bodies** have one camera and one scale. If start and goal are the same, they also have one frame, so
//!   that equal places appear at equal places.

mod axes;
mod camera;
mod marks;
mod obstacles;
mod place;
mod stage;
mod tube;

pub use camera::Look;

use growbot_core::layer_bytes::LayerBytes;
use nalgebra::Vector3;

use self::axes::Axes;
use self::camera::Camera;
use self::marks::{FREE_SIDE, Line, key};
use self::place::{Bounds, Place};
use self::stage::Stage;
use self::tube::Detail;
use super::around::Around;
use super::heights::{HeightScale, LEGEND};
use super::numbers::{caption, measured};
use super::side_by_side::difference;
use super::{Layers, Subject, ViewError};
use crate::drawing::canvas::{Canvas, escape};
use crate::drawing::chart::{number, round_below};
use crate::drawing::colours::Palette;

/// Width of a drawing, and how high a stage in it must be, and may be alone and beside another, units of the drawing.
const WIDE: f64 = 960.0;
const MIN_HIGH: f64 = 240.0;
const HIGH: f64 = 600.0;
const HIGH_OF_TWO: f64 = 440.0;
/// Room round a body for arrows' words, and above and below it for caption, scale bar and legend.
const MARGIN: [f64; 2] = [44.0, 30.0];
const HEAD: f64 = 84.0;
const FOOT: f64 = 76.0;
/// Left and right edge of what is written.
const EDGE: f64 = 28.0;
/// Width of a letter in a title and in what is written below it, about.
const TITLE_LETTER: f64 = 10.0;
const LETTER: f64 = 6.8;
/// Room above a body without a title, and round one with axes.
const UNTITLED: f64 = 10.0;
const AXES_ROOM: f64 = 44.0;
/// The middle of the text between scale bar and legend, and the number of letters that fit.
const MIDDLE: f64 = 0.47 * WIDE;
const MAX_LETTERS: usize = 70;
/// How finely a body alone is drawn and each of two: a picture has some hundreds of kB.
const FINE: Detail = Detail { rings: 200, faces: 56 };
const LESS_FINE: Detail = Detail { rings: 80, faces: 36 };

/// What a picture shows, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// From where.
    pub look: Look,
    /// The colours of heights.
    pub palette: Palette,
    /// Where they end, mm; none to find it.
    pub range: Option<[f64; 2]>,
    /// Whether names and captions stand over the bodies.
    pub title: bool,
    /// Whether axes with numbers stand round them.
    pub axes: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { look: Look::Corner, palette: Palette::default(), range: None, title: true, axes: false }
    }
}

/// The picture of any number of bodies, which are then seen from one side and at one scale.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn svg(subjects: &[&Subject], options: &Options) -> Result<String, ViewError> {
    let layers = subjects.iter().map(|subject| subject.layers()).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<(&Subject, &Layers)> = subjects.iter().copied().zip(&layers).collect();
    let grid = Grid::of(all.len());
    let stages: Vec<Stage> = all.iter().map(|(subject, layers)| Stage::new(subject, layers, grid.detail)).collect();
    let camera = Camera::new(options.look, &facing(&stages));
    let heights = height_scale(&all, options);
    let square = stages.iter().map(Stage::square).fold(0.0, f64::max);
    let margin = MARGIN.map(|margin| margin + if options.axes { AXES_ROOM } else { 0.0 });
    let boxes: Vec<Option<Axes>> = stages.iter().map(|stage| options.axes.then(|| stage.axes(square))).collect();
    let mut bounds: Vec<Bounds> =
        stages.iter().zip(&boxes).map(|(stage, axes)| stage.bounds(&camera, square, axes.as_ref())).collect();
    // Bodies to one goal are seen in one frame, so that what is at one place is at one place.
    if stages.iter().all(|stage| stages.first().is_some_and(|first| stage.has_ends_of(first))) {
        let together = bounds.iter().fold(Bounds::NONE, |all, one| all.and(*one));
        bounds.fill(together);
    }
    let fitting_scale = |bounds| scale(bounds, [grid.width, grid.max_high], margin);
    let scale = bounds.iter().map(fitting_scale).fold(f64::INFINITY, f64::min);
    let room_above = if stages.iter().any(Stage::has_reached) { FREE_SIDE - MARGIN[1] } else { 0.0 };
    let top = room_above + if options.title { HEAD } else { UNTITLED };
    let high = bounds.iter().map(|bounds| scale * bounds.size()[1] + 2.0 * margin[1]).fold(MIN_HIGH, f64::max);

    let bottom = grid.rows as f64 * (top + high);
    let mut canvas = Canvas::new(WIDE, bottom + FOOT, &spoken(&all, &stages));
    let names = names(subjects);
    for (index, (stage, bounds)) in stages.iter().zip(&bounds).enumerate() {
        let [left, above] = grid.corner(index, top + high);
        let at = [left + 0.5 * grid.width, above + top + 0.5 * high];
        let place = Place { camera, scale, centre: bounds.centre(), at };
        let room = [left + 2.0, above + top, left + grid.width - 2.0, above + top + high - 16.0];
        stage.draw(&mut canvas, (&place, &room), &heights, square, boxes[index].as_ref());
        if options.title {
            let (subject, layers) = all[index];
            head(&mut canvas, [left + EDGE, above], grid.width - 2.0 * EDGE, names[index], subject, layers);
        }
    }
    for column in 1..grid.columns {
        let x = grid.width * column as f64;
        canvas.add(format_args!("<path class=\"grid\" d=\"M{x} 24V{bottom}\"/>"));
    }
    scale_bar(&mut canvas, [EDGE, bottom + FOOT - 26.0], scale);
    key(&mut canvas, [MIDDLE, bottom + FOOT - 48.0], &lines(&stages));
    if let ([(_, a), (_, b)], [one, other]) = (&all[..], &names[..]) {
        let words = difference([(one, a), (other, b)]);
        if options.title && words.chars().count() <= MAX_LETTERS {
            canvas.text(MIDDLE, bottom + FOOT - 26.0, "mid", escape(&words));
        }
    }
    heights.legend(&mut canvas, [WIDE - EDGE - LEGEND, bottom + FOOT - 46.0]);
    Ok(canvas.finish())
}

/// Where bodies stand in a picture.
struct Grid {
    columns: usize,
    rows: usize,
    /// Width of a column, and how high a stage may be, units of the drawing.
    width: f64,
    max_high: f64,
    detail: Detail,
}

impl Grid {
    /// For so many bodies.
    fn of(count: usize) -> Self {
        let columns = match count {
            0 | 1 => 1,
            2 | 4 => 2,
            _ => 3,
        };
        let (max_high, detail) = if count > 1 { (HIGH_OF_TWO, LESS_FINE) } else { (HIGH, FINE) };
        Self { columns, rows: count.div_ceil(columns).max(1), width: WIDE / columns as f64, max_high, detail }
    }

    /// The left upper corner of a body's place; `high`: of a row.
    fn corner(&self, index: usize, high: f64) -> [f64; 2] {
        [self.width * (index % self.columns) as f64, high * (index / self.columns) as f64]
    }
}

/// The colours of the layers of all bodies.
fn height_scale(all: &[(&Subject, &Layers)], options: &Options) -> HeightScale {
    let bodies: Vec<(&[LayerBytes], f64)> =
        all.iter().map(|(subject, layers)| (layers.body(), subject.robot.tip_radius())).collect();
    HeightScale::of(&bodies, options.palette, options.range)
}

/// What the picture is called for who cannot see it.
fn spoken(all: &[(&Subject, &Layers)], stages: &[Stage]) -> String {
    let title = |((subject, layers), stage): (&(&Subject, &Layers), &Stage)| {
        let scene = stage.around().and_then(clear_of).map_or_else(String::new, |words| format!(", {words}"));
        escape(&format!("{}: {}{scene}", subject.name, caption(subject, layers, "")))
    };
    all.iter().zip(stages).map(title).collect::<Vec<_>>().join("; ")
}

/// How near a body comes to its scene, in a line.
fn clear_of(around: &Around) -> Option<String> {
    let (clearance, place) = around.clearance().zip(around.place())?;
    Some(format!("{}: narrowest {clearance}, {place}; obstacles: {}", around.file, around.shown.summary()))
}

/// How bodies are called: without their files' endings, unless they would have one name then.
fn names<'a>(subjects: &[&'a Subject]) -> Vec<&'a str> {
    let alike = |one: &Subject| subjects.iter().filter(|other| other.stem() == one.stem()).count() > 1;
    subjects.iter().map(|subject| if alike(subject) { subject.name } else { subject.stem() }).collect()
}

/// The lines beside bodies, each once.
fn lines(stages: &[Stage]) -> Vec<Line> {
    stages.iter().flat_map(Stage::lines).fold(Vec::new(), |mut lines, line| {
        if !lines.contains(&line) {
            lines.push(line);
        }
        lines
    })
}

/// What the picture from a corner is to show, the first most: where goals point, and where they lie.
fn facing(stages: &[Stage]) -> Vec<Vector3<f64>> {
    let goals = stages.iter().map(Stage::goal_direction);
    goals.chain(stages.iter().map(Stage::way_to_goal)).collect()
}

/// Units for a mm at which these bounds fit on a stage of this width and height.
fn scale(bounds: &Bounds, [width, max_high]: [f64; 2], margin: [f64; 2]) -> f64 {
    let [wide, high] = bounds.size().map(|size| size.max(1.0));
    ((width - 2.0 * margin[0]) / wide).min((max_high - 2.0 * margin[1]) / high)
}

/// What is written over a stage, from this left upper corner on, `width` wide.
fn head(canvas: &mut Canvas, [left, top]: [f64; 2], width: f64, name: &str, subject: &Subject, layers: &Layers) {
    canvas.text(left, top + 42.0, "title", escape(&fitting(name, width / TITLE_LETTER)));
    canvas.text(left, top + 64.0, "", escape(&fitting(&caption(subject, layers, name), width / LETTER)));
    if let Some(measured) = measured(subject) {
        canvas.text(left, top + 83.0, "note", escape(&fitting(&measured, width / LETTER)));
    }
}

/// A text, shortened to at most `max` letters.
fn fitting(text: &str, max: f64) -> String {
    let max = max as usize;
    if text.chars().count() <= max {
        return text.to_owned();
    }
    text.chars().take(max.saturating_sub(1)).chain(['…']).collect()
}

fn scale_bar(canvas: &mut Canvas, [left, y]: [f64; 2], scale: f64) {
    let length = round_below(150.0 / scale);
    let (right, middle) = (left + length * scale, left + 0.5 * length * scale);
    let label = if length >= 1000.0 { format!("{} m", length / 1000.0) } else { format!("{} mm", number(length)) };
    canvas
        .add(format_args!("<path class=\"axis\" stroke-width=\"1.5\" d=\"M{left} {:.1}v6H{right:.1}v-6\"/>", y - 6.0));
    canvas.text(middle, y - 12.0, "mid", label);
}
