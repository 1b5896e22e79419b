//! A body, or two side by side, as a picture for papers: one SVG, drawn here.
//!
//! - `camera`: from where; `place`: where that is in the drawing;
//! - `tube`: the printed wall as shaded faces, far ones first;
//! - `marks`: arrows, the tip's frame, poses, the floor;
//! - `stage`: one body with all of that.

mod camera;
mod marks;
mod place;
mod stage;
mod tube;

pub use camera::Look;

use growbot_core::layer_bytes::LayerBytes;
use nalgebra::Vector3;

use self::camera::Camera;
use self::marks::{FREE_SIDE, Line, key};
use self::place::{Bounds, Place};
use self::stage::Stage;
use self::tube::{Detail, height_range};
use super::numbers::{caption, measured};
use super::side_by_side::difference;
use super::{Layers, Subject, ViewError};
use crate::drawing::canvas::{Canvas, escape};
use crate::drawing::chart::{number, round_below};
use crate::drawing::colours::{HEIGHTS, hex};

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
/// Width of the scale of heights.
const LEGEND: f64 = 220.0;
/// The middle of the text between scale bar and legend, and the number of letters that fit.
const MIDDLE: f64 = 0.47 * WIDE;
const MAX_LETTERS: usize = 70;
/// How finely a body alone is drawn and each of two: a picture has some hundreds of kB.
const FINE: Detail = Detail { rings: 200, faces: 56 };
const LESS_FINE: Detail = Detail { rings: 80, faces: 36 };

/// The picture of a body or two, which are then seen from one side and at one scale.
///
/// # Errors
/// [`ViewError::TooManyLayers`].
pub fn svg(subjects: &[&Subject], look: Look) -> Result<String, ViewError> {
    let layers = subjects.iter().map(|subject| subject.layers()).collect::<Result<Vec<_>, _>>()?;
    let all: Vec<(&Subject, &Layers)> = subjects.iter().copied().zip(&layers).collect();
    let width = WIDE / all.len().max(1) as f64;
    let (max_high, detail) = if all.len() > 1 { (HIGH_OF_TWO, LESS_FINE) } else { (HIGH, FINE) };
    let stages: Vec<Stage> = all.iter().map(|(subject, layers)| Stage::new(subject, layers, detail)).collect();
    let camera = Camera::new(look, &facing(&stages));
    let range = whole_range(&all);
    let square = stages.iter().map(Stage::square).fold(0.0, f64::max);
    let mut bounds: Vec<Bounds> = stages.iter().map(|stage| stage.bounds(&camera, square)).collect();
    // Bodies to one goal are seen in one frame, so that what is at one place is at one place.
    if stages.iter().all(|stage| stages.first().is_some_and(|first| stage.has_ends_of(first))) {
        let together = bounds.iter().fold(Bounds::NONE, |all, one| all.and(*one));
        bounds.fill(together);
    }
    let scale = bounds.iter().map(|bounds| scale(bounds, [width, max_high])).fold(f64::INFINITY, f64::min);
    let room_above = if stages.iter().any(Stage::has_reached) { FREE_SIDE - MARGIN[1] } else { 0.0 };
    let top = HEAD + room_above;
    let high = bounds.iter().map(|bounds| scale * bounds.size()[1] + 2.0 * MARGIN[1]).fold(MIN_HIGH, f64::max);

    let title: Vec<String> = all
        .iter()
        .map(|(subject, layers)| escape(&format!("{}: {}", subject.name, caption(subject, layers, ""))))
        .collect();
    let bottom = top + high;
    let mut canvas = Canvas::new(WIDE, bottom + FOOT, &title.join("; "));
    let names = names(subjects);
    for (index, ((stage, bounds), ((subject, layers), name))) in
        stages.iter().zip(&bounds).zip(all.iter().zip(&names)).enumerate()
    {
        let left = width * index as f64;
        let at = [left + 0.5 * width, top + 0.5 * high];
        let place = Place { camera, scale, centre: bounds.centre(), at };
        stage.draw(&mut canvas, &place, range, square);
        head(&mut canvas, [left + EDGE, width - 2.0 * EDGE], name, subject, layers);
    }
    if stages.len() > 1 {
        canvas.add(format_args!("<path class=\"grid\" d=\"M{width} 24V{bottom}\"/>"));
    }
    scale_bar(&mut canvas, [EDGE, bottom + FOOT - 26.0], scale);
    key(&mut canvas, [MIDDLE, bottom + FOOT - 48.0], &lines(&stages));
    if let ([(_, a), (_, b)], [one, other]) = (&all[..], &names[..]) {
        let words = difference([(one, a), (other, b)]);
        if words.chars().count() <= MAX_LETTERS {
            canvas.text(MIDDLE, bottom + FOOT - 26.0, "mid", escape(&words));
        }
    }
    legend(&mut canvas, [WIDE - EDGE - LEGEND, bottom + FOOT - 46.0], range);
    Ok(canvas.finish())
}

/// How bodies are called: without their files' endings, unless they would have one name then.
fn names<'a>(subjects: &[&'a Subject]) -> Vec<&'a str> {
    let alike = matches!(subjects, [one, other] if one.stem() == other.stem());
    subjects.iter().map(|subject| if alike { subject.name } else { subject.stem() }).collect()
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

/// The heights that the colours of all go over, mm.
fn whole_range(all: &[(&Subject, &Layers)]) -> [f64; 2] {
    let range = |layers: &[LayerBytes], subject: &Subject| height_range(layers, subject.robot.tip_radius());
    let ranges = all.iter().map(|(subject, layers)| range(layers.body(), subject));
    ranges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or([0.0, 1.0])
}

/// Units for a mm at which these bounds fit on a stage of this width and height.
fn scale(bounds: &Bounds, [width, max_high]: [f64; 2]) -> f64 {
    let [wide, high] = bounds.size().map(|size| size.max(1.0));
    ((width - 2.0 * MARGIN[0]) / wide).min((max_high - 2.0 * MARGIN[1]) / high)
}

/// What is written over a stage, from `left` on, `width` wide.
fn head(canvas: &mut Canvas, [left, width]: [f64; 2], name: &str, subject: &Subject, layers: &Layers) {
    canvas.text(left, 42.0, "title", escape(&fitting(name, width / TITLE_LETTER)));
    canvas.text(left, 64.0, "", escape(&fitting(&caption(subject, layers, name), width / LETTER)));
    if let Some(measured) = measured(subject) {
        canvas.text(left, 83.0, "note", escape(&measured));
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

fn legend(canvas: &mut Canvas, [left, y]: [f64; 2], [min, max]: [f64; 2]) {
    let stops: String = HEIGHTS
        .iter()
        .enumerate()
        .map(|(index, colour)| {
            let at = index as f64 / (HEIGHTS.len() - 1) as f64;
            format!("<stop offset=\"{at}\" stop-color=\"{}\"/>", hex(*colour))
        })
        .collect();
    canvas.add(format_args!(
        "<defs><linearGradient id=\"gc-heights\">{stops}</linearGradient></defs>\
         <rect x=\"{left}\" y=\"{y}\" width=\"{LEGEND}\" height=\"10\" rx=\"2\" fill=\"url(#gc-heights)\"/>"
    ));
    canvas.text(left, y - 9.0, "", "Height of the layers, mm");
    for (share, class) in [(0.0, "note"), (0.5, "note mid"), (1.0, "note end")] {
        canvas.text(left + share * LEGEND, y + 26.0, class, format_args!("{:.2}", min + share * (max - min)));
    }
}
