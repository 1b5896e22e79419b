//! A body, or several side by side, as a picture for papers: one SVG, drawn here.
//!
//! - `camera`: the viewpoint
//! - `projection`: projection into the drawing
//! - `tube`: the printed wall as shaded faces, far ones first
//! - `axes`: x, y and z with numbers, around a body
//! - `marks`: arrows, the tip's frame, poses, the floor
//! - `labels`: places of all numbers and names
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
//! - **Axes** x and y are edges of a box around the body, those that hide least of it. z is at the left, at the depth
//!   of the base, so the base reads its own height.
//! - **Labels** do not grow with the body. The scale is found in steps, so that body and labels together fill the
//!   frame. Each label takes the free place that is nearest to its point.
//! - **Obstacles** are shaded by their normals. Those between the viewer and the body are translucent.
//! - **Several bodies** have one camera and one scale. If start and goal are the same, they also have one frame, so
//!   that equal positions are drawn at equal positions.

mod axes;
mod camera;
mod labels;
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
use self::marks::{LineStyle, key};
use self::projection::{Projection, ScreenBounds};
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

/// Width of a drawing, units of the drawing. `NARROW` is the width of one with few pixels, so that its letters stay
/// legible: a drawing has at most `PER_PIXEL` units for each pixel.
const WIDE: f64 = 960.0;
const NARROW: f64 = 520.0;
const PER_PIXEL: f64 = 1.3;
/// Minimum height of a body's area, units of the drawing. The constants below are the maximum for a single body, and
/// the maximum for each of several bodies, as fractions of the drawing's width.
const MIN_HIGH: f64 = 200.0;
const HIGH: f64 = 0.8;
const HIGH_OF_TWO: f64 = 0.5;
/// Minimum width of the area of each of several bodies.
const MIN_WIDE: f64 = 250.0;
/// Margin around a body and its labels. `HEAD` is the space above a body for its caption, `MEASURED` the space for a
/// further line, and `FOOT` the space below for scale bar and legend.
const MARGIN: f64 = 18.0;
const HEAD: f64 = 74.0;
const MEASURED: f64 = 18.0;
const FOOT: f64 = 76.0;
/// Height of a line of text between bodies and foot in a narrow drawing.
const ROW: f64 = 28.0;
/// Left and right margin of texts.
const EDGE: f64 = 28.0;
/// Approximate width of a letter in a title. `LETTER` is the width of a letter in the text below the title.
const TITLE_LETTER: f64 = 10.0;
const LETTER: f64 = 6.8;
/// Greatest width of a label, as a fraction of the width of a body's area.
const LABEL: f64 = 0.36;
/// Horizontal position of the middle of the text between scale bar and legend, as a fraction of the width.
/// `MAX_LETTERS` is the number of letters that fit there.
const MIDDLE: f64 = 0.47;
const MAX_LETTERS: usize = 70;
/// Number of times that the scale is adapted to the space that the labels need.
const FITS: usize = 4;
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
    /// Width of the picture in pixels. Letters of a small picture are drawn larger. If `None`, the picture can be shown
    /// at any size.
    pub width: Option<u32>,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self {
            look: Viewpoint::Corner,
            palette: Palette::default(),
            range: None,
            title: true,
            axes: false,
            width: None,
        }
    }
}

/// Returns the picture of any number of bodies, with one camera and one scale.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn svg(subjects: &[&Subject], options: &PictureOptions) -> Result<String, ViewError> {
    let layers = subjects.iter().map(|subject| subject.layers()).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<(&Subject, &Layers)> = subjects.iter().copied().zip(&layers).collect();
    let wide = options.width.map_or(WIDE, |pixels| (PER_PIXEL * f64::from(pixels)).clamp(NARROW, WIDE));
    let grid = AxisGrid::of(all.len(), wide);
    let stages: Vec<Stage> = all.iter().map(|(subject, layers)| Stage::new(subject, layers, grid.detail)).collect();
    let camera = Camera::new(options.look, &facing(&stages));
    let heights = height_scale(&all, options);
    let square = stages.iter().map(Stage::square).fold(0.0, f64::max);
    let boxes: Vec<Option<Axes>> = stages.iter().map(|stage| options.axes.then(|| stage.axes())).collect();
    let mut bounds: Vec<ScreenBounds> =
        stages.iter().zip(&boxes).map(|(stage, axes)| stage.bounds(&camera, square, axes.as_ref())).collect();
    // Bodies with the same start and goal share one frame, so that equal points appear at equal points.
    let alike = stages.iter().all(|stage| stages.first().is_some_and(|first| stage.has_ends_of(first)));
    if alike {
        let together = bounds.iter().fold(ScreenBounds::NONE, |all, one| all.and(*one));
        bounds.fill(together);
    }
    // Labels do not grow with the scale, so the scale is found in steps.
    let mut margins = vec![[0.0; 4]; stages.len()];
    let mut scale = 1.0;
    for _ in 0..FITS {
        let fitting = bounds.iter().zip(&margins).map(|(bounds, margin)| grid.scale(bounds, margin));
        scale = fitting.fold(f64::INFINITY, f64::min);
        for (index, stage) in stages.iter().enumerate() {
            let place = Projection { camera, scale, centre: bounds[index].centre(), at: [0.0; 2] };
            let [right, down] = bounds[index].size().map(|size| 0.5 * scale * size);
            let frame = [-right, -down, right, down];
            margins[index] = stage.labels(&place, frame, LABEL * grid.width, boxes[index].as_ref()).margins();
        }
        if alike {
            let most = |side: usize| margins.iter().map(|margin| margin[side]).fold(0.0, f64::max);
            let together = [0, 1, 2, 3].map(most);
            margins.fill(together);
        }
    }
    let fitting = bounds.iter().zip(&margins).map(|(bounds, margin)| grid.scale(bounds, margin));
    scale = fitting.fold(scale, f64::min);

    let has_measured = subjects.iter().any(|subject| measured(subject).is_some());
    let head_high = HEAD + if has_measured { MEASURED } else { 0.0 };
    let top = if options.title { head_high } else { 0.0 };
    let high = |index: usize| {
        let [_, above, _, below] = margins[index];
        scale * bounds[index].size()[1] + above + below + 2.0 * MARGIN
    };
    let row_high =
        |row: usize| (0..stages.len()).filter(|index| index / grid.columns == row).map(high).fold(MIN_HIGH, f64::max);
    let rows: Vec<f64> = (0..grid.rows).map(row_high).collect();
    let bottom = rows.iter().map(|high| top + high).sum::<f64>();
    let names = names(subjects);
    let lines = lines(&stages);
    let difference = match (&all[..], &names[..]) {
        ([(_, a), (_, b)], [one, other]) if options.title => difference([(one, a), (other, b)]),
        _ => String::new(),
    };
    // In a narrow drawing, the texts have rows of their own.
    let is_narrow = wide < WIDE;
    let texts = f64::from(u8::from(!lines.is_empty()) + u8::from(!difference.is_empty()));
    let foot = FOOT + if is_narrow { ROW * texts } else { 0.0 };
    let mut canvas = Canvas::new(wide, bottom + foot, &accessible_title(&all, &stages));
    for (index, (stage, bounds)) in stages.iter().zip(&bounds).enumerate() {
        let row = index / grid.columns;
        let left = grid.width * (index % grid.columns) as f64;
        let above: f64 = rows[..row].iter().map(|high| top + high).sum();
        let margin = margins[index];
        let at = [
            left + 0.5 * (grid.width + margin[0] - margin[2]),
            above + top + 0.5 * (rows[row] + margin[1] - margin[3]),
        ];
        let place = Projection { camera, scale, centre: bounds.centre(), at };
        let room = [left + 2.0, above + top, left + grid.width - 2.0, above + top + rows[row]];
        stage.draw(&mut canvas, (&place, &room), &heights, square, boxes[index].as_ref());
        let [right, down] = bounds.size().map(|size| 0.5 * scale * size);
        let frame = [at[0] - right, at[1] - down, at[0] + right, at[1] + down];
        stage.labels(&place, frame, LABEL * grid.width, boxes[index].as_ref()).draw(&mut canvas);
        if options.title {
            let (subject, layers) = all[index];
            head(&mut canvas, [left + EDGE, above], grid.width - 1.5 * EDGE, names[index], subject, layers);
        }
    }
    for column in 1..grid.columns {
        let x = grid.width * column as f64;
        canvas.add(format_args!("<path class=\"grid\" d=\"M{x} 24V{bottom}\"/>"));
    }
    scale_bar(&mut canvas, [EDGE, bottom + foot - 26.0], scale);
    let (middle, first, second) = if is_narrow {
        (0.5 * wide, bottom + 14.0, bottom + 14.0 + ROW * (texts - 1.0))
    } else {
        (MIDDLE * wide, bottom + foot - 48.0, bottom + foot - 26.0)
    };
    key(&mut canvas, [middle, first], &lines);
    if difference.chars().count() <= MAX_LETTERS {
        canvas.text(middle, second, "mid", escape(&difference));
    }
    heights.legend(&mut canvas, [wide - EDGE - LEGEND, bottom + foot - 46.0]);
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
    /// Returns the grid for `count` bodies in a drawing of this width.
    fn of(count: usize, wide: f64) -> Self {
        let columns = match count {
            0 | 1 => 1,
            2 | 4 => 2,
            _ => 3,
        };
        let columns = columns.min((wide / MIN_WIDE) as usize);
        let (max_high, detail) = if count > 1 { (HIGH_OF_TWO, LESS_FINE) } else { (HIGH, FINE) };
        let rows = count.div_ceil(columns).max(1);
        Self { columns, rows, width: wide / columns as f64, max_high: max_high * wide, detail }
    }

    /// Returns the scale, in units of the drawing per mm, at which these bounds and margins for labels fit into a
    /// body's area.
    fn scale(&self, bounds: &ScreenBounds, margin: &[f64; 4]) -> f64 {
        let [wide, high] = bounds.size().map(|size| size.max(1.0));
        let [left, top, right, bottom] = margin;
        ((self.width - left - right - 2.0 * MARGIN) / wide).min((self.max_high - top - bottom - 2.0 * MARGIN) / high)
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

#[cfg(test)]
mod tests {
    use growbot_plan::plan::Plan;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;
    use growbot_scene::scene_file;

    use super::*;
    use crate::view::NamedScene;

    const ROOM: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5.0\n[[ball]]\ncenter_mm = [0, 0, 150]\n\
                        radius_mm = 40\n[[halfspace]]\npoint_mm = [0, 0, -40]\nnormal = [0, 0, 1]\n";

    /// Returns the picture of bodies to these goals, in a scene.
    fn picture(goals: &[&str], scene: Option<&str>, options: &PictureOptions) -> String {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let radius = robot.description().planning_radius_mm;
        let start = parse_pose("0,0,0,0,90").unwrap();
        let planner = growbot_core::plan::Planner::Shortest;
        let plan = |goal: &&str| Plan::new(&robot, &start, &parse_pose(goal).unwrap(), radius, planner).unwrap();
        let plans: Vec<Plan> = goals.iter().map(plan).collect();
        let directory = tempfile::tempdir().unwrap();
        let scene = scene.map(|text| {
            let file = directory.path().join("room.toml");
            std::fs::write(&file, text).unwrap();
            scene_file::load(&file).unwrap().scene
        });
        let scene = scene.as_ref().map(|scene| NamedScene { file: "room.toml", scene });
        let subject = |plan| Subject { name: "plan.json", robot: &robot, plan, run: None, laid: None, scene };
        let subjects: Vec<Subject> = plans.iter().map(subject).collect();
        svg(&subjects.iter().collect::<Vec<_>>(), options).unwrap()
    }

    /// Returns the number after a mark in a text.
    fn number_after(text: &str, mark: &str) -> f64 {
        let rest = text.split_once(mark).unwrap().1;
        let end = rest.find(|letter: char| !"-.0123456789".contains(letter));
        rest[..end.unwrap_or(rest.len())].parse().unwrap()
    }

    /// Returns width and height of a drawing.
    fn size(svg: &str) -> [f64; 2] {
        [number_after(svg, " width=\""), number_after(svg, " height=\"")]
    }

    #[test]
    fn labels_lie_in_the_drawing_and_cover_no_other_label() {
        let goals = ["120,60,200,30,20", "60,0,90,0,0", "300,200,250,-45,-30", "0,0,500,0,90", "0,0,300,0,90"];
        for (goals, scene) in [(&goals[..1], None), (&goals[1..2], None), (&goals[..], None), (&goals[4..], Some(ROOM))]
        {
            for (axes, width) in [(false, None), (true, None), (true, Some(400))] {
                let svg = picture(goals, scene, &PictureOptions { axes, width, ..PictureOptions::default() });
                let [wide, high] = size(&svg);
                let texts = svg.split("<text class=\"").skip(1).filter(|text| !text.contains("stroke-width=\"3.5\""));
                let boxes: Vec<([f64; 4], &str)> = texts
                    .map(|text| {
                        let (x, y) = (number_after(text, " x=\""), number_after(text, " y=\""));
                        let words = text.split_once('>').unwrap().1.split('<').next().unwrap();
                        let length = 5.5 * words.replace("&lt;", "<").replace("&gt;", ">").chars().count() as f64;
                        let class = text.split('"').next().unwrap();
                        let share = [("mid", 0.5), ("end", 1.0)].into_iter().find(|(name, _)| class.ends_with(name));
                        let left = x - length * share.map_or(0.0, |(_, share)| share);
                        ([left, y - 9.0, left + length, y + 2.0], words)
                    })
                    .collect();
                for (index, (rect, words)) in boxes.iter().enumerate() {
                    assert!(
                        rect[0] >= 0.0 && rect[2] <= wide && rect[1] >= 0.0 && rect[3] <= high,
                        "{words}: {rect:?}"
                    );
                    for (other, others) in &boxes[..index] {
                        let apart = |axis: usize| rect[axis] >= other[axis + 2] || other[axis] >= rect[axis + 2];
                        assert!(apart(0) || apart(1), "{words} covers {others}: {rect:?} {other:?}");
                    }
                }
                let names = |name: &str| boxes.iter().filter(|(_, words)| *words == name).count();
                for name in ["start", "goal", "x", "y", "z"] {
                    assert_eq!(names(name), goals.len(), "{name}");
                }
            }
        }
    }

    #[test]
    fn a_body_with_its_floor_or_axes_fills_the_frame() {
        for axes in [false, true] {
            for goal in ["120,60,200,30,20", "60,0,90,0,0", "0,0,500,0,90"] {
                let svg = picture(&[goal], None, &PictureOptions { axes, ..PictureOptions::default() });
                // The scale bar is below the frame.
                let paths = svg.lines().filter(|line| line.starts_with("<path") && !line.contains("v6H"));
                let begins = paths.flat_map(|path| path.split_once(" d=\"").unwrap().1.split(['M', 'L']).skip(1));
                let [min, max] = begins.fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], begin| {
                    let y = begin.trim_start_matches(|letter: char| ".0123456789".contains(letter));
                    let y = number_after(y.trim_start(), "");
                    [min.min(y), max.max(y)]
                });
                let [wide, high] = size(&svg);
                assert!(max - min >= 0.67 * wide.min(high), "{goal}, {axes}: {min} to {max} of {wide} times {high}");
            }
        }
    }

    #[test]
    fn small_pictures_have_larger_letters() {
        let of =
            |width| size(&picture(&["0,0,100,0,90"], None, &PictureOptions { width, ..PictureOptions::default() }))[0];
        assert_eq!((of(None), of(Some(1600)), of(Some(400))), (WIDE, WIDE, NARROW));
        // The smallest letters have 12 units.
        assert!(12.0 * 400.0 / of(Some(400)) > 9.0);
    }

    #[test]
    fn an_obstacle_far_away_leaves_the_body_its_place() {
        let near = picture(&["100,0,400,0,60"], None, &PictureOptions::default());
        // Length of the scale bar.
        let bar = |svg: &str| {
            let line = svg.lines().find(|line| line.contains(" mm</text>")).unwrap();
            line.rsplit_once('>').and_then(|(start, _)| start.rsplit_once('>')).map(|(_, text)| text.to_owned())
        };
        for far in [
            "[[ball]]\ncenter_mm = [1600, 0, 200]\nradius_mm = 100\n",
            "[[ball]]\ncenter_mm = [6000, 3000, 200]\nradius_mm = 100\n",
            "[[halfspace]]\npoint_mm = [0, 0, -1500]\nnormal = [0, 0, 1]\n",
            "[[halfspace]]\npoint_mm = [2000, 0, 0]\nnormal = [-1, 0, 0]\n",
        ] {
            for axes in [false, true] {
                let options = PictureOptions { axes, ..PictureOptions::default() };
                let scene = format!("format = \"growbot-scene/1\"\n{far}");
                let svg = picture(&["100,0,400,0,60"], Some(&scene), &options);
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{far}");
                if !axes {
                    assert_eq!(bar(&svg), bar(&near), "{far}");
                }
            }
        }
    }

    #[test]
    fn the_obstacle_at_the_narrowest_place_is_named_and_coloured() {
        let svg = picture(&["0,0,300,0,90"], Some(ROOM), &PictureOptions::default());
        let words: Vec<&str> = svg.split("</text>").filter_map(|text| text.rsplit('>').next()).collect();
        assert!(words.join(" ").contains("mm inside the ball at 0, 0, 150"), "{words:?}");
        assert!(svg.contains("<linearGradient id=\"gc-"), "the ball is shaded");
    }
}
