//! Axes around a body, in mm. x and y are edges of a box around the body, those that hide least of it. z stands at the
//! left edge of the picture's box, at the depth of the base: level lines lead from its numbers to the base.

use nalgebra::Vector3;

use super::labels::{Kind, Labels};
use super::projection::Projection;
use crate::drawing::canvas::Canvas;
use crate::drawing::chart::number;

/// Length of a tick, units of the drawing.
const TICK: f64 = 5.0;
/// Distances from an axis to its name, beside and below it, units of the drawing.
const BEYOND: [f64; 2] = [36.0, 20.0];
/// Projected length, as a fraction of an axis's length, below which the axis is seen from its end and not drawn.
const END_ON: f64 = 0.2;
/// Least size of the box in each direction, as a fraction of its greatest size. So each axis has space for numbers.
const LEAST: f64 = 0.25;
/// Fewest ticks of an axis. It has at most twice as many.
const TICKS: usize = 3;
const NAMES: [&str; 3] = ["x, mm", "y, mm", "z, mm"];

/// A box around a body, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    min: Vector3<f64>,
    max: Vector3<f64>,
    /// Point at whose depth z stands.
    base: Vector3<f64>,
}

/// An axis as it is drawn.
struct Axis {
    /// Both ends, mm.
    ends: [Vector3<f64>; 2],
    /// Direction away from the box, a unit vector in the drawing.
    out: [f64; 2],
    /// Positions of the ticks along the axis, mm.
    ticks: Vec<f64>,
}

impl Axes {
    /// Returns the axes around these corners (mm). The box is extended where it is thin, but not downwards.
    pub fn around(min: Vector3<f64>, max: Vector3<f64>, base: Vector3<f64>) -> Self {
        let least = LEAST * (max - min).max();
        let missing = (max - min).map(|size| (least - size).max(0.0));
        let min = min - Vector3::new(0.5 * missing.x, 0.5 * missing.y, 0.0);
        Self { min, max: max.sup(&(min + Vector3::repeat(least))), base }
    }

    /// Returns the eight corners of the box.
    pub fn corners(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        let ends = [self.min, self.max];
        (0..8_usize).map(move |corner| Vector3::from_fn(|axis, _| ends[corner >> axis & 1][axis]))
    }

    /// Returns the height of the lower face of the box, mm.
    pub fn floor(&self) -> f64 {
        self.min.z
    }

    /// Returns the positions of the ticks along an axis, mm: multiples of the greatest round step that gives enough.
    fn ticks(&self, axis: usize) -> Vec<f64> {
        let (from, to) = (self.min[axis], self.max[axis]);
        let power = libm::pow(10.0, libm::floor(libm::log10(to - from)));
        let multiples = |share: f64| -> Vec<f64> {
            let step = share * power;
            let (first, last) = (libm::ceil(from / step - 1e-9) as i64, libm::floor(to / step + 1e-9) as i64);
            (first..=last).map(|tick| step * tick as f64).collect()
        };
        let steps = [5.0, 2.5, 2.0, 1.0, 0.5, 0.25, 0.2, 0.1].map(multiples);
        steps.into_iter().find(|ticks| ticks.len() >= TICKS).unwrap_or_default()
    }

    /// Returns an axis. Returns `None` if it is seen from its end.
    fn axis(&self, place: &Projection, axis: usize) -> Option<Axis> {
        let along = Vector3::from_fn(|part, _| if part == axis { 1.0 } else { 0.0 });
        let [right, down] = place.direction(&along);
        let seen = libm::hypot(right, down);
        if seen < END_ON {
            return None;
        }
        let from = if axis == 2 {
            let left = self.corners().map(|corner| place.camera.see(&corner)[0]).fold(f64::INFINITY, f64::min);
            let from = self.base + place.camera.right * (left - place.camera.see(&self.base)[0]);
            Vector3::new(from.x, from.y, self.min.z)
        } else {
            // This is the lowest edge of the floor, or the rightmost if the edges look upright.
            let part = usize::from(down.abs() <= 2.0 * right.abs());
            let other = 1 - axis;
            let edges = [self.min[other], self.max[other]].map(|at| {
                let mut from = self.min;
                from[other] = at;
                from
            });
            edges.into_iter().max_by(|a, b| place.point(a)[part].total_cmp(&place.point(b)[part]))?
        };
        let to = from + along * (self.max[axis] - self.min[axis]);
        // Direction away from the box, perpendicular to the edge.
        let across = [-down / seen, right / seen];
        let [middle, centre] = [0.5 * (from + to), 0.5 * (self.min + self.max)].map(|point| place.point(&point));
        let side = (middle[0] - centre[0]) * across[0] + (middle[1] - centre[1]) * across[1];
        let out = if side < 0.0 { across.map(|part| -part) } else { across };
        Some(Axis { ends: [from, to], out, ticks: self.ticks(axis) })
    }

    /// Draws the grid of the floor and the axes with their ticks.
    pub fn draw(&self, canvas: &mut Canvas, place: &Projection) {
        let mut grid = String::new();
        let mut add = |from: Vector3<f64>, to: Vector3<f64>| {
            let [from, to] = [from, to].map(|end| place.point(&end));
            grid += &format!("M{:.1} {:.1}L{:.1} {:.1}", from[0], from[1], to[0], to[1]);
        };
        if place.camera.towards.z.abs() > 0.1 {
            for axis in 0..2 {
                for at in [self.min[axis], self.max[axis]].into_iter().chain(self.ticks(axis)) {
                    let ends = [self.min, self.max].map(|end| {
                        let mut point = Vector3::new(end.x, end.y, self.min.z);
                        point[axis] = at;
                        point
                    });
                    add(ends[0], ends[1]);
                }
            }
        }
        let axes: Vec<(usize, Axis)> = (0..3).filter_map(|axis| Some((axis, self.axis(place, axis)?))).collect();
        if let Some((2, z)) = axes.last() {
            // The base reads its own height.
            add(Vector3::new(z.ends[0].x, z.ends[0].y, self.base.z), self.base);
        }
        canvas.add(format_args!("<path class=\"grid\" d=\"{grid}\"/>"));
        for (axis, Axis { ends, out, ticks }) in &axes {
            canvas.line(ends.map(|end| place.point(&end).into()), "class=\"axis\"");
            for at in ticks {
                let [x, y] = tick(place, &ends[0], *axis, *at);
                canvas.line([(x, y), (x + TICK * out[0], y + TICK * out[1])], "class=\"axis\"");
            }
        }
    }

    /// Adds the numbers and names of the axes.
    pub fn label(&self, labels: &mut Labels, place: &Projection) {
        let axes: Vec<(usize, Axis)> = (0..3).filter_map(|axis| Some((axis, self.axis(place, axis)?))).collect();
        // The heights come first, so that the base's is never left out.
        for (axis, Axis { ends, out, ticks }) in axes.iter().rev() {
            for at in ticks {
                let [x, y] = tick(place, &ends[0], *axis, *at);
                // Adding 0 turns -0 into 0.
                labels.add_number([x + TICK * out[0], y + TICK * out[1]], *out, number(at + 0.0));
            }
        }
        for (axis, Axis { ends, out, .. }) in axes {
            let [from, to] = ends.map(|end| place.point(&end));
            labels.avoid(from, to, 4.0);
            let beyond = |part: usize| 0.5 * (from[part] + to[part]) + BEYOND[part] * out[part];
            let (at, ahead) = if axis == 2 { (to, [0.0, -1.0]) } else { ([beyond(0), beyond(1)], out) };
            labels.add(at, ahead, NAMES[axis], Kind::Axis);
        }
    }
}

/// Returns the position of a tick in the drawing.
fn tick(place: &Projection, from: &Vector3<f64>, axis: usize, at: f64) -> [f64; 2] {
    let mut point = *from;
    point[axis] = at;
    place.point(&point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::picture::camera::{Camera, Viewpoint};

    fn place(look: Viewpoint) -> Projection {
        let camera = Camera::new(look, &[Vector3::x()]);
        Projection { camera, scale: 3.0, centre: [50.0, 50.0], at: [300.0, 300.0] }
    }

    #[test]
    fn each_axis_has_three_to_six_round_ticks() {
        for size in [0.7, 20.0, 45.6, 90.0, 101.0, 149.9, 250.0, 599.0, 4321.0] {
            let thin = Vector3::new(size, 0.0, 0.02 * size);
            let axes = Axes::around(-0.37 * thin, 0.63 * thin, Vector3::zeros());
            for axis in 0..3 {
                let ticks = axes.ticks(axis);
                assert!((3..=6).contains(&ticks.len()), "{size}, {axis}: {ticks:?}");
                assert!(ticks.iter().all(|at| (axes.min[axis] - 1e-6..=axes.max[axis] + 1e-6).contains(at)));
            }
        }
        let axes = Axes::around(Vector3::new(-23.0, -23.0, 0.0), Vector3::new(23.0, 200.0, 310.0), Vector3::zeros());
        assert_eq!(axes.ticks(2), [0.0, 100.0, 200.0, 300.0]);
        assert_eq!(axes.ticks(1), [0.0, 100.0, 200.0]);
    }

    #[test]
    fn the_base_reads_its_own_height() {
        let base = Vector3::new(10.0, -20.0, 0.0);
        let axes = Axes::around(Vector3::new(-40.0, -30.0, 0.0), Vector3::new(160.0, 120.0, 250.0), base);
        for look in [Viewpoint::Corner, Viewpoint::Front, Viewpoint::Side] {
            let place = place(look);
            let z = axes.axis(&place, 2).unwrap();
            assert!((tick(&place, &z.ends[0], 2, 0.0)[1] - place.point(&base)[1]).abs() < 1e-9, "{look:?}");
            let leftmost = axes.corners().map(|corner| place.point(&corner)[0]).fold(f64::INFINITY, f64::min);
            assert!((place.point(&z.ends[0])[0] - leftmost).abs() < 1e-9, "{look:?}");
        }
    }

    #[test]
    fn an_axis_seen_end_on_has_no_label() {
        let axes = Axes::around(Vector3::zeros(), Vector3::repeat(100.0), Vector3::zeros());
        for (look, names) in [
            (Viewpoint::Front, ["x, mm", "z, mm"]),
            (Viewpoint::Side, ["y, mm", "z, mm"]),
            (Viewpoint::Top, ["x, mm", "y, mm"]),
        ] {
            let place = place(look);
            let mut canvas = Canvas::new(600.0, 600.0, "");
            let mut labels = Labels::new(Vec::new(), [0.0, 0.0, 600.0, 600.0], 200.0);
            axes.draw(&mut canvas, &place);
            axes.label(&mut labels, &place);
            labels.draw(&mut canvas);
            let drawn = canvas.finish();
            for name in NAMES {
                assert_eq!(drawn.contains(name), names.contains(&name), "{look:?}: {name}");
            }
        }
    }
}
