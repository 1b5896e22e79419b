//! The camera of a picture: orthographic, as on the page (growbot-pictures/viewer/src/stage.js), so that one scale holds
//! everywhere.

use std::f64::consts::PI;

use nalgebra::Vector3;

/// From where.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// A corner: of eight, the one from which start and goal are seen best from the side.
    Corner,
    /// Against the y axis.
    Front,
    /// Against the x axis, from its far end.
    Side,
    /// From above.
    Top,
}

/// A direction to look from, and what is right and up in the picture: unit vectors, perpendicular.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Rightwards in the picture.
    pub right: Vector3<f64>,
    /// Upwards in the picture.
    pub up: Vector3<f64>,
    /// Towards who looks.
    pub towards: Vector3<f64>,
}

impl Camera {
    /// The one that looks so; from a corner, these directions are to be seen well, the first most.
    pub fn new(look: Look, facing: &[Vector3<f64>]) -> Self {
        let towards = match look {
            Look::Corner => best_corner(facing),
            Look::Front => Vector3::new(0.0, -1.0, 0.0),
            Look::Side => Vector3::new(1.0, 0.0, 0.0),
            Look::Top => return Self { right: Vector3::x(), up: Vector3::y(), towards: Vector3::z() },
        };
        let right = Vector3::z().cross(&towards).normalize();
        Self { right, up: towards.cross(&right), towards }
    }

    /// Where a point is in the picture, rightwards and upwards, mm.
    pub fn see(&self, point: &Vector3<f64>) -> [f64; 2] {
        [self.right.dot(point), self.up.dot(point)]
    }

    /// How near a point is: the greater, the nearer, mm.
    pub fn nearness(&self, point: &Vector3<f64>) -> f64 {
        self.towards.dot(point)
    }
}

/// As stage.js has it: seen from the side, and rather towards the camera than away from it.
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
    fn every_look_has_perpendicular_axes_and_sees_z_upwards() {
        for look in [Look::Corner, Look::Front, Look::Side, Look::Top] {
            let camera = Camera::new(look, &[Vector3::x(), Vector3::z()]);
            assert!((camera.right.cross(&camera.up) - camera.towards).norm() < 1e-12, "{look:?}");
            assert!(look == Look::Top || camera.see(&Vector3::z())[1] > 0.8, "{look:?}");
        }
        assert_eq!(Camera::new(Look::Front, &[]).see(&Vector3::new(1.0, 2.0, 3.0)), [1.0, 3.0]);
        assert_eq!(Camera::new(Look::Side, &[]).see(&Vector3::new(1.0, 2.0, 3.0)), [2.0, 3.0]);
    }

    #[test]
    fn a_corner_shows_the_goal_from_the_side() {
        let camera = Camera::new(Look::Corner, &[Vector3::x()]);
        assert!(camera.see(&Vector3::x())[0].abs() > 0.6, "{camera:?}");
        // No direction at all is no reason to look from nowhere.
        let camera = Camera::new(Look::Corner, &[Vector3::zeros()]);
        assert!((camera.towards.norm() - 1.0).abs() < 1e-12);
    }
}
