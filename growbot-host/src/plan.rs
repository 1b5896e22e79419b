//! A plan: a path that has been checked to end at its goal, with all that is said about it.

use growbot_core::path::Segment;
use growbot_core::plan::{self as planning, Needs, PlanError, Planner};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use crate::warning::{Warning, warnings};

/// A plan for one robot. Lengths in mm, angles in radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The robot's name.
    pub robot: String,
    /// Hash of the robot's whole description ([`Robot::hash`]).
    pub robot_hash: u64,
    /// How the path was found.
    pub planner: Planner,
    /// Radius of the arcs, mm.
    pub radius: f64,
    /// Where the tip starts.
    pub start: Pose,
    /// Where it is to arrive.
    pub goal: Pose,
    /// The path from start to goal.
    pub path: Vec<Segment>,
    /// Length, layers, time and filament.
    pub needs: Needs,
    /// What speaks against growing it.
    pub warnings: Vec<Warning>,
}

impl Plan {
    /// Plans a path of this radius (mm).
    ///
    /// ```
    /// use growbot_host::{plan::Plan, pose_text::parse_pose, robot_file};
    /// use growbot_core::plan::Planner;
    /// let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    /// let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,0,77.4,0,90").unwrap());
    /// let plan = Plan::make(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap();
    /// assert_eq!(plan.needs.layers, 100);
    /// ```
    ///
    /// # Errors
    /// As [`growbot_core::plan::plan`]: a radius that the robot cannot bend to, above all.
    pub fn make(robot: &Robot, start: &Pose, goal: &Pose, radius: f64, planner: Planner) -> Result<Self, PlanError> {
        let path = planning::plan(robot, start, goal, radius, planner)?.path;
        Ok(Self::of_path(robot, start, goal, radius, planner, path.to_vec()))
    }

    /// The plan of a path that is known to lead from start to goal.
    pub(crate) fn of_path(
        robot: &Robot,
        start: &Pose,
        goal: &Pose,
        radius: f64,
        planner: Planner,
        path: Vec<Segment>,
    ) -> Self {
        Self {
            robot: robot.name().to_owned(),
            robot_hash: robot.hash(),
            planner,
            radius,
            start: *start,
            goal: *goal,
            needs: planning::needs(&path, robot),
            warnings: warnings(&path, robot),
            path,
        }
    }
}
