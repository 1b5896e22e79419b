//! The scene around a body: obstacles shaded by their faces, and the narrowest point. Obstacles between the viewer and
//! the body are translucent, and far ones are pale. The obstacle at the narrowest point has a colour of its own.

use growbot_scene::bvh::{Bounds, BvhItem};
use growbot_scene::obstacle_selection::SelectionLimits;
use growbot_scene::scene::Obstacle;
use growbot_scene::shapes::{Shape, Triangle};
use nalgebra::{Rotation3, Vector3};

use super::camera::Camera;
use super::labels::{Kind, Labels};
use super::marks::disc;
use super::projection::{Projection, Rect, clip_to_rect, outline, round_points};
use super::tube::shaded;
use crate::drawing::canvas::Canvas;
use crate::drawing::colours::{hex, mixed};
use crate::view::scene_view::SceneView;

/// Maximum numbers of obstacles in a picture.
pub const LIMITS: SelectionLimits = SelectionLimits { shapes: 300, triangles: 4000, points: 3000 };

/// Colour of obstacles. `NEAREST` is the colour of the shape at the closest approach, `PLANE` that of half spaces, and
/// `NARROWEST` that of the mark.
const OBSTACLE: [u8; 3] = [176, 164, 146];
const NEAREST: [u8; 3] = [226, 150, 132];
const PLANE: [u8; 3] = [150, 160, 174];
const NARROWEST: &str = "#b3261e";
/// Greatest share of white in the colour of far obstacles.
const PALE: f64 = 0.45;
/// Opacity of obstacles that do not hide the body. `VEIL` is the opacity of those that would, and `PLANE_OPACITY`
/// that of half spaces.
const SOLID: f64 = 0.92;
const VEIL: f64 = 0.3;
const PLANE_OPACITY: f64 = 0.25;
/// Number of intervals between the points sampled along and across an obstacle to find the one that is nearest to the
/// tube in the picture.
const SAMPLES: u32 = 12;

/// Returns the box of all shown obstacles and this box of a body. Obstacles far beside the body do not count.
pub fn around(around: &SceneView, body: &Bounds) -> Bounds {
    let shown = &around.obstacles;
    let near = body.inflated(0.5 * (body.max - body.min).norm());
    let shapes = shown.shapes.iter().map(Shape::bounds).chain(shown.triangles.iter().map(Triangle::bounds));
    shapes.chain(shown.points.iter().map(|(at, radius)| at.bounds().inflated(*radius))).fold(*body, |all, one| {
        let one = Bounds { min: one.min.sup(&near.min), max: one.max.inf(&near.max) };
        if (one.max - one.min).min() >= 0.0 { all.with(&one) } else { all }
    })
}

/// Returns the points that bound the obstacles in the picture, moved into the box of all that is shown.
pub fn corners(around: &SceneView, content: &Bounds, camera: &Camera) -> Vec<Vector3<f64>> {
    let shown = &around.obstacles;
    let round = |at: &Vector3<f64>, radius: f64| {
        [-radius, radius].into_iter().flat_map(|by| [at + camera.right * by, at + camera.up * by]).collect::<Vec<_>>()
    };
    let shapes = shown.shapes.iter().flat_map(|shape| match shape {
        Shape::Box { centre, half_extents: half, rotation } => {
            faces(centre, half, rotation, camera).flat_map(|(face, _)| face).collect()
        }
        Shape::Ball { centre, radius } => round(centre, *radius),
        Shape::Capsule { from, to, radius } => [round(from, *radius), round(to, *radius)].concat(),
    });
    let others = shown.triangles.iter().flat_map(|triangle| triangle.0).chain(shown.points.iter().map(|(at, _)| *at));
    shapes.chain(others).map(|corner| corner.sup(&content.min).inf(&content.max)).collect()
}

/// Returns the parts of the planes of half spaces that lie beside this box.
pub fn planes(around: &SceneView, content: &Bounds) -> Vec<[Vector3<f64>; 4]> {
    let content = content.inflated(0.05 * (content.max - content.min).norm());
    let part = |square: &[Vector3<f64>; 4]| {
        let sides = [square[1] - square[0], square[3] - square[0]];
        let corners = (0..8_usize).map(|corner| {
            Vector3::from_fn(|axis, _| [content.min, content.max][corner >> axis & 1][axis] - square[0][axis])
        });
        let shares = corners.map(|corner| sides.map(|side| corner.dot(&side) / side.norm_squared()));
        let [from, to] = shares.fold([[1.0_f64; 2], [0.0_f64; 2]], |[from, to], at| {
            [[0, 1].map(|side| from[side].min(at[side])), [0, 1].map(|side| to[side].max(at[side]))]
        });
        let at = |x: f64, y: f64| square[0] + sides[0] * x.clamp(0.0, 1.0) + sides[1] * y.clamp(0.0, 1.0);
        [at(from[0], from[1]), at(to[0], from[1]), at(to[0], to[1]), at(from[0], to[1])]
    };
    around.obstacles.squares.iter().map(part).collect()
}

/// Fill of an outline.
enum Fill {
    /// A plane face with this normal.
    Flat(Vector3<f64>),
    /// A round surface, whose normals turn from one side to the other across this direction of the drawing.
    Round([f64; 2]),
}

/// The obstacles of a picture.
pub struct Pieces<'a> {
    place: &'a Projection,
    room: &'a Rect,
    /// Depths of the farthest and the nearest point, mm.
    depths: [f64; 2],
    pieces: Vec<(f64, String)>,
}

impl Pieces<'_> {
    fn add(&mut self, near: f64, corners: Vec<[f64; 2]>, colour: [u8; 3], opacity: f64, fill: &Fill) {
        let corners = clip_to_rect(corners, self.room);
        if corners.len() < 3 {
            return;
        }
        let camera = &self.place.camera;
        let [far, close] = self.depths;
        let pale = PALE * ((close - near) / (close - far).max(1e-9)).clamp(0.0, 1.0);
        let tone = |normal: &Vector3<f64>| hex(mixed(&[shaded(colour, normal, camera), [255; 3]], pale));
        let edge = hex(mixed(&[colour.map(|part| part / 2), [255; 3]], pale));
        let (defined, paint) = match fill {
            Fill::Flat(normal) => (String::new(), tone(normal)),
            Fill::Round(across) => gradient(&corners, *across, camera, tone),
        };
        let d = outline(&corners);
        self.pieces.push((
            near,
            format!(
                "{defined}<path fill=\"{paint}\" stroke=\"{edge}\" fill-opacity=\"{opacity}\" stroke-opacity=\"{:.2}\" \
                 d=\"{d}\"/>\n",
                0.6 * opacity
            ),
        ));
    }
}

/// Returns a gradient over an outline as a definition and a paint. Its colours are those of the normals of a round
/// surface, from one side to the other in the direction `across`.
fn gradient(
    corners: &[[f64; 2]],
    across: [f64; 2],
    camera: &Camera,
    tone: impl Fn(&Vector3<f64>) -> String,
) -> (String, String) {
    let along = |corner: &[f64; 2]| corner[0] * across[0] + corner[1] * across[1];
    let extreme = |sign: f64| corners.iter().max_by(|a, b| (sign * along(a)).total_cmp(&(sign * along(b))));
    let (Some(from), Some(to)) = (extreme(-1.0), extreme(1.0)) else { return Default::default() };
    let length = along(to) - along(from);
    let to = [from[0] + length * across[0], from[1] + length * across[1]];
    let aside = camera.right * across[0] - camera.up * across[1];
    let stops: String = (0..=6)
        .map(|stop| {
            let share = f64::from(stop) / 6.0;
            let side = 1.9 * share - 0.95;
            let normal = aside * side + camera.towards * (1.0 - side * side).sqrt();
            format!("<stop offset=\"{share:.3}\" stop-color=\"{}\"/>", tone(&normal))
        })
        .collect();
    let ends = format!("x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"", from[0], from[1], to[0], to[1]);
    let id = format!("gc-{:.0}-{:.0}-{:.0}-{:.0}{}", from[0], from[1], to[0], to[1], &tone(&camera.towards)[1..]);
    let paint = format!("url(#{id})");
    (format!("<linearGradient id=\"{id}\" gradientUnits=\"userSpaceOnUse\" {ends}>{stops}</linearGradient>"), paint)
}

/// Returns the obstacles within a rectangle as SVG paths, each with its depth, mm. `tube` holds points of the body's
/// centreline, and `content` is the box of all that is shown.
pub fn pieces(
    around: &SceneView,
    tube: &[Vector3<f64>],
    content: &Bounds,
    place: &Projection,
    room: &Rect,
) -> Vec<(f64, String)> {
    let shown = &around.obstacles;
    let camera = &place.camera;
    let nearest = around.closest_approach.as_ref().map(|(found, _)| found.obstacle);
    let (middle, half) = (0.5 * (content.min + content.max), 0.5 * (content.max - content.min));
    let reach = half.dot(&camera.towards.abs());
    let depths = [camera.depth(&middle) - reach, camera.depth(&middle) + reach];
    let mut found = Pieces { place, room, depths, pieces: Vec::new() };
    let points = |corners: &[Vector3<f64>]| corners.iter().map(|corner| place.point(corner)).collect::<Vec<_>>();
    for square in planes(around, content) {
        // A half space lies behind everything on its free side.
        let near = square.iter().map(|corner| camera.depth(corner)).fold(f64::INFINITY, f64::min);
        let normal = (square[1] - square[0]).cross(&(square[3] - square[0])).normalize();
        found.add(near, points(&square), PLANE, PLANE_OPACITY, &Fill::Flat(normal));
    }
    for shape in &shown.shapes {
        let (near, opacity) = nearness(shape, tube, place);
        let is_nearest = nearest == Some(Obstacle::Shape(*shape));
        let (colour, opacity) = if is_nearest { (NEAREST, opacity.max(0.55)) } else { (OBSTACLE, opacity) };
        match shape {
            Shape::Box { centre, half_extents: half, rotation } => {
                for (face, normal) in faces(centre, half, rotation, camera) {
                    found.add(near, points(&face), colour, opacity, &Fill::Flat(normal));
                }
            }
            Shape::Ball { centre, radius } => {
                let corners = round_points(place, &[(*centre, camera.towards, *radius)]);
                found.add(near, corners, colour, opacity, &Fill::Round([0.24, -0.97]));
            }
            Shape::Capsule { from, to, radius } => {
                let corners = round_points(place, &[from, to].map(|end| (*end, camera.towards, *radius)));
                let [right, down] = place.direction(&(to - from));
                let seen = libm::hypot(right, down);
                let across = if seen > 1e-6 { [-down / seen, right / seen] } else { [0.24, -0.97] };
                found.add(near, corners, colour, opacity, &Fill::Round(across));
            }
        }
    }
    for Triangle(corners) in &shown.triangles {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-12).unwrap_or(camera.towards);
        if normal.dot(&camera.towards) >= 0.0 {
            let near = camera.depth(&((a + b + c) / 3.0));
            found.add(near, points(corners), OBSTACLE, 0.6, &Fill::Flat(normal));
        }
    }
    for (at, radius) in &shown.points {
        found.add(camera.depth(at), dot(place, at, *radius), OBSTACLE, 0.6, &Fill::Flat(camera.towards));
    }
    found.pieces
}

/// Returns the depth (mm) of a shape at the point where it is nearest to the tube in the picture, and its opacity.
fn nearness(shape: &Shape, tube: &[Vector3<f64>], place: &Projection) -> (f64, f64) {
    let (centre, halves, radius) = match shape {
        Shape::Ball { centre, radius } => (*centre, [Vector3::zeros(); 2], *radius),
        Shape::Capsule { from, to, radius } => (0.5 * (from + to), [0.5 * (to - from), Vector3::zeros()], *radius),
        Shape::Box { centre, half_extents: half, rotation } => {
            let part = |axis: usize| rotation * Vector3::from_fn(|part, _| if part == axis { half[part] } else { 0.0 });
            let thin = half.imin();
            (*centre, [part((thin + 1) % 3), part((thin + 2) % 3)], half.min())
        }
    };
    let camera = &place.camera;
    let shares = || (0..=SAMPLES).map(|step| 2.0 * f64::from(step) / f64::from(SAMPLES) - 1.0);
    let seen: Vec<([f64; 2], f64)> = tube.iter().map(|point| (camera.see(point), camera.depth(point))).collect();
    let mut best = (f64::INFINITY, camera.depth(&centre), f64::NEG_INFINITY);
    for at in shares().flat_map(|x| shares().map(move |y| centre + halves[0] * x + halves[1] * y)) {
        let [x, y] = camera.see(&at);
        for ([u, v], depth) in &seen {
            let apart = libm::hypot(x - u, y - v);
            if apart < best.0 {
                best = (apart, camera.depth(&at), *depth);
            }
        }
    }
    let (apart, near, tube) = best;
    (near, if near > tube && apart < 2.0 * radius + 60.0 { VEIL } else { SOLID })
}

/// Returns the faces of a box that face the camera, each with its normal.
fn faces(
    centre: &Vector3<f64>,
    half: &Vector3<f64>,
    rotation: &Rotation3<f64>,
    camera: &Camera,
) -> impl Iterator<Item = ([Vector3<f64>; 4], Vector3<f64>)> {
    let axes: [Vector3<f64>; 3] =
        std::array::from_fn(|axis| rotation * Vector3::from_fn(|part, _| if part == axis { half[part] } else { 0.0 }));
    let (centre, towards) = (*centre, camera.towards);
    (0..3).filter_map(move |axis| {
        let out = axes[axis] * axes[axis].dot(&towards).signum();
        let [a, b] = [axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
        let seen = out.dot(&towards) > 1e-6 * out.norm();
        seen.then(|| ([a + b, b - a, -a - b, a - b].map(|corner| centre + out + corner), out.normalize()))
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

/// Draws the mark at the closest approach, over everything, as far as it lies in this rectangle.
pub fn mark(canvas: &mut Canvas, place: &Projection, around: &SceneView, room: &Rect) {
    let Some((found, _)) = &around.closest_approach else { return };
    let [from, to] = [&found.on_body, &found.on_obstacle].map(|point| place.point(point));
    let end = end_within(from, to, room);
    for (colour, width) in [("#fff", 4.0), (NARROWEST, 2.0)] {
        canvas.line([from.into(), end.into()], format_args!("stroke=\"{colour}\" stroke-width=\"{width}\""));
    }
    disc(canvas, from, 3.0, NARROWEST);
    let cut = libm::hypot(to[0] - end[0], to[1] - end[1]);
    if cut < 0.5 {
        disc(canvas, to, 3.0, NARROWEST);
    }
}

/// Returns the end of a line from a point in a rectangle to another point, or the place where it leaves the rectangle.
fn end_within(from: [f64; 2], to: [f64; 2], rect: &Rect) -> [f64; 2] {
    let share = (0..2).fold(1.0_f64, |share, axis| {
        let step = to[axis] - from[axis];
        let side = if step > 0.0 { rect[axis + 2] } else { rect[axis] };
        if step.abs() < 1e-9 { share } else { share.min(((side - from[axis]) / step).max(0.0)) }
    });
    [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
}

/// Adds the label of the closest approach: the clearance and the obstacle.
pub fn label(labels: &mut Labels, place: &Projection, around: &SceneView) {
    let (Some((found, _)), Some(text)) = (&around.closest_approach, around.narrowest_text()) else { return };
    let out = place.direction(&(found.on_obstacle - found.on_body));
    let [from, to] = [&found.on_body, &found.on_obstacle].map(|point| place.point(point));
    // An obstacle far away is outside the frame, and so would be its label.
    let to = end_within(from, to, labels.frame());
    labels.avoid(from, to, 4.0);
    labels.add(to, out, &text, Kind::Mark(NARROWEST));
}
