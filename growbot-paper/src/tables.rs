//! All numbers as CSV files and as JSON.

use growbot_core::robot::Robot;
use growbot_plan::table::{NumberFormat, Row, Table, pose_columns};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::Serialize;

use super::comparison::{ExactErrors, SignificanceTest};
use super::experiments::{Condition, ErrorQuantity, Example, ExperimentGrowth, GrowthSet, PlannedSegment, SENSORS};
use super::paper::{self, GROUPS, PaperRobot, ROBOTS};
use super::reproduction::{Reproduction, ResultFile};
use super::statistics::{MeanComparison, SampleSummary};
use super::table2::Cell;

/// Parameters of a robot of the paper. Ours come from its description: `g`, `phi` and `k` follow from step, time and
/// radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Robot with the paper's numbers.
    pub paper: PaperRobot,
    /// Time for a step, s.
    pub dt_s: f64,
    /// Height of a step, mm.
    pub step_mm: f64,
    /// Radius of arcs, mm.
    pub radius_mm: f64,
    /// Radius of the tip, mm.
    pub tip_radius_mm: f64,
}

impl Parameters {
    /// Returns the growth velocity, mm/s.
    pub fn g_mm_per_s(&self) -> f64 {
        self.step_mm / self.dt_s
    }

    /// Returns the bending rate, rad/s.
    pub fn phi_rad_per_s(&self) -> f64 {
        self.g_mm_per_s() / self.radius_mm
    }

    /// Returns the bend of one step, radians.
    pub fn k(&self) -> f64 {
        self.step_mm / self.radius_mm
    }
}

/// Returns the parameters of the robots in Table 1 or Table 3.
pub fn parameters(of: &Reproduction, table: u8) -> Vec<Parameters> {
    let shown = |robot: &usize| match table {
        1 => *robot < paper::B,
        _ => matches!(*robot, paper::ROBOT_A | paper::B | paper::C),
    };
    (0..ROBOTS.len())
        .filter(shown)
        .map(|robot| {
            let description = of.experiments.robots[robot].description();
            Parameters {
                paper: ROBOTS[robot],
                dt_s: description.layer.period_s,
                step_mm: description.layer.height_mm,
                radius_mm: description.planning_radius_mm,
                tip_radius_mm: description.geometry.tip_radius_mm,
            }
        })
        .collect()
}

fn robots() -> Table<'static, Parameters> {
    Table::new(NumberFormat::Fraction)
        .column("robot", |of: &Parameters| of.paper.name)
        .column("description", |of| of.paper.file)
        .column("dt_s", |of| of.dt_s)
        .column("dt_s_paper", |of| of.paper.dt_s)
        .column("g_mm_per_s", Parameters::g_mm_per_s)
        .column("g_mm_per_s_paper", |of| 10.0 * of.paper.g_cm_per_s)
        .column("radius_mm", |of| of.radius_mm)
        .column("radius_mm_paper", |of| 10.0 * of.paper.radius_cm)
        .column("tip_radius_mm", |of| of.tip_radius_mm)
        .column("step_mm", |of| of.step_mm)
        .column("phi_rad_per_s", Parameters::phi_rad_per_s)
        .column("phi_rad_per_s_paper", |of| of.paper.phi_rad_per_s)
        .column("k", Parameters::k)
        .column("k_paper", |of| of.paper.k)
}

/// Name of an experiment, condition of its growths, and their robot.
type GrownBody<'a, T> = (&'static str, &'a T, &'a Robot);

/// Returns all sets of growths, with their experiment and robot.
fn sets(of: &Reproduction) -> impl Iterator<Item = GrownBody<'_, GrowthSet>> {
    let random = of.experiments.sets.iter().map(|set| ("random-poses", set));
    let all = random.chain(of.experiments.noise.iter().map(|set| ("noise", set)));
    all.map(|(experiment, set)| (experiment, set, &of.experiments.robots[set.robot]))
}

/// Adds the columns of the condition of growths by a robot.
fn condition_columns<'a, R>(
    table: Table<'a, R>,
    condition: impl Fn(&R) -> (Condition, &Robot) + Copy + 'a,
) -> Table<'a, R> {
    table
        .column("planner", move |row| condition(row).0.planner.name())
        .column("slicing", move |row| condition(row).0.slicing.name())
        .column("step_mm", move |row| {
            let (condition, robot) = condition(row);
            condition.slicing.step(robot)
        })
        .column("loop", move |row| condition(row).0.loop_name())
        .column("noise_percent", move |row| 100.0 * condition(row).0.noise)
}

fn growths<'a>() -> Table<'static, GrownBody<'a, ExperimentGrowth>> {
    let table = Table::new(NumberFormat::Fraction)
        .column("experiment", |(experiment, ..): &GrownBody<'a, ExperimentGrowth>| *experiment)
        .column("robot", |(_, growth, _)| ROBOTS[growth.robot].name)
        .column("group_radii", |(_, growth, _)| GROUPS[growth.group])
        .column("repetition", |(_, growth, _)| growth.repetition);
    condition_columns(table, |(_, growth, robot)| (growth.condition, robot))
        .columns(pose_columns("start"), |(_, growth, _)| growth.poses.start.to_degrees())
        .columns(pose_columns("goal"), |(_, growth, _)| growth.poses.goal.to_degrees())
        .column("path_length_mm", |(_, growth, _)| growth.path_length)
        .column("path_length_over_radius", |(_, growth, _)| growth.path_radii)
        .column("layers", |(_, growth, _)| growth.layers)
        .column("position_error_mm", |(_, growth, _)| growth.arrival.position_error_mm)
        .column("position_error_over_length", |(_, growth, _)| growth.arrival.normalized_position_error)
        .column("heading_error_deg", |(_, growth, _)| ErrorQuantity::Heading.of(growth))
        .column("pitch_error_deg", |(_, growth, _)| growth.arrival.pitch_error_deg)
        .column("direction_error_deg", |(_, growth, _)| growth.arrival.direction_error_deg)
}

/// A set of growths, and one of their quantities.
type Summarized<'a> = (GrownBody<'a, GrowthSet>, ErrorQuantity);

/// Returns the table with the statistics of one quantity over a set of growths in each row.
fn summaries<'a>() -> Table<'static, Summarized<'a>> {
    let paper = |((experiment, set, _), quantity): &Summarized<'a>| {
        let is_table2 = *experiment == "random-poses"
            && *quantity == ErrorQuantity::Position
            && set.condition.noise == 0.0
            && !set.condition.feedback;
        ROBOTS[set.robot].position_error.filter(|_| is_table2).map(|groups| groups[set.group])
    };
    let table = Table::new(NumberFormat::Fraction)
        .column("experiment", |((experiment, ..), _): &Summarized<'a>| *experiment)
        .column("robot", |((_, set, _), _)| ROBOTS[set.robot].name)
        .column("group_radii", |((_, set, _), _)| GROUPS[set.group]);
    condition_columns(table, |((_, set, robot), _)| (set.condition, robot))
        .column("quantity", |(_, quantity)| quantity.name())
        .column("n", |((_, set, _), _)| set.growths.len())
        .columns(["mean", "sd", "median", "p95"], |((_, set, _), quantity)| {
            let SampleSummary { mean, sd, median, p95, .. } = set.summary(*quantity);
            [mean, sd, median, p95]
        })
        .columns(["mean_paper", "sd_paper"], move |row| {
            [paper(row).map(|paper| paper.mean), paper(row).map(|paper| paper.sd)]
        })
}

fn summary_rows(of: &Reproduction) -> impl Iterator<Item = Summarized<'_>> {
    sets(of).flat_map(|set| ErrorQuantity::ALL.map(|quantity| (set, quantity)))
}

/// Returns the table of the means of Table 2: ours, the paper's, and the tests for difference and equivalence. p-values
/// for the difference are two-sided. Values with `_holm` are corrected for all means of one planner and slicing.
fn table2() -> Table<'static, Cell> {
    Table::new(NumberFormat::Fraction)
        .column("robot", |cell: &Cell| ROBOTS[cell.robot].name)
        .column("group_radii", |cell| GROUPS[cell.group])
        .column("planner", |cell| cell.planner.name())
        .column("slicing", |cell| cell.slicing.name())
        .column("n", |cell| cell.ours.n)
        .column("mean", |cell| cell.ours.mean)
        .column("sd", |cell| cell.ours.sd)
        .column("n_paper", |_| paper::REPEAT)
        .column("mean_paper", |cell| cell.paper.mean)
        .column("sd_paper", |cell| cell.paper.sd)
        .column("within_sd_of_paper", Cell::is_within)
        .column("comparisons", |cell| cell.comparisons)
        .column("welch_t", |cell| cell.tests.map(|tests| tests.welch.statistic))
        .column("welch_df", |cell| cell.tests.map(|tests| tests.degrees_of_freedom))
        .column("welch_p", |cell| cell.tests.map(|tests| tests.welch.p))
        .column("welch_p_holm", |cell| cell.tests.map(|tests| tests.p_holm))
        .column("differs", |cell| cell.tests.as_ref().map(MeanComparison::differs))
        .column("equivalence_margin", Cell::margin)
        .column("tost_p", |cell| cell.tests.map(|tests| tests.tost_p))
        .column("tost_p_holm", |cell| cell.tests.map(|tests| tests.tost_p_holm))
        .column("equivalent", |cell| cell.tests.as_ref().map(MeanComparison::is_equivalent))
}

fn significance_tests() -> Table<'static, SignificanceTest> {
    Table::new(NumberFormat::Fraction)
        .column("what", |test: &SignificanceTest| test.what.clone())
        .column("slicing", |test| test.slicing.clone())
        .column("planner", |test| test.planner.name())
        .column("groups", |test| test.groups)
        .column("n", |test| test.n)
        .column("kruskal_wallis_h", |test| test.kruskal_wallis.map(|test| test.statistic))
        .column("kruskal_wallis_p", |test| test.kruskal_wallis.map(|test| test.p))
        .column("anova_f", |test| test.anova.map(|test| test.statistic))
        .column("anova_p", |test| test.anova.map(|test| test.p))
        .column("p_paper", |test| test.paper)
}

/// A point on a curve in Figures 5 and 7: the growth, the name of the curve, its segment, and the position.
type CurvePoint<'a> = (&'a ExperimentGrowth, &'static str, Option<usize>, &'a Vector3<f64>);

/// Returns the number of the figure that shows an example of this robot.
fn figure_of(robot: usize) -> u8 {
    if robot == paper::ROBOT_A { 5 } else { 7 }
}

fn points<'a>() -> Table<'static, CurvePoint<'a>> {
    Table::new(NumberFormat::Fraction)
        .column("figure", |(growth, ..): &CurvePoint<'a>| figure_of(growth.robot))
        .column("robot", |(growth, ..)| ROBOTS[growth.robot].name)
        .column("group_radii", |(growth, ..)| GROUPS[growth.group])
        .column("repetition", |(growth, ..)| growth.repetition)
        .column("curve", |(_, curve, ..)| *curve)
        .column("segment", |(_, _, segment, _)| *segment)
        .columns(["x_mm", "y_mm", "z_mm"], |(.., point)| <[f64; 3]>::from(**point))
}

fn point_rows(of: &Reproduction) -> impl Iterator<Item = CurvePoint<'_>> {
    let shown = |example: &&Example| of.request.has_figure(figure_of(example.growth.robot));
    of.experiments.examples.iter().filter(shown).flat_map(|Example { growth, planned, grown, .. }| {
        let planned = planned.iter().enumerate().flat_map(move |(index, PlannedSegment { points, .. })| {
            points.iter().map(move |point| (growth, "planned", Some(index), point))
        });
        planned.chain(grown.iter().map(move |point| (growth, "grown", None, point)))
    })
}

/// Returns the CSV files. A file without rows is omitted.
pub fn files(of: &Reproduction) -> Vec<ResultFile> {
    let mut files = Vec::new();
    let mut add = |name: &str, contents: String| {
        if contents.lines().nth(1).is_some() {
            files.push(ResultFile { name: name.to_owned(), contents });
        }
    };
    for table in [1, 3].into_iter().filter(|table| of.request.has_table(*table)) {
        add(&format!("table{table}.csv"), robots().csv(parameters(of, table)));
    }
    if of.request.has_table(2) {
        add("table2.csv", table2().csv(&of.comparison.table2));
    }
    add("summary.csv", summaries().csv(summary_rows(of)));
    add("tests.csv", significance_tests().csv(&of.comparison.questions));
    let rows =
        sets(of).flat_map(|(experiment, set, robot)| set.growths.iter().map(move |growth| (experiment, growth, robot)));
    add("growths.csv", growths().csv(rows));
    add("paths.csv", points().csv(point_rows(of)));
    files
}

/// The errors of bodies that are sliced exactly and grown without noise.
#[derive(Debug, Serialize, JsonSchema)]
struct ExactErrorsJson {
    /// Number of growths.
    growths: usize,
    /// Greatest position error, divided by the length of the path.
    max_position_error_over_length: f64,
    /// Greatest direction error, radians.
    max_direction_error_rad: f64,
}

/// The distribution of a random error of layers or sensors.
#[derive(Debug, Serialize, JsonSchema)]
struct NoiseJson {
    /// Name of the distribution.
    distribution: &'static str,
    /// Column with the half-width of a uniform distribution.
    #[serde(skip_serializing_if = "Option::is_none")]
    half_width: Option<&'static str>,
    /// Standard deviation of a normal distribution.
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_deviation: Option<f64>,
    /// Unit of both.
    unit: &'static str,
    /// The loop that has the error, if only one has.
    #[serde(rename = "loop", skip_serializing_if = "Option::is_none")]
    in_loop: Option<&'static str>,
}

impl NoiseJson {
    fn of_sensor(standard_deviation: f64, unit: &'static str) -> Self {
        let (standard_deviation, in_loop) = (Some(standard_deviation), Some("closed"));
        Self { distribution: "normal", half_width: None, standard_deviation, unit, in_loop }
    }
}

/// Random errors of layers and sensors.
#[derive(Debug, Serialize, JsonSchema)]
struct DisturbancesJson {
    growth_noise: NoiseJson,
    odometry_noise: NoiseJson,
    direction_noise: NoiseJson,
}

/// The results of the experiments, without the single growths. The rows of tables have the columns of the CSV files.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ReproductionJson {
    /// Seed of the random numbers.
    seed: u64,
    /// Numbers of the reproduced tables.
    tables: Vec<u8>,
    /// Numbers of the reproduced figures.
    figures: Vec<u8>,
    /// Number of growths of each experiment without noise.
    repeat: usize,
    /// Number of growths of each experiment with noise.
    repeat_noise: usize,
    disturbances: DisturbancesJson,
    /// Parameters of the robots (tables 1 and 3).
    robots: Vec<Row>,
    /// Rows of table 2.
    table2: Vec<Row>,
    /// Errors of each experiment.
    summaries: Vec<Row>,
    /// Tests of the differences between experiments.
    tests: Vec<Row>,
    /// Errors without noise. Null if that experiment was not requested.
    exact_slicing_without_noise: Option<ExactErrorsJson>,
}

impl From<&Reproduction> for ReproductionJson {
    fn from(of: &Reproduction) -> Self {
        let shown = [1, 3].into_iter().filter(|table| of.request.has_table(*table));
        let exact = of.comparison.exact.map(|ExactErrors { max_position, max_direction, growths }| ExactErrorsJson {
            growths,
            max_position_error_over_length: max_position,
            max_direction_error_rad: max_direction,
        });
        let noise = &SENSORS.noise;
        Self {
            seed: of.request.seed,
            tables: of.request.tables.clone(),
            figures: of.request.figures.clone(),
            repeat: of.request.repeat,
            repeat_noise: of.request.repeat_noise,
            disturbances: DisturbancesJson {
                growth_noise: NoiseJson {
                    distribution: "uniform",
                    half_width: Some("noise_percent"),
                    standard_deviation: None,
                    unit: "percent",
                    in_loop: None,
                },
                odometry_noise: NoiseJson::of_sensor(100.0 * noise.odometry, "percent"),
                direction_noise: NoiseJson::of_sensor(noise.direction.to_degrees(), "deg"),
            },
            robots: robots().json(shown.flat_map(|table| parameters(of, table))),
            table2: table2().json(&of.comparison.table2),
            summaries: summaries().json(summary_rows(of)),
            tests: significance_tests().json(&of.comparison.questions),
            exact_slicing_without_noise: exact,
        }
    }
}
