//! Small pictures of plans and scenes, for lists.

use std::f64::consts::FRAC_1_SQRT_2;

use growbot_core::job::job_layers;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::robot::Robot;
use growbot_plan::plan::Plan;
use growbot_scene::scene_file::SceneBox;
use nalgebra::Vector3;

use super::centreline::{points, thinned};
use crate::drawing::canvas::Canvas;

/// Width and height of a picture, pixels.
const SIZE: f64 = 96.0;
/// Free space at each edge of a picture, pixels.
const EDGE: f64 = 6.0;
/// Greatest number of points of a body, without the first.
const MAX_POINTS: usize = 100;
/// Edges of a box, as pairs of corners. Bit 0 of a corner is its side along x, bit 1 along y, bit 2 along z.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Returns the picture of a planned body, an SVG document.
pub fn of_plan(plan: &Plan, robot: &Robot) -> String {
    let layers: Vec<LayerBytes> = job_layers(&plan.path, robot).collect();
    draw("Planned body", &[thinned(&points(&plan.start.frame(), &layers), MAX_POINTS)])
}

/// Returns the picture of a scene, an SVG document: its bounding box. The picture is empty for a scene without one.
pub fn of_scene(bounds: Option<&SceneBox>) -> String {
    let Some(SceneBox { min_mm, max_mm }) = bounds else { return draw("Half spaces", &[]) };
    let corner =
        |corner: usize| Vector3::from_fn(|axis, _| if corner >> axis & 1 == 0 { min_mm[axis] } else { max_mm[axis] });
    draw("Bounding box of the scene", &EDGES.map(|edge| edge.map(corner).to_vec()))
}

/// Draws lines in space as seen from a corner, as large as the picture allows.
fn draw(title: &str, lines: &[Vec<Vector3<f64>>]) -> String {
    let seen = |point: &Vector3<f64>| {
        [(point.x - point.y) * FRAC_1_SQRT_2, -point.z - (point.x + point.y) * FRAC_1_SQRT_2 / 2.0]
    };
    let seen: Vec<Vec<[f64; 2]>> = lines.iter().map(|line| line.iter().map(seen).collect()).collect();
    let range = |axis: usize| {
        let values = seen.iter().flatten().map(|point| point[axis]);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], value| [min.min(value), max.max(value)])
    };
    let ranges = [range(0), range(1)];
    let extent = ranges.iter().map(|[min, max]| max - min).fold(1e-9, f64::max);
    let scale = (SIZE - 2.0 * EDGE) / extent;
    let place = |point: [f64; 2]| {
        let [x, y] = [0, 1].map(|axis| SIZE / 2.0 + scale * (point[axis] - ranges[axis].iter().sum::<f64>() / 2.0));
        (x, y)
    };
    let mut canvas = Canvas::new(SIZE, SIZE, title);
    for line in &seen {
        canvas.line(line.iter().copied().map(place), "stroke=\"#1f5fbf\" stroke-width=\"3\"");
    }
    canvas.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_drawn_within_its_picture() {
        let bounds = SceneBox { min_mm: [-10.0, 0.0, 5.0], max_mm: [40.0, 2000.0, 6.0] };
        let picture = of_scene(Some(&bounds));
        assert_eq!(picture.matches("<path").count(), EDGES.len(), "{picture}");
        let numbers = picture.split(" d=\"").skip(1).flat_map(|path| {
            path.split('"').next().unwrap_or_default().split(['M', 'L', ' ']).filter(|part| !part.is_empty())
        });
        let numbers: Vec<f64> = numbers.map(|number| number.parse().unwrap()).collect();
        assert!(numbers.iter().all(|number| (EDGE - 0.1..=SIZE - EDGE + 0.1).contains(number)), "{picture}");
        assert!(!of_scene(None).contains("<path"));
    }
}
