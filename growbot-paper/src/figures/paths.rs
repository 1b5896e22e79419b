//! Figures 5 and 7: paths as planned and as grown, seen from the side.

use growbot_pictures::drawing::canvas::Canvas;
use growbot_pictures::drawing::chart::{number, round_below};
use growbot_pictures::duration::duration_text;
use nalgebra::Vector3;

use super::super::experiments::{Example, PlannedSegment};
use super::super::paper::{self, GROUPS, ROBOTS};
use super::super::poses::Endpoints;
use super::super::reproduction::Reproduction;
use super::chart::{CanvasExt, Mark, figure};

/// Colour of planned arcs, as in the paper.
const ARC: &str = "#c8102e";
const STRAIGHT: &str = "#0072b2";
const BODY: &str = "#e69f00";
const SHINE: &str = "#f6c453";
const START: &str = "#b5488f";
const GOAL: &str = "#1c2430";
/// Angle at which the view looks down at the paths, radians.
const ELEVATION: f64 = 0.42;
/// Number of horizontal view directions that are tried.
const AZIMUTHS: u32 = 36;

/// Returns Figure 5 as SVG.
pub fn of_robot_a(of: &Reproduction, title: &'static str) -> String {
    let examples: Vec<&Example> = of.experiments.examples.iter().filter(|e| e.growth.robot == paper::ROBOT_A).collect();
    let first = "For each group, the growth whose position error is nearest to the median of the group; two-plane \
                 paths, steps of 3.096 mm.";
    draw(of, title, first, &examples, 236.0)
}

/// Returns Figure 7 as SVG.
pub fn of_robots_b_and_c(of: &Reproduction, title: &'static str) -> String {
    let examples: Vec<&Example> = of.experiments.examples.iter().filter(|e| e.growth.robot != paper::ROBOT_A).collect();
    let first = "The growths to goals at 8 R whose position errors are nearest to the median; two-plane paths, steps \
                 of 62.64 and 20 mm.";
    draw(of, title, first, &examples, 480.0)
}

fn draw(of: &Reproduction, title: &str, first: &str, examples: &[&Example], side: f64) -> String {
    let tall = side.min(330.0);
    let (width, height) = (1000.0, 150.0 + 2.0 * tall + 84.0 + 74.0);
    let notes = [
        first.to_owned(),
        "Each body is seen from its own best side; the grey line is its shadow on the ground.".to_owned(),
    ];
    let mut canvas = figure(width, height, title, &notes);
    canvas.legend(
        24.0,
        102.0,
        &[
            (Mark::Line, ARC, "planned arc".to_owned()),
            (Mark::Line, STRAIGHT, "planned line".to_owned()),
            (Mark::Line, BODY, "grown body, as wide as the robot".to_owned()),
            (Mark::Line, START, "start".to_owned()),
            (Mark::Line, GOAL, "goal".to_owned()),
        ],
    );
    for (column, example) in examples.iter().enumerate() {
        let left = 20.0 + (side + 8.0) * column as f64;
        let growth = &example.growth;
        let (robot, group) = (ROBOTS[growth.robot].name, GROUPS[growth.group]);
        let view = View::of(example, [left, 150.0, side - 8.0, tall], of);
        canvas.text(left, 138.0, "head", format!("{robot}, goal at {group} R: planned"));
        view.planned(&mut canvas, example);
        canvas.text(left, 150.0 + tall + 24.0, "note", format!("path of {} mm", round(growth.path_length)));

        let top = 150.0 + tall + 84.0;
        let view = View { area: [left, top, side - 8.0, tall], ..view };
        canvas.text(left, top - 12.0, "head", "Grown");
        view.grown(&mut canvas, example, of.experiments.robots[growth.robot].outer_diameter());
        let arrival = &growth.arrival;
        for (line, note) in [
            format!("{} steps, {}", growth.layers, duration_text(example.seconds)),
            format!("missed by {} mm, {:.1} deg", round(arrival.position_error_mm), arrival.direction_error_deg),
            format!("{:.4} of the path's length", arrival.normalized_position_error),
        ]
        .into_iter()
        .enumerate()
        {
            canvas.text(left, top + tall + 24.0 + 17.0 * line as f64, "note", note);
        }
    }
    canvas.finish()
}

fn round(mm: f64) -> f64 {
    if mm < 100.0 { libm::round(10.0 * mm) / 10.0 } else { libm::round(mm) }
}

/// View of an example: a parallel projection from the direction in which it is seen best.
#[derive(Clone, Copy)]
struct View {
    /// Left, top, width and height, pixels.
    area: [f64; 4],
    azimuth: f64,
    /// Pixels per mm.
    scale: f64,
    /// Point in the middle of the area, mm to the right and up in the projection.
    middle: (f64, f64),
    /// Height of the ground, mm.
    ground: f64,
}

impl View {
    fn of(example: &Example, area: [f64; 4], of: &Reproduction) -> Self {
        let [_, _, width, height] = area;
        let points = || example.planned.iter().flat_map(|segment| &segment.points).chain(&example.grown);
        let diameter = of.experiments.robots[example.growth.robot].outer_diameter();
        let ground = points().map(|point| point.z).fold(f64::INFINITY, f64::min) - diameter;
        let views = (0..AZIMUTHS).map(|i| {
            let azimuth = core::f64::consts::TAU * f64::from(i) / f64::from(AZIMUTHS);
            let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
            let shadows = points().map(|point| Vector3::new(point.x, point.y, ground));
            for (x, y) in points().copied().chain(shadows).map(|point| seen(azimuth, &point)) {
                bounds = [bounds[0].min(x), bounds[1].max(x), bounds[2].min(y), bounds[3].max(y)];
            }
            // The margins are room for arrows and the scale.
            let scale = ((width - 40.0) / (bounds[1] - bounds[0] + diameter))
                .min((height - 60.0) / (bounds[3] - bounds[2] + diameter));
            let middle = (0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3]));
            Self { area, azimuth, scale, middle, ground }
        });
        // The best direction is the one in which the projected curve is longest.
        let length = |view: &Self| {
            let line: Vec<(f64, f64)> = points().map(|point| view.place(point)).collect();
            line.windows(2).map(|pair| libm::hypot(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1)).sum::<f64>()
        };
        views.max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(Self {
            area,
            azimuth: 0.0,
            scale: 1.0,
            middle: (0.0, 0.0),
            ground,
        })
    }

    fn place(&self, point: &Vector3<f64>) -> (f64, f64) {
        let [left, top, width, height] = self.area;
        let (x, y) = seen(self.azimuth, point);
        (
            left + 0.5 * width + self.scale * (x - self.middle.0),
            top + 0.5 * (height - 24.0) - self.scale * (y - self.middle.1),
        )
    }

    /// Draws frame, shadow, scale and the axes of the base.
    fn ground(&self, canvas: &mut Canvas, curve: &[Vector3<f64>]) {
        let [left, top, width, height] = self.area;
        canvas.add(format_args!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"4\" \
             fill=\"#f7f8fa\" stroke=\"#d8dde5\"/>"
        ));
        let shadow: Vec<(f64, f64)> =
            curve.iter().map(|point| self.place(&Vector3::new(point.x, point.y, self.ground))).collect();
        canvas.line(shadow, "stroke=\"#1c2430\" stroke-opacity=\".22\" stroke-width=\"2.5\" stroke-linejoin=\"round\"");
        for end in [curve.first(), curve.last()].into_iter().flatten() {
            let foot = self.place(&Vector3::new(end.x, end.y, self.ground));
            canvas.line([self.place(end), foot], "stroke=\"#1c2430\" stroke-opacity=\".35\" stroke-dasharray=\"2 3\"");
        }
        let long = round_below(0.3 * width / self.scale);
        let (x, y) = (left + 12.0, top + height - 12.0);
        let end = x + long * self.scale;
        canvas.add(format_args!("<path class=\"axis\" d=\"M{x:.1} {:.1}v6M{x:.1} {y:.1}H{end:.1}m0 -3v6\"/>", y - 3.0));
        canvas.text(end + 7.0, y + 4.5, "note", format!("{} mm", number(long)));
        let origin = (left + width - 34.0, top + height - 22.0);
        for (axis, name) in [(Vector3::x(), "x"), (Vector3::y(), "y"), (Vector3::z(), "z")] {
            let (dx, dy) = seen(self.azimuth, &axis);
            let tip = (origin.0 + 17.0 * dx, origin.1 - 17.0 * dy);
            canvas.line([origin, tip], "stroke=\"#4a5565\" stroke-width=\"1.2\"");
            canvas.text(origin.0 + 25.0 * dx, origin.1 - 25.0 * dy + 4.0, "note mid", name);
        }
    }

    /// Draws an arrow from a point along a direction.
    fn arrow(&self, canvas: &mut Canvas, from: &Vector3<f64>, direction: &Vector3<f64>, colour: &str) {
        const LONG: f64 = 34.0;
        let (x, y) = self.place(from);
        let (dx, dy) = seen(self.azimuth, direction);
        let (end_x, end_y) = (x + LONG * dx, y - LONG * dy);
        canvas.line([(x, y), (end_x, end_y)], format_args!("stroke=\"{colour}\" stroke-width=\"2.4\""));
        let size = libm::hypot(dx, dy);
        if size > 0.1 {
            let (ux, uy) = (dx / size, -dy / size);
            let corner = |side: f64| (end_x - 8.0 * ux - side * 4.5 * uy, end_y - 8.0 * uy + side * 4.5 * ux);
            let ((ax, ay), (bx, by)) = (corner(1.0), corner(-1.0));
            let (tip_x, tip_y) = (end_x + 2.0 * ux, end_y + 2.0 * uy);
            canvas.add(format_args!(
                "<path d=\"M{tip_x:.1} {tip_y:.1}L{ax:.1} {ay:.1}L{bx:.1} {by:.1}Z\" fill=\"{colour}\"/>"
            ));
        }
        canvas.add(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"{colour}\"/>"));
    }

    fn planned(&self, canvas: &mut Canvas, example: &Example) {
        let curve: Vec<Vector3<f64>> = example.planned.iter().flat_map(|segment| &segment.points).copied().collect();
        self.ground(canvas, &curve);
        for PlannedSegment { bends, points } in &example.planned {
            let colour = if *bends { ARC } else { STRAIGHT };
            let line = points.iter().map(|point| self.place(point));
            canvas.line(line, format_args!("stroke=\"{colour}\" stroke-width=\"2.6\" stroke-linecap=\"round\""));
        }
        self.arrows(canvas, example);
    }

    fn grown(&self, canvas: &mut Canvas, example: &Example, diameter: f64) {
        self.ground(canvas, &example.grown);
        let wide = (diameter * self.scale).max(3.0);
        let line: Vec<(f64, f64)> = example.grown.iter().map(|point| self.place(point)).collect();
        for (colour, width) in [("#9a6a00", wide + 1.6), (BODY, wide), (SHINE, 0.45 * wide)] {
            let style = format!("stroke=\"{colour}\" stroke-width=\"{width:.1}\" stroke-linejoin=\"round\"");
            canvas.line(line.iter().copied(), style);
        }
        for PlannedSegment { bends, points } in &example.planned {
            let colour = if *bends { ARC } else { STRAIGHT };
            let line = points.iter().map(|point| self.place(point));
            canvas.line(line, format_args!("stroke=\"{colour}\" stroke-width=\"1.4\""));
        }
        self.arrows(canvas, example);
    }

    fn arrows(&self, canvas: &mut Canvas, example: &Example) {
        let Endpoints { start, goal } = &example.poses;
        self.arrow(canvas, &start.position(), &start.direction(), START);
        self.arrow(canvas, &goal.position(), &goal.direction(), GOAL);
    }
}

/// Projects a point onto the picture that is seen from the direction `azimuth` (radians). Returns its coordinates to
/// the right and up, mm.
fn seen(azimuth: f64, point: &Vector3<f64>) -> (f64, f64) {
    let (sine, cosine) = libm::sincos(azimuth);
    let away = cosine * point.y + sine * point.x;
    (cosine * point.x - sine * point.y, libm::cos(ELEVATION) * point.z + libm::sin(ELEVATION) * away)
}
