//! Axes around a body, in mm. They are edges of a box whose corners have round coordinates. The edges that hide least
//! of the body have ticks and names.

use nalgebra::Vector3;

use super::projection::Projection;
use crate::drawing::canvas::Canvas;
use crate::drawing::chart::number;

/// Distances from an edge to its numbers, below the edge and next to it, units of the drawing. `NAME` are the distances
/// to the middle of its name, and `TICK` is the length of a tick.
const NUMBERS: [f64; 2] = [17.0, 9.0];
const NAME: [f64; 2] = [40.0, 62.0];
const TICK: f64 = 5.0;
/// Smallest distance between two numbers, units of the drawing.
const BETWEEN: f64 = 38.0;
/// Projected length, as a fraction of an axis's length, below which the axis is seen from its end and not drawn.
const END_ON: f64 = 0.2;
const NAMES: [&str; 3] = ["x, mm", "y, mm", "z, mm"];

/// A box whose corners are whole steps from the origin, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    min: Vector3<f64>,
    max: Vector3<f64>,
    step: f64,
}

impl Axes {
    /// Returns the smallest box of whole steps (mm) around these corners. It is at least one step wide in each
    /// direction.
    pub fn round(min: Vector3<f64>, max: Vector3<f64>, step: f64) -> Self {
        let min = min.map(|at| step * libm::floor(at / step + 1e-9));
        let max = max.map(|at| step * libm::ceil(at / step - 1e-9));
        Self { min, max: max.sup(&min.add_scalar(step)), step }
    }

    /// Returns the eight corners of the box.
    pub fn corners(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        (0..8).map(|corner| self.corner([corner & 1, corner >> 1 & 1, corner >> 2 & 1]))
    }

    /// Returns the height of the lower face of the box, mm.
    pub fn floor(&self) -> f64 {
        self.min.z
    }

    fn corner(&self, ends: [usize; 3]) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| if ends[axis] == 0 { self.min[axis] } else { self.max[axis] })
    }

    /// Returns the four edges along an axis, each by its two ends.
    fn edges(&self, axis: usize) -> [[Vector3<f64>; 2]; 4] {
        [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[one, other]| {
            [0, 1].map(|end| {
                let mut ends = [one, other, 0];
                ends.copy_within(axis..2, axis + 1);
                ends[axis] = end;
                self.corner(ends)
            })
        })
    }

    /// Draws the grid of the floor, and the three edges with ticks, numbers and names.
    pub fn draw(&self, canvas: &mut Canvas, place: &Projection) {
        if place.camera.towards.z.abs() > 0.1 {
            self.draw_floor(canvas, place);
        }
        let centre = place.point(&(0.5 * (self.min + self.max)));
        for axis in 0..3 {
            self.draw_axis(canvas, place, axis, centre);
        }
    }

    fn draw_floor(&self, canvas: &mut Canvas, place: &Projection) {
        let mut lines = String::new();
        for axis in 0..2 {
            let other = 1 - axis;
            for at in self.ticks(axis, 1) {
                let [from, to] = [self.min[other], self.max[other]].map(|end| {
                    let mut point = self.min;
                    (point[axis], point[other]) = (at, end);
                    place.point(&point)
                });
                lines += &format!("M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1]);
            }
        }
        canvas.add(format_args!("<path class=\"grid\" d=\"{lines}\"/>"));
    }

    /// Returns the positions of the ticks along an axis, mm: all multiples of `every` steps.
    fn ticks(&self, axis: usize, every: u32) -> Vec<f64> {
        let step = self.step * f64::from(every);
        let first = libm::ceil(self.min[axis] / step - 1e-9) as i64;
        let last = libm::floor(self.max[axis] / step + 1e-9) as i64;
        (first..=last).map(|tick| step * tick as f64).collect()
    }

    fn draw_axis(&self, canvas: &mut Canvas, place: &Projection, axis: usize, centre: [f64; 2]) {
        let mut along = Vector3::zeros();
        along[axis] = 1.0;
        let [right, down] = place.direction(&along);
        let seen = libm::hypot(right, down);
        if seen < END_ON {
            return;
        }
        // For x and y this is the lowest edge of the floor, or the rightmost if the edges look upright. For z it is the
        // leftmost.
        let is_upright = down.abs() > 2.0 * right.abs();
        let rank = |edge: &[Vector3<f64>; 2]| {
            let [x, y] = place.point(&(0.5 * (edge[0] + edge[1])));
            match (axis, is_upright) {
                (2, _) => -x,
                (_, true) => x,
                (_, false) => y,
            }
        };
        let edges = self.edges(axis).into_iter().filter(|[from, _]| axis == 2 || from.z == self.min.z);
        let Some(edge) = edges.max_by(|a, b| rank(a).total_cmp(&rank(b))) else { return };
        let [from, to] = edge.map(|end| place.point(&end));
        let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
        // Direction away from the box, perpendicular to the edge.
        let across = [-down / seen, right / seen];
        let side = (middle[0] - centre[0]) * across[0] + (middle[1] - centre[1]) * across[1];
        let out = if side < 0.0 { across.map(|part| -part) } else { across };
        let anchor = match out[0] {
            out if out < -0.7 => "end",
            out if out > 0.7 => "begin",
            _ => "mid",
        };
        let beside = |[x, y]: [f64; 2], far: f64| [x + far * out[0], y + far * out[1]];
        canvas
            .add(format_args!("<path class=\"axis\" d=\"M{:.1} {:.1}L{:.1} {:.1}\"/>", from[0], from[1], to[0], to[1]));
        let every = [1, 2, 5, 10, 20, 50, 100]
            .into_iter()
            .find(|every| self.step * f64::from(*every) * seen * place.scale >= BETWEEN)
            .unwrap_or(200);
        for at in self.ticks(axis, every) {
            let mut point = edge[0];
            point[axis] = at;
            let tick = place.point(&point);
            let (end, [x, y]) = (beside(tick, TICK), beside(tick, NUMBERS[usize::from(anchor != "mid")]));
            canvas.add(format_args!(
                "<path class=\"axis\" d=\"M{:.1} {:.1}L{:.1} {:.1}\"/>",
                tick[0], tick[1], end[0], end[1]
            ));
            // Adding 0 turns -0 into 0.
            canvas.text(x, y + 4.5, &format!("note {anchor}"), number(at + 0.0));
        }
        let [x, y] = beside(middle, NAME[usize::from(anchor != "mid")]);
        canvas.text(x, y + 4.5, "mid", NAMES[axis]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::picture::camera::{Camera, Viewpoint};

    #[test]
    fn a_box_has_round_corners_and_four_edges_along_each_axis() {
        let axes = Axes::round(Vector3::new(-1.0, 0.0, 10.0), Vector3::new(201.0, 0.0, 90.0), 50.0);
        assert_eq!((axes.min, axes.max), (Vector3::new(-50.0, 0.0, 0.0), Vector3::new(250.0, 50.0, 100.0)));
        assert_eq!(axes.ticks(0, 2), [0.0, 100.0, 200.0]);
        for axis in 0..3 {
            for [from, to] in axes.edges(axis) {
                let along = to - from;
                assert!((0..3).all(|other| (along[other] != 0.0) == (other == axis)), "{axis}: {along}");
            }
        }
    }

    #[test]
    fn an_axis_seen_end_on_has_no_label() {
        let axes = Axes::round(Vector3::zeros(), Vector3::repeat(100.0), 50.0);
        for (look, names) in [
            (Viewpoint::Front, ["x, mm", "z, mm"]),
            (Viewpoint::Side, ["y, mm", "z, mm"]),
            (Viewpoint::Top, ["x, mm", "y, mm"]),
        ] {
            let place =
                Projection { camera: Camera::new(look, &[]), scale: 3.0, centre: [50.0, 50.0], at: [300.0, 300.0] };
            let mut canvas = Canvas::new(600.0, 600.0, "");
            axes.draw(&mut canvas, &place);
            let drawn = canvas.finish();
            for name in NAMES {
                assert_eq!(drawn.contains(name), names.contains(&name), "{look:?}: {name}");
            }
        }
    }
}
