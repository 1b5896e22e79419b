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
use super::place::{Place, outline};
use crate::drawing::colours::hex;
use crate::view::heights::HeightScale;

/// The rim of the wall, and the inside of the tube.
const RIM: &str = "#9aa3b0";
const INSIDE: &str = "#4a5361";

/// Corners of a ring that is seen whole.
const CORNERS: u32 = 72;
/// A stretch between rings is no longer than this many radii of the tube and not bent by more than that, radians: of
/// less nothing is seen.
const LONG: f64 = 0.7;
const BENT: f64 = 0.05;
/// Where the light comes from, rightwards, upwards and towards who looks, and how bright it and what is around are.
const LIGHT: [f64; 3] = [-0.5, 0.8, 2.0];
const SUN: f64 = 2.4;
const AROUND: f64 = 1.3;

/// A tube: rings, each at the end of some layers, and the layer in the middle of those.
#[derive(Debug, Clone)]
pub struct Tube {
    /// Where it begins.
    pub base_from_start: Frame,
    /// The rings after that.
    rings: Vec<(Frame, Layer)>,
    /// Radius over the wall, on its middle where layers are measured, and inside, mm.
    outer: f64,
    tip_radius: f64,
    inner: f64,
    /// Faces round it, of which half are seen.
    faces: u32,
}

/// How finely a tube is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Detail {
    /// Some such number of rings at most.
    pub rings: usize,
    /// Faces round it.
    pub faces: u32,
}

impl Tube {
    /// Of these layers; radii over the wall, on its middle and inside it, mm.
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

    /// The tip.
    pub fn base_from_tip(&self) -> Frame {
        self.rings.last().map_or(self.base_from_start, |(frame, _)| *frame)
    }

    /// All frames along it.
    pub fn frames(&self) -> impl Iterator<Item = Frame> + '_ {
        std::iter::once(self.base_from_start).chain(self.rings.iter().map(|(frame, _)| *frame))
    }

    /// Its centreline.
    pub fn centreline(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        self.frames().map(|frame| frame.translation.vector)
    }

    /// The faces that are seen, ring by ring, each with how near it is; coloured by the heights of layers.
    pub fn pieces(&self, camera: &Camera, place: &Place, heights: &HeightScale) -> Vec<(f64, String)> {
        let mut pieces = Vec::with_capacity(self.rings.len() + 2);
        let mut below = self.base_from_start;
        for (frame, layer) in &self.rings {
            let mut faces: Vec<(f64, String)> = Vec::new();
            for face in 0..self.faces {
                let [from, middle, to] =
                    [0.0, 0.5, 1.0].map(|part| TAU * (f64::from(face) + part) / f64::from(self.faces));
                let normal = around(frame, middle);
                let facing = normal.dot(&camera.towards);
                // A little round the edge, so that no gap is left there.
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
            let near = camera.nearness(&(0.5 * (below.translation.vector + frame.translation.vector)));
            pieces.push((near, faces.into_iter().map(|(_, face)| face).collect()));
            below = *frame;
        }
        for (frame, outwards) in [(self.base_from_start, -1.0), (self.base_from_tip(), 1.0)] {
            pieces.extend(self.end(&frame, outwards, camera, place));
        }
        pieces
    }

    /// The open end: the rim, and what is seen inside; none where it looks away.
    fn end(&self, frame: &Frame, outwards: f64, camera: &Camera, place: &Place) -> Option<(f64, String)> {
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
            // Before the ring that ends there.
            (camera.nearness(&(frame.translation.vector + 0.02 * self.outer * ahead)), faces)
        })
    }

    /// Its two edges in the picture, as the tube of a plan is drawn behind the one as built.
    pub fn edges(&self, camera: &Camera, place: &Place) -> [String; 2] {
        [-1.0, 1.0].map(|side| {
            let points = self.frames().filter_map(|frame| {
                let ahead = frame.rotation * Vector3::z();
                let aside = ahead.cross(&camera.towards).try_normalize(1e-6)?;
                Some(place.point(&(frame.translation.vector + side * self.outer * aside)))
            });
            line(points)
        })
    }

    /// Its shadow on a floor at this height, mm: faces of one colour.
    pub fn shadow(&self, floor: f64, place: &Place) -> String {
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
            // A tube that ends upright ends in a disc, one that lies in a line.
            shadow += &outline(&one_way_round(round().map(|angle| onto(on(&end, angle, self.outer))).collect()));
        }
        shadow
    }
}

/// Corners in the order in which they go round one way: overlapping outlines of a path then add up.
fn one_way_round(mut corners: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let next = corners.iter().skip(1).chain(corners.first());
    let area: f64 = corners.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
    if area < 0.0 {
        corners.reverse();
    }
    corners
}

/// Layers by rings: each stretch as long and as bent as is not seen, or, if that were too many, as gives so many; and
/// none with layers of two kinds, where there are few kinds.
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

/// Whether another piece of the path begins between two layers, by how they look.
fn is_other(one: &Layer, next: &Layer) -> bool {
    let high = one.height.max(next.height);
    (one.height - next.height).abs() > 0.05 * high
        || (one.tilt - next.tilt).abs() > 0.1 * one.tilt.max(next.tilt) + 1e-6
        || (one.tilt > 1e-4 && libm::cos(one.alpha - next.alpha) < 0.99)
}

/// Angles round a ring.
fn round() -> impl Iterator<Item = f64> {
    (0..CORNERS).map(|corner| TAU * f64::from(corner) / f64::from(CORNERS))
}

/// Outwards at an angle round a ring.
fn around(frame: &Frame, angle: f64) -> Vector3<f64> {
    frame.rotation * Vector3::new(libm::cos(angle), libm::sin(angle), 0.0)
}

/// A point on a ring.
fn on(frame: &Frame, angle: f64, radius: f64) -> Vector3<f64> {
    frame.translation.vector + radius * around(frame, angle)
}

/// A colour as it is seen on a dull surface that faces there: reckoned in linear light, as three.js does.
fn shaded(colour: [u8; 3], normal: &Vector3<f64>, camera: &Camera) -> [u8; 3] {
    let light = Vector3::from(LIGHT).normalize();
    let facing = [&camera.right, &camera.up, &camera.towards].map(|axis| axis.dot(normal));
    let bright = (AROUND + SUN * light.dot(&Vector3::from(facing)).max(0.0)) / std::f64::consts::PI;
    colour.map(|part| {
        let linear = bright * libm::pow(f64::from(part) / 255.0, 2.2);
        (255.0 * libm::pow(linear.min(1.0), 1.0 / 2.2)).round() as u8
    })
}

/// An open line through points, as the `d` of a path.
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
    fn stretches_have_every_layer_once_and_end_where_pieces_do() {
        let layers = layers_of(&[(100, 0.774, 0.00774), (300, 0.775, 0.0), (1, 0.2, 0.0)]);
        let found = stretches(&layers, 280, 22.0);
        assert_eq!(found.concat(), layers);
        assert!(found.len() < 60, "{}", found.len());
        assert!(found.iter().all(|stretch| stretch.windows(2).all(|pair| pair[0] == pair[1])));
        // Few rings are few for any layers.
        let noisy: Vec<Layer> =
            (0..5000).map(|i| Layer { height: 0.7 + 0.1 * f64::from(i % 2), ..layers[0] }).collect();
        assert!(stretches(&noisy, 100, 22.0).len() <= 101);
        assert!(stretches(&[], 100, 22.0).is_empty());
    }
}
