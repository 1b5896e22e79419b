//! All numbers as CSV files and as JSON.

use serde::Serialize;
use serde_json::{Value, json};

use super::comparison::{ExactErrors, SignificanceTest};
use super::experiments::{ErrorQuantity, ExperimentGrowth, GrowthSet, PlannedSegment, SENSORS};
use super::paper::{self, GROUPS, PaperRobot, ROBOTS};
use super::reproduction::{Reproduction, ResultFile};
use super::statistics::{MeanComparison, SampleSummary};
use super::table2::Cell;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

/// Row of a robot of Tables 1 and 3: the paper's numbers, and ours from its description.
#[derive(Debug, Serialize)]
struct RobotRow {
    robot: &'static str,
    description: &'static str,
    dt_s: f64,
    dt_s_paper: f64,
    g_mm_per_s: f64,
    g_mm_per_s_paper: f64,
    radius_mm: f64,
    radius_mm_paper: f64,
    tip_radius_mm: f64,
    step_mm: f64,
    phi_rad_per_s: f64,
    phi_rad_per_s_paper: f64,
    k: f64,
    k_paper: f64,
}

/// Row of a growth.
#[derive(Debug, Serialize)]
struct GrowthRow {
    experiment: &'static str,
    robot: &'static str,
    group_radii: u32,
    repetition: usize,
    planner: &'static str,
    slicing: &'static str,
    step_mm: Option<f64>,
    #[serde(rename = "loop")]
    loop_name: &'static str,
    noise_percent: f64,
    start_x_mm: f64,
    start_y_mm: f64,
    start_z_mm: f64,
    start_heading_deg: f64,
    start_pitch_deg: f64,
    goal_x_mm: f64,
    goal_y_mm: f64,
    goal_z_mm: f64,
    goal_heading_deg: f64,
    goal_pitch_deg: f64,
    path_length_mm: f64,
    path_length_over_radius: f64,
    layers: usize,
    position_error_mm: f64,
    position_error_over_length: f64,
    heading_error_deg: f64,
    pitch_error_deg: f64,
    direction_error_deg: f64,
}

/// Row with the statistics of one quantity over a set of growths.
#[derive(Debug, Serialize)]
struct SummaryRow {
    experiment: &'static str,
    robot: &'static str,
    group_radii: u32,
    planner: &'static str,
    slicing: &'static str,
    step_mm: Option<f64>,
    #[serde(rename = "loop")]
    loop_name: &'static str,
    noise_percent: f64,
    quantity: &'static str,
    n: usize,
    mean: f64,
    sd: f64,
    median: f64,
    p95: f64,
    mean_paper: Option<f64>,
    sd_paper: Option<f64>,
}

/// Row of a mean of Table 2: ours, the paper's, and the tests for difference and equivalence. p-values for the
/// difference are two-sided. Values with `_holm` are corrected for all means of one planner and slicing.
#[derive(Debug, Serialize)]
struct Table2Row {
    robot: &'static str,
    group_radii: u32,
    planner: &'static str,
    slicing: &'static str,
    n: usize,
    mean: f64,
    sd: f64,
    n_paper: usize,
    mean_paper: f64,
    sd_paper: f64,
    within_sd_of_paper: bool,
    comparisons: usize,
    welch_t: Option<f64>,
    welch_df: Option<f64>,
    welch_p: Option<f64>,
    welch_p_holm: Option<f64>,
    differs: Option<bool>,
    equivalence_margin: f64,
    tost_p: Option<f64>,
    tost_p_holm: Option<f64>,
    equivalent: Option<bool>,
}

/// Row of a significance test.
#[derive(Debug, Serialize)]
struct TestRow<'a> {
    what: &'a str,
    slicing: &'a str,
    planner: &'static str,
    groups: usize,
    n: usize,
    kruskal_wallis_h: Option<f64>,
    kruskal_wallis_p: Option<f64>,
    anova_f: Option<f64>,
    anova_p: Option<f64>,
    p_paper: Option<f64>,
}

/// Row of a point on a curve in Figures 5 and 7.
#[derive(Debug, Serialize)]
struct PointRow {
    figure: u8,
    robot: &'static str,
    group_radii: u32,
    repetition: usize,
    curve: &'static str,
    segment: Option<usize>,
    x_mm: f64,
    y_mm: f64,
    z_mm: f64,
}

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

fn robot_rows(of: &Reproduction, table: u8) -> Vec<RobotRow> {
    let row = |parameters: Parameters| RobotRow {
        robot: parameters.paper.name,
        description: parameters.paper.file,
        dt_s: parameters.dt_s,
        dt_s_paper: parameters.paper.dt_s,
        g_mm_per_s: parameters.g_mm_per_s(),
        g_mm_per_s_paper: 10.0 * parameters.paper.g_cm_per_s,
        radius_mm: parameters.radius_mm,
        radius_mm_paper: 10.0 * parameters.paper.radius_cm,
        tip_radius_mm: parameters.tip_radius_mm,
        step_mm: parameters.step_mm,
        phi_rad_per_s: parameters.phi_rad_per_s(),
        phi_rad_per_s_paper: parameters.paper.phi_rad_per_s,
        k: parameters.k(),
        k_paper: parameters.paper.k,
    };
    parameters(of, table).into_iter().map(row).collect()
}

/// Returns all sets of growths, with the name of their experiment.
fn sets(of: &Reproduction) -> impl Iterator<Item = (&'static str, &GrowthSet)> {
    let random = of.experiments.sets.iter().map(|set| ("random-poses", set));
    random.chain(of.experiments.noise.iter().map(|set| ("noise", set)))
}

fn growth_rows(of: &Reproduction) -> impl Iterator<Item = GrowthRow> {
    let robots = &of.experiments.robots;
    sets(of).flat_map(move |(experiment, set)| {
        set.growths.iter().map(move |growth| growth_row(experiment, growth, &robots[growth.robot]))
    })
}

fn growth_row(experiment: &'static str, growth: &ExperimentGrowth, robot: &Robot) -> GrowthRow {
    let [start, goal] = [&growth.poses.start, &growth.poses.goal].map(Pose::to_degrees);
    GrowthRow {
        experiment,
        robot: ROBOTS[growth.robot].name,
        group_radii: GROUPS[growth.group],
        repetition: growth.repetition,
        planner: growth.condition.planner.name(),
        slicing: growth.condition.slicing.name(),
        step_mm: growth.condition.slicing.step(robot),
        loop_name: growth.condition.loop_name(),
        noise_percent: 100.0 * growth.condition.noise,
        start_x_mm: start[0],
        start_y_mm: start[1],
        start_z_mm: start[2],
        start_heading_deg: start[3],
        start_pitch_deg: start[4],
        goal_x_mm: goal[0],
        goal_y_mm: goal[1],
        goal_z_mm: goal[2],
        goal_heading_deg: goal[3],
        goal_pitch_deg: goal[4],
        path_length_mm: growth.path_length,
        path_length_over_radius: growth.path_radii,
        layers: growth.layers,
        position_error_mm: growth.arrival.position_error_mm,
        position_error_over_length: growth.arrival.normalized_position_error,
        heading_error_deg: ErrorQuantity::Heading.of(growth),
        pitch_error_deg: growth.arrival.pitch_error_deg,
        direction_error_deg: growth.arrival.direction_error_deg,
    }
}

fn summary_rows(of: &Reproduction) -> impl Iterator<Item = SummaryRow> {
    sets(of).flat_map(move |(experiment, set)| {
        ErrorQuantity::ALL.into_iter().map(move |quantity| {
            let SampleSummary { n, mean, sd, median, p95 } = set.summary(quantity);
            let condition = &set.condition;
            let is_table2 = experiment == "random-poses"
                && quantity == ErrorQuantity::Position
                && condition.noise == 0.0
                && !condition.feedback;
            let paper = ROBOTS[set.robot].position_error.filter(|_| is_table2).map(|groups| groups[set.group]);
            SummaryRow {
                experiment,
                robot: ROBOTS[set.robot].name,
                group_radii: GROUPS[set.group],
                planner: condition.planner.name(),
                slicing: condition.slicing.name(),
                step_mm: condition.slicing.step(&of.experiments.robots[set.robot]),
                loop_name: condition.loop_name(),
                noise_percent: 100.0 * condition.noise,
                quantity: quantity.name(),
                n,
                mean,
                sd,
                median,
                p95,
                mean_paper: paper.map(|paper| paper.mean),
                sd_paper: paper.map(|paper| paper.sd),
            }
        })
    })
}

fn table2_row(cell: &Cell) -> Table2Row {
    let tests = cell.tests.as_ref();
    Table2Row {
        robot: ROBOTS[cell.robot].name,
        group_radii: GROUPS[cell.group],
        planner: cell.planner.name(),
        slicing: cell.slicing.name(),
        n: cell.ours.n,
        mean: cell.ours.mean,
        sd: cell.ours.sd,
        n_paper: paper::REPEAT,
        mean_paper: cell.paper.mean,
        sd_paper: cell.paper.sd,
        within_sd_of_paper: cell.is_within(),
        comparisons: cell.comparisons,
        welch_t: tests.map(|tests| tests.welch.statistic),
        welch_df: tests.map(|tests| tests.degrees_of_freedom),
        welch_p: tests.map(|tests| tests.welch.p),
        welch_p_holm: tests.map(|tests| tests.p_holm),
        differs: tests.map(MeanComparison::differs),
        equivalence_margin: cell.margin(),
        tost_p: tests.map(|tests| tests.tost_p),
        tost_p_holm: tests.map(|tests| tests.tost_p_holm),
        equivalent: tests.map(MeanComparison::is_equivalent),
    }
}

fn test_row(question: &SignificanceTest) -> TestRow<'_> {
    TestRow {
        what: &question.what,
        slicing: &question.slicing,
        planner: question.planner.name(),
        groups: question.groups,
        n: question.n,
        kruskal_wallis_h: question.kruskal_wallis.map(|test| test.statistic),
        kruskal_wallis_p: question.kruskal_wallis.map(|test| test.p),
        anova_f: question.anova.map(|test| test.statistic),
        anova_p: question.anova.map(|test| test.p),
        p_paper: question.paper,
    }
}

fn point_rows(of: &Reproduction) -> Vec<PointRow> {
    let mut rows = Vec::new();
    for example in &of.experiments.examples {
        let growth = &example.growth;
        let figure = if growth.robot == paper::ROBOT_A { 5 } else { 7 };
        if !of.request.has_figure(figure) {
            continue;
        }
        let mut push = |curve, segment, point: &nalgebra::Vector3<f64>| {
            rows.push(PointRow {
                figure,
                robot: ROBOTS[growth.robot].name,
                group_radii: GROUPS[growth.group],
                repetition: growth.repetition,
                curve,
                segment,
                x_mm: point.x,
                y_mm: point.y,
                z_mm: point.z,
            });
        };
        for (index, PlannedSegment { points, .. }) in example.planned.iter().enumerate() {
            points.iter().for_each(|point| push("planned", Some(index), point));
        }
        example.grown.iter().for_each(|point| push("grown", None, point));
    }
    rows
}

fn csv_of<T: Serialize>(name: &str, rows: impl IntoIterator<Item = T>) -> Result<Option<ResultFile>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
    let contents = String::from_utf8_lossy(&bytes).into_owned();
    Ok((!contents.is_empty()).then(|| ResultFile { name: name.to_owned(), contents }))
}

/// Returns the CSV files. A file without rows is omitted.
///
/// # Errors
/// A number that cannot be written.
pub fn files(of: &Reproduction) -> Result<Vec<ResultFile>, csv::Error> {
    let tables = [1, 3].into_iter().filter(|table| of.request.has_table(*table));
    let mut files = Vec::new();
    for table in tables {
        files.extend(csv_of(&format!("table{table}.csv"), robot_rows(of, table))?);
    }
    if of.request.has_table(2) {
        files.extend(csv_of("table2.csv", of.comparison.table2.iter().map(table2_row))?);
    }
    files.extend(csv_of("summary.csv", summary_rows(of))?);
    files.extend(csv_of("tests.csv", of.comparison.questions.iter().map(test_row))?);
    files.extend(csv_of("growths.csv", growth_rows(of))?);
    files.extend(csv_of("paths.csv", point_rows(of))?);
    Ok(files)
}

/// Returns the results as JSON, without the single growths.
pub fn json(of: &Reproduction) -> Value {
    let robots: Vec<RobotRow> = [1, 3]
        .into_iter()
        .filter(|table| of.request.has_table(*table))
        .flat_map(|table| robot_rows(of, table))
        .collect();
    let exact = of.comparison.exact.map(|ExactErrors { max_position, max_direction, growths }| {
        json!({
            "growths": growths,
            "max_position_error_over_length": max_position,
            "max_direction_error_rad": max_direction,
        })
    });
    json!({
        "seed": of.request.seed,
        "tables": of.request.tables,
        "figures": of.request.figures,
        "repeat": of.request.repeat,
        "repeat_noise": of.request.repeat_noise,
        "disturbances": {
            "growth_noise": { "distribution": "uniform", "half_width": "noise_percent", "unit": "percent" },
            "odometry_noise": {
                "distribution": "normal", "standard_deviation": 100.0 * SENSORS.noise.odometry, "unit": "percent",
                "loop": "closed",
            },
            "direction_noise": {
                "distribution": "normal", "standard_deviation": SENSORS.noise.direction.to_degrees(), "unit": "deg",
                "loop": "closed",
            },
        },
        "robots": robots,
        "table2": of.comparison.table2.iter().map(table2_row).collect::<Vec<_>>(),
        "summaries": summary_rows(of).collect::<Vec<_>>(),
        "tests": of.comparison.questions.iter().map(test_row).collect::<Vec<_>>(),
        "exact_slicing_without_noise": exact,
    })
}
