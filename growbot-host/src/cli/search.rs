//! How a path is looked for, as `plan` and `grow` ask.

use clap::{Args, ValueEnum};
use growbot_client::plan::Search;
use growbot_client::pose_text::parse_pose;
use growbot_core::plan::{PlanError, Planner};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use super::Failure;

/// The start pose where none is given: at the origin, straight up.
pub const START: &str = "0,0,0,0,90";

/// Start, poses on the way, planner and radius.
#[derive(Args)]
pub struct SearchArgs {
    /// Where the tip starts: X,Y,Z,HEADING,PITCH in mm and degrees
    #[arg(long, value_name = "POSE", default_value = START, allow_hyphen_values = true, value_parser = parse_pose)]
    pub from: Pose,
    /// A pose to pass through on the way; repeat it for more, in order
    #[arg(long, value_name = "POSE", allow_hyphen_values = true, value_parser = parse_pose)]
    pub via: Vec<Pose>,
    /// How the path is found [default: shortest]
    #[arg(long, value_enum)]
    pub planner: Option<PlannerName>,
    /// Radius of the bends, mm [default: the robot's planning radius]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub radius: Option<f64>,
}

/// The planners, as the command line calls them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlannerName {
    /// The shortest path that is found
    Shortest,
    /// Two planar paths that meet on the line from start to goal (the paper's)
    TwoPlane,
}

impl From<PlannerName> for Planner {
    fn from(name: PlannerName) -> Self {
        match name {
            PlannerName::TwoPlane => Self::TwoPlane,
            PlannerName::Shortest => Self::Shortest,
        }
    }
}

impl SearchArgs {
    /// The search for paths of this robot.
    pub fn search(&self, robot: &Robot, clear_of_self: bool) -> Search {
        Search {
            radius: self.radius.unwrap_or(robot.description().planning_radius_mm),
            planner: self.planner.unwrap_or(PlannerName::Shortest).into(),
            clear_of_self,
        }
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::RadiusTooSmall { .. } | PlanError::RadiusTooLarge { .. } => Self::bad_input(error),
            PlanError::Missed { .. } | PlanError::NoPath | PlanError::TooManySegments(_) => Self::answered_no(error),
        }
    }
}
