//! Position errors beside the paper's Table 2: whether the means differ, and whether they are equivalent.
//!
//! A test that finds no difference is no proof that there is none: the claim that two means are alike is made by an
//! equivalence test alone, two one-sided tests (TOST). Their margin is one standard deviation of the paper's, which is
//! what "mean +- SD" shows a reader.

use growbot_core::plan::Planner;

use super::experiments::{Experiments, Quantity};
use super::paper::{self, MeanSd, ROBOTS};
use super::slicing_rule::SlicingRule;
use super::statistics::{LEVEL, Summary, TwoMeans, holm};

/// The margin of equivalence, in standard deviations of the paper's.
pub const MARGIN_SD: f64 = 1.0;

/// Position errors of a robot in a group, beside those of Table 2.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Place in [`ROBOTS`].
    pub robot: usize,
    /// Place in [`paper::GROUPS`].
    pub group: usize,
    /// The planner.
    pub planner: Planner,
    /// How the paths were sliced.
    pub slicing: SlicingRule,
    /// Ours.
    pub ours: Summary,
    /// The paper's mean and standard deviation, of [`paper::REPEAT`] growths.
    pub paper: MeanSd,
    /// The tests of the two means, corrected for all of the same planner and slicing.
    pub tests: Option<TwoMeans>,
    /// How many comparisons the tests are corrected for.
    pub comparisons: usize,
}

impl Cell {
    /// Whether our mean lies within the paper's mean and its standard deviation. That is no test.
    #[must_use]
    pub fn is_within(&self) -> bool {
        (self.ours.mean - self.paper.mean).abs() <= self.paper.sd
    }

    /// How far apart equivalent means may be.
    #[must_use]
    pub fn margin(&self) -> f64 {
        MARGIN_SD * self.paper.sd
    }

    fn family(&self) -> (Planner, SlicingRule) {
        (self.planner, self.slicing)
    }
}

/// What the tests say of all means of one planner and slicing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Verdicts {
    /// Means compared.
    pub cells: usize,
    /// Within the paper's mean and its standard deviation.
    pub within: usize,
    /// Different at [`LEVEL`] without any correction.
    pub differ_uncorrected: usize,
    /// Different after the correction.
    pub differ: usize,
    /// Equivalent after the correction.
    pub equivalent: usize,
}

impl Verdicts {
    /// Of these cells, as far as they are of this planner and slicing.
    #[must_use]
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

/// The cells of all that was grown without noise and in open loop by robots of Table 2.
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
                ours: set.summary(Quantity::Position),
                paper: paper[set.group],
                tests: None,
                comparisons: 0,
            });
        }
    }
    test(&mut cells);
    cells
}

/// Tests the means, each corrected for those of its family.
fn test(cells: &mut [Cell]) {
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        for slicing in [SlicingRule::Text, SlicingRule::Table, SlicingRule::Exact] {
            let mut family: Vec<&mut Cell> =
                cells.iter_mut().filter(|cell| cell.family() == (planner, slicing)).collect();
            let comparisons = family.len();
            for cell in &mut family {
                let Summary { n, mean, sd, .. } = cell.ours;
                let paper = (paper::REPEAT, cell.paper.mean, cell.paper.sd);
                cell.tests = TwoMeans::of((n, mean, sd), paper, cell.margin());
                cell.comparisons = comparisons;
            }
            let tested: Vec<&mut TwoMeans> = family.iter_mut().filter_map(|cell| cell.tests.as_mut()).collect();
            let p_holm = holm(&tested.iter().map(|tests| tests.welch.p).collect::<Vec<_>>());
            let tost_p_holm = holm(&tested.iter().map(|tests| tests.tost_p).collect::<Vec<_>>());
            for (tests, (p, tost_p)) in tested.into_iter().zip(p_holm.into_iter().zip(tost_p_holm)) {
                (tests.p_holm, tests.tost_p_holm) = (p, tost_p);
            }
        }
    }
}
