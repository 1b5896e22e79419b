//! The camera of a picture. It is orthographic, like the page's (growbot-pictures/viewer/src/stage.js), so one scale
//! holds everywhere.

use std::f64::consts::PI;

use nalgebra::Vector3;

/// Viewpoint of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Viewpoint {
    /// The corner from which start and goal are seen best.
    ///
    /// The goal's direction and the way to the goal are seen from the side from this one of the eight corners.
    Corner,
    /// From the front: the picture looks along the y axis.
    Front,
    /// From the side: the picture looks against the x axis.
    Side,
    /// From above.
    Top,
}

/// Viewing direction, with the directions to the right and up in the picture: perpendicular unit vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Direction to the right in the picture.
    pub right: Vector3<f64>,
    /// Direction up in the picture.
    pub up: Vector3<f64>,
    /// Direction towards the viewer.
    pub towards: Vector3<f64>,
}

impl Camera {
    /// Returns the camera of a viewpoint. [`Viewpoint::Corner`] shows the directions in `facing` best, the first above
    /// all.
    pub fn new(look: Viewpoint, facing: &[Vector3<f64>]) -> Self {
        let towards = match look {
            Viewpoint::Corner => best_corner(facing),
            Viewpoint::Front => Vector3::new(0.0, -1.0, 0.0),
            Viewpoint::Side => Vector3::new(1.0, 0.0, 0.0),
            Viewpoint::Top => return Self { right: Vector3::x(), up: Vector3::y(), towards: Vector3::z() },
        };
        let right = Vector3::z().cross(&towards).normalize();
        Self { right, up: towards.cross(&right), towards }
    }

    /// Returns the coordinates of a point in the picture, to the right and up, mm.
    pub fn see(&self, point: &Vector3<f64>) -> [f64; 2] {
        [self.right.dot(point), self.up.dot(point)]
    }

    /// Returns the depth of a point, mm. A nearer point has a greater value.
    pub fn depth(&self, point: &Vector3<f64>) -> f64 {
        self.towards.dot(point)
    }
}

/// Returns the direction to the viewer for [`Viewpoint::Corner`], selected as in stage.js. The best corner sees the
/// directions in `facing` from the side, and rather pointing to the camera than away from it.
fn best_corner(facing: &[Vector3<f64>]) -> Vector3<f64> {
    let mut best = (-1.0, Vector3::z());
    for corner in 0..8 {
        let turn = (-1.01 + 0.25 * f64::from(corner)) * PI;
        let from = Vector3::new(libm::cos(turn), libm::sin(turn), 0.45).normalize();
        let seen: f64 = facing
            .iter()
            .filter_map(|direction| direction.try_normalize(1e-9))
            .zip(1..)
            .map(|(along, rank)| (along.cross(&from).norm() + 0.2 * along.dot(&from)) / f64::from(rank))
            .sum();
        if seen > best.0 + 1e-9 {
            best = (seen, from);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_viewpoint_has_perpendicular_axes_with_z_up() {
        for look in [Viewpoint::Corner, Viewpoint::Front, Viewpoint::Side, Viewpoint::Top] {
            let camera = Camera::new(look, &[Vector3::x(), Vector3::z()]);
            assert!((camera.right.cross(&camera.up) - camera.towards).norm() < 1e-12, "{look:?}");
            assert!(look == Viewpoint::Top || camera.see(&Vector3::z())[1] > 0.8, "{look:?}");
        }
        assert_eq!(Camera::new(Viewpoint::Front, &[]).see(&Vector3::new(1.0, 2.0, 3.0)), [1.0, 3.0]);
        assert_eq!(Camera::new(Viewpoint::Side, &[]).see(&Vector3::new(1.0, 2.0, 3.0)), [2.0, 3.0]);
    }

    #[test]
    fn the_corner_view_shows_the_goal_from_the_side() {
        let camera = Camera::new(Viewpoint::Corner, &[Vector3::x()]);
        assert!(camera.see(&Vector3::x())[0].abs() > 0.6, "{camera:?}");
        // A direction of length 0 still gives a valid camera.
        let camera = Camera::new(Viewpoint::Corner, &[Vector3::zeros()]);
        assert!((camera.towards.norm() - 1.0).abs() < 1e-12);
    }
}
