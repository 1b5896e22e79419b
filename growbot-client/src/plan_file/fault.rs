//! Why a plan file is refused.

use growbot_core::number::Short;
use growbot_core::plan::Miss;
use growbot_core::pose::PoseError;

/// More segments than this are no plan: what they ask for could not be grown in a lifetime.
pub(super) const MAX_SEGMENTS: usize = 10_000;

/// Why a plan file is refused: what, the value, the limit, what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanFault {
    /// The plan is for a robot of another name.
    #[error(
        "the plan is for robot {plan:?}, not for {robot:?}: plan again for this robot, or choose that one with --robot"
    )]
    OtherRobot {
        /// Name in the plan.
        plan: String,
        /// Name of the robot at hand.
        robot: String,
    },
    /// The robot's description has changed since.
    #[error(
        "the plan is for {robot} of hash {plan}, and this {robot} has hash {here}: the description has changed; plan \
         again, or give the old one with --robot FILE"
    )]
    OtherHash {
        /// The robot.
        robot: String,
        /// Hash in the plan.
        plan: String,
        /// Hash of the robot at hand.
        here: String,
    },
    /// Start or goal are no poses.
    #[error("{which}: {error}")]
    Pose {
        /// Start or goal.
        which: &'static str,
        /// What is wrong.
        #[source]
        error: PoseError,
    },
    /// A number out of its range.
    #[error("{what} is {value:?}; it must lie between {min:?} and {max:?}: plan again")]
    Range {
        /// Which number.
        what: String,
        /// What it is.
        value: f64,
        /// The min value.
        min: f64,
        /// The max value.
        max: f64,
    },
    /// A bend that the robot cannot make.
    #[error(
        "segment {segment} has a radius of {} mm, below R_min = {limit} mm of this robot: plan again with a larger \
         --radius", Short(.radius)
    )]
    TooTight {
        /// Which segment, from 0.
        segment: usize,
        /// Its radius, mm.
        radius: f64,
        /// The robot's min radius, mm.
        limit: f64,
    },
    /// Too many segments.
    #[error("the plan has {found} segments; growbot reads {MAX_SEGMENTS} at most: split it")]
    TooManySegments {
        /// How many there are.
        found: usize,
    },
    /// A helicoidal arc whose tip would not only bend but twist.
    #[error(
        "m0 of segment {segment} is not perpendicular to the tip there: {value} of it points ahead, {limit} may; plan \
         again"
    )]
    NotPerpendicular {
        /// Which segment, from 0.
        segment: usize,
        /// The part of m0 along the tip's direction, as a share.
        value: f64,
        /// The max value.
        limit: f64,
    },
    /// A total that is not the sum of the segments.
    #[error(
        "{what} is {}, and the segments give {}: the plan was changed by hand; plan again",
        Short(.value), Short(.expected)
    )]
    Total {
        /// Which total.
        what: &'static str,
        /// What the file says.
        value: f64,
        /// What the segments give.
        expected: f64,
    },
    /// Letters that are not those of the segments.
    #[error("path_type is {found:?}, and the segments give {expected:?}: the plan was changed by hand; plan again")]
    PathType {
        /// What the file says.
        found: String,
        /// What the segments give.
        expected: String,
    },
    /// Legs that are not those between the poses.
    #[error(
        "the plan has {found} legs, and its via poses ask for {expected}: the plan was changed by hand; plan again"
    )]
    Legs {
        /// How many there are.
        found: usize,
        /// How many there must be: one more than via poses, and none without.
        expected: usize,
    },
    /// The segments lead elsewhere.
    #[error(
        "the segments end {} mm and {} rad from {which}, more than {} mm and {} rad: the plan was changed by hand; \
         plan again",
        .miss.distance, .miss.angle, .limit.distance, .limit.angle
    )]
    Missed {
        /// The goal, or which of the poses on the way.
        which: String,
        /// How far off they end.
        miss: Miss,
        /// How far off they may.
        limit: Miss,
    },
}
