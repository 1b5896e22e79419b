//! Errors of the checks of a plan file.

use growbot_core::compact_number::{CompactNumber, rounded_up};
use growbot_core::plan::GoalError;
use growbot_core::pose::PoseError;

/// Maximum number of segments of a plan. A body with more segments could not be grown in a lifetime.
pub(super) const MAX_SEGMENTS: usize = 10_000;

/// Error of a check of a plan file. The message contains the item, the value, the limit and a remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanCheckError {
    /// The plan was made for a robot with another name.
    #[error("the plan is for robot {plan:?}, not for {robot:?}: plan again for this robot, or choose the plan's robot")]
    OtherRobot {
        /// Name of the robot in the plan.
        plan: String,
        /// Name of the robot that is used now.
        robot: String,
    },
    /// The robot's description has changed since the plan was made.
    #[error(
        "the plan is for {robot} with hash {plan}, but this {robot} has hash {here}: the robot description has changed \
         since the plan was made; plan again, or give the old description"
    )]
    OtherHash {
        /// Name of the robot.
        robot: String,
        /// Hash of the robot's description in the plan, 16 hexadecimal digits.
        plan: String,
        /// Hash of the description of the robot that is used now, 16 hexadecimal digits.
        here: String,
    },
    /// The table of layers is not that of the segments.
    #[error(
        "row {row} of layer_table (from 0) is not the layer that the segments give: remove layer_table, or make the \
         table again from the plan"
    )]
    LayerRow {
        /// Index of the first row that is different, missing or surplus.
        row: usize,
    },
    /// The start, the goal or a waypoint is not a valid pose.
    #[error("{which}: {error}")]
    Pose {
        /// Name of the pose in the file: "start", "goal" or "via".
        which: &'static str,
        /// Error of the pose.
        #[source]
        error: PoseError,
    },
    /// A number in the file is outside its range.
    #[error("{what} is {value:?}; it must lie between {min:?} and {max:?}: plan again")]
    Range {
        /// Name of the number.
        what: String,
        /// Value in the file.
        value: f64,
        /// Minimum valid value.
        min: f64,
        /// Maximum valid value.
        max: f64,
    },
    /// An arc has a smaller radius than the robot can bend.
    #[error(
        "segment {segment} has a radius of {} mm, below R_min = {} mm of this robot: plan again",
        CompactNumber(.radius),
        CompactNumber(&rounded_up(.limit))
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
    /// The vector `m0` of a helicoidal arc is not perpendicular to the tip's direction, so the tip would also twist.
    #[error(
        "m0 of segment {segment} is not perpendicular to the tip there: its forward component is {value}, the limit is \
         {limit}; plan again"
    )]
    NotPerpendicular {
        /// Index of the segment, from 0.
        segment: usize,
        /// Component of `m0` along the tip's direction, as a fraction of the larger of `|m0|` and `|p|`.
        value: f64,
        /// Maximum absolute value of this fraction.
        limit: f64,
    },
    /// A total in the file does not match the value computed from the segments.
    #[error(
        "{what} is {}, but the segments give {}: the plan was edited or damaged; plan again",
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
    /// The path type in the file does not match the segments.
    #[error("path_type is {found:?}, but the segments give {expected:?}: the plan was edited or damaged; plan again")]
    PathType {
        /// Path type in the file.
        found: String,
        /// Path type of the segments.
        expected: String,
    },
    /// The number of legs in the file does not match the number of waypoints.
    #[error(
        "the plan has {found} legs, but its via poses require {expected}: the plan was edited or damaged; plan again"
    )]
    Legs {
        /// Number of legs in the file.
        found: usize,
        /// Required number of legs: one more than waypoints, or 0 without waypoints.
        expected: usize,
    },
    /// The segments of a leg do not end at its goal or waypoint.
    #[error(
        "the segments end {} mm and {} rad from {which}, more than {} mm and {} rad: the plan was edited or damaged; \
         plan again",
        .miss.distance, .miss.angle, .limit.distance, .limit.angle
    )]
    Missed {
        /// Name of the goal or waypoint.
        which: String,
        /// Distance (mm) and angle (radians) of the end of the segments from the goal or waypoint.
        miss: GoalError,
        /// Maximum distance and angle.
        limit: GoalError,
    },
}
