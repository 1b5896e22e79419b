//! Errors of a tip at its goal (Eqs 26 to 28, with angles wrapped).

use growbot_core::angle::{degrees, wrap_signed};
use growbot_core::plan::goal_error;
use growbot_core::pose::{Frame, Pose, angle_between};

/// Pose of a tip, and its errors from the goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Pose of the tip.
    pub final_pose: Pose,
    /// Distance from the goal, mm.
    pub position_error_mm: f64,
    /// Distance from the goal divided by the length of the planned path (Eq 26). 0 if the path has no length.
    pub normalized_position_error: f64,
    /// Difference of the headings, degrees, 0 to 180 (Eq 27). It is large at a steep pitch even if the directions are
    /// similar. `None` if the tip or the goal is vertical.
    pub heading_error_deg: Option<f64>,
    /// Difference of the pitches, degrees (Eq 28).
    pub pitch_error_deg: f64,
    /// Angle between the directions of tip and goal, degrees. Unlike the errors of heading and pitch, it is meaningful
    /// at any pitch.
    pub direction_error_deg: f64,
}

impl Arrival {
    /// Computes the errors of a tip at its goal. `path_length` is the length of the planned path, mm.
    pub fn of(base_from_tip: &Frame, goal: &Pose, path_length: f64) -> Self {
        let final_pose = Pose::from_frame(base_from_tip);
        let missed = goal_error(base_from_tip, goal);
        let has_headings = !final_pose.is_vertical() && !goal.is_vertical();
        let heading_error = || degrees(wrap_signed(final_pose.heading() - goal.heading()).abs());
        Self {
            final_pose,
            position_error_mm: missed.distance,
            normalized_position_error: if path_length > 0.0 { missed.distance / path_length } else { 0.0 },
            heading_error_deg: has_headings.then(heading_error),
            pitch_error_deg: degrees((final_pose.pitch() - goal.pitch()).abs()),
            direction_error_deg: degrees(missed.angle),
        }
    }

    /// Returns the difference between the final poses of two arrivals, for example an estimate and the true pose.
    pub fn difference_from(&self, other: &Self) -> PoseDifference {
        let (this, other) = (&self.final_pose, &other.final_pose);
        PoseDifference {
            position_mm: (this.position() - other.position()).norm(),
            direction_deg: degrees(angle_between(&this.direction(), &other.direction())),
        }
    }
}

/// Difference between two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseDifference {
    /// Distance between the positions, mm.
    pub position_mm: f64,
    /// Angle between the directions, degrees.
    pub direction_deg: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heading_error_is_at_most_180_degrees() {
        let goal = Pose::from_degrees([0.0, 0.0, 0.0, 179.0, 0.0]).unwrap();
        let tip = Pose::from_degrees([3.0, 4.0, 0.0, -179.0, 0.0]).unwrap();
        let arrival = Arrival::of(&tip.frame(), &goal, 100.0);
        assert!((arrival.heading_error_deg.unwrap() - 2.0).abs() < 1e-9);
        assert!((arrival.direction_error_deg - 2.0).abs() < 1e-9);
        assert!((arrival.position_error_mm - 5.0).abs() < 1e-9);
        assert!((arrival.normalized_position_error - 0.05).abs() < 1e-12);
        assert_eq!(Arrival::of(&tip.frame(), &goal, 0.0).normalized_position_error, 0.0);
    }

    #[test]
    fn a_vertical_direction_has_no_heading_error() {
        let up = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let leaning = Pose::from_degrees([0.0, 0.0, 0.0, 56.0, 89.0]).unwrap();
        for (tip, goal) in [(up, leaning), (leaning, up), (up, up)] {
            assert_eq!(Arrival::of(&tip.frame(), &goal, 100.0).heading_error_deg, None);
        }
        assert!(Arrival::of(&leaning.frame(), &leaning, 100.0).heading_error_deg.is_some());
    }
}
