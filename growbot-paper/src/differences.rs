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
            "With steps of 3.096 mm, {}; the ratio of our means to the paper's is {:.2} at the median, and {:.2} to \
             {:.2}. With steps of 0.774 mm, {}; this ratio is {:.2} at the median.",
            verdicts(table2, SlicingRule::Text),
            text.median,
            text.min,
            text.max,
            verdicts(table2, SlicingRule::Table),
            table.median
        ),
        why: "The paper's text says that the step g t is 0.3096 cm for all robots, but Table 1 gives 0.0774 cm in \
              every row. Whole steps whose number is rounded up pass the end of each segment by half a step on \
              average, so the errors are in proportion to the step. Table 2 agrees better with the step of the text \
              than with that of Table 1. The means that still differ after the correction differ by more than chance. \
              A possible cause is the way in which the paper chose its poses, which the paper does not describe.",
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
        why: "A whole step bends the path by k: 1.8 degrees for robot A (3.096 mm at a radius of 100 mm), 0.6 degrees \
              for A3, 5.3 for A6 and B, and 30 for C. When the number of steps is rounded up, each arc turns too far \
              by half of k on average, so direction errors grow with k, as position errors do. Whole steps cannot \
              result in direction errors that are the same for all robots, but they do result in the position errors \
              of Table 2, which grow with k. The paper does not say how the last step of an arc is bent.",
    })
}

/// Reason why heading errors differ.
pub const WHY_HEADING: &str = "The reason for the pitch error applies here, too. In addition, heading errors depend on \
                               how the poses are chosen, because near straight up or down a small angle between \
                               directions is a large difference in heading. With directions that are uniform on the \
                               sphere, heading errors are pi/2 times the pitch errors on average, but the paper's \
                               heading errors are hardly larger than its pitch errors. The angle between the \
                               directions, which is in the CSV files, does not depend on the choice of poses in this \
                               way.";
/// Reason why pitch errors differ.
pub const WHY_PITCH: &str = "The paper's 1.77 degrees are the bend of one whole step of 3.096 mm at R = 100 mm, which \
                             is the largest error of one arc by rounding up. On average an arc turns too far by half \
                             of that, and only a part of this error is in pitch. So the paper's simulation turned \
                             further than rounding up explains, or the paper measured the error in another way; the \
                             paper does not describe this. The paper's position errors are too small for a larger \
                             error of direction, except at the very end of the path.";
/// Reason why robot B's errors differ.
pub const WHY_B: &str = "With k = 0.0921, robot B's steps are three times as long in relation to its radius as robot \
                         A's steps of 3.096 mm, so with whole steps robot B's errors must be larger than robot A's. \
                         The paper's errors of robot B are three times smaller. They agree with a step of a tenth of \
                         that length (6.264 mm, k = 0.0092), as if a centimetre had been taken for a millimetre. This \
                         explanation is a guess.";
/// Reason why robot C's errors differ.
pub const WHY_C: &str = "At k = 0.5263 a step bends the path by 30 degrees, so an arc consists of a few steps. The \
                         paper's mean agrees with a step of about half of the step in Table 3: 10 mm, the distance of \
                         robot C's latches. This explanation is a guess, and less certain than that for robot B, \
                         because our errors grow with the distance for either step, but the paper's do not. On the \
                         shortest path, which has three segments instead of five or six, our errors with the step of \
                         Table 3 are nearer to the paper's and hardly depend on the distance.";
