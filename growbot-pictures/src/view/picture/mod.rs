//! A body, or several side by side, as a picture for papers: one SVG, drawn here.
//!
//! - `camera`: the viewpoint
//! - `projection`: projection into the drawing
//! - `tube`: the printed wall as shaded faces, far ones first
//! - `axes`: x, y and z with numbers, around a body
//! - `marks`: arrows, the tip's frame, poses, the floor
//! - `obstacles`: the scene around a body
//! - `stage`: one body with its marks
//!
//! - **Faces.** The tube is rings of flat faces. Each ring is drawn after those farther away (painter's algorithm), and
//!   the faces of a ring are ordered by how much they face the viewer. Two parts of a tube that pass each other are
//!   ordered by their rings. A ring ends with a segment of the path, after 2.9 degrees of bend, or after 0.7 radii of
//!   length. Long bodies have longer rings, so that an SVG stays below 500 kB. Every face has an edge in its own
//!   colour, because renderers leave seams otherwise.
//! - **Around it.** The shadow is the tube's own, straight down onto a floor of whole squares. Arrows are solids,
//!   drawn by their outlines in the order of depth. The tip's axes and the names lie over everything. The planned
//!   tube of a run is two lines where a tube's surface turns away: its centreline, moved by a radius to both sides of
//!   the line of sight.
//! - **Colours of heights** end at percentiles 1 and 99 of all heights shown, so that a few layers do not take the
//!   contrast from all others. The legend names the percentiles if there are heights beyond them. Colour-blind readers
//!   can distinguish the scales and series. Viridis and cividis suit print in grey.
//! - **Axes** are three edges of a box of whole squares, those that hide least of the body.
//! - **Several bodies** have one camera and one scale. If start and goal are the same, they also have one frame, so
//!   that equal positions are drawn at equal positions.

mod axes;
mod camera;
mod marks;
mod obstacles;
mod projection;
mod stage;
mod tube;

pub use camera::Viewpoint;

use growbot_core::layer_bytes::LayerBytes;
use nalgebra::Vector3;

use self::axes::Axes;
use self::camera::Camera;
use self::marks::{FREE_SIDE, LineStyle, key};
use self::projection::{Projection, ScreenBounds, WIDE};
use self::stage::Stage;
use self::tube::Detail;
use super::heights::{HeightScale, LEGEND};
use super::info_panel::{caption, measured};
use super::scene_view::SceneView;
use super::side_by_side::difference;
use super::{Layers, Subject, ViewError};
use crate::drawing::canvas::{Canvas, escape};
use crate::drawing::chart::{number, round_below};
use crate::drawing::colours::Palette;

/// Minimum height of a body's area, units of the drawing. The constants below are the maximum for a single body, and
/// the maximum for each of several bodies.
const MIN_HIGH: f64 = 240.0;
const HIGH: f64 = 600.0;
const HIGH_OF_TWO: f64 = 440.0;
/// Horizontal and vertical margin around a body for the labels of the arrows. `HEAD` is the space above a body for its
/// caption, and `FOOT` the space below for scale bar and legend.
const MARGIN: [f64; 2] = [44.0, 30.0];
const HEAD: f64 = 84.0;
const FOOT: f64 = 76.0;
/// Left and right margin of texts.
const EDGE: f64 = 28.0;
/// Approximate width of a letter in a title. `LETTER` is the width of a letter in the text below the title.
const TITLE_LETTER: f64 = 10.0;
const LETTER: f64 = 6.8;
/// Space above a body without a title. `AXES_ROOM` is the additional margin around a body with axes.
const UNTITLED: f64 = 10.0;
const AXES_ROOM: f64 = 44.0;
/// Horizontal position of the middle of the text between scale bar and legend. `MAX_LETTERS` is the number of letters
/// that fit there.
const MIDDLE: f64 = 0.47 * WIDE;
const MAX_LETTERS: usize = 70;
/// Detail of a single body. `LESS_FINE` is the detail of each of several bodies. A picture then has some hundreds of
/// kB.
const FINE: Detail = Detail { rings: 200, faces: 56 };
const LESS_FINE: Detail = Detail { rings: 80, faces: 36 };

/// Options of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureOptions {
    /// Viewpoint of the picture.
    pub look: Viewpoint,
    /// Colours of the heights of layers.
    pub palette: Palette,
    /// Range of heights that the colours cover, mm. If `None`, it is derived from the heights.
    pub range: Option<[f64; 2]>,
    /// True to draw names and captions above the bodies.
    pub title: bool,
    /// True to draw axes with numbers around the bodies.
    pub axes: bool,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self { look: Viewpoint::Corner, palette: Palette::default(), range: None, title: true, axes: false }
    }
}

/// Returns the picture of any number of bodies, with one camera and one scale.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn svg(subjects: &[&Subject], options: &PictureOptions) -> Result<String, ViewError> {
    let layers = subjects.iter().map(|subject| subject.layers()).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<(&Subject, &Layers)> = subjects.iter().copied().zip(&layers).collect();
    let grid = AxisGrid::of(all.len());
    let stages: Vec<Stage> = all.iter().map(|(subject, layers)| Stage::new(subject, layers, grid.detail)).collect();
    let camera = Camera::new(options.look, &facing(&stages));
    let heights = height_scale(&all, options);
    let square = stages.iter().map(Stage::square).fold(0.0, f64::max);
    let margin = MARGIN.map(|margin| margin + if options.axes { AXES_ROOM } else { 0.0 });
    let boxes: Vec<Option<Axes>> = stages.iter().map(|stage| options.axes.then(|| stage.axes(square))).collect();
    let mut bounds: Vec<ScreenBounds> =
        stages.iter().zip(&boxes).map(|(stage, axes)| stage.bounds(&camera, square, axes.as_ref())).collect();
    // Bodies with the same start and goal share one frame, so that equal points appear at equal points.
    if stages.iter().all(|stage| stages.first().is_some_and(|first| stage.has_ends_of(first))) {
        let together = bounds.iter().fold(ScreenBounds::NONE, |all, one| all.and(*one));
        bounds.fill(together);
    }
    let fitting_scale = |bounds| scale(bounds, [grid.width, grid.max_high], margin);
    let scale = bounds.iter().map(fitting_scale).fold(f64::INFINITY, f64::min);
    let room_above = if stages.iter().any(Stage::has_reached) { FREE_SIDE - MARGIN[1] } else { 0.0 };
    let top = room_above + if options.title { HEAD } else { UNTITLED };
    let high = bounds.iter().map(|bounds| scale * bounds.size()[1] + 2.0 * margin[1]).fold(MIN_HIGH, f64::max);

    let bottom = grid.rows as f64 * (top + high);
    let mut canvas = Canvas::new(WIDE, bottom + FOOT, &accessible_title(&all, &stages));
    let names = names(subjects);
    for (index, (stage, bounds)) in stages.iter().zip(&bounds).enumerate() {
        let [left, above] = grid.corner(index, top + high);
        let at = [left + 0.5 * grid.width, above + top + 0.5 * high];
        let place = Projection { camera, scale, centre: bounds.centre(), at };
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

/// Arrangement of several bodies in columns and rows of a picture.
struct AxisGrid {
    columns: usize,
    rows: usize,
    /// Width of a column, units of the drawing. `max_high` is the greatest height of a body's area.
    width: f64,
    max_high: f64,
    detail: Detail,
}

impl AxisGrid {
    /// Returns the grid for `count` bodies.
    fn of(count: usize) -> Self {
        let columns = match count {
            0 | 1 => 1,
            2 | 4 => 2,
            _ => 3,
        };
        let (max_high, detail) = if count > 1 { (HIGH_OF_TWO, LESS_FINE) } else { (HIGH, FINE) };
        Self { columns, rows: count.div_ceil(columns).max(1), width: WIDE / columns as f64, max_high, detail }
    }

    /// Returns the upper left corner of the area of the body with this index. `high` is the height of a row.
    fn corner(&self, index: usize, high: f64) -> [f64; 2] {
        [self.width * (index % self.columns) as f64, high * (index / self.columns) as f64]
    }
}

/// Returns the scale of colours for the layers of all bodies.
fn height_scale(all: &[(&Subject, &Layers)], options: &PictureOptions) -> HeightScale {
    let bodies: Vec<(&[LayerBytes], f64)> =
        all.iter().map(|(subject, layers)| (layers.body(), subject.robot.tip_radius())).collect();
    HeightScale::of(&bodies, options.palette, options.range)
}

/// Returns the title of the picture for screen readers.
fn accessible_title(all: &[(&Subject, &Layers)], stages: &[Stage]) -> String {
    let title = |((subject, layers), stage): (&(&Subject, &Layers), &Stage)| {
        let scene = stage.around().and_then(clear_of).map_or_else(String::new, |words| format!(", {words}"));
        escape(&format!("{}: {}{scene}", subject.name, caption(subject, layers, "")))
    };
    all.iter().zip(stages).map(title).collect::<Vec<_>>().join("; ")
}

/// Returns a text with the smallest clearance of a body from its scene.
fn clear_of(around: &SceneView) -> Option<String> {
    let (clearance, place) = around.clearance_text().zip(around.closest_approach_text())?;
    Some(format!("{}: narrowest {clearance}, {place}; obstacles: {}", around.file, around.obstacles.summary()))
}

/// Returns the names of bodies: files without their extensions, unless two bodies would then have the same name.
fn names<'a>(subjects: &[&'a Subject]) -> Vec<&'a str> {
    let alike = |one: &Subject| subjects.iter().filter(|other| other.stem() == one.stem()).count() > 1;
    subjects.iter().map(|subject| if alike(subject) { subject.name } else { subject.stem() }).collect()
}

/// Returns the styles of the lines next to all bodies, without repetitions.
fn lines(stages: &[Stage]) -> Vec<LineStyle> {
    stages.iter().flat_map(Stage::lines).fold(Vec::new(), |mut lines, line| {
        if !lines.contains(&line) {
            lines.push(line);
        }
        lines
    })
}

/// Returns the directions that a picture from a corner shows best: first those of the goals, then those to the goals.
fn facing(stages: &[Stage]) -> Vec<Vector3<f64>> {
    let goals = stages.iter().map(Stage::goal_direction);
    goals.chain(stages.iter().map(Stage::way_to_goal)).collect()
}

/// Returns the scale, in units of the drawing per mm, at which these bounds fit into an area of this width and height.
fn scale(bounds: &ScreenBounds, [width, max_high]: [f64; 2], margin: [f64; 2]) -> f64 {
    let [wide, high] = bounds.size().map(|size| size.max(1.0));
    ((width - 2.0 * margin[0]) / wide).min((max_high - 2.0 * margin[1]) / high)
}

/// Writes the texts above a body, from this upper left corner on, within `width`.
fn head(canvas: &mut Canvas, [left, top]: [f64; 2], width: f64, name: &str, subject: &Subject, layers: &Layers) {
    canvas.text(left, top + 42.0, "title", escape(&fitting(name, width / TITLE_LETTER)));
    canvas.text(left, top + 64.0, "", escape(&fitting(&caption(subject, layers, name), width / LETTER)));
    if let Some(measured) = measured(subject) {
        canvas.text(left, top + 83.0, "note", escape(&fitting(&measured, width / LETTER)));
    }
}

/// Returns a text, shortened to at most `max` letters.
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
