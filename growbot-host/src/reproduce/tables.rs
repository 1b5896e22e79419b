//! Every number as CSV and JSON, and the summary that is printed.

use std::fmt::Write;

use growbot_core::plan::Planner;
use serde::Serialize;
use serde_json::{Value, json};

use super::comparison::{Question, capital, p_text};
use super::experiments::{Cutting, NOISE_OF_FEEDBACK, Quantity, Set, planner_name};
use super::paper::{self, GROUPS, PaperRobot, ROBOTS};
use super::statistics::Summary;
use super::{Reproduction, ResultFile};

/// A robot of Tables 1 and 3: the paper's numbers, and ours from its description.
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

/// A growth.
#[derive(Debug, Serialize)]
struct GrowthRow {
    experiment: &'static str,
    robot: &'static str,
    group_radii: u32,
    repetition: usize,
    planner: &'static str,
    cutting: &'static str,
    step_mm: Option<f64>,
    #[serde(rename = "loop")]
    loop_name: &'static str,
    noise_percent: f64,
    path_length_mm: f64,
    path_length_over_radius: f64,
    layers: usize,
    position_error_mm: f64,
    position_error_over_length: f64,
    heading_error_deg: f64,
    pitch_error_deg: f64,
    direction_error_deg: f64,
}

/// A quantity of a set of growths.
#[derive(Debug, Serialize)]
struct SummaryRow {
    experiment: &'static str,
    robot: &'static str,
    group_radii: u32,
    planner: &'static str,
    cutting: &'static str,
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

/// A significance test.
#[derive(Debug, Serialize)]
struct TestRow<'a> {
    what: &'a str,
    cutting: &'a str,
    planner: &'static str,
    groups: usize,
    n: usize,
    kruskal_wallis_h: Option<f64>,
    kruskal_wallis_p: Option<f64>,
    anova_f: Option<f64>,
    anova_p: Option<f64>,
    p_paper: Option<f64>,
}

/// A point of a curve in Figures 5 and 7.
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

/// What of the paper's robots our descriptions say: `g`, `phi` and `k` follow from step, time and radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// The paper's.
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
    /// Growth velocity, mm/s.
    #[must_use]
    pub fn g_mm_per_s(&self) -> f64 {
        self.step_mm / self.dt_s
    }

    /// Bending, rad/s.
    #[must_use]
    pub fn phi_rad_per_s(&self) -> f64 {
        self.g_mm_per_s() / self.radius_mm
    }

    /// Bending, radians a step.
    #[must_use]
    pub fn k(&self) -> f64 {
        self.step_mm / self.radius_mm
    }
}

/// The robots of Table 1 or Table 3, as they are described here.
#[must_use]
pub fn parameters(of: &Reproduction, table: u8) -> Vec<Parameters> {
    let wanted = |robot: &usize| match table {
        1 => *robot < paper::B,
        _ => matches!(*robot, paper::A | paper::B | paper::C),
    };
    (0..ROBOTS.len())
        .filter(wanted)
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

/// All sets, with the name of their experiment.
fn sets(of: &Reproduction) -> impl Iterator<Item = (&'static str, &Set)> {
    let random = of.experiments.sets.iter().map(|set| ("random-poses", set));
    random.chain(of.experiments.noise.iter().map(|set| ("noise", set)))
}

fn growth_rows(of: &Reproduction) -> impl Iterator<Item = GrowthRow> {
    sets(of).flat_map(|(experiment, set)| set.growths.iter().map(move |growth| (experiment, growth))).map(
        move |(experiment, growth)| GrowthRow {
            experiment,
            robot: ROBOTS[growth.robot].name,
            group_radii: GROUPS[growth.group],
            repetition: growth.repetition,
            planner: planner_name(growth.condition.planner),
            cutting: growth.condition.cutting.name(),
            step_mm: growth.condition.cutting.step(&of.experiments.robots[growth.robot]),
            loop_name: growth.condition.loop_name(),
            noise_percent: 100.0 * growth.condition.noise,
            path_length_mm: growth.path_length,
            path_length_over_radius: growth.path_radii,
            layers: growth.layers,
            position_error_mm: growth.arrival.position_error_mm,
            position_error_over_length: growth.arrival.normalized_position_error,
            heading_error_deg: growth.arrival.heading_error_deg,
            pitch_error_deg: growth.arrival.pitch_error_deg,
            direction_error_deg: growth.arrival.direction_error_deg,
        },
    )
}

fn summary_rows(of: &Reproduction) -> impl Iterator<Item = SummaryRow> {
    sets(of).flat_map(move |(experiment, set)| {
        Quantity::ALL.into_iter().map(move |quantity| {
            let Summary { n, mean, sd, median, p95 } = set.summary(quantity);
            let condition = &set.condition;
            let is_table2 = experiment == "random-poses"
                && quantity == Quantity::Position
                && condition.noise == 0.0
                && !condition.feedback;
            let paper = ROBOTS[set.robot].position_error.filter(|_| is_table2).map(|groups| groups[set.group]);
            SummaryRow {
                experiment,
                robot: ROBOTS[set.robot].name,
                group_radii: GROUPS[set.group],
                planner: planner_name(condition.planner),
                cutting: condition.cutting.name(),
                step_mm: condition.cutting.step(&of.experiments.robots[set.robot]),
                loop_name: condition.loop_name(),
                noise_percent: 100.0 * condition.noise,
                quantity: quantity.name(),
                n,
                mean,
                sd,
                median,
                p95,
                mean_paper: paper.map(|(mean, _)| mean),
                sd_paper: paper.map(|(_, sd)| sd),
            }
        })
    })
}

fn test_row(question: &Question) -> TestRow<'_> {
    TestRow {
        what: &question.what,
        cutting: &question.cutting,
        planner: planner_name(question.planner),
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
        let figure = if growth.robot == paper::A { 5 } else { 7 };
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
        for (index, (_, points)) in example.planned.iter().enumerate() {
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

/// The CSV files; those without a row are left out.
///
/// # Errors
/// A number that cannot be written.
pub fn files(of: &Reproduction) -> Result<Vec<ResultFile>, csv::Error> {
    let tables = [1, 3].into_iter().filter(|table| of.request.has_table(*table));
    let mut files = Vec::new();
    for table in tables {
        files.extend(csv_of(&format!("table{table}.csv"), robot_rows(of, table))?);
    }
    files.extend(csv_of("summary.csv", summary_rows(of))?);
    files.extend(csv_of("tests.csv", of.comparison.questions.iter().map(test_row))?);
    files.extend(csv_of("growths.csv", growth_rows(of))?);
    files.extend(csv_of("paths.csv", point_rows(of))?);
    Ok(files)
}

/// The results as JSON: all but the single growths.
#[must_use]
pub fn json(of: &Reproduction) -> Value {
    let robots: Vec<RobotRow> = [1, 3]
        .into_iter()
        .filter(|table| of.request.has_table(*table))
        .flat_map(|table| robot_rows(of, table))
        .collect();
    let exact = of.comparison.exact.map(|(position, direction, growths)| {
        json!({
            "growths": growths,
            "greatest_position_error_over_length": position,
            "greatest_direction_error_rad": direction,
        })
    });
    json!({
        "seed": of.request.seed,
        "tables": of.request.tables,
        "figures": of.request.figures,
        "repeat": of.request.repeat,
        "repeat_noise": of.request.repeat_noise,
        "robots": robots,
        "summaries": summary_rows(of).collect::<Vec<_>>(),
        "tests": of.comparison.questions.iter().map(test_row).collect::<Vec<_>>(),
        "exact_slicing_without_noise": exact,
    })
}

/// A short table for people, 80 columns wide.
#[must_use]
pub fn summary(of: &Reproduction) -> String {
    let request = &of.request;
    let mut text = format!(
        "Del Dottore et al. 2019, by growbot {}: seed {}\n{} growths in each group, {} at each level of noise; two-plane paths\n",
        env!("CARGO_PKG_VERSION"),
        request.seed,
        request.repeat,
        request.repeat_noise
    );
    for table in [1, 3].into_iter().filter(|table| request.has_table(*table)) {
        parameters_text(&mut text, of, table);
    }
    if request.has_table(2) {
        table2_text(&mut text, of);
    }
    quoted_text(&mut text, of);
    noise_text(&mut text, of);
    feedback_text(&mut text, of);
    tests_text(&mut text, of);
    if let Some((position, direction, growths)) = of.comparison.exact {
        let _ = writeln!(
            text,
            "\nExact slicing, no noise, {growths} growths: at most {position:.0e} of the length, {direction:.0e} rad."
        );
    }
    text
}

// Writing to a String cannot fail, so what `writeln!` says of it is let go.

fn parameters_text(text: &mut String, of: &Reproduction, table: u8) {
    let _ = writeln!(text, "\nTable {table}  dt, s   g, mm/s  R, mm  step, mm  phi, rad/s (paper)        k (paper)");
    for of in parameters(of, table) {
        let _ = writeln!(
            text,
            "{:<7} {:>5} {:>9} {:>6} {:>9} {:>10.4} ({:.4}) {:>8.4} ({:.4})",
            of.paper.name,
            of.dt_s,
            libm::round(1e6 * of.g_mm_per_s()) / 1e6,
            of.radius_mm,
            of.step_mm,
            of.phi_rad_per_s(),
            of.paper.phi_rad_per_s,
            of.k(),
            of.paper.k
        );
    }
}

fn groups_heading() -> String {
    GROUPS.iter().map(|group| format!("{:>16}", format!("{group} R"))).collect()
}

fn table2_text(text: &mut String, of: &Reproduction) {
    let _ = writeln!(text, "\nTable 2: position error over the path's length, mean +- SD, steps of 3.096 mm");
    let _ = writeln!(text, "              {}", groups_heading());
    for (robot, paper) in ROBOTS.iter().enumerate() {
        let Some(groups) = paper.position_error else { continue };
        let cells = |numbers: &mut dyn Iterator<Item = (f64, f64)>| -> String {
            numbers.map(|(mean, sd)| format!("{:>16}", format!("{mean:.4}+-{sd:.4}"))).collect()
        };
        let ours = of
            .comparison
            .table2
            .iter()
            .filter(|cell| (cell.robot, cell.planner, cell.cutting) == (robot, Planner::TwoPlane, Cutting::Text));
        let _ = writeln!(text, "{:<4} paper     {}", paper.name, cells(&mut groups.into_iter()));
        let _ = writeln!(text, "     growbot   {}", cells(&mut ours.map(|cell| (cell.ours.mean, cell.ours.sd))));
    }
    let count = |cutting: Cutting| {
        let cells: Vec<_> = of
            .comparison
            .table2
            .iter()
            .filter(|cell| cell.cutting == cutting && cell.planner == Planner::TwoPlane)
            .collect();
        (cells.iter().filter(|cell| cell.is_within()).count(), cells.len())
    };
    let ((text_within, all), (table_within, _)) = (count(Cutting::Text), count(Cutting::Table));
    let _ = writeln!(
        text,
        "{text_within} of {all} means lie within the paper's mean +- SD; with steps of 0.774 mm {table_within} do."
    );
}

fn quoted_text(text: &mut String, of: &Reproduction) {
    for quoted in &of.comparison.quoted {
        let digits = quoted.decimals;
        let (mean, sd) = quoted.paper;
        let _ = writeln!(text, "\n{}\n  {:<38} {mean:>8.digits$} +- {sd:.digits$}", capital(quoted.what), "the paper");
        for (label, mean, sd) in &quoted.ours {
            // Exact slicing has a line of its own.
            if *mean > 1e-9 {
                let _ = writeln!(text, "  {label:<38} {mean:>8.digits$} +- {sd:.digits$}");
            }
        }
    }
}

fn noise_text(text: &mut String, of: &Reproduction) {
    if of.experiments.noise.is_empty() {
        return;
    }
    let _ = writeln!(text, "\nFigure 6: mean position error over the path's length, by noise of the growth");
    let _ = writeln!(text, "{:<32}{:>9}{:>9}{:>9}{:>9}{:>9}", "", "0 %", "1 %", "2 %", "5 %", "10 %");
    for sets in of.experiments.noise.chunk_by(|a, b| {
        (a.group, a.condition.cutting, a.condition.feedback) == (b.group, b.condition.cutting, b.condition.feedback)
    }) {
        let Some(first) = sets.first() else { continue };
        let cutting = first.condition.cutting.step(&of.experiments.robots[first.robot]).map_or_else(
            || "exact slicing".to_owned(),
            |step| format!("steps of {} mm", libm::round(step * 1e6) / 1e6),
        );
        let feedback = if first.condition.feedback { ", closed loop" } else { "" };
        let means: String =
            sets.iter().map(|set| format!("{:>9}", error_text(set.summary(Quantity::Position).mean))).collect();
        let _ = writeln!(text, "{:>2} R {:<27}{means}", GROUPS[first.group], format!("{cutting}{feedback}"));
    }
}

fn feedback_text(text: &mut String, of: &Reproduction) {
    let sets = || {
        let noisy = of.experiments.sets.iter().filter(|set| set.condition.noise > 0.0);
        noisy.filter(|set| set.condition.planner == Planner::TwoPlane)
    };
    if sets().next().is_none() {
        return;
    }
    let _ = writeln!(
        text,
        "\nRobot A, noise of +-{} %, exact slicing: position error over length, direction",
        100.0 * NOISE_OF_FEEDBACK
    );
    let heading: String = GROUPS.iter().map(|group| format!("{:>17}", format!("{group} R"))).collect();
    let _ = writeln!(text, "            {heading}");
    for (name, quantity, feedback) in [
        ("open", Quantity::Position, false),
        ("closed", Quantity::Position, true),
        ("open, deg", Quantity::Direction, false),
        ("closed, deg", Quantity::Direction, true),
    ] {
        let _ = write!(text, "{name:<12}");
        for set in sets().filter(|set| set.condition.feedback == feedback) {
            let summary = set.summary(quantity);
            let cell = match quantity {
                Quantity::Position => format!("{:.5}+-{:.5}", summary.mean, summary.sd),
                _ => format!("{:.3}+-{:.3}", summary.mean, summary.sd),
            };
            let _ = write!(text, "{cell:>17}");
        }
        text.push('\n');
    }
}

/// An error over a length as it is read.
#[must_use]
pub fn error_text(error: f64) -> String {
    if error < 5e-6 { format!("{error:.0e}") } else { format!("{error:.5}") }
}

fn tests_text(text: &mut String, of: &Reproduction) {
    let quoted: Vec<&Question> = of
        .comparison
        .questions
        .iter()
        .filter(|question| question.paper.is_some() && question.planner == Planner::TwoPlane)
        .collect();
    if quoted.is_empty() {
        return;
    }
    let _ = writeln!(text, "\n{:<50}{:>8}{:>11}{:>11}", "p: do groups differ?", "paper", "K.-Wallis", "ANOVA");
    let mut before = "";
    for question in quoted {
        if question.what != before {
            let _ = writeln!(text, "{}", capital(&question.what));
            before = &question.what;
        }
        let p = |test: Option<super::statistics::Test>| test.map_or("-".to_owned(), |test| p_text(test.p));
        let _ = writeln!(
            text,
            "  {:<48}{:>8.4}{:>11}{:>11}",
            question.cutting,
            question.paper.unwrap_or_default(),
            p(question.kruskal_wallis),
            p(question.anova)
        );
    }
}
