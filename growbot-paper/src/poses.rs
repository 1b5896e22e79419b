//! Random starts and goals.
//!
//! The paper chooses "a completely random" start and target pose at the distance of the group. Here the start is at the
//! origin, because nothing depends on its position. The goal is anywhere on the sphere of that radius around it. Both
//! directions are uniform on the sphere.

use growbot_core::pose::{Pose, PoseError};
use growbot_core::random::Rng;
use growbot_core::trigonometry;
use nalgebra::Vector3;

/// A start and a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Endpoints {
    /// Start pose of the tip.
    pub start: Pose,
    /// Goal pose of the tip.
    pub goal: Pose,
}

/// Draws a start and a goal from a random stream, at this distance from each other, mm.
///
/// # Errors
/// A distance that is not valid in a pose.
pub fn draw(random: &mut Rng, distance: f64) -> Result<Endpoints, PoseError> {
    let start = pose(&Vector3::zeros(), &random.direction())?;
    let position = distance * random.direction();
    Ok(Endpoints { start, goal: pose(&position, &random.direction())? })
}

fn pose(position: &Vector3<f64>, direction: &Vector3<f64>) -> Result<Pose, PoseError> {
    let heading = libm::atan2(direction.y, direction.x);
    let pitch = libm::atan2(direction.z, trigonometry::hypot(direction.x, direction.y));
    Pose::new(*position, heading, pitch)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_lie_on_the_sphere_and_directions_are_spread_evenly() {
        let (mut goals, mut directions) = (Vector3::zeros(), Vector3::zeros());
        for repetition in 0..4000 {
            let Endpoints { start, goal } = draw(&mut Rng::new(&[3, repetition]), 400.0).unwrap();
            assert!((goal.position().norm() - 400.0).abs() < 1e-9 && start.position().norm() == 0.0);
            goals += goal.position() / 400.0;
            directions += goal.direction() + start.direction();
        }
        // Each coordinate has a standard deviation of 1/sqrt(3), so 5 standard deviations of its mean are 0.05.
        assert!((goals / 4000.0).amax() < 0.05 && (directions / 8000.0).amax() < 0.05);
    }
}
