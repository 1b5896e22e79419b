//! Differences from the paper's numbers, and their reasons.

use super::compared_values::{OurMean, QuotedMean, SignificanceTest};
use super::paper::{self, MeanSd, PAPERS_PLANNER};
use super::slicing_rule::SlicingRule;
use super::statistics::SampleSummary;
use super::table2::{Cell, Verdicts};
use super::texts::{capital, p_text};

/// A difference between our results and the paper's, with its reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Compared quantity.
    pub what: &'static str,
    /// Size of the difference.
    pub by: String,
    /// Reason of the difference, as far as it is known.
    pub why: &'static str,
}

/// Returns all differences, with their reasons.
pub fn differences(table2: &[Cell], quoted: &[QuotedMean], questions: &[SignificanceTest]) -> Vec<Difference> {
    let mut differences: Vec<Difference> = of_table2(table2).into_iter().collect();
    differences.extend(quoted.iter().filter_map(of_quoted));
    differences.extend(of_directions(questions));
    differences
}

/// Ratios of our means to those of Table 2, under one slicing rule.
struct Ratios {
    median: f64,
    min: f64,
    max: f64,
}

fn ratios(table2: &[Cell], slicing: SlicingRule) -> Ratios {
    let cells: Vec<&Cell> =
        table2.iter().filter(|cell| cell.slicing == slicing && cell.planner == PAPERS_PLANNER).collect();
    let ratios: Vec<f64> = cells.iter().map(|cell| cell.ours.mean / cell.paper.mean).collect();
    Ratios {
        median: SampleSummary::of(&ratios).median,
        min: ratios.iter().copied().fold(f64::INFINITY, f64::min),
        max: ratios.iter().copied().fold(0.0, f64::max),
    }
}

fn of_table2(table2: &[Cell]) -> Option<Difference> {
    if table2.is_empty() {
        return None;
    }
    let (text, table) = (ratios(table2, SlicingRule::Text), ratios(table2, SlicingRule::Table));
    Some(Difference {
        what: "Table 2: position errors of robots A to A8",
        by: format!(
            "With steps of 3.096 mm, {}; ours over the paper's is {:.2} at the median, {:.2} to {:.2}. With steps of \
             0.774 mm, {}; {:.2} at the median.",
            verdicts(table2, SlicingRule::Text),
            text.median,
            text.min,
            text.max,
            verdicts(table2, SlicingRule::Table),
            table.median
        ),
        why: "The text says that g t is 0.3096 (cm) throughout, Table 1 gives 0.0774 cm in every row. Whole steps, \
              rounded up, pass the end of each segment by half a step on average, so the errors are in proportion to \
              the step: Table 2 is nearer to the text's value than to Table 1's. The means that differ after the \
              correction do so by more than chance: how the paper drew its poses, which it does not say, may be why.",
    })
}

/// Returns a text with the test results of all means in Table 2, for one slicing rule.
fn verdicts(table2: &[Cell], slicing: SlicingRule) -> String {
    let Verdicts { cells, within, differ_uncorrected, differ, equivalent } =
        Verdicts::of(table2, PAPERS_PLANNER, slicing);
    format!(
        "{differ_uncorrected} of {cells} means differ by Welch's test at 5 %, {differ} after Holm's correction, and \
         {equivalent} are equivalent (TOST, Holm) with the paper's SD as the margin; {within} lie within the paper's \
         mean +- SD"
    )
}

fn of_quoted(quoted: &QuotedMean) -> Option<Difference> {
    let (OurMean { label, mean, sd }, others) = quoted.ours.split_first()?;
    let digits = quoted.decimals;
    let others: Vec<String> =
        others.iter().map(|OurMean { label, mean, .. }| format!("{mean:.digits$} with {label}")).collect();
    let MeanSd { mean: paper, sd: paper_sd } = quoted.paper;
    Some(Difference {
        what: quoted.what,
        by: format!(
            "{mean:.digits$} +- {sd:.digits$} with {label}, {paper:.digits$} +- {paper_sd:.digits$} in the paper: \
             {:.2} times as much; {}.",
            mean / paper,
            others.join(", ")
        ),
        why: quoted.why,
    })
}

fn of_directions(questions: &[SignificanceTest]) -> Option<Difference> {
    let p_values = [paper::P_HEADING_ALL, paper::P_PITCH_ALL].into_iter().filter_map(|p| {
        let question = questions.iter().find(|question| question.paper == Some(p))?;
        Some(format!("{}: p {} (paper: {p:.4})", question.what, p_text(question.kruskal_wallis?.p)))
    });
    let p_values: Vec<String> = p_values.collect();
    (!p_values.is_empty()).then(|| Difference {
        what: "heading and pitch errors over all robots: the paper finds no difference",
        by: capital(&format!("{}. The errors of growbot depend on the robot.", p_values.join("; "))),
        why: "A whole step bends by k: 1.8 degrees for robot A (3.096 mm at a radius of 100 mm), 0.6 for A3, 5.3 for \
              A6 and B, 30 for C. Steps that are rounded up turn too far by half of that in each arc on average, so \
              direction errors grow with k as position errors do. Errors of direction that are the same for all robots \
              cannot come out of whole steps, while the position errors of Table 2, which grow with k, do. The paper \
              does not say how the last step of an arc is bent.",
    })
}

/// Reason why heading errors differ.
pub const WHY_HEADING: &str = "As for the pitch, and heading errors depend on how poses are drawn besides: near \
    straight up or down a small angle is a large heading. With directions uniform on the sphere heading errors are \
    pi/2 times the pitch errors on average; the paper's are hardly larger than its pitch errors. The angle between the \
    directions, in the files, does not depend on it.";
/// Reason why pitch errors differ.
pub const WHY_PITCH: &str = "The paper's 1.77 degrees are the bend of one whole step of 3.096 mm at R = 100 mm: the \
                             most that rounding up turns too far in one arc. On average it turns too far by half of \
    that, and only a part of it goes up or down. So the paper's simulation turned further than rounding up does, or \
    measured otherwise; it does not say. Its position errors leave no room for it, except at the very end of the \
    path.";
/// Reason why robot B's errors differ.
pub const WHY_B: &str = "By k = 0.0921, robot B's steps are three times as long, for its radius, as robot A's of \
    3.096 mm, so with whole steps its errors must be larger than robot A's; the paper's are three times smaller. They \
    go with a step a tenth as long (6.264 mm, k = 0.0092), as if a centimetre had been taken for a millimetre. That is \
    a guess.";
/// Reason why robot C's errors differ.
pub const WHY_C: &str = "At k = 0.5263 a step bends by 30 degrees and an arc is a handful of steps. The paper's mean \
                         goes \
    with a step of about half of Table 3's: 10 mm, the distance of its latches. That is a guess, and a weaker one than \
    for robot B: ours grow with the distance for either step, the paper's do not. By the shortest path, of three \
    segments instead of five or six, ours come nearer with Table 3's step, and hardly depend on the distance.";
