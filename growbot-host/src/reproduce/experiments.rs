//! The paper's growths: planned between random poses, cut into layers, laid, and compared with the goal.

use growbot_client::arrival::Arrival;
use growbot_client::robot_file::{self, RobotFileError};
use growbot_core::path;
use growbot_core::path::{Leg, Path};
use growbot_core::plan::{PlanError, Planner, plan};
use growbot_core::pose::{Pose, PoseError};
use growbot_core::random::Random;
use growbot_core::robot::Robot;
use growbot_core::simulation::{self, DirectionSensor, Disturbance, Grown, Sensors, grow_closed, grow_open};
use growbot_core::slicing::{Slicing, layers};
use growbot_core::tracking::SensorNoise;
use growbot_sim::parallel;
use nalgebra::Vector3;

use super::paper::{self, GROUPS, NOISE, ROBOTS};
use super::statistics::Summary;
use super::{Request, poses};

/// How a path is cut into layers. The paper gives two values of the step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cutting {
    /// Whole steps, rounded up, of the `g t = 0.3096` cm of the text. It is said of Table 1's robots only.
    Text,
    /// Whole steps, rounded up, of `g dt` by Tables 1 and 3.
    Table,
    /// Whole steps of half the table's: of a single latch of robot C. A guess: it comes near the paper's results.
    Half,
    /// Whole steps of a tenth of the table's: for robot B, as if a centimetre had been taken for a millimetre. A guess likewise.
    Tenth,
    /// Exact slicing: equal layers that end where the segment does.
    Exact,
}

/// How much longer the text's step is than Table 1's: 0.3096 cm over 0.0774 cm.
const TEXT_OVER_TABLE: f64 = 4.0;

impl Cutting {
    /// The cuttings that make sense for a robot of this index.
    #[must_use]
    pub fn of_robot(robot: usize) -> &'static [Self] {
        match robot {
            paper::B => &[Self::Table, Self::Tenth, Self::Exact],
            paper::C => &[Self::Table, Self::Half, Self::Exact],
            _ => &[Self::Text, Self::Table, Self::Exact],
        }
    }

    /// What the paper seems to have simulated a robot of this index with.
    #[must_use]
    pub fn of_paper(robot: usize) -> Self {
        if matches!(robot, paper::B | paper::C) { Self::Table } else { Self::Text }
    }

    /// Height of a whole step, mm; none where layers end with the segment.
    #[must_use]
    pub fn step(self, robot: &Robot) -> Option<f64> {
        let table = robot.description().layer.height_mm;
        match self {
            Self::Text => Some(TEXT_OVER_TABLE * table),
            Self::Table => Some(table),
            Self::Half => Some(0.5 * table),
            Self::Tenth => Some(0.1 * table),
            Self::Exact => None,
        }
    }

    /// The segments that are given whole steps. The waypoint of a two-plane path is where two circles touch, and by rounding every other
    /// path has a straight of 3e-8 radii between them: whether it is there must not decide whether a step is.
    fn stepped(self, robot: &Robot, path: &Path) -> Path {
        let rounding = 1e-6 * robot.description().planning_radius_mm;
        path.filtered(|segment| self == Self::Exact || segment.length() > rounding)
    }

    fn slicing(self, robot: &Robot) -> Slicing {
        self.step(robot).map_or(Slicing::Exact, |step| Slicing::Whole { step })
    }

    /// In files and results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "whole-text",
            Self::Table => "whole-table",
            Self::Half => "whole-half",
            Self::Tenth => "whole-tenth",
            Self::Exact => "exact",
        }
    }

    /// As a person reads it, for a robot of this name.
    #[must_use]
    pub fn label(self, robot: &Robot) -> String {
        self.step(robot).map_or_else(
            || "exact slicing".to_owned(),
            |step| format!("whole steps of {} mm", libm::round(step * 1e6) / 1e6),
        )
    }
}

/// In files and results.
#[must_use]
pub fn planner_name(planner: Planner) -> &'static str {
    match planner {
        Planner::TwoPlane => "two-plane",
        Planner::Shortest => "shortest",
    }
}

/// How a growth is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Condition {
    /// The planner.
    pub planner: Planner,
    /// How the path is cut.
    pub cutting: Cutting,
    /// Noise of the growth: at most this share of each layer's height.
    pub noise: f64,
    /// Whether the tip is measured and the rest of the path planned again.
    pub feedback: bool,
}

impl Condition {
    const fn open(planner: Planner, cutting: Cutting, noise: f64) -> Self {
        Self { planner, cutting, noise, feedback: false }
    }

    /// With feedback, each layer is cut anew, and exactly.
    const fn closed(planner: Planner, noise: f64) -> Self {
        Self { planner, cutting: Cutting::Exact, noise, feedback: true }
    }

    /// In files and results.
    #[must_use]
    pub fn loop_name(&self) -> &'static str {
        if self.feedback { "closed" } else { "open" }
    }
}

/// One growth, and how near it came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Place in [`ROBOTS`].
    pub robot: usize,
    /// Place in [`GROUPS`].
    pub group: usize,
    /// Which repetition, from 0.
    pub repetition: usize,
    /// How it was done.
    pub condition: Condition,
    /// Length of the planned path, mm.
    pub path_length: f64,
    /// That over the radius.
    pub path_radii: f64,
    /// Layers laid.
    pub layers: usize,
    /// Errors.
    pub arrival: Arrival,
}

/// What of a growth is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Position error over the path's length (Eq 26).
    Position,
    /// Heading error (Eq 27, wrapped), degrees.
    Heading,
    /// Pitch error (Eq 28), degrees.
    Pitch,
    /// Angle between the directions, degrees.
    Direction,
    /// Length of the path, radii.
    Length,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Position, Self::Heading, Self::Pitch, Self::Direction, Self::Length];

    /// Its value.
    #[must_use]
    pub fn of(self, growth: &Growth) -> f64 {
        match self {
            Self::Position => growth.arrival.normalized_position_error,
            Self::Heading => growth.arrival.heading_error_deg,
            Self::Pitch => growth.arrival.pitch_error_deg,
            Self::Direction => growth.arrival.direction_error_deg,
            Self::Length => growth.path_radii,
        }
    }

    /// In files and results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position_error_over_length",
            Self::Heading => "heading_error_deg",
            Self::Pitch => "pitch_error_deg",
            Self::Direction => "direction_error_deg",
            Self::Length => "path_length_over_radius",
        }
    }
}

/// Growths under one condition in one group.
#[derive(Debug, Clone, PartialEq)]
pub struct Set {
    /// Place in [`ROBOTS`].
    pub robot: usize,
    /// Place in [`GROUPS`].
    pub group: usize,
    /// How they were done.
    pub condition: Condition,
    /// By repetition.
    pub growths: Vec<Growth>,
}

impl Set {
    /// The values of a quantity.
    #[must_use]
    pub fn values(&self, quantity: Quantity) -> Vec<f64> {
        self.growths.iter().map(|growth| quantity.of(growth)).collect()
    }

    /// A quantity in a few numbers.
    #[must_use]
    pub fn summary(&self, quantity: Quantity) -> Summary {
        Summary::of(&self.values(quantity))
    }

    /// The growth whose position error is nearest to the median.
    #[must_use]
    pub fn representative(&self) -> Option<&Growth> {
        let median = self.summary(Quantity::Position).median;
        let off = |growth: &&Growth| (growth.arrival.normalized_position_error - median).abs();
        self.growths.iter().min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

/// A growth with its curves, to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// Which growth.
    pub growth: Growth,
    /// Start and goal.
    pub poses: (Pose, Pose),
    /// The path between them.
    pub path: Path,
    /// The planned curve, segment by segment: whether it bends, and points, mm.
    pub planned: Vec<(bool, Vec<Vector3<f64>>)>,
    /// Where the tip was after each layer, from the start on, mm.
    pub grown: Vec<Vector3<f64>>,
    /// Time of growth, s.
    pub seconds: f64,
}

/// All that was grown.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiments {
    /// The robots, as [`ROBOTS`].
    pub robots: Vec<Robot>,
    /// Growths between random poses.
    pub sets: Vec<Set>,
    /// Growths with noise along robot A's representative paths.
    pub noise: Vec<Set>,
    /// The paths of Figures 5 and 7.
    pub examples: Vec<Example>,
}

/// Why an experiment could not be done.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A built-in robot cannot be read.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// No random pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// No path.
    #[error("robot {robot}, {group} radii, repetition {repetition}: {error}")]
    Plan {
        /// Name of the robot.
        robot: &'static str,
        /// The group, radii.
        group: u32,
        /// The repetition.
        repetition: usize,
        /// Why.
        error: PlanError,
    },
}

/// What random numbers are drawn for.
#[derive(Debug, Clone, Copy)]
enum Draw {
    Poses = 1,
    GrowthBetweenPoses,
    GrowthWithNoise,
}

/// One random start and goal, and the growths between them.
#[derive(Debug, Clone, Copy)]
struct Task {
    robot: usize,
    group: usize,
    repetition: usize,
}

/// The noise with which open and closed loop are compared between random poses.
pub const NOISE_OF_FEEDBACK: f64 = 0.1;
/// What a closed loop measures, and how badly: growth to 1 % of a layer and the direction to 0.5 degrees an axis, standard deviations.
pub const SENSORS: Sensors = Sensors {
    noise: SensorNoise { odometry: 0.01, direction: 0.5 / 180.0 * std::f64::consts::PI },
    odometry_scale: 0.0,
    direction: DirectionSensor::Tip,
};

/// Does what the request asks for on so many threads. `at` hears how many pieces of work are done, and of how many.
///
/// # Errors
/// Never yet seen: a built-in robot that cannot be read, or poses without a path.
pub fn run(request: &Request, threads: usize, mut at: impl FnMut(u64, u64)) -> Result<Experiments, ExperimentError> {
    let robots: Vec<Robot> =
        ROBOTS.iter().map(|robot| robot_file::load(robot.file.as_ref())).collect::<Result<_, _>>()?;
    let tasks: Vec<Task> = (0..ROBOTS.len())
        .filter(|robot| request.needs_robot(*robot))
        .flat_map(|robot| (0..GROUPS.len()).map(move |group| (robot, group)))
        .flat_map(|(robot, group)| (0..request.repeat).map(move |repetition| Task { robot, group, repetition }))
        .collect();
    let noises = if request.needs_noise() { conditions_with_noise() } else { Vec::new() };
    let noise_tasks: Vec<(usize, Condition)> =
        (0..GROUPS.len()).flat_map(|group| noises.iter().map(move |condition| (group, *condition))).collect();
    let of = (tasks.len() + noise_tasks.len()) as u64;

    let grown =
        parallel::map_on(threads, &tasks, |task| between_poses(request, &robots, task), |done| at(done as u64, of));
    let mut sets: Vec<Set> = Vec::new();
    let mut first_of_group = 0;
    for (index, growths) in grown.into_iter().enumerate() {
        let growths = growths?;
        if tasks[index].repetition == 0 {
            first_of_group = sets.len();
            sets.extend(growths.iter().map(|growth| Set {
                robot: growth.robot,
                group: growth.group,
                condition: growth.condition,
                growths: Vec::with_capacity(request.repeat),
            }));
        }
        for (set, growth) in sets[first_of_group..].iter_mut().zip(growths) {
            set.growths.push(growth);
        }
    }

    let examples = examples(request, &robots, &sets)?;
    let with_noise = |(group, condition): &(usize, Condition)| {
        let example =
            examples.iter().find(|example| example.growth.robot == paper::A && example.growth.group == *group)?;
        Some(along_example(request, &robots[paper::A], example, *condition))
    };
    let before = tasks.len();
    let noise: Vec<Set> = parallel::map_on(threads, &noise_tasks, with_noise, |done| at((before + done) as u64, of))
        .into_iter()
        .flatten()
        .collect();
    Ok(Experiments { robots, sets, noise, examples })
}

/// Under which conditions a robot grows between random poses. Noise and feedback belong to Figure 4.
fn conditions(request: &Request, robot: usize, planner: Planner) -> Vec<Condition> {
    let cuttings = Cutting::of_robot(robot).iter();
    let mut conditions: Vec<_> = cuttings.map(|cutting| Condition::open(planner, *cutting, 0.0)).collect();
    if robot == paper::A && request.has_figure(4) {
        conditions.push(Condition::open(planner, Cutting::Exact, NOISE_OF_FEEDBACK));
        conditions.push(Condition::closed(planner, NOISE_OF_FEEDBACK));
    }
    conditions
}

/// Under which conditions robot A grows along its representative paths. Without noise a growth is the same every time.
fn conditions_with_noise() -> Vec<Condition> {
    let levels = [0.0].into_iter().chain(NOISE);
    let open = Cutting::of_robot(paper::A)
        .iter()
        .flat_map(|cutting| levels.clone().map(|noise| Condition::open(Planner::TwoPlane, *cutting, noise)));
    open.chain(levels.clone().map(|noise| Condition::closed(Planner::TwoPlane, noise))).collect()
}

/// Start, goal and their distance.
fn poses_of(request: &Request, robot: &Robot, task: &Task) -> Result<(Pose, Pose), PoseError> {
    let names = [request.seed, Draw::Poses as u64, task.robot as u64, task.group as u64, task.repetition as u64];
    poses::draw(&mut Random::new(&names), f64::from(GROUPS[task.group]) * robot.description().planning_radius_mm)
}

fn planned(
    robot: &Robot,
    task: &Task,
    (start, goal): &(Pose, Pose),
    planner: Planner,
) -> Result<Path, ExperimentError> {
    plan(robot, start, goal, robot.description().planning_radius_mm, planner).map(|chosen| chosen.path).map_err(
        |error| ExperimentError::Plan {
            robot: ROBOTS[task.robot].name,
            group: GROUPS[task.group],
            repetition: task.repetition,
            error,
        },
    )
}

/// A seed for the noise of one growth.
fn noise_seed(names: &[u64]) -> u64 {
    (Random::new(names).unit() * (1_u64 << 53) as f64) as u64
}

/// The growths between one start and one goal.
fn between_poses(request: &Request, robots: &[Robot], task: &Task) -> Result<Vec<Growth>, ExperimentError> {
    let robot = &robots[task.robot];
    let poses = poses_of(request, robot, task)?;
    let seed = noise_seed(&[
        request.seed,
        Draw::GrowthBetweenPoses as u64,
        task.robot as u64,
        task.group as u64,
        task.repetition as u64,
    ]);
    let mut growths = Vec::new();
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        let path = planned(robot, task, &poses, planner)?;
        let conditions = conditions(request, task.robot, planner);
        growths.extend(conditions.into_iter().map(|condition| grow(robot, task, &poses, &path, condition, seed)));
    }
    Ok(growths)
}

/// One growth.
fn grow(
    robot: &Robot,
    task: &Task,
    (start, goal): &(Pose, Pose),
    path: &Path,
    condition: Condition,
    seed: u64,
) -> Growth {
    let disturbance = Disturbance { growth_noise: condition.noise, ..Disturbance::default() };
    let Grown { base_from_tip, layers: laid, .. } = if condition.feedback {
        let legs = [Leg { goal: *goal, segments: path.len() }];
        let task = simulation::Task { robot, start: *start, path, legs: &legs };
        grow_closed(&task, &disturbance, &SENSORS, seed, |_, _, base_from_tip| *base_from_tip)
    } else {
        let path = condition.cutting.stepped(robot, path);
        let layers = layers(&path, robot, condition.cutting.slicing(robot)).map(|sliced| sliced.layer);
        grow_open(start, layers, &disturbance, seed, |_| ())
    };
    let path_length = path::length(path);
    Growth {
        robot: task.robot,
        group: task.group,
        repetition: task.repetition,
        condition,
        path_length,
        path_radii: path_length / robot.description().planning_radius_mm,
        layers: laid as usize,
        arrival: Arrival::of(&base_from_tip, goal, path_length),
    }
}

/// The representative paths: robot A's in each group, and one each of robots B and C.
fn examples(request: &Request, robots: &[Robot], sets: &[Set]) -> Result<Vec<Example>, ExperimentError> {
    /// The group that Figure 7 shows, a place in [`GROUPS`].
    const SHOWN: usize = 1;
    let wanted = (0..GROUPS.len()).map(|group| (paper::A, group)).chain([(paper::B, SHOWN), (paper::C, SHOWN)]);
    let mut examples = Vec::new();
    for (robot, group) in wanted {
        let condition = Condition::open(Planner::TwoPlane, Cutting::of_paper(robot), 0.0);
        let set = sets.iter().find(|set| set.robot == robot && set.group == group && set.condition == condition);
        if let Some(growth) = set.and_then(Set::representative) {
            examples.push(example(request, &robots[robot], growth)?);
        }
    }
    Ok(examples)
}

/// A growth without noise, with its curves.
fn example(request: &Request, robot: &Robot, growth: &Growth) -> Result<Example, ExperimentError> {
    /// Points along a bend.
    const POINTS: u32 = 40;
    let task = Task { robot: growth.robot, group: growth.group, repetition: growth.repetition };
    let poses = poses_of(request, robot, &task)?;
    let path = planned(robot, &task, &poses, growth.condition.planner)?;
    let mut base_from_segment = poses.0.frame();
    let mut planned = Vec::new();
    for segment in path.iter() {
        let bends = segment.bend() > 0.0;
        let count = if bends { POINTS } else { 1 };
        let points = (0..=count).map(|i| {
            let part = part_of(segment, f64::from(i) / f64::from(count));
            (base_from_segment * part.step()).translation.vector
        });
        planned.push((bends, points.collect()));
        base_from_segment *= segment.step();
    }
    let cutting = growth.condition.cutting;
    let mut base_from_tip = poses.0.frame();
    let mut grown = vec![poses.0.position()];
    for sliced in layers(&cutting.stepped(robot, &path), robot, cutting.slicing(robot)) {
        base_from_tip *= sliced.layer.step();
        grown.push(base_from_tip.translation.vector);
    }
    // By the velocity, as the paper has it: a step of the text's length takes four of the table's.
    let step = cutting.step(robot).unwrap_or_default();
    let layer = &robot.description().layer;
    let seconds = growth.layers as f64 * step / layer.height_mm * layer.period_s;
    Ok(Example { growth: *growth, poses, path, planned, grown, seconds })
}

/// The first share of a segment.
fn part_of(segment: &path::Segment, share: f64) -> path::Segment {
    use path::Segment::{Arc, Helicoid, Straight};
    match *segment {
        Arc { alpha, bend, length } => Arc { alpha, bend: share * bend, length: share * length },
        Straight { length } => Straight { length: share * length },
        Helicoid { curve, radius, length } => Helicoid { curve, radius, length: share * length },
    }
}

/// Robot A along a representative path, again and again.
fn along_example(request: &Request, robot: &Robot, example: &Example, condition: Condition) -> Set {
    let Growth { robot: index, group, repetition, .. } = example.growth;
    let task = Task { robot: index, group, repetition };
    let mut set = Set { robot: index, group, condition, growths: Vec::new() };
    let times = if condition.noise == 0.0 && !condition.feedback { 1 } else { request.repeat_noise };
    let level = (1e6 * condition.noise) as u64;
    for repetition in 0..times {
        let names = [request.seed, Draw::GrowthWithNoise as u64, group as u64, level, repetition as u64];
        let growth = grow(robot, &task, &example.poses, &example.path, condition, noise_seed(&names));
        set.growths.push(Growth { repetition, ..growth });
    }
    set
}
