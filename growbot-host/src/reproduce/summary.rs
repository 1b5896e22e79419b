//! The summary that `growbot reproduce` prints, 80 columns wide.

use std::fmt::Write;

use growbot_core::plan::Planner;

use super::comparison::{ExactErrors, OurMean, SignificanceTest};
use super::experiments::{ErrorQuantity, NOISE_OF_FEEDBACK};
use super::paper::{GROUPS, MeanSd, ROBOTS};
use super::reproduction::Reproduction;
use super::slicing_rule::SlicingRule;
use super::statistics::{LEVEL, MeanComparison, TestResult};
use super::table2::{Cell, Verdicts};
use super::tables::parameters;
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
    let _ = writeln!(text, "means of {:<37}{:>16}{:>16}", by_text.cells, "3.096 mm steps", "0.774 mm steps");
    for (what, count) in [
        ("different, without correction", (|v| v.differ_uncorrected) as fn(&Verdicts) -> usize),
        ("different", |v| v.differ),
        ("equivalent to within the paper's SD", |v| v.equivalent),
        ("within the paper's mean +- SD, untested", |v| v.within),
    ] {
        let _ = writeln!(text, "  {what:<44}{:>16}{:>16}", count(&by_text), count(&by_table));
    }
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
    let _ = writeln!(text, "{:<32}{:>9}{:>9}{:>9}{:>9}{:>9}", "", "0 %", "1 %", "2 %", "5 %", "10 %");
    for sets in of.experiments.noise.chunk_by(|a, b| {
        (a.group, a.condition.slicing, a.condition.feedback) == (b.group, b.condition.slicing, b.condition.feedback)
    }) {
        let Some(first) = sets.first() else { continue };
        let slicing = first.condition.slicing.step(&of.experiments.robots[first.robot]).map_or_else(
            || "exact slicing".to_owned(),
            |step| format!("steps of {} mm", libm::round(step * 1e6) / 1e6),
        );
        let feedback = if first.condition.feedback { ", closed loop" } else { "" };
        let means: String =
            sets.iter().map(|set| format!("{:>9}", error_text(set.summary(ErrorQuantity::Position).mean))).collect();
        let _ = writeln!(text, "{:>2} R {:<27}{means}", GROUPS[first.group], format!("{slicing}{feedback}"));
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
        "\nRobot A, uniform noise of +-{} %, exact slicing: error over length, direction",
        100.0 * NOISE_OF_FEEDBACK
    );
    let heading: String = GROUPS.iter().map(|group| format!("{:>17}", format!("{group} R"))).collect();
    let _ = writeln!(text, "            {heading}");
    for (name, quantity, feedback) in [
        ("open", ErrorQuantity::Position, false),
        ("closed", ErrorQuantity::Position, true),
        ("open, deg", ErrorQuantity::Direction, false),
        ("closed, deg", ErrorQuantity::Direction, true),
    ] {
        let _ = write!(text, "{name:<12}");
        for set in sets().filter(|set| set.condition.feedback == feedback) {
            let summary = set.summary(quantity);
            let cell = match quantity {
                ErrorQuantity::Position => format!("{:.5}+-{:.5}", summary.mean, summary.sd),
                _ => format!("{:.3}+-{:.3}", summary.mean, summary.sd),
            };
            let _ = write!(text, "{cell:>17}");
        }
        text.push('\n');
    }
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
    let _ = writeln!(text, "\n{:<50}{:>8}{:>11}{:>11}", "p: do groups differ?", "paper", "K.-Wallis", "ANOVA");
    let mut before = "";
    for question in quoted {
        if question.what != before {
            let _ = writeln!(text, "{}", capital(&question.what));
            before = &question.what;
        }
        let p = |test: Option<TestResult>| test.map_or("-".to_owned(), |test| p_text(test.p));
        let _ = writeln!(
            text,
            "  {:<48}{:>8.4}{:>11}{:>11}",
            question.slicing,
            question.paper.unwrap_or_default(),
            p(question.kruskal_wallis),
            p(question.anova)
        );
    }
}
