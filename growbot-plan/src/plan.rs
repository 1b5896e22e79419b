//! Plans: a plan is a path that has been checked to end at its goal, with its properties.
//!
//! A path through several poses is planned leg by leg. Each leg starts at the goal of the previous leg if the tip is
//! there within 1e-11 (radii and radians), and otherwise at the computed pose of the tip. A goal exactly ahead
//! therefore stays exactly ahead, and rounding errors do not add up over many legs. The frame of a pose has no roll,
//! but the frame of the tip after the earlier legs has, so the segments of a leg are rotated by the difference. If
//! every candidate would collide with the body, the shortest one is taken, with a warning.

use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::path::{self, Leg, Segment};
use growbot_core::plan::{self as planning, MAX_RADIUS_MM, PlanError, PlannedPath, Planner, Requirements};
use growbot_core::pose::{Frame, Pose, Position};
use growbot_core::robot::Robot;
use growbot_core::to_position::{self, PositionPlan};
use nalgebra::Vector3;

use crate::self_collision::closest_self_approach;
use crate::warning::{SELF_COLLISION, Warning, continues_body, self_collision, warnings};

/// Maximum number of layers of a body at whose tip a plan begins, with those of the body before it.
pub const MAX_EXISTING_LAYERS: usize = 100_000;

/// A plan for one robot: a path that ends at its goal, with its properties. Lengths in mm, angles in radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the robot.
    pub robot: String,
    /// Hash of the robot's whole description ([`Robot::hash`]).
    pub robot_hash: u64,
    /// Planner that found the path.
    pub planner: Planner,
    /// Radius of the arcs, mm.
    pub radius: f64,
    /// Start pose of the tip.
    pub start: Pose,
    /// Goal pose of the tip, at the end of the last leg.
    pub goal: Pose,
    /// Legs of the path, from the start through all waypoints to the goal. At least one.
    pub legs: Vec<Leg>,
    /// Search statistics of each leg. `None` for a leg from a search around obstacles, and in plans of older versions.
    pub choices: Vec<Option<SearchSummary>>,
    /// For each leg: true if only the position of its goal was given, so that the planner chose the direction.
    pub free_directions: Vec<bool>,
    /// Segments of the path from start to goal.
    pub path: Vec<Segment>,
    /// Length, layers, time and filament.
    pub requirements: Requirements,
    /// Reasons against growing the plan.
    pub warnings: Vec<Warning>,
    /// Scene of obstacles from which the path is clear. `None` for a plan in empty space.
    pub scene: Option<SceneClearance>,
    /// Layers of the body at whose tip the path begins. Empty for a path that begins a new body.
    pub existing_layers: Vec<LayerBytes>,
}

/// The scene that a plan leads through, and the clearance of the body from it.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneClearance {
    /// Name of the scene's file.
    pub file: String,
    /// Hash of the scene's files.
    pub hash: u64,
    /// Proven minimum clearance between the outside of the tube and everything in the scene, mm.
    pub clearance: f64,
    /// Clearance that was required from the plan, mm.
    pub margin: f64,
}

/// Search statistics of the path of a leg or of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SearchSummary {
    /// Number of paths that the planner found to the goal. For several legs, the sum.
    pub candidates: usize,
    /// Number of shorter paths that were rejected because the body would have collided with itself.
    pub rejected: usize,
    /// Length of the path that the two-plane planner finds for the same start and goal, mm.
    pub two_plane_length: f64,
}

impl SearchSummary {
    /// Returns by how many percent the two-plane path is longer than `length` (mm). 0 if `length` is 0.
    pub fn two_plane_longer_percent(&self, length: f64) -> f64 {
        if length > 0.0 { 100.0 * (self.two_plane_length / length - 1.0) } else { 0.0 }
    }

    fn and(self, other: Self) -> Self {
        Self {
            candidates: self.candidates + other.candidates,
            rejected: self.rejected + other.rejected,
            two_plane_length: self.two_plane_length + other.two_plane_length,
        }
    }
}

/// Goal of a leg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// A position with a direction.
    Pose(Pose),
    /// A position with any direction.
    Position(Position),
}

impl From<Pose> for Goal {
    fn from(pose: Pose) -> Self {
        Self::Pose(pose)
    }
}

impl Goal {
    /// Returns the position of the goal, mm.
    pub fn position(&self) -> Vector3<f64> {
        match self {
            Self::Pose(pose) => pose.position(),
            Self::Position(position) => position.vector(),
        }
    }

    /// Reports whether the goal is only a position, so that any direction is accepted.
    pub fn is_free(&self) -> bool {
        matches!(self, Self::Position(_))
    }
}

/// Legs of a plan, with the search statistics of each leg. All lists have the same length.
#[derive(Debug)]
pub(crate) struct PlanLegs {
    /// Legs of the path, at least one.
    pub(crate) legs: Vec<Leg>,
    /// Search statistics of each leg. `None` if a plan file does not contain them.
    pub(crate) choices: Vec<Option<SearchSummary>>,
    /// For each leg: true if the planner chose the direction at its end.
    pub(crate) free_directions: Vec<bool>,
}

/// Parameters of the search for a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanOptions<'a> {
    /// Radius of the arcs, mm.
    pub radius: f64,
    /// Planner that generates the candidate paths.
    pub planner: Planner,
    /// True to take the shortest candidate that collides neither with itself, nor with the earlier legs, nor with the
    /// existing body. False to take the shortest candidate.
    pub avoid_self_collision: bool,
    /// Body at whose tip the path begins. `None` if the path begins a new body.
    pub existing: Option<ExistingBody<'a>>,
}

/// A body at whose tip a path begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExistingBody<'a> {
    /// Segments of the body.
    pub segments: &'a [Segment],
    /// Frame of the tip of the body.
    pub base_from_tip: &'a Frame,
}

/// Maximum error of the tip at the end of a leg, in radii and radians, at which the next leg is planned from the goal
/// of this leg. A goal that lies exactly ahead then stays exactly ahead. If the error is larger, the next leg is
/// planned from the computed pose of the tip, so that errors do not add up.
const AT_THE_POSE: f64 = 1e-11;

impl Plan {
    /// Plans the legs one after the other. The direction at a position is the one that makes the leg to it shortest.
    pub(crate) fn leg_by_leg<E: From<PlanError>>(
        robot: &Robot,
        start: &Pose,
        goals: &[Goal],
        search: &PlanOptions,
        check: &dyn Fn() -> Result<(), E>,
    ) -> Result<Self, E> {
        Self::by_legs(robot, start, goals, search, |from, goal, body, roll| {
            check()?;
            Ok(plan_leg(robot, from, goal, search, body, roll)?)
        })
    }

    /// Plans the legs one after the other with the function `plan_leg`. Its arguments are the start pose of the leg,
    /// the goal of the leg, the segments of the existing body and of all earlier legs, and the roll of their tip
    /// relative to the start pose of the leg, radians.
    pub(crate) fn by_legs<E>(
        robot: &Robot,
        start: &Pose,
        goals: &[Goal],
        search: &PlanOptions,
        mut plan_leg: impl FnMut(&Pose, &Goal, &[Segment], f64) -> Result<PlannedLeg, E>,
    ) -> Result<Self, E> {
        let existing = search.existing.map_or(&[][..], |existing| existing.segments);
        let roll_of_existing = search.existing.map_or(0.0, |existing| start.roll_to(existing.base_from_tip));
        let (mut path, mut body) = (Vec::new(), existing.to_vec());
        let (mut legs, mut choices) = (Vec::with_capacity(goals.len()), Vec::with_capacity(goals.len()));
        // Frame of the tip, and the pose and the roll from which the next leg is planned.
        let mut base_from_tip = start.frame();
        let (mut from, mut roll) = (*start, 0.0);
        for goal in goals {
            let leg = plan_leg(&from, goal, &body, roll + roll_of_existing)?;
            let (goal, own): (_, Vec<_>) = (leg.goal, leg.path.iter().map(|segment| segment.rolled(roll)).collect());
            choices.push(leg.choice);
            legs.push(Leg { goal, segment_count: own.len() });
            base_from_tip = path::end(&own, &base_from_tip);
            body.extend(own.iter().map(|segment| segment.rolled(roll_of_existing)));
            path.extend(own);
            let miss = planning::goal_error(&base_from_tip, &goal);
            let there = miss.distance <= AT_THE_POSE * search.radius && miss.angle <= AT_THE_POSE;
            from = if there { goal } else { Pose::from_frame(&base_from_tip) };
            roll = from.roll_to(&base_from_tip);
        }
        let free_directions = goals.iter().map(Goal::is_free).collect();
        let legs = PlanLegs { legs, choices, free_directions };
        let mut plan = Self::of_path(robot, start, search.radius, search.planner, legs, path);
        if !existing.is_empty() {
            plan.add_self_collision(&body, robot, path::length(existing));
        }
        Ok(plan)
    }

    /// Adds the warning for a collision of the path with itself or with the existing body, unless it is there. `body`
    /// is the existing body with the path, and `existing` the length of the existing body, mm.
    fn add_self_collision(&mut self, body: &[Segment], robot: &Robot, existing: f64) {
        if self.warnings.iter().all(|warning| warning.code != SELF_COLLISION) {
            self.warnings.extend(self_collision(body, robot, existing));
        }
    }

    /// Returns the plan as one whose path begins at the tip of a body with these layers. It has a warning that this
    /// body must be in place, and one if the path runs into it.
    #[must_use]
    pub fn after_layers(mut self, layers: Vec<LayerBytes>, robot: &Robot) -> Self {
        if !layers.is_empty() {
            self.warnings.push(continues_body(layers.len()));
            let mut body = segments(&layers);
            let existing = path::length(&body);
            body.extend(&self.path);
            self.add_self_collision(&body, robot, existing);
        }
        Self { existing_layers: layers, ..self }
    }

    /// Creates the plan of a given path. There must be at least one leg.
    pub(crate) fn of_path(
        robot: &Robot,
        start: &Pose,
        radius: f64,
        planner: Planner,
        PlanLegs { legs, choices, free_directions }: PlanLegs,
        path: Vec<Segment>,
    ) -> Self {
        let needs = planning::requirements(&path, robot);
        Self {
            robot: robot.name().to_owned(),
            robot_hash: robot.hash(),
            planner,
            radius,
            start: *start,
            goal: legs.last().map_or(*start, |leg| leg.goal),
            warnings: warnings(&path, &needs, robot),
            requirements: needs,
            legs,
            choices,
            free_directions,
            path,
            scene: None,
            existing_layers: Vec::new(),
        }
    }

    /// Returns the path type, a letter for each segment: C for an arc, S for a straight line, H for a helicoidal arc.
    /// Empty for a path without segments.
    pub fn path_type(&self) -> String {
        path_type(&self.path)
    }

    /// Returns the search statistics and the segments of each leg, in order.
    pub fn by_leg(&self) -> impl Iterator<Item = (Option<SearchSummary>, &[Segment])> {
        let mut rest = self.path.as_slice();
        self.legs.iter().zip(&self.choices).map(move |(leg, choice)| {
            let (own, after) = rest.split_at_checked(leg.segment_count).unwrap_or((rest, &[]));
            rest = after;
            (*choice, own)
        })
    }

    /// Returns the waypoints: the goals of all legs but the last.
    pub fn via(&self) -> Vec<Pose> {
        let on_the_way = self.legs.len().saturating_sub(1);
        self.legs.iter().take(on_the_way).map(|leg| leg.goal).collect()
    }

    /// Reports whether only the position of the plan's goal was given, so that the planner chose its direction.
    pub fn has_free_direction(&self) -> bool {
        self.free_directions.last().is_some_and(|free| *free)
    }

    /// Returns the search statistics of the whole path: the sum over its legs. `None` if they are unknown for a leg.
    pub fn search_summary(&self) -> Option<SearchSummary> {
        self.choices.iter().try_fold(SearchSummary::default(), |sum, choice| Some(sum.and((*choice)?)))
    }
}

/// Returns the path type, a letter for each segment: C for an arc, S for a straight line, H for a helicoidal arc.
pub fn path_type(path: &[Segment]) -> String {
    let letter = |segment: &Segment| match segment {
        Segment::Arc { .. } => 'C',
        Segment::Straight { .. } => 'S',
        Segment::Helicoid { .. } => 'H',
    };
    let mut letters: Vec<char> = path.iter().map(letter).collect();
    // A helicoidal arc with a narrow neck consists of two segments.
    letters.dedup_by(|after, before| *after == 'H' && *before == 'H');
    letters.into_iter().collect()
}

/// Returns the centrelines of layers as segments.
pub(crate) fn segments(layers: &[LayerBytes]) -> Vec<Segment> {
    layers.iter().map(|layer| Segment::from(&decode(layer))).collect()
}

/// A planned leg.
pub(crate) struct PlannedLeg {
    /// Pose at the end of the leg.
    pub(crate) goal: Pose,
    /// Segments of the leg, relative to the frame of its start pose (without roll).
    pub(crate) path: Vec<Segment>,
    /// Search statistics. `None` if the path is the result of a search around obstacles.
    pub(crate) choice: Option<SearchSummary>,
}

impl PlannedLeg {
    /// Creates a leg from the chosen candidate. `passed_over` is the number of shorter candidates that were rejected.
    pub(crate) fn chosen(goal: Pose, chosen: &PlannedPath, passed_over: usize) -> Self {
        let &PlannedPath { ref path, candidate_count: candidates, two_plane_length } = chosen;
        Self {
            goal,
            path: path.to_vec(),
            choice: Some(SearchSummary { candidates, rejected: passed_over, two_plane_length }),
        }
    }
}

/// Plans one leg. `body` are the segments of the existing body and of all earlier legs, and `roll` is the roll of the
/// tip at their end, radians.
fn plan_leg(
    robot: &Robot,
    from: &Pose,
    goal: &Goal,
    search: &PlanOptions,
    body: &[Segment],
    roll: f64,
) -> Result<PlannedLeg, PlanError> {
    if search.avoid_self_collision && search.radius <= MAX_RADIUS_MM {
        let before = path::length(body);
        let mut whole = body.to_vec();
        let mut passed_over = 0;
        let is_clear = |candidate: &[Segment]| {
            whole.truncate(body.len());
            whole.extend(candidate.iter().map(|segment| segment.rolled(roll)));
            let clear = closest_self_approach(&whole, robot.outer_diameter(), before).is_none();
            passed_over += usize::from(!clear);
            clear
        };
        if let Some((goal, chosen)) = plan_where(robot, from, goal, search, is_clear)? {
            return Ok(PlannedLeg::chosen(goal, &chosen, passed_over));
        }
    }
    let (goal, chosen) = plan_where(robot, from, goal, search, |_| true)?.ok_or(PlanError::NoPath)?;
    Ok(PlannedLeg::chosen(goal, &chosen, 0))
}

/// Returns the shortest candidate for which `accept` returns true, and the pose at its end. `None` if no candidate is
/// accepted.
pub(crate) fn plan_where(
    robot: &Robot,
    from: &Pose,
    goal: &Goal,
    &PlanOptions { radius, planner, .. }: &PlanOptions,
    accept: impl FnMut(&[Segment]) -> bool,
) -> Result<Option<(Pose, PlannedPath)>, PlanError> {
    Ok(match goal {
        Goal::Pose(goal) => {
            planning::plan_with_filter(robot, from, goal, radius, planner, accept)?.map(|chosen| (*goal, chosen))
        }
        Goal::Position(position) => to_position::plan_to_position(robot, from, position, radius, planner, accept)?
            .map(|PositionPlan { goal, planned: chosen }| (goal, chosen)),
    })
}
