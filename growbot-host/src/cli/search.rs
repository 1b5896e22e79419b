//! Options of the search for a path, for `plan` and `grow`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use growbot_core::plan::{PlanError, Planner};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::input;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::pose_text::{TypedGoal, parse_goal, parse_pose, parse_typed_pose};
use growbot_plan::via_csv;

use super::failure::Failure;
use super::units::{self, mm};

/// Default start pose: at the origin, straight up.
pub const START: &str = "0,0,0,0,90";

/// Start, poses on the way, planner and radius.
#[derive(Args)]
pub struct PlanningOptions {
    /// Start pose of the tip: X,Y,Z,HEADING,PITCH in mm and degrees [default: 0,0,0,0,90]
    #[arg(long, value_name = "POSE", allow_hyphen_values = true, value_parser = parse_typed_pose)]
    pub from: Option<(Pose, TypedGoal)>,
    /// A pose or a position to pass through on the way. Repeat the option for more, in order
    #[arg(long, value_name = "POSE", allow_hyphen_values = true, value_parser = parse_goal)]
    pub via: Vec<TypedGoal>,
    /// Pass through the poses or positions of a CSV file (- for standard input), in order: columns x,y,z, or
    /// x,y,z,heading,pitch
    #[arg(long, value_name = "CSV", conflicts_with = "via")]
    pub via_csv: Option<PathBuf>,
    /// Planner of the path [default: shortest]
    #[arg(long, value_enum)]
    pub planner: Option<PlannerName>,
    /// Radius of the bends, mm [default: the robot's planning radius]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = mm)]
    pub radius: Option<f64>,
}

/// Names of the planners on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlannerName {
    /// The shortest path found
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

impl PlanningOptions {
    /// Returns the start pose of the tip.
    pub fn start(&self) -> Result<Pose, Failure> {
        match &self.from {
            Some((pose, _)) => Ok(*pose),
            None => parse_pose(START).map_err(Failure::bad_input),
        }
    }

    /// Returns the poses and positions that the path must pass through before the goal, in order.
    fn waypoints(&self) -> Result<Vec<Goal>, Failure> {
        let Some(file) = &self.via_csv else { return Ok(self.via.iter().map(|typed| typed.goal).collect()) };
        let name = input::display_name(file);
        via_csv::read(&input::read_text(file)?).map_err(|error| Failure::bad_input(format!("{name}: {error}")))
    }

    /// Plans from the start through the poses on the way to a goal, and warns about units that may be mistaken.
    pub fn plan(&self, robot: &Robot, goal: &TypedGoal, search: &PlanOptions) -> Result<Plan, Failure> {
        let (start, mut via) = self.start_and_goals(robot, goal, None)?;
        let goal = via.pop().unwrap_or(goal.goal);
        Ok(Plan::through_waypoints(robot, &start, &via, &goal, search)?)
    }

    /// Returns the start, and the poses and positions on the way with the goal as the last one. `tip` replaces the
    /// given start. Warns about units that may be mistaken.
    pub fn start_and_goals(
        &self,
        robot: &Robot,
        goal: &TypedGoal,
        tip: Option<Pose>,
    ) -> Result<(Pose, Vec<Goal>), Failure> {
        let (start, via) = (tip.map_or_else(|| self.start(), Ok)?, self.waypoints()?);
        let typed: Vec<&TypedGoal> = self.from.iter().map(|(_, typed)| typed).chain(&self.via).chain([goal]).collect();
        units::warn_of_radians(&typed);
        if self.via.iter().chain([goal]).all(|typed| typed.bare_lengths) {
            units::warn_of_metres(&start, via.iter().chain([&goal.goal]), robot);
        }
        Ok((start, via.into_iter().chain([goal.goal]).collect()))
    }

    /// Returns the parameters of the path search for this robot, which avoids self-collisions.
    pub fn search(&self, robot: &Robot) -> PlanOptions<'static> {
        PlanOptions {
            radius: self.radius.unwrap_or(robot.description().planning_radius_mm),
            planner: self.planner.unwrap_or(PlannerName::Shortest).into(),
            avoid_self_collision: true,
            existing: None,
        }
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::RadiusTooSmall { .. } | PlanError::RadiusTooLarge { .. } => Self::before_start(&error),
            PlanError::GoalNotReached { .. } | PlanError::NoPath | PlanError::TooManySegments(_) => {
                Self::during_request(&error)
            }
        }
    }
}
