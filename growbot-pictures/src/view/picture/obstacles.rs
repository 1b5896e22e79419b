//! The scene around a body: obstacles as translucent outlines between which the tube passes, and the narrowest point.

use growbot_scene::obstacle_selection::SelectionLimits;
use growbot_scene::shapes::{Shape, Triangle};
use nalgebra::{Rotation3, Vector3};

use super::camera::Camera;
use super::marks::{disc, word_at_free_side};
use super::projection::{Projection, clip_to_rect, outline, round_points};
use crate::drawing::canvas::Canvas;
use crate::view::scene_view::SceneView;

/// Maximum numbers of obstacles in a picture.
pub const LIMITS: SelectionLimits = SelectionLimits { shapes: 300, triangles: 4000, points: 3000 };

/// Colour of obstacles. `PLANE` is the colour of half spaces, and `NARROWEST` that of the mark at the closest approach.
const OBSTACLE: &str = "#7a6a55";
const PLANE: &str = "#8a94a3";
const NARROWEST: &str = "#b3261e";
/// Opacity of the faces and edges of shapes and points, as SVG attributes. `FINE_FACE` is the opacity for triangles and
/// half spaces.
const FACE: &str = "fill-opacity=\".17\" stroke-opacity=\".4\"";
const FINE_FACE: &str = "fill-opacity=\".14\" stroke-opacity=\".12\"";
/// Number of intervals between the points sampled along an obstacle to find the one that is nearest to the tube in the
/// picture.
const SAMPLES: u32 = 24;

/// A rectangle of the drawing: left, top, right, bottom.
pub type ClipRect = [f64; 4];

/// Returns the obstacles within a rectangle as SVG paths, each with its depth, mm. `tube` holds points of the body's
/// centreline.
pub fn pieces(around: &SceneView, tube: &[Vector3<f64>], place: &Projection, room: &ClipRect) -> Vec<(f64, String)> {
    let shown = &around.obstacles;
    let camera = &place.camera;
    let mut pieces = Vec::new();
    let mut add = |near: f64, corners: Vec<[f64; 2]>, colour: &str, style: &str| {
        let corners = clip_to_rect(corners, room);
        if corners.len() > 2 {
            let d = outline(&corners);
            pieces.push((near, format!("<path fill=\"{colour}\" stroke=\"{colour}\" {style} d=\"{d}\"/>\n")));
        }
    };
    for square in &shown.squares {
        // A half space lies behind everything on its free side.
        let near = square.iter().map(|corner| camera.depth(corner)).fold(f64::INFINITY, f64::min);
        add(near, square.iter().map(|corner| place.point(corner)).collect(), PLANE, FINE_FACE);
    }
    for shape in &shown.shapes {
        let near = nearness(shape, tube, place);
        match shape {
            Shape::Box { centre, half_extents: half, rotation } => {
                for face in faces(centre, half, rotation, camera) {
                    add(near, face.iter().map(|corner| place.point(corner)).collect(), OBSTACLE, FACE);
                }
            }
            Shape::Ball { centre, radius } => {
                add(near, round_points(place, &[(*centre, camera.towards, *radius)]), OBSTACLE, FACE);
            }
            Shape::Capsule { from, to, radius } => {
                let ends = [from, to].map(|end| (*end, camera.towards, *radius));
                add(near, round_points(place, &ends), OBSTACLE, FACE);
            }
        }
    }
    for Triangle(corners) in &shown.triangles {
        let [a, b, c] = corners;
        if (b - a).cross(&(c - a)).dot(&camera.towards) >= 0.0 {
            let near = camera.depth(&((a + b + c) / 3.0));
            add(near, corners.iter().map(|corner| place.point(corner)).collect(), OBSTACLE, FINE_FACE);
        }
    }
    for (at, radius) in &shown.points {
        add(camera.depth(at), dot(place, at, *radius), OBSTACLE, FACE);
    }
    pieces
}

/// Returns the depth (mm) of a shape at the point where it is nearest to the tube in the picture.
fn nearness(shape: &Shape, tube: &[Vector3<f64>], place: &Projection) -> f64 {
    let (from, to) = match shape {
        Shape::Ball { centre, .. } => (*centre, *centre),
        Shape::Capsule { from, to, .. } => (*from, *to),
        Shape::Box { centre, half_extents: half, rotation } => {
            let mut along = Vector3::zeros();
            along[half.imax()] = half.max() - half.min();
            (centre - rotation * along, centre + rotation * along)
        }
    };
    let camera = &place.camera;
    let apart = |a: &Vector3<f64>, b: &Vector3<f64>| {
        let ([x, y], [u, v]) = (camera.see(a), camera.see(b));
        libm::hypot(x - u, y - v)
    };
    let samples = (0..=SAMPLES).map(|step| from + (to - from) * (f64::from(step) / f64::from(SAMPLES)));
    let least = |at: &Vector3<f64>| tube.iter().map(|point| apart(at, point)).fold(f64::INFINITY, f64::min);
    let nearest = samples.map(|at| (least(&at), at)).min_by(|a, b| a.0.total_cmp(&b.0));
    camera.depth(&nearest.map_or(from, |(_, at)| at))
}

/// Returns the faces of a box that face the camera.
fn faces(
    centre: &Vector3<f64>,
    half: &Vector3<f64>,
    rotation: &Rotation3<f64>,
    camera: &Camera,
) -> impl Iterator<Item = [Vector3<f64>; 4]> {
    let axes: [Vector3<f64>; 3] =
        std::array::from_fn(|axis| rotation * Vector3::from_fn(|part, _| if part == axis { half[part] } else { 0.0 }));
    let (centre, towards) = (*centre, camera.towards);
    (0..3).filter_map(move |axis| {
        let out = axes[axis] * axes[axis].dot(&towards).signum();
        let [a, b] = [axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
        let seen = out.dot(&towards) > 1e-6 * out.norm();
        seen.then(|| [a + b, b - a, -a - b, a - b].map(|corner| centre + out + corner))
    })
}

/// Returns the outline of a cloud's point with this radius (mm) as a hexagon, which is at least large enough to be
/// visible.
fn dot(place: &Projection, at: &Vector3<f64>, radius: f64) -> Vec<[f64; 2]> {
    let [x, y] = place.point(at);
    let radius = (radius * place.scale).max(0.8);
    let corner = |corner: u32| {
        let angle = std::f64::consts::TAU * f64::from(corner) / 6.0;
        [x + radius * libm::cos(angle), y + radius * libm::sin(angle)]
    };
    (0..6).map(corner).collect()
}

/// Draws the mark at the closest approach, over everything. `along` is the body's direction there, which the label
/// avoids.
pub fn mark(canvas: &mut Canvas, place: &Projection, around: &SceneView, along: &Vector3<f64>) {
    let (Some((found, _)), Some(clearance)) = (&around.closest_approach, around.clearance_text()) else { return };
    let [from, to] = [&found.on_body, &found.on_obstacle].map(|point| place.point(point));
    for (colour, width) in [("#fff", 4.0), (NARROWEST, 2.0)] {
        canvas.line([from.into(), to.into()], format_args!("stroke=\"{colour}\" stroke-width=\"{width}\""));
    }
    let taken = [*along, -along];
    word_at_free_side(canvas, place, to, &taken, &format!("narrowest: {clearance}"), NARROWEST);
    disc(canvas, from, 3.0, NARROWEST);
    disc(canvas, to, 3.0, NARROWEST);
}
