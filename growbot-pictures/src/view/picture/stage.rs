//! One body in the picture, with its marks.

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::Pose;
use growbot_scene::bvh::Bounds;
use nalgebra::Vector3;

use super::axes::Axes;
use super::camera::Camera;
use super::labels::{Kind, Labels};
use super::marks::{Arrow, Floor, LineStyle, arrow, disc, tip_axes};
use super::obstacles::{self, LIMITS};
use super::projection::{Projection, Rect, ScreenBounds};
use super::tube::{Detail, Tube};
use crate::drawing::canvas::Canvas;
use crate::drawing::chart::round_below;
use crate::view::heights::HeightScale;
use crate::view::scene_view::SceneView;
use crate::view::{Layers, Subject, measured_end};

/// Colour of the mark at the start. The constants below are the colours of the other marks, of the planned tube and of
/// the shadow. They are equal to those of the HTML page.
const START: &str = "#2b8a57";
const GOAL: &str = "#b3367a";
const REACHED: &str = "#4a5563";
const GHOST: &str = "#a9b2be";
const SHADOW: &str = "#e6e9ee";

/// Line along the planned centreline. The constants below are the lines along the commanded and the estimated path of
/// the tip.
const PLANNED_LINE: LineStyle =
    LineStyle { name: "plan", style: "stroke=\"#4a5563\" stroke-width=\"1.3\" stroke-dasharray=\"7 4\"" };
const COMMANDED_LINE: LineStyle =
    LineStyle { name: "commanded", style: "stroke=\"#1f5fbf\" stroke-width=\"1.5\" stroke-dasharray=\"2 3\"" };
const ESTIMATED_LINE: LineStyle = LineStyle { name: "estimated", style: "stroke=\"#c2185b\" stroke-width=\"1.5\"" };

/// A body with its marks in a picture. Lengths are in mm.
pub struct Stage {
    tube: Tube,
    /// The planned body, if another body is shown.
    planned: Option<Tube>,
    /// Positions of the tip if the plastic lay as commanded. `None` unless the plastic is known to lie otherwise.
    commanded: Option<Vec<Vector3<f64>>>,
    /// Positions of the tip as estimated by feedback. `None` without feedback.
    estimated: Option<Vec<Vector3<f64>>>,
    /// The scene around the body. `None` without a scene.
    around: Option<SceneView>,
    start: Pose,
    goal: Pose,
    via: Vec<Pose>,
    /// Measured position of the tip. `None` if it is at the goal or was not measured.
    reached: Option<Vector3<f64>>,
    outer: f64,
    /// Length of the arrows at start and goal.
    reach: f64,
    /// Box of the body, of all that is built and planned. `content` also contains the scene beside it.
    body: Bounds,
    content: Bounds,
    /// Height of the floor, below everything, or that of the scene's floor.
    floor: f64,
}

impl Stage {
    /// Returns the body of a subject with its marks.
    pub fn new(subject: &Subject, layers: &Layers, detail: Detail) -> Self {
        let Subject { robot, plan, .. } = subject;
        let outer = 0.5 * robot.outer_diameter();
        let radii = [outer, robot.tip_radius(), outer - robot.description().wall.width_mm];
        let tube = |layers: &[LayerBytes]| Tube::new(plan.start.frame(), layers, radii, detail);
        let (shown, planned) = (tube(layers.body()), layers.built.as_ref().map(|_| tube(&layers.planned)));
        let points = shown.centreline().chain(planned.iter().flat_map(Tube::centreline)).chain([plan.goal.position()]);
        let [start, direction] = [plan.start.position(), plan.start.direction()];
        let line = Bounds::of(&points.collect::<Vec<_>>());
        let reach = (2.2 * outer).max(0.06 * (line.max - line.min).norm());
        // A tube is as wide as its layers are tilted, so one that stands upright begins at the base's height.
        let tilted = shown.frames().flat_map(|frame| {
            let ahead = frame.rotation * Vector3::z();
            let wide = ahead.map(|part| outer * libm::sqrt((1.0 - part * part).max(0.0)));
            [frame.translation.vector - wide, frame.translation.vector + wide]
        });
        let body = Bounds::of(&tilted.collect::<Vec<_>>()).with(&line);
        let around = SceneView::of(subject, layers, &LIMITS);
        let content = around.as_ref().map_or(body, |around| obstacles::around(around, &body));
        let below = |square: &[Vector3<f64>; 4]| {
            let [min, max] = square
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], corner| [min.min(corner.z), max.max(corner.z)]);
            (max - min < 1e-6 && max <= body.min.z).then_some(max)
        };
        let squares = around.iter().flat_map(|around| &around.obstacles.squares);
        let floor = squares.filter_map(below).fold(f64::NEG_INFINITY, f64::max);
        let tail = start - reach * direction;
        let floor = if floor.is_finite() { floor } else { body.min.z.min(tail.z) - 0.3 * outer };
        // A distance from the goal of less than a dot is given as text only.
        let reached = subject.run.and_then(measured_end).map(|(reached, _)| reached.position());
        let reached = reached.filter(|reached| (reached - plan.goal.position()).norm() > 0.5 * outer);
        Self {
            tube: shown,
            planned,
            commanded: subject.commanded(layers),
            estimated: subject.estimated(),
            around,
            start: plan.start,
            goal: plan.goal,
            via: plan.via(),
            reached,
            outer,
            reach,
            body,
            content,
            floor,
        }
    }

    /// Returns the styles of the lines next to the body.
    pub fn lines(&self) -> impl Iterator<Item = LineStyle> {
        let planned = self.planned.as_ref().map(|_| PLANNED_LINE);
        let commanded = self.commanded.as_ref().map(|_| COMMANDED_LINE);
        planned.into_iter().chain(commanded).chain(self.estimated.as_ref().map(|_| ESTIMATED_LINE))
    }

    /// Returns the scene around the body.
    pub fn around(&self) -> Option<&SceneView> {
        self.around.as_ref()
    }

    /// Returns the direction of the goal.
    pub fn goal_direction(&self) -> Vector3<f64> {
        self.goal.direction()
    }

    /// Returns the vector from the start to the goal.
    pub fn way_to_goal(&self) -> Vector3<f64> {
        self.goal.position() - self.start.position()
    }

    /// Returns true if both bodies have the same start and goal.
    pub fn has_ends_of(&self, other: &Self) -> bool {
        self.start == other.start && self.goal == other.goal
    }

    /// Returns the axes around the body and the scene beside it.
    pub fn axes(&self) -> Axes {
        Axes::around(self.content.min, self.content.max, self.start.position())
    }

    /// Returns the bounds of the body with its marks and the scene, and with the axes or a floor of squares of this
    /// side, mm.
    pub fn bounds(&self, camera: &Camera, square: f64, axes: Option<&Axes>) -> ScreenBounds {
        let frames = self.tube.frames().chain(self.planned.iter().flat_map(Tube::frames));
        let lines = self.commanded.iter().chain(&self.estimated).flatten().copied();
        let lines = frames.map(|frame| frame.translation.vector).chain(lines);
        let seen = lines.fold(ScreenBounds::NONE, |seen, point| seen.with(camera.see(&point), self.outer));
        let arrows = [self.start_arrow(), self.goal_arrow()].map(|arrow| arrow.ends()).into_iter().flatten();
        let seen = arrows.chain(self.reached).fold(seen, |seen, point| seen.with(camera.see(&point), 0.2 * self.outer));
        let with = |seen: ScreenBounds, corner: Vector3<f64>| seen.with(camera.see(&corner), 0.0);
        let planes = self.around.iter().flat_map(|around| obstacles::planes(around, &self.content));
        let seen = planes.flatten().fold(seen, with);
        let seen =
            self.around.iter().flat_map(|around| obstacles::corners(around, &self.content, camera)).fold(seen, with);
        match axes {
            Some(axes) => axes.corners().fold(seen, with),
            None => self.floor(square, camera).iter().flat_map(Floor::corners).fold(seen, with),
        }
    }

    /// Returns the floor, with squares of this side, mm. From its edge a floor shows nothing, and from above the body
    /// hides it. A scene that has a floor needs no other.
    fn floor(&self, square: f64, camera: &Camera) -> Option<Floor> {
        let has_plane = self.around.as_ref().is_some_and(|around| !around.obstacles.squares.is_empty());
        let bounds = ScreenBounds { min: [self.body.min.x, self.body.min.y], max: [self.body.max.x, self.body.max.y] };
        (is_oblique(camera) && !has_plane).then(|| Floor::under(&bounds, self.floor, square))
    }

    /// Returns a suitable side of the floor's squares, mm.
    pub fn square(&self) -> f64 {
        let size = self.body.max - self.body.min;
        round_below(0.3 * (0.5 * libm::hypot(size.x, size.y)).max(8.0 * self.outer))
    }

    /// Returns the arrow that leads to the start.
    fn start_arrow(&self) -> Arrow {
        let along = self.start.direction();
        Arrow {
            from: self.start.position() - self.reach * along,
            along,
            length: 0.97 * self.reach,
            thick: 0.045 * self.reach,
        }
    }

    /// Returns the arrow that leaves the goal. If the tip is at the goal, the arrow begins beyond the tip's axes.
    fn goal_arrow(&self) -> Arrow {
        let there = (self.tube.base_from_tip().translation.vector - self.goal.position()).norm() < self.outer;
        let along = self.goal.direction();
        let from = self.goal.position() + if there { 1.15 * self.axis() * along } else { Vector3::zeros() };
        Arrow { from, along, length: self.reach, thick: 0.045 * self.reach }
    }

    /// Returns the length with which the tip's axes are drawn, mm.
    fn axis(&self) -> f64 {
        1.6 * self.outer
    }

    /// Draws the body, coloured by the heights of its layers, and the obstacles within a rectangle. The floor has
    /// squares of the side `square` (mm). If `axes` are given, they are drawn instead of the floor.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        (place, room): (&Projection, &Rect),
        heights: &HeightScale,
        square: f64,
        axes: Option<&Axes>,
    ) {
        let camera = &place.camera;
        match axes {
            Some(axes) => axes.draw(canvas, place),
            None => self.floor(square, camera).iter().for_each(|floor| floor.draw(canvas, place)),
        }
        if is_oblique(camera) {
            canvas.add(format_args!(
                "<path fill=\"{SHADOW}\" stroke=\"{SHADOW}\" stroke-width=\".5\" d=\"{}\"/>",
                self.tube.shadow(axes.map_or(self.floor, Axes::floor), place)
            ));
        }
        if let Some(planned) = &self.planned {
            for edge in planned.edges(camera, place) {
                canvas.add(format_args!("<path fill=\"none\" stroke=\"{GHOST}\" stroke-width=\"1\" d=\"{edge}\"/>"));
            }
        }
        let mut pieces = self.tube.pieces(camera, place, heights);
        for (mark, colour) in [(self.start_arrow(), START), (self.goal_arrow(), GOAL)] {
            pieces.push((camera.depth(&(mark.from + 0.5 * mark.length * mark.along)), arrow(place, &mark, colour)));
        }
        if let Some(around) = &self.around {
            let tube: Vec<Vector3<f64>> = self.tube.centreline().collect();
            pieces.extend(obstacles::pieces(around, &tube, &self.content, place, room));
        }
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Edges in the colour of their face leave no seams.
        canvas.add("<g stroke-width=\".7\" stroke-linejoin=\"round\">");
        for (_, piece) in &pieces {
            canvas.add(piece.trim_end());
        }
        canvas.add("</g>");
        // The dashed line is drawn last, so that both lines are visible where they coincide.
        if let Some(estimated) = &self.estimated {
            ESTIMATED_LINE.draw(canvas, place, estimated.iter().copied());
        }
        if let Some(commanded) = &self.commanded {
            COMMANDED_LINE.draw(canvas, place, commanded.iter().copied());
        }
        if let Some(planned) = &self.planned {
            PLANNED_LINE.draw(canvas, place, planned.centreline());
        }
        if let Some(around) = &self.around {
            obstacles::mark(canvas, place, around, room);
        }
        let mut axes = tip_axes(&self.tube.base_from_tip(), self.axis());
        axes.sort_by(|(a, ..), (b, ..)| camera.depth(&a.along).total_cmp(&camera.depth(&b.along)));
        for (axis, _, colour) in &axes {
            canvas.add(arrow(place, axis, colour).trim_end());
        }
        for via in &self.via {
            disc(canvas, place.point(&via.position()), 0.2 * self.outer * place.scale, GOAL);
        }
        if let Some(reached) = &self.reached {
            disc(canvas, place.point(reached), 0.15 * self.outer * place.scale, REACHED);
        }
    }

    /// Returns the labels of the marks and the axes, which rather lie within a frame of the drawing.
    pub fn labels(&self, place: &Projection, frame: Rect, max_width: f64, axes: Option<&Axes>) -> Labels {
        let tip = tip_axes(&self.tube.base_from_tip(), self.axis());
        let [start, goal] = [self.start_arrow(), self.goal_arrow()];
        let body = self.tube.centreline().map(|point| (place.point(&point), self.outer * place.scale));
        let mut labels = Labels::new(body.collect(), frame, max_width);
        for arrow in tip.iter().map(|(arrow, ..)| arrow).chain([&start, &goal]) {
            let [from, to] = arrow.ends().map(|end| place.point(&end));
            labels.avoid(from, to, (2.0 * arrow.thick * place.scale).max(3.0));
        }
        if let Some(axes) = axes {
            axes.label(&mut labels, place);
        }
        let mut add = |at: &Vector3<f64>, ahead: Vector3<f64>, name: &str, colour| {
            labels.add(place.point(at), place.direction(&ahead), name, Kind::Mark(colour));
        };
        for (axis, name, colour) in &tip {
            // The goal's arrow continues where z ends, so its name is beside it.
            let (share, ahead) = if *name == "z" { (0.6, -tip[0].0.along) } else { (1.0, axis.along) };
            add(&(axis.from + share * axis.length * axis.along), ahead, name, colour);
        }
        add(&start.from, -start.along, "start", START);
        add(&goal.ends()[1], goal.along, "goal", GOAL);
        for (via, number) in self.via.iter().zip(1..) {
            add(&via.position(), place.camera.up, &format!("via {number}"), GOAL);
        }
        if let Some(reached) = &self.reached {
            add(reached, -goal.along, "reached", REACHED);
        }
        if let Some(around) = &self.around {
            obstacles::label(&mut labels, place, around);
        }
        labels
    }
}

/// Returns true if a floor is seen neither from its edge nor from above.
fn is_oblique(camera: &Camera) -> bool {
    (0.1..0.9).contains(&camera.towards.z)
}
