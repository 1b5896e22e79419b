//! The printed tube as shaded faces, coloured by the height of its layers as on the page
//! (growbot-pictures/viewer/src/tube.js).

use std::f64::consts::TAU;
use std::fmt::Write;

use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::pose::Frame;
use nalgebra::{Vector2, Vector3};

use super::camera::Camera;
use super::projection::{Projection, outline};
use crate::drawing::colours::hex;
use crate::view::heights::HeightScale;

/// Colour of the rim of the wall. `INSIDE` is the colour of the inside of the tube.
const RIM: &str = "#9aa3b0";
const INSIDE: &str = "#4a5361";

/// Number of corners of a whole circle, such as the rim of an open end.
const CORNERS: u32 = 72;
/// Greatest length of a stretch between two rings, in radii of the tube. `BENT` is its greatest bend, radians. Finer
/// rings would show no difference.
const LONG: f64 = 0.7;
const BENT: f64 = 0.05;
/// Direction to the light (to the right, up and towards the viewer). `SUN` and `AROUND` are the strengths of the direct
/// and the ambient light.
const LIGHT: [f64; 3] = [-0.5, 0.8, 2.0];
const SUN: f64 = 2.4;
const AROUND: f64 = 1.3;

/// A tube, as a sequence of rings. Each ring is at the end of a stretch of layers, and has the layer in the middle of
/// this stretch.
#[derive(Debug, Clone)]
pub struct Tube {
    /// Pose of the start of the tube in the base's frame.
    pub base_from_start: Frame,
    /// Rings after the start, each as its frame and its layer.
    rings: Vec<(Frame, Layer)>,
    /// Radius of the outside of the wall, mm. `tip_radius` is the radius of the middle of the wall, where layers are
    /// measured, and `inner` that of its inside.
    outer: f64,
    tip_radius: f64,
    inner: f64,
    /// Number of faces around the tube. Half of them are visible.
    faces: u32,
}

/// Level of detail of a drawn tube.
#[derive(Debug, Clone, Copy)]
pub struct Detail {
    /// Approximate greatest number of rings.
    pub rings: usize,
    /// Number of faces around the tube.
    pub faces: u32,
}

impl Tube {
    /// Returns a tube of these layers. The radii are those of the outside, the middle and the inside of the wall, mm.
    pub fn new(
        base_from_start: Frame,
        layers: &[LayerBytes],
        [outer, tip_radius, inner]: [f64; 3],
        detail: Detail,
    ) -> Self {
        let layers: Vec<Layer> = layers.iter().map(decode).collect();
        let mut base_from_tip = base_from_start;
        let rings = stretches(&layers, detail.rings, outer).into_iter().filter_map(|stretch| {
            for layer in stretch {
                base_from_tip = advance(&base_from_tip, &layer.step());
            }
            Some((base_from_tip, *stretch.get(stretch.len() / 2)?))
        });
        Self { base_from_start, rings: rings.collect(), outer, tip_radius, inner, faces: detail.faces }
    }

    /// Returns the pose of the tip in the base's frame.
    pub fn base_from_tip(&self) -> Frame {
        self.rings.last().map_or(self.base_from_start, |(frame, _)| *frame)
    }

    /// Returns all frames along the tube.
    pub fn frames(&self) -> impl Iterator<Item = Frame> + '_ {
        std::iter::once(self.base_from_start).chain(self.rings.iter().map(|(frame, _)| *frame))
    }

    /// Returns the points of the centreline at the rings, mm.
    pub fn centreline(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        self.frames().map(|frame| frame.translation.vector)
    }

    /// Returns the visible faces as SVG paths, ring by ring, each ring with its depth, mm. Faces are coloured by the
    /// heights of layers.
    pub fn pieces(&self, camera: &Camera, place: &Projection, heights: &HeightScale) -> Vec<(f64, String)> {
        let mut pieces = Vec::with_capacity(self.rings.len() + 2);
        let mut below = self.base_from_start;
        for (frame, layer) in &self.rings {
            let mut faces: Vec<(f64, String)> = Vec::new();
            for face in 0..self.faces {
                let [from, middle, to] =
                    [0.0, 0.5, 1.0].map(|part| TAU * (f64::from(face) + part) / f64::from(self.faces));
                let normal = around(frame, middle);
                let facing = normal.dot(&camera.towards);
                // Faces a little around the edge are drawn too, so that no gap is left there.
                if facing < -0.06 {
                    continue;
                }
                let height = layer.height_at(middle, self.tip_radius);
                let colour = hex(shaded(heights.colour(height), &normal, camera));
                let corners = [(&below, from), (&below, to), (frame, to), (frame, from)]
                    .map(|(ring, angle)| place.point(&on(ring, angle, self.outer)));
                faces.push((
                    facing,
                    format!("<path fill=\"{colour}\" stroke=\"{colour}\" d=\"{}\"/>\n", outline(&corners)),
                ));
            }
            faces.sort_by(|a, b| a.0.total_cmp(&b.0));
            let near = camera.depth(&(0.5 * (below.translation.vector + frame.translation.vector)));
            pieces.push((near, faces.into_iter().map(|(_, face)| face).collect()));
            below = *frame;
        }
        for (frame, outwards) in [(self.base_from_start, -1.0), (self.base_from_tip(), 1.0)] {
            pieces.extend(self.end(&frame, outwards, camera, place));
        }
        pieces
    }

    /// Returns the rim and the visible inside of an open end. Returns `None` if the end faces away from the viewer.
    fn end(&self, frame: &Frame, outwards: f64, camera: &Camera, place: &Projection) -> Option<(f64, String)> {
        let ahead = outwards * (frame.rotation * Vector3::z());
        (ahead.dot(&camera.towards) > 0.0).then(|| {
            let circle = |radius: f64| {
                let corners: Vec<[f64; 2]> = round().map(|angle| place.point(&on(frame, angle, radius))).collect();
                outline(&corners)
            };
            let (rim, inside) = (circle(self.outer), circle(self.inner));
            let faces = format!(
                "<path fill=\"{RIM}\" stroke=\"{RIM}\" d=\"{rim}\"/>\n<path fill=\"{INSIDE}\" stroke=\"none\" \
                 d=\"{inside}\"/>\n"
            );
            // The end is nearer than the ring that ends there, so it is drawn later.
            (camera.depth(&(frame.translation.vector + 0.02 * self.outer * ahead)), faces)
        })
    }

    /// Returns the two edges of the tube in the picture. They show the planned tube behind the one as built.
    pub fn edges(&self, camera: &Camera, place: &Projection) -> [String; 2] {
        [-1.0, 1.0].map(|side| {
            let points = self.frames().filter_map(|frame| {
                let ahead = frame.rotation * Vector3::z();
                let aside = ahead.cross(&camera.towards).try_normalize(1e-6)?;
                Some(place.point(&(frame.translation.vector + side * self.outer * aside)))
            });
            line(points)
        })
    }

    /// Returns the shadow on a floor at this height (mm), as outlines in the attribute `d` of an SVG path.
    pub fn shadow(&self, floor: f64, place: &Projection) -> String {
        let onto = |point: Vector3<f64>| place.point(&Vector3::new(point.x, point.y, floor));
        let mut shadow = String::new();
        let mut before: Option<[[f64; 2]; 2]> = None;
        let mut aside = Vector3::zeros();
        for frame in self.frames() {
            let ahead = frame.rotation * Vector3::z();
            if let Some(along) = Vector2::new(ahead.x, ahead.y).try_normalize(1e-6) {
                aside = self.outer * Vector3::new(-along.y, along.x, 0.0);
            }
            let edge = [1.0, -1.0].map(|side| onto(frame.translation.vector + side * aside));
            if let Some([left, right]) = before.replace(edge) {
                shadow += &outline(&one_way_round(vec![left, right, edge[1], edge[0]]));
            }
        }
        for end in [self.base_from_start, self.base_from_tip()] {
            // A tube that ends upright ends in a disc. A tube that ends horizontally ends in a line.
            shadow += &outline(&one_way_round(round().map(|angle| onto(on(&end, angle, self.outer))).collect()));
        }
        shadow
    }
}

/// Returns corners in one sense of rotation, so that overlapping outlines of a path add up.
fn one_way_round(mut corners: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let next = corners.iter().skip(1).chain(corners.first());
    let area: f64 = corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    if area < 0.0 {
        corners.reverse();
    }
    corners
}

/// Divides layers into one stretch for each ring. A stretch is so short and so little bent that no difference is
/// visible, unless that gives more than about `max` stretches. If the path has few segments, no stretch crosses from
/// one segment to the next.
fn stretches(layers: &[Layer], max: usize, outer: f64) -> Vec<&[Layer]> {
    let max = max.max(1);
    let length: f64 = layers.iter().map(|layer| layer.height).sum();
    let bend: f64 = layers.iter().map(|layer| layer.tilt).sum();
    let rings = length / (LONG * outer) + bend / BENT;
    let coarser = (rings / max as f64).max(1.0);
    let kinds = layers.windows(2).filter(|pair| is_other(&pair[0], &pair[1])).count();
    let by_kind = kinds <= max / 4;
    let mut filled = 0.0;
    let mut stretches = Vec::new();
    let mut rest = layers;
    let mut count = 0;
    for (index, layer) in layers.iter().enumerate() {
        count += 1;
        filled += (layer.height / (LONG * outer) + layer.tilt / BENT) / coarser;
        let next = layers.get(index + 1);
        let ends = next.is_none_or(|next| filled >= 1.0 || (by_kind && is_other(layer, next)));
        if ends {
            let (stretch, after) = rest.split_at_checked(count).unwrap_or((rest, &[]));
            stretches.push(stretch);
            (rest, count, filled) = (after, 0, 0.0);
        }
    }
    stretches
}

/// Returns true if two successive layers differ so much that they belong to different segments of the path.
fn is_other(one: &Layer, next: &Layer) -> bool {
    let high = one.height.max(next.height);
    (one.height - next.height).abs() > 0.05 * high
        || (one.tilt - next.tilt).abs() > 0.1 * one.tilt.max(next.tilt) + 1e-6
        || (one.tilt > 1e-4 && libm::cos(one.alpha - next.alpha) < 0.99)
}

/// Returns the angles of the corners of a ring.
fn round() -> impl Iterator<Item = f64> {
    (0..CORNERS).map(|corner| TAU * f64::from(corner) / f64::from(CORNERS))
}

/// Returns the outward direction at an angle around a ring.
fn around(frame: &Frame, angle: f64) -> Vector3<f64> {
    frame.rotation * Vector3::new(libm::cos(angle), libm::sin(angle), 0.0)
}

/// Returns the point at an angle and a distance from the centre (mm) on the plane of a ring.
fn on(frame: &Frame, angle: f64, radius: f64) -> Vector3<f64> {
    frame.translation.vector + radius * around(frame, angle)
}

/// Returns a colour as seen on a matt surface with this normal, computed in linear light like three.js.
pub fn shaded(colour: [u8; 3], normal: &Vector3<f64>, camera: &Camera) -> [u8; 3] {
    let light = Vector3::from(LIGHT).normalize();
    let facing = [&camera.right, &camera.up, &camera.towards].map(|axis| axis.dot(normal));
    let bright = (AROUND + SUN * light.dot(&Vector3::from(facing)).max(0.0)) / std::f64::consts::PI;
    colour.map(|part| {
        let linear = bright * libm::pow(f64::from(part) / 255.0, 2.2);
        (255.0 * libm::pow(linear.min(1.0), 1.0 / 2.2)).round() as u8
    })
}

/// Returns an open line through points, as the attribute `d` of an SVG path.
pub fn line(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let mut path = String::new();
    for [x, y] in points {
        // Writing to a String cannot fail.
        let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { "M" } else { " " });
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers_of(kinds: &[(usize, f64, f64)]) -> Vec<Layer> {
        let layers =
            kinds.iter().map(|(count, height, tilt)| (*count, Layer { alpha: 1.0, height: *height, tilt: *tilt }));
        layers.flat_map(|(count, layer)| std::iter::repeat_n(layer, count)).collect()
    }

    #[test]
    fn stretches_contain_every_layer_once_and_end_at_segments() {
        let layers = layers_of(&[(100, 0.774, 0.00774), (300, 0.775, 0.0), (1, 0.2, 0.0)]);
        let found = stretches(&layers, 280, 22.0);
        assert_eq!(found.concat(), layers);
        assert!(found.len() < 60, "{}", found.len());
        assert!(found.iter().all(|stretch| stretch.windows(2).all(|pair| pair[0] == pair[1])));
        // The number of rings stays small for any layers.
        let noisy: Vec<Layer> =
            (0..5000).map(|i| Layer { height: 0.7 + 0.1 * f64::from(i % 2), ..layers[0] }).collect();
        assert!(stretches(&noisy, 100, 22.0).len() <= 101);
        assert!(stretches(&[], 100, 22.0).is_empty());
    }
}
