//! The growths of the paper: planned between random poses, sliced into layers, laid, and compared with the goal.

use growbot_core::path;
use growbot_core::path::{Leg, Path};
use growbot_core::plan::{PlanError, Planner, plan};
use growbot_core::pose::PoseError;
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_core::simulation::{
    self, DirectionSensor, Disturbance, GrownBody, SimulatedSensors, grow_closed_loop, grow_open_loop,
};
use growbot_core::slicing::layers;
use growbot_core::tracking::SensorNoise;
use growbot_plan::arrival::Arrival;
use growbot_plan::parallel;
use growbot_plan::robot_file::{self, RobotFileError};
use nalgebra::Vector3;

use super::paper::{self, GROUPS, NOISE, ROBOTS};
use super::poses::{self, Endpoints};
use super::request::ReproduceRequest;
use super::slicing_rule::SlicingRule;
use super::statistics::SampleSummary;

/// Condition of a growth: planner, slicing, noise and feedback.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Condition {
    /// Planner of the path.
    pub planner: Planner,
    /// Slicing rule of the path.
    pub slicing: SlicingRule,
    /// Noise of the growth: largest deviation of a layer, as a share of its height.
    pub noise: f64,
    /// True if the tip is measured and the rest of the path is planned again after each layer.
    pub feedback: bool,
}

impl Condition {
    const fn open(planner: Planner, slicing: SlicingRule, noise: f64) -> Self {
        Self { planner, slicing, noise, feedback: false }
    }

    /// Returns a condition with feedback. Each layer is then sliced again, and exactly.
    const fn closed(planner: Planner, noise: f64) -> Self {
        Self { planner, slicing: SlicingRule::Exact, noise, feedback: true }
    }

    /// Returns the name of the control loop in files and results: `open` or `closed`.
    pub fn loop_name(&self) -> &'static str {
        if self.feedback { "closed" } else { "open" }
    }
}

/// One growth, with its errors at the goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExperimentGrowth {
    /// Index into [`ROBOTS`].
    pub robot: usize,
    /// Index into [`GROUPS`].
    pub group: usize,
    /// Number of the repetition, from 0.
    pub repetition: usize,
    /// Condition of the growth.
    pub condition: Condition,
    /// Start and goal.
    pub poses: Endpoints,
    /// Length of the planned path, mm.
    pub path_length: f64,
    /// Length of the planned path, radii.
    pub path_radii: f64,
    /// Number of laid layers.
    pub layers: usize,
    /// Errors at the goal.
    pub arrival: Arrival,
}

/// Quantity of a growth that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorQuantity {
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

impl ErrorQuantity {
    /// All quantities.
    pub const ALL: [Self; 5] = [Self::Position, Self::Heading, Self::Pitch, Self::Direction, Self::Length];

    /// Returns the value of the quantity for a growth.
    pub fn of(self, growth: &ExperimentGrowth) -> f64 {
        match self {
            Self::Position => growth.arrival.normalized_position_error,
            // The directions are random, and none is exactly vertical.
            Self::Heading => growth.arrival.heading_error_deg.unwrap_or(0.0),
            Self::Pitch => growth.arrival.pitch_error_deg,
            Self::Direction => growth.arrival.direction_error_deg,
            Self::Length => growth.path_radii,
        }
    }

    /// Returns the name of the quantity in files and results.
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
pub struct GrowthSet {
    /// Index into [`ROBOTS`].
    pub robot: usize,
    /// Index into [`GROUPS`].
    pub group: usize,
    /// Condition of the growths.
    pub condition: Condition,
    /// Growths, in the order of repetitions.
    pub growths: Vec<ExperimentGrowth>,
}

impl GrowthSet {
    /// Returns the values of a quantity.
    pub fn values(&self, quantity: ErrorQuantity) -> Vec<f64> {
        self.growths.iter().map(|growth| quantity.of(growth)).collect()
    }

    /// Returns summary statistics of a quantity.
    pub fn summary(&self, quantity: ErrorQuantity) -> SampleSummary {
        SampleSummary::of(&self.values(quantity))
    }

    /// Returns the growth whose position error is nearest to the median. `None` without growths.
    pub fn representative(&self) -> Option<&ExperimentGrowth> {
        let median = self.summary(ErrorQuantity::Position).median;
        let off = |growth: &&ExperimentGrowth| (growth.arrival.normalized_position_error - median).abs();
        self.growths.iter().min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

/// A growth with its curves, for a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// The growth.
    pub growth: ExperimentGrowth,
    /// Start and goal.
    pub poses: Endpoints,
    /// Path between start and goal.
    pub path: Path,
    /// Planned curve.
    pub planned: Vec<PlannedSegment>,
    /// Position of the tip at the start and after each layer, mm.
    pub grown: Vec<Vector3<f64>>,
    /// Time that the growth takes at the paper's velocity, s.
    pub seconds: f64,
}

/// A segment of a planned curve.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSegment {
    /// True if the segment bends.
    pub bends: bool,
    /// Points along the segment, mm.
    pub points: Vec<Vector3<f64>>,
}

/// Results of all growths.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiments {
    /// Robots, in the order of [`ROBOTS`].
    pub robots: Vec<Robot>,
    /// Growths between random poses.
    pub sets: Vec<GrowthSet>,
    /// Growths with noise along robot A's representative paths.
    pub noise: Vec<GrowthSet>,
    /// Paths of Figures 5 and 7.
    pub examples: Vec<Example>,
}

/// Errors of an experiment.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A built-in robot cannot be read.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// A random pose is invalid.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The planner found no path.
    #[error("robot {robot}, {group} radii, repetition {repetition}: {error}")]
    Plan {
        /// Name of the robot.
        robot: &'static str,
        /// Distance of the group, radii.
        group: u32,
        /// Number of the repetition.
        repetition: usize,
        /// Error of the planner.
        #[source]
        error: PlanError,
    },
}

/// Purpose of a stream of random numbers.
#[derive(Debug, Clone, Copy)]
enum RandomStream {
    Poses = 1,
    GrowthBetweenPoses,
    GrowthWithNoise,
}

/// Identifies one random pair of start and goal: indexes of its robot and group, and the number of the repetition.
#[derive(Debug, Clone, Copy)]
struct TrialId {
    robot: usize,
    group: usize,
    repetition: usize,
}

/// Noise at which open and closed loop are compared between random poses, as a fraction of a layer's growth.
pub const NOISE_OF_FEEDBACK: f64 = 0.1;
/// Sensors of a closed loop. The standard deviations of their noise are 1 % of a layer for the growth, and 0.5 degrees
/// an axis for the direction.
pub const SENSORS: SimulatedSensors = SimulatedSensors {
    noise: SensorNoise { odometry: 0.01, direction: 0.5 / 180.0 * std::f64::consts::PI },
    odometry_scale: 0.0,
    direction: DirectionSensor::Tip,
};

/// Runs the experiments of the request on `threads` threads. `at` receives the number of finished tasks and the number
/// of all tasks.
///
/// # Errors
/// A built-in robot that cannot be read, or poses without a path. Neither has ever occurred.
pub fn run(
    request: &ReproduceRequest,
    threads: usize,
    mut at: impl FnMut(u64, u64),
) -> Result<Experiments, ExperimentError> {
    let robots: Vec<Robot> =
        ROBOTS.iter().map(|robot| robot_file::load(robot.file.as_ref())).collect::<Result<_, _>>()?;
    let tasks: Vec<TrialId> = (0..ROBOTS.len())
        .filter(|robot| request.needs_robot(*robot))
        .flat_map(|robot| (0..GROUPS.len()).map(move |group| (robot, group)))
        .flat_map(|(robot, group)| (0..request.repeat).map(move |repetition| TrialId { robot, group, repetition }))
        .collect();
    let noises = if request.needs_noise() { conditions_with_noise() } else { Vec::new() };
    let noise_tasks: Vec<(usize, Condition)> =
        (0..GROUPS.len()).flat_map(|group| noises.iter().map(move |condition| (group, *condition))).collect();
    let of = (tasks.len() + noise_tasks.len()) as u64;

    let grown =
        parallel::map_on(threads, &tasks, |task| between_poses(request, &robots, task), |done| at(done as u64, of));
    let mut sets: Vec<GrowthSet> = Vec::new();
    let mut first_of_group = 0;
    for (index, growths) in grown.into_iter().enumerate() {
        let growths = growths?;
        if tasks[index].repetition == 0 {
            first_of_group = sets.len();
            sets.extend(growths.iter().map(|growth| GrowthSet {
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
            examples.iter().find(|example| example.growth.robot == paper::ROBOT_A && example.growth.group == *group)?;
        Some(along_example(request, &robots[paper::ROBOT_A], example, *condition))
    };
    let before = tasks.len();
    let noise: Vec<GrowthSet> =
        parallel::map_on(threads, &noise_tasks, with_noise, |done| at((before + done) as u64, of))
            .into_iter()
            .flatten()
            .collect();
    Ok(Experiments { robots, sets, noise, examples })
}

/// Returns the conditions for growths of a robot between random poses. Noise and feedback are for Figure 4 only.
fn conditions(request: &ReproduceRequest, robot: usize, planner: Planner) -> Vec<Condition> {
    let rules = SlicingRule::of_robot(robot).iter();
    let mut conditions: Vec<_> = rules.map(|slicing| Condition::open(planner, *slicing, 0.0)).collect();
    if robot == paper::ROBOT_A && request.has_figure(4) {
        conditions.push(Condition::open(planner, SlicingRule::Exact, NOISE_OF_FEEDBACK));
        conditions.push(Condition::closed(planner, NOISE_OF_FEEDBACK));
    }
    conditions
}

/// Returns the conditions for growths of robot A along its representative paths: open loop with each slicing rule,
/// and closed loop, each without noise and at each level of noise.
fn conditions_with_noise() -> Vec<Condition> {
    let levels = [0.0].into_iter().chain(NOISE);
    let open = SlicingRule::of_robot(paper::ROBOT_A)
        .iter()
        .flat_map(|slicing| levels.clone().map(|noise| Condition::open(Planner::TwoPlane, *slicing, noise)));
    open.chain(levels.clone().map(|noise| Condition::closed(Planner::TwoPlane, noise))).collect()
}

/// Returns the random start and goal of a task.
fn poses_of(request: &ReproduceRequest, robot: &Robot, task: &TrialId) -> Result<Endpoints, PoseError> {
    let names =
        [request.seed, RandomStream::Poses as u64, task.robot as u64, task.group as u64, task.repetition as u64];
    poses::draw(&mut Rng::new(&names), f64::from(GROUPS[task.group]) * robot.description().planning_radius_mm)
}

fn planned(
    robot: &Robot,
    task: &TrialId,
    Endpoints { start, goal }: &Endpoints,
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

/// Returns a seed for the noise of one growth.
fn noise_seed(names: &[u64]) -> u64 {
    (Rng::new(names).uniform() * (1_u64 << 53) as f64) as u64
}

/// Returns the growths between one random start and goal, under all conditions.
fn between_poses(
    request: &ReproduceRequest,
    robots: &[Robot],
    task: &TrialId,
) -> Result<Vec<ExperimentGrowth>, ExperimentError> {
    let robot = &robots[task.robot];
    let poses = poses_of(request, robot, task)?;
    let seed = noise_seed(&[
        request.seed,
        RandomStream::GrowthBetweenPoses as u64,
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

/// Simulates one growth, and returns its errors at the goal.
fn grow(
    robot: &Robot,
    task: &TrialId,
    poses: &Endpoints,
    path: &Path,
    condition: Condition,
    seed: u64,
) -> ExperimentGrowth {
    let Endpoints { start, goal } = poses;
    let disturbance = Disturbance { growth_noise: condition.noise, ..Disturbance::default() };
    let GrownBody { base_from_tip, layers: laid, .. } = if condition.feedback {
        let legs = [Leg { goal: *goal, segment_count: path.len() }];
        let task = simulation::GrowthTask { robot, start: *start, path, legs: &legs };
        grow_closed_loop(&task, &disturbance, &SENSORS, seed, |_, _, base_from_tip| *base_from_tip)
    } else {
        let path = condition.slicing.stepped(robot, path);
        let layers = layers(&path, robot, condition.slicing.slicing(robot)).map(|sliced| sliced.layer);
        grow_open_loop(start, layers, &disturbance, seed, |_| ())
    };
    let path_length = path::length(path);
    ExperimentGrowth {
        robot: task.robot,
        group: task.group,
        repetition: task.repetition,
        condition,
        poses: *poses,
        path_length,
        path_radii: path_length / robot.description().planning_radius_mm,
        layers: laid as usize,
        arrival: Arrival::of(&base_from_tip, goal, path_length),
    }
}

/// Returns the representative paths: robot A's in each group, and one each of robots B and C.
fn examples(request: &ReproduceRequest, robots: &[Robot], sets: &[GrowthSet]) -> Result<Vec<Example>, ExperimentError> {
    /// Group in Figure 7, an index into [`GROUPS`].
    const SHOWN: usize = 1;
    let shown = (0..GROUPS.len()).map(|group| (paper::ROBOT_A, group)).chain([(paper::B, SHOWN), (paper::C, SHOWN)]);
    let mut examples = Vec::new();
    for (robot, group) in shown {
        let condition = Condition::open(Planner::TwoPlane, SlicingRule::of_paper(robot), 0.0);
        let set = sets.iter().find(|set| set.robot == robot && set.group == group && set.condition == condition);
        if let Some(growth) = set.and_then(GrowthSet::representative) {
            examples.push(example(request, &robots[robot], growth)?);
        }
    }
    Ok(examples)
}

/// Simulates a growth without noise again, and returns it with its planned and its grown curve.
fn example(request: &ReproduceRequest, robot: &Robot, growth: &ExperimentGrowth) -> Result<Example, ExperimentError> {
    /// Number of intervals along a bend.
    const POINTS: u32 = 40;
    let task = TrialId { robot: growth.robot, group: growth.group, repetition: growth.repetition };
    let poses = poses_of(request, robot, &task)?;
    let path = planned(robot, &task, &poses, growth.condition.planner)?;
    let mut base_from_segment = poses.start.frame();
    let mut planned = Vec::new();
    for segment in path.iter() {
        let bends = segment.bend() > 0.0;
        let count = if bends { POINTS } else { 1 };
        let points = (0..=count).map(|i| {
            let part = part_of(segment, f64::from(i) / f64::from(count));
            (base_from_segment * part.step()).translation.vector
        });
        planned.push(PlannedSegment { bends, points: points.collect() });
        base_from_segment *= segment.step();
    }
    let slicing = growth.condition.slicing;
    let mut base_from_tip = poses.start.frame();
    let mut grown = vec![poses.start.position()];
    for sliced in layers(&slicing.stepped(robot, &path), robot, slicing.slicing(robot)) {
        base_from_tip *= sliced.layer.step();
        grown.push(base_from_tip.translation.vector);
    }
    // The time follows from the paper's velocity, so a step of the text's length takes as long as four of the table's.
    let step = slicing.step(robot).unwrap_or_default();
    let layer = &robot.description().layer;
    let seconds = growth.layers as f64 * step / layer.height_mm * layer.period_s;
    Ok(Example { growth: *growth, poses, path, planned, grown, seconds })
}

/// Returns the beginning of a segment, up to the fraction `share` of its length.
fn part_of(segment: &path::Segment, share: f64) -> path::Segment {
    use path::Segment::{Arc, Helicoid, Straight};
    match *segment {
        Arc { alpha, bend, length } => Arc { alpha, bend: share * bend, length: share * length },
        Straight { length } => Straight { length: share * length },
        Helicoid { curve, radius, length } => Helicoid { curve, radius, length: share * length },
    }
}

/// Returns the growths of robot A along a representative path under one condition, each with its own random noise.
fn along_example(request: &ReproduceRequest, robot: &Robot, example: &Example, condition: Condition) -> GrowthSet {
    let ExperimentGrowth { robot: index, group, repetition, .. } = example.growth;
    let task = TrialId { robot: index, group, repetition };
    let mut set = GrowthSet { robot: index, group, condition, growths: Vec::new() };
    let times = if condition.noise == 0.0 && !condition.feedback { 1 } else { request.repeat_noise };
    let level = (1e6 * condition.noise) as u64;
    for repetition in 0..times {
        let names = [request.seed, RandomStream::GrowthWithNoise as u64, group as u64, level, repetition as u64];
        let growth = grow(robot, &task, &example.poses, &example.path, condition, noise_seed(&names));
        set.growths.push(ExperimentGrowth { repetition, ..growth });
    }
    set
}
