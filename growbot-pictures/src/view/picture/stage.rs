//! One body in the picture, with its marks.

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::{Frame, Pose};
use nalgebra::Vector3;

use super::axes::Axes;
use super::camera::Camera;
use super::marks::{Arrow, Floor, LineStyle, arrow, disc, draw_axes, draw_label, word_at_free_side, word_beyond};
use super::obstacles::{self, ClipRect, LIMITS};
use super::projection::{Projection, ScreenBounds};
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
    /// Height of the floor, below everything.
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
        let points = || shown.centreline().chain(planned.iter().flat_map(Tube::centreline));
        let [min, max] =
            points().fold([plan.goal.position(); 2], |[min, max], point| [min.inf(&point), max.sup(&point)]);
        let reach = (3.0 * outer).max(0.06 * (max - min).norm());
        let tail = plan.start.position() - reach * plan.start.direction();
        let floor = min.z.min(tail.z) - outer;
        // A distance from the goal of less than a dot is given as text only.
        let reached = subject.run.and_then(measured_end).map(|(reached, _)| reached.position());
        let reached = reached.filter(|reached| (reached - plan.goal.position()).norm() > 0.5 * outer);
        Self {
            tube: shown,
            planned,
            commanded: subject.commanded(layers),
            estimated: subject.estimated(),
            around: SceneView::of(subject, layers, &LIMITS),
            start: plan.start,
            goal: plan.goal,
            via: plan.via(),
            reached,
            outer,
            reach,
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

    /// Returns true if the measured position of the tip has a label.
    pub fn has_reached(&self) -> bool {
        self.reached.is_some()
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

    /// Returns the axes around the body, with ticks at least this far apart, mm.
    pub fn axes(&self, square: f64) -> Axes {
        let points = self.tube.centreline().chain(self.planned.iter().flat_map(Tube::centreline));
        // The axes leave space for the labels beyond both arrows.
        let below = Vector3::new(0.0, 0.0, 0.8 * self.reach);
        let goal = self.goal_arrow();
        let ends = [self.start_arrow().from - below, goal.from + 1.6 * goal.length * goal.along];
        let around = Vector3::new(self.outer, self.outer, 0.0);
        let [min, max] = points
            .chain(ends)
            .fold([ends[1]; 2], |[min, max], point| [min.inf(&(point - around)), max.sup(&(point + around))]);
        Axes::round(min, max, square)
    }

    /// Returns the bounds of the body with its marks, and with the axes or a floor of squares of this side, mm.
    pub fn bounds(&self, camera: &Camera, square: f64, axes: Option<&Axes>) -> ScreenBounds {
        let centrelines = self.tube.centreline().chain(self.planned.iter().flat_map(Tube::centreline));
        let lines = centrelines.chain(self.commanded.iter().chain(&self.estimated).flatten().copied());
        // A part of the scene is visible next to the body.
        let room = if self.around.is_some() { 2.0 * self.reach } else { self.outer };
        let seen = lines.fold(ScreenBounds::NONE, |seen, point| seen.with(camera.see(&point), room));
        let [start, goal] = [self.start_arrow(), self.goal_arrow()];
        let marks = [start.from, goal.from + goal.length * goal.along].into_iter().chain(self.reached);
        let seen = marks.fold(seen, |seen, point| seen.with(camera.see(&point), 0.2 * self.outer));
        if let Some(axes) = axes {
            return axes.corners().fold(seen, |seen, corner| seen.with(camera.see(&corner), 0.0));
        }
        let floor = self.floor(square).filter(|_| self.has_floor(camera));
        floor.iter().flat_map(Floor::corners).fold(seen, |seen, corner| seen.with(camera.see(&corner), 0.0))
    }

    /// Returns the floor, with squares of this side, mm.
    fn floor(&self, square: f64) -> Option<Floor> {
        Some(Floor::under(&self.ground()?, self.floor, square))
    }

    /// Returns the bounds of the area under the body, x and y.
    fn ground(&self) -> Option<ScreenBounds> {
        let points = self.tube.centreline().chain(self.planned.iter().flat_map(Tube::centreline));
        let points = points.chain([self.goal.position()]).map(|point| [point.x, point.y]);
        points.map(|point| ScreenBounds::NONE.with(point, self.outer)).reduce(ScreenBounds::and)
    }

    /// Returns a suitable side of the floor's squares, mm.
    pub fn square(&self) -> f64 {
        let [wide, deep] = self.ground().map_or([0.0; 2], |ground| ground.size());
        round_below(0.3 * (0.5 * libm::hypot(wide, deep)).max(200.0))
    }

    /// Returns true if the floor is drawn. From its edge a floor shows nothing, and from above the body hides it.
    fn has_floor(&self, camera: &Camera) -> bool {
        (0.1..0.9).contains(&camera.towards.z)
    }

    /// Returns the arrow that leads to the start.
    fn start_arrow(&self) -> Arrow {
        let along = self.start.direction();
        Arrow {
            from: self.start.position() - self.reach * along,
            along,
            length: 0.97 * self.reach,
            thick: 0.035 * self.reach,
        }
    }

    /// Returns the arrow that leaves the goal. If the tip is at the goal, the arrow begins beyond the tip's axes.
    fn goal_arrow(&self) -> Arrow {
        let there = (self.tube.base_from_tip().translation.vector - self.goal.position()).norm() < self.outer;
        let along = self.goal.direction();
        let from = self.goal.position() + if there { 1.15 * self.axis() * along } else { Vector3::zeros() };
        Arrow { from, along, length: self.reach, thick: 0.035 * self.reach }
    }

    /// Returns the length with which the tip's axes are drawn, mm.
    fn axis(&self) -> f64 {
        2.0 * self.outer
    }

    /// Draws the body, coloured by the heights of its layers, and the obstacles within a rectangle. The floor has
    /// squares of the side `square` (mm). If `axes` are given, they are drawn instead of the floor.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        (place, room): (&Projection, &ClipRect),
        heights: &HeightScale,
        square: f64,
        axes: Option<&Axes>,
    ) {
        let camera = &place.camera;
        let floor = self.floor(square).filter(|_| self.has_floor(camera));
        match (axes, &floor) {
            (Some(axes), _) => axes.draw(canvas, place),
            (None, Some(floor)) => floor.draw(canvas, place),
            (None, None) => {}
        }
        if floor.is_some() {
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
            pieces.extend(obstacles::pieces(around, &tube, place, room));
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
            obstacles::mark(canvas, place, around, &self.way_past(around));
        }
        self.words(canvas, place);
    }

    /// Returns the direction of the body at its closest approach to an obstacle.
    fn way_past(&self, around: &SceneView) -> Vector3<f64> {
        let Some((found, _)) = &around.closest_approach else { return Vector3::z() };
        let frames = self.tube.frames();
        let apart = |frame: &Frame| (frame.translation.vector - found.on_body).norm_squared();
        let nearest = frames.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        nearest.map_or_else(Vector3::z, |frame| frame.rotation * Vector3::z())
    }

    /// Draws the marks that lie over everything: the tip's axes, poses on the way, and labels.
    fn words(&self, canvas: &mut Canvas, place: &Projection) {
        draw_axes(canvas, place, &self.tube.base_from_tip(), self.axis());
        let [start, goal] = [self.start_arrow(), self.goal_arrow()];
        let tip = self.tube.base_from_tip();
        let axes = [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::z()].map(|axis| tip.rotation * axis);
        let ahead = self.tube.centreline().find(|point| (point - start.from).norm() > 2.0 * self.reach);
        let ahead = ahead.map_or(start.along, |point| (point - start.from).normalize());
        for (end, along, name, colour, taken) in [
            (start.from, -start.along, "start", START, &[ahead][..]),
            (goal.from + goal.length * goal.along, goal.along, "goal", GOAL, &axes[..]),
        ] {
            let [right, down] = place.direction(&along);
            if libm::hypot(right, down) > 0.15 {
                word_beyond(canvas, place, &end, &along, name, colour);
            } else {
                word_at_free_side(canvas, place, place.point(&end), taken, name, colour);
            }
        }
        for (index, via) in self.via.iter().enumerate() {
            let at = place.point(&via.position());
            disc(canvas, at, 0.2 * self.outer * place.scale, GOAL);
            draw_label(
                canvas,
                [at[0], at[1] - 0.2 * self.outer * place.scale - 9.0],
                &format!("via {}", index + 1),
                GOAL,
            );
        }
        if let Some(reached) = &self.reached {
            let at = place.point(reached);
            word_at_free_side(canvas, place, at, &axes, "reached", REACHED);
            disc(canvas, at, 0.15 * self.outer * place.scale, REACHED);
        }
    }
}
