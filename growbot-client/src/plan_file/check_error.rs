//! Faults of a plan file.

use growbot_core::compact_number::CompactNumber;
use growbot_core::plan::GoalError;
use growbot_core::pose::PoseError;

/// Maximum number of segments. A body with more could not be grown in a lifetime.
pub(super) const MAX_SEGMENTS: usize = 10_000;

/// Fault of a plan file. The message contains the item, the value, the limit and a remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanCheckError {
    /// The plan is for a robot of another name.
    #[error(
        "the plan is for robot {plan:?}, not for {robot:?}: plan again for this robot, or choose the plan's robot with \
         --robot"
    )]
    OtherRobot {
        /// Name in the plan.
        plan: String,
        /// Name of the robot to be used.
        robot: String,
    },
    /// The robot's description has changed since the plan was made.
    #[error(
        "the plan is for {robot} with hash {plan}, but this {robot} has hash {here}: the robot description has changed \
         since the plan was made; plan again, or give the old description with --robot FILE"
    )]
    OtherHash {
        /// Name of the robot.
        robot: String,
        /// Hash in the plan.
        plan: String,
        /// Hash of the robot to be used.
        here: String,
    },
    /// Start or goal is not a valid pose.
    #[error("{which}: {error}")]
    Pose {
        /// Start or goal.
        which: &'static str,
        /// Error of the pose.
        #[source]
        error: PoseError,
    },
    /// A number is out of its range.
    #[error("{what} is {value:?}; it must lie between {min:?} and {max:?}: plan again")]
    Range {
        /// Name of the number.
        what: String,
        /// Value of the number.
        value: f64,
        /// Minimum value.
        min: f64,
        /// Maximum value.
        max: f64,
    },
    /// The robot cannot make this bend.
    #[error(
        "segment {segment} has a radius of {} mm, below R_min = {limit} mm of this robot: plan again with a larger \
         --radius", CompactNumber(.radius)
    )]
    TooTight {
        /// Index of the segment, from 0.
        segment: usize,
        /// Radius of the segment, mm.
        radius: f64,
        /// Minimum radius of the robot, mm.
        limit: f64,
    },
    /// The plan has too many segments.
    #[error("the plan has {found} segments; growbot reads at most {MAX_SEGMENTS}: split the plan into several plans")]
    TooManySegments {
        /// Number of segments.
        found: usize,
    },
    /// The tip of a helicoidal arc would twist as well as bend.
    #[error(
        "m0 of segment {segment} is not perpendicular to the tip there: its forward component is {value}, the limit is \
         {limit}; plan again"
    )]
    NotPerpendicular {
        /// Index of the segment, from 0.
        segment: usize,
        /// Component of m0 along the tip's direction, as a fraction.
        value: f64,
        /// Maximum value.
        limit: f64,
    },
    /// A total does not match the sum of the segments.
    #[error(
        "{what} is {}, but the segments give {}: the plan was edited by hand; plan again",
        CompactNumber(.value), CompactNumber(.expected)
    )]
    Total {
        /// Name of the total.
        what: &'static str,
        /// Value in the file.
        value: f64,
        /// Value computed from the segments.
        expected: f64,
    },
    /// The path type does not match the segments.
    #[error("path_type is {found:?}, but the segments give {expected:?}: the plan was edited by hand; plan again")]
    PathType {
        /// Path type in the file.
        found: String,
        /// Path type of the segments.
        expected: String,
    },
    /// The number of legs does not match the waypoints.
    #[error("the plan has {found} legs, but its via poses require {expected}: the plan was edited by hand; plan again")]
    Legs {
        /// Number of legs.
        found: usize,
        /// Required number of legs: one more than waypoints, or 0 without waypoints.
        expected: usize,
    },
    /// The segments do not end at the goal or waypoint.
    #[error(
        "the segments end {} mm and {} rad from {which}, more than {} mm and {} rad: the plan was edited by hand; plan \
         again",
        .miss.distance, .miss.angle, .limit.distance, .limit.angle
    )]
    Missed {
        /// Name of the goal or waypoint.
        which: String,
        /// Error of the end.
        miss: GoalError,
        /// Maximum error.
        limit: GoalError,
    },
}
