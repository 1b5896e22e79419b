//! Comparison of our position errors with Table 2 of the paper: tests for difference and for equivalence.
//!
//! A test that finds no difference does not prove equality. Only an equivalence test, two one-sided tests (TOST), shows
//! that two means are alike. Its margin is one standard deviation of the paper's mean, which is what "mean +- SD" shows
//! a reader.

use growbot_core::plan::Planner;

use super::experiments::{ErrorQuantity, Experiments};
use super::paper::{self, MeanSd, ROBOTS};
use super::slicing_rule::SlicingRule;
use super::statistics::{LEVEL, MeanComparison, SampleSummary, holm};

/// Margin of equivalence, in standard deviations of the paper.
pub const MARGIN_SD: f64 = 1.0;

/// Position errors of a robot in a group, compared with a cell of Table 2.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Index into [`ROBOTS`].
    pub robot: usize,
    /// Index into [`paper::GROUPS`].
    pub group: usize,
    /// Planner of the paths.
    pub planner: Planner,
    /// Slicing rule of the paths.
    pub slicing: SlicingRule,
    /// Statistics of our position errors over the path's length.
    pub ours: SampleSummary,
    /// Mean and standard deviation of the paper, of [`paper::REPEAT`] growths.
    pub paper: MeanSd,
    /// Tests of the two means, corrected for all cells with the same planner and slicing. `None` if the values do not
    /// permit a test.
    pub tests: Option<MeanComparison>,
    /// Number of comparisons for which the tests are corrected.
    pub comparisons: usize,
}

impl Cell {
    /// Returns true if our mean is within one standard deviation of the paper's mean. This is not a test.
    pub fn is_within(&self) -> bool {
        (self.ours.mean - self.paper.mean).abs() <= self.paper.sd
    }

    /// Returns the margin of equivalence, the largest difference of equivalent means.
    pub fn margin(&self) -> f64 {
        MARGIN_SD * self.paper.sd
    }

    fn family(&self) -> (Planner, SlicingRule) {
        (self.planner, self.slicing)
    }
}

/// Number of cells with each test result, for one planner and slicing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Verdicts {
    /// Number of compared means.
    pub cells: usize,
    /// Number of means within one standard deviation of the paper's.
    pub within: usize,
    /// Number of means that differ at [`LEVEL`] without a correction.
    pub differ_uncorrected: usize,
    /// Number of means that differ after the correction.
    pub differ: usize,
    /// Number of means that are equivalent after the correction.
    pub equivalent: usize,
}

impl Verdicts {
    /// Counts the results of the cells with this planner and slicing.
    pub fn of(cells: &[Cell], planner: Planner, slicing: SlicingRule) -> Self {
        let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.family() == (planner, slicing)).collect();
        let count = |holds: fn(&Cell) -> bool| cells.iter().filter(|cell| holds(cell)).count();
        Self {
            cells: cells.len(),
            within: count(Cell::is_within),
            differ_uncorrected: count(|cell| cell.tests.is_some_and(|tests| tests.welch.p < LEVEL)),
            differ: count(|cell| cell.tests.is_some_and(|tests| tests.differs())),
            equivalent: count(|cell| cell.tests.is_some_and(|tests| tests.is_equivalent())),
        }
    }
}

/// Returns the cells of all growths without noise and in open loop, for the robots of Table 2.
pub(super) fn cells(experiments: &Experiments) -> Vec<Cell> {
    let mut cells = Vec::new();
    for set in &experiments.sets {
        let condition = &set.condition;
        if let Some(paper) = ROBOTS[set.robot].position_error
            && condition.noise == 0.0
            && !condition.feedback
        {
            cells.push(Cell {
                robot: set.robot,
                group: set.group,
                planner: condition.planner,
                slicing: condition.slicing,
                ours: set.summary(ErrorQuantity::Position),
                paper: paper[set.group],
                tests: None,
                comparisons: 0,
            });
        }
    }
    test(&mut cells);
    cells
}

/// Tests the means of the cells. The p-values are corrected within each family, the cells with the same planner and
/// slicing.
fn test(cells: &mut [Cell]) {
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        for slicing in [SlicingRule::Text, SlicingRule::Table, SlicingRule::Exact] {
            let mut family: Vec<&mut Cell> =
                cells.iter_mut().filter(|cell| cell.family() == (planner, slicing)).collect();
            let comparisons = family.len();
            for cell in &mut family {
                let SampleSummary { n, mean, sd, .. } = cell.ours;
                let paper = (paper::REPEAT, cell.paper.mean, cell.paper.sd);
                cell.tests = MeanComparison::of((n, mean, sd), paper, cell.margin());
                cell.comparisons = comparisons;
            }
            let tested: Vec<&mut MeanComparison> = family.iter_mut().filter_map(|cell| cell.tests.as_mut()).collect();
            let p_holm = holm(&tested.iter().map(|tests| tests.welch.p).collect::<Vec<_>>());
            let tost_p_holm = holm(&tested.iter().map(|tests| tests.tost_p).collect::<Vec<_>>());
            for (tests, (p, tost_p)) in tested.into_iter().zip(p_holm.into_iter().zip(tost_p_holm)) {
                (tests.p_holm, tests.tost_p_holm) = (p, tost_p);
            }
        }
    }
}
