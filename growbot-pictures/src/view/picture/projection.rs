//! Projection of points into a drawing, and the outlines of solids there.

use std::f64::consts::TAU;
use std::fmt::Write;

use nalgebra::Vector3;

use super::camera::Camera;

/// A rectangle of the drawing: left, top, right, bottom.
pub type Rect = [f64; 4];

/// A rectangle of the camera's picture. Coordinates are to the right and up, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenBounds {
    /// Smallest coordinates, to the right and up.
    pub min: [f64; 2],
    /// Greatest coordinates, to the right and up.
    pub max: [f64; 2],
}

impl ScreenBounds {
    /// Empty bounds.
    pub const NONE: Self = Self { min: [f64::INFINITY; 2], max: [f64::NEG_INFINITY; 2] };

    /// Returns bounds that also contain a square about a point. `around` is half the side of the square, mm.
    pub fn with(self, [right, up]: [f64; 2], around: f64) -> Self {
        Self {
            min: [self.min[0].min(right - around), self.min[1].min(up - around)],
            max: [self.max[0].max(right + around), self.max[1].max(up + around)],
        }
    }

    /// Returns bounds that contain these bounds and `other`.
    pub fn and(self, other: Self) -> Self {
        self.with(other.min, 0.0).with(other.max, 0.0)
    }

    /// Returns width and height, mm.
    pub fn size(&self) -> [f64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }

    /// Returns the centre, mm.
    pub fn centre(&self) -> [f64; 2] {
        [0.5 * (self.min[0] + self.max[0]), 0.5 * (self.min[1] + self.max[1])]
    }
}

/// Projection of a camera's picture into a drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// The camera.
    pub camera: Camera,
    /// Scale of the drawing, units of the drawing per mm.
    pub scale: f64,
    /// Point of the camera's picture (mm) that is drawn at `at`.
    pub centre: [f64; 2],
    /// Point of the drawing at which `centre` is drawn, units of the drawing to the right and down.
    pub at: [f64; 2],
}

impl Projection {
    /// Returns the position of a point (mm) in the drawing, units of the drawing to the right and down.
    pub fn point(&self, point: &Vector3<f64>) -> [f64; 2] {
        let [right, up] = self.camera.see(point);
        [self.at[0] + self.scale * (right - self.centre[0]), self.at[1] - self.scale * (up - self.centre[1])]
    }

    /// Returns a direction as a vector in the drawing, to the right and down. It is as long as the projected direction.
    pub fn direction(&self, direction: &Vector3<f64>) -> [f64; 2] {
        let [right, up] = self.camera.see(direction);
        [right, -up]
    }
}

/// Returns a closed outline through corners, as the attribute `d` of an SVG path. Coordinates are rounded to tenths and
/// relative, in as few characters as possible.
pub fn outline(corners: &[[f64; 2]]) -> String {
    let mut path = String::with_capacity(8 * corners.len());
    let mut before: Option<[i64; 2]> = None;
    for corner in corners {
        let at = corner.map(|part| (10.0 * part).round() as i64);
        match before.replace(at) {
            None => push(&mut path, "M", at),
            Some(from) => {
                let letter = if path.contains('l') { "" } else { "l" };
                push(&mut path, letter, [at[0] - from[0], at[1] - from[1]]);
            }
        }
    }
    path + "z"
}

/// Appends a command letter and two coordinates, given in tenths of a unit, to the attribute `d` of an SVG path.
fn push(path: &mut String, letter: &str, [x, y]: [i64; 2]) {
    *path += letter;
    for (part, first) in [(x, !letter.is_empty()), (y, false)] {
        let (sign, whole, tenth) = (if part < 0 { "-" } else { "" }, part.abs() / 10, part.abs() % 10);
        if !first && part >= 0 {
            path.push(' ');
        }
        // Writing to a String cannot fail.
        let _ = match (whole, tenth) {
            (_, 0) => write!(path, "{sign}{whole}"),
            (0, _) => write!(path, "{sign}.{tenth}"),
            _ => write!(path, "{sign}{whole}.{tenth}"),
        };
    }
}

/// Returns the outline of a solid whose corners lie on circles, each with a centre, an axis and a radius, mm.
pub fn solid(place: &Projection, rounds: &[(Vector3<f64>, Vector3<f64>, f64)]) -> String {
    outline(&round_points(place, rounds))
}

/// Returns the corners of the outline that [`solid`] draws.
pub fn round_points(place: &Projection, rounds: &[(Vector3<f64>, Vector3<f64>, f64)]) -> Vec<[f64; 2]> {
    const CORNERS: u32 = 20;
    let mut points: Vec<[f64; 2]> = Vec::new();
    for (middle, axis, radius) in rounds {
        let aside = axis.cross(&if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
        let other = axis.cross(&aside);
        points.extend((0..CORNERS).map(|corner| {
            let angle = TAU * f64::from(corner) / f64::from(CORNERS);
            place.point(&(middle + *radius * (libm::cos(angle) * aside + libm::sin(angle) * other)))
        }));
    }
    hull(points)
}

/// Returns the part of a convex outline within a rectangle: left, top, right, bottom (Sutherland and Hodgman 1974).
pub fn clip_to_rect(mut corners: Vec<[f64; 2]>, [left, top, right, bottom]: &Rect) -> Vec<[f64; 2]> {
    // Axis, limit, and 1 if the limit is a lower one.
    for (axis, limit, sign) in [(0, *left, 1.0), (0, *right, -1.0), (1, *top, 1.0), (1, *bottom, -1.0)] {
        let inside = |corner: &[f64; 2]| sign * (corner[axis] - limit);
        let mut kept = Vec::with_capacity(corners.len() + 1);
        let next = corners.iter().skip(1).chain(corners.first());
        for (from, to) in corners.iter().zip(next) {
            let [a, b] = [inside(from), inside(to)];
            if a >= 0.0 {
                kept.push(*from);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let share = a / (a - b);
                kept.push([0, 1].map(|part| from[part] + share * (to[part] - from[part])));
            }
        }
        corners = kept;
    }
    corners
}

/// Returns the corners of the convex hull of points.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let left = |a: &[f64; 2], b: &[f64; 2], c: &[f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut corners: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., before, last] = &corners[..]
                && left(before, last, &point) <= 0.0
            {
                corners.pop();
            }
            corners.push(point);
        }
        corners.pop();
        corners
    };
    let mut corners = half(&mut points.iter().copied());
    corners.extend(half(&mut points.iter().rev().copied()));
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::picture::camera::Viewpoint;

    #[test]
    fn an_outline_has_only_the_outer_points() {
        let corners = hull(vec![[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [1.0, 0.0]]);
        assert_eq!(corners, [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]);
        assert_eq!(outline(&[[1.0, 2.0], [3.04, -4.0], [2.9, -4.1]]), "M1 2l2-6-.1-.1z");
        assert_eq!(outline(&hull(Vec::new())), "z");
    }

    #[test]
    fn lines_are_clipped_to_a_rectangle() {
        let room = [0.0, 0.0, 10.0, 10.0];
        let square = |from: f64, to: f64| vec![[from, from], [to, from], [to, to], [from, to]];
        assert_eq!(clip_to_rect(square(2.0, 3.0), &room), square(2.0, 3.0));
        assert_eq!(clip_to_rect(square(20.0, 30.0), &room), Vec::<[f64; 2]>::new());
        let cut = clip_to_rect(square(-5.0, 5.0), &room);
        assert_eq!(cut.len(), 4, "{cut:?}");
        assert!(square(0.0, 5.0).iter().all(|corner| cut.contains(corner)), "{cut:?}");
        assert_eq!(clip_to_rect(Vec::new(), &room), Vec::<[f64; 2]>::new());
    }

    #[test]
    fn projection_keeps_up_and_scale() {
        let place = Projection {
            camera: Camera::new(Viewpoint::Front, &[]),
            scale: 2.0,
            centre: [10.0, 0.0],
            at: [100.0, 50.0],
        };
        assert_eq!(place.point(&Vector3::new(10.0, 99.0, 0.0)), [100.0, 50.0]);
        assert_eq!(place.point(&Vector3::new(20.0, 0.0, 5.0)), [120.0, 40.0]);
    }
}
