//! The summary that `growbot reproduce` prints, 80 columns wide.

use std::fmt::Write;

use growbot_core::plan::Planner;
use growbot_plan::table::{NumberFormat, Table};

use super::comparison::{ExactErrors, OurMean, SignificanceTest};
use super::experiments::{ErrorQuantity, GrowthSet, NOISE_OF_FEEDBACK};
use super::paper::{GROUPS, MeanSd, ROBOTS};
use super::reproduction::Reproduction;
use super::slicing_rule::SlicingRule;
use super::statistics::{LEVEL, MeanComparison, TestResult};
use super::table2::{Cell, Verdicts};
use super::tables::{Parameters, parameters};
use super::texts::{capital, p_text};

/// Returns the summary, a short text that is 80 columns wide.
pub fn summary(of: &Reproduction) -> String {
    let request = &of.request;
    let mut text = format!(
        "Del Dottore et al. 2019, by growbot {}: seed {}\n\
         {} growths in each group, {} at each level of noise; two-plane paths\n",
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
    if let Some(ExactErrors { max_position, max_direction, growths }) = of.comparison.exact {
        let _ = writeln!(
            text,
            "\nExact slicing, no noise, {growths} growths: at most {max_position:.0e} of the length, \
             {max_direction:.0e} rad."
        );
    }
    text
}

// Writing to a String cannot fail, so the results of `writeln!` are ignored.

fn parameters_text(text: &mut String, of: &Reproduction, table: u8) {
    let _ = writeln!(text, "\nTable {table}  dt, s   g, mm/s  R, mm  step, mm  phi, rad/s (paper)        k (paper)");
    let robots = Table::new(NumberFormat::Plain)
        .column("robot", |of: &Parameters| of.paper.name)
        .column("dt", |of| of.dt_s)
        .column("g", |of| libm::round(1e6 * of.g_mm_per_s()) / 1e6)
        .column("R", |of| of.radius_mm)
        .column("step", |of| of.step_mm)
        .column("phi", |of| format!("{:.4} ({:.4})", of.phi_rad_per_s(), of.paper.phi_rad_per_s))
        .column("k", |of| format!("{:.4} ({:.4})", of.k(), of.paper.k));
    *text += &robots.text_rows(parameters(of, table), &[7, 6, 10, 7, 10, 20, 18]);
}

fn groups_heading() -> String {
    GROUPS.iter().map(|group| format!("{:>16}", format!("{group} R"))).collect()
}

fn table2_text(text: &mut String, of: &Reproduction) {
    let _ = writeln!(text, "\nTable 2: position error over the path's length, mean +- SD, steps of 3.096 mm");
    let _ = writeln!(text, "              {}", groups_heading());
    for (robot, paper) in ROBOTS.iter().enumerate() {
        let Some(groups) = paper.position_error else { continue };
        let cells: Vec<&Cell> = of
            .comparison
            .table2
            .iter()
            .filter(|cell| (cell.robot, cell.planner, cell.slicing) == (robot, Planner::TwoPlane, SlicingRule::Text))
            .collect();
        let means = |means: &mut dyn Iterator<Item = MeanSd>| -> String {
            means.map(|MeanSd { mean, sd }| format!("{:>16}", format!("{mean:.4}+-{sd:.4}"))).collect()
        };
        let p_values = |p: fn(&MeanComparison) -> f64| -> String {
            let p = |cell: &&Cell| cell.tests.as_ref().map_or("-".to_owned(), |tests| p_text(p(tests)));
            cells.iter().map(|cell| format!("{:>16}", p(cell))).collect()
        };
        let _ = writeln!(text, "{:<4} paper     {}", paper.name, means(&mut groups.into_iter()));
        let ours = &mut cells.iter().map(|cell| MeanSd { mean: cell.ours.mean, sd: cell.ours.sd });
        let _ = writeln!(text, "     growbot   {}", means(ours));
        let _ = writeln!(text, "     p Welch   {}", p_values(|tests| tests.p_holm));
        let _ = writeln!(text, "     p TOST    {}", p_values(|tests| tests.tost_p_holm));
    }
    verdicts_text(text, of);
}

/// Name of a verdict, and the number of means with it.
type VerdictCount = (&'static str, fn(&Verdicts) -> usize);

/// Writes the numbers of means that differ from Table 2 or are equivalent to it.
fn verdicts_text(text: &mut String, of: &Reproduction) {
    let verdicts = |slicing| Verdicts::of(&of.comparison.table2, Planner::TwoPlane, slicing);
    let (by_text, by_table) = (verdicts(SlicingRule::Text), verdicts(SlicingRule::Table));
    let _ = writeln!(
        text,
        "p Welch: p-value of Welch's test that the means do not differ. p TOST: p-value\n\
         of two one-sided tests that the means differ by more than the paper's SD; a\n\
         small value shows that they are equivalent within the SD. Both p-values have\n\
         Holm's correction for {} comparisons, at the level {LEVEL}.\n",
        by_text.cells
    );
    let counts = Table::new(NumberFormat::Plain)
        .column(format!("means of {}", by_text.cells), |(what, _): &VerdictCount| format!("  {what}"))
        .column("3.096 mm steps", |(_, count)| count(&by_text))
        .column("0.774 mm steps", |(_, count)| count(&by_table));
    let rows: [VerdictCount; 4] = [
        ("different, without correction", |v| v.differ_uncorrected),
        ("different", |v| v.differ),
        ("equivalent to within the paper's SD", |v| v.equivalent),
        ("within the paper's mean +- SD, untested", |v| v.within),
    ];
    *text += &counts.text(rows, &[46, 16, 16]);
}

fn quoted_text(text: &mut String, of: &Reproduction) {
    for quoted in &of.comparison.quoted {
        let digits = quoted.decimals;
        let MeanSd { mean, sd } = quoted.paper;
        let _ = writeln!(text, "\n{}\n  {:<38} {mean:>8.digits$} +- {sd:.digits$}", capital(quoted.what), "the paper");
        for OurMean { label, mean, sd } in &quoted.ours {
            // Exact slicing has its own line.
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
    let _ = writeln!(text, "\nFigure 6: mean position error over length, by half-width of the uniform noise");
    let slicing = |of_set: &GrowthSet| {
        let step = of_set.condition.slicing.step(&of.experiments.robots[of_set.robot]);
        step.map_or_else(|| "exact slicing".to_owned(), |step| format!("steps of {} mm", libm::round(step * 1e6) / 1e6))
    };
    let means = Table::new(NumberFormat::Plain)
        .column("", |sets: &&[GrowthSet]| {
            sets.first().map(|first| {
                let feedback = if first.condition.feedback { ", closed loop" } else { "" };
                format!("{:>2} R {}{feedback}", GROUPS[first.group], slicing(first))
            })
        })
        .columns(["0 %", "1 %", "2 %", "5 %", "10 %"], |sets| {
            sets.iter().map(|set| error_text(set.summary(ErrorQuantity::Position).mean)).collect::<Vec<_>>()
        });
    let rows = of.experiments.noise.chunk_by(|a, b| {
        (a.group, a.condition.slicing, a.condition.feedback) == (b.group, b.condition.slicing, b.condition.feedback)
    });
    *text += &means.text(rows, &[32, 9, 9, 9, 9, 9]);
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
        "\nRobot A, uniform noise of +-{} %, exact slicing: error over length, direction",
        100.0 * NOISE_OF_FEEDBACK
    );
    let errors = Table::new(NumberFormat::Plain).column("", |(name, ..): &(&str, ErrorQuantity, bool)| *name).columns(
        GROUPS.map(|group| format!("{group} R")),
        |(_, quantity, feedback)| {
            let summaries = sets().filter(|set| set.condition.feedback == *feedback).map(|set| set.summary(*quantity));
            let digits = if *quantity == ErrorQuantity::Position { 5 } else { 3 };
            summaries.map(|summary| format!("{:.digits$}+-{:.digits$}", summary.mean, summary.sd)).collect::<Vec<_>>()
        },
    );
    let rows = [
        ("open", ErrorQuantity::Position, false),
        ("closed", ErrorQuantity::Position, true),
        ("open, deg", ErrorQuantity::Direction, false),
        ("closed, deg", ErrorQuantity::Direction, true),
    ];
    *text += &errors.text(rows, &[12, 17, 17, 17, 17]);
}

/// Formats a position error over a length.
pub fn error_text(error: f64) -> String {
    if error < 5e-6 { format!("{error:.0e}") } else { format!("{error:.5}") }
}

fn tests_text(text: &mut String, of: &Reproduction) {
    let quoted: Vec<&SignificanceTest> = of
        .comparison
        .questions
        .iter()
        .filter(|question| question.paper.is_some() && question.planner == Planner::TwoPlane)
        .collect();
    if quoted.is_empty() {
        return;
    }
    let p = |test: Option<TestResult>| test.map_or("-".to_owned(), |test| p_text(test.p));
    let table = Table::new(NumberFormat::Plain)
        .column("p: do groups differ?", |question: &SignificanceTest| format!("  {}", question.slicing))
        .column("paper", |question| question.paper.map(|p| format!("{p:.4}")))
        .column("K.-Wallis", move |question| p(question.kruskal_wallis))
        .column("ANOVA", move |question| p(question.anova));
    let widths = [50, 8, 11, 11];
    let _ = write!(text, "\n{}", table.text_header(&widths));
    for group in quoted.chunk_by(|a, b| a.what == b.what) {
        let _ = writeln!(text, "{}", group.first().map_or_else(String::new, |first| capital(&first.what)));
        *text += &table.text_rows(group.iter().copied(), &widths);
    }
}
