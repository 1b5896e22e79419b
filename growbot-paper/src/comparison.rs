//! Comparison of our simulated growths with the paper's results: quoted means, significance tests, and reasons for
//! differences.

use growbot_core::plan::Planner;

pub use super::compared_values::{OurMean, QuotedMean, SignificanceTest};
pub use super::differences::Difference;
use super::differences::{WHY_B, WHY_C, WHY_HEADING, WHY_PITCH, differences};
use super::experiments::{ErrorQuantity, Experiments, GrowthSet};
use super::paper::{self, GROUPS, PAPERS_PLANNER, ROBOTS};
use super::slicing_rule::SlicingRule;
use super::statistics::{SampleSummary, anova, kruskal_wallis};
use super::table2::{self, Cell};

/// Groups that the paper calls long paths: 8 radii and more, as indexes into [`GROUPS`].
const LONG: std::ops::Range<usize> = 1..4;

/// Largest errors of our growths with exact slicing and without noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExactErrors {
    /// Largest position error, divided by the length of the path.
    pub max_position: f64,
    /// Largest direction error, radians.
    pub max_direction: f64,
    /// Number of growths.
    pub growths: usize,
}

/// The whole comparison. A list is empty if its growths were not requested.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Cells of Table 2.
    pub table2: Vec<Cell>,
    /// Means that the paper's text quotes.
    pub quoted: Vec<QuotedMean>,
    /// Significance tests.
    pub questions: Vec<SignificanceTest>,
    /// Largest errors of exact slicing without noise. `None` without such growths.
    pub exact: Option<ExactErrors>,
    /// Differences from the paper, with reasons.
    pub differences: Vec<Difference>,
}

/// Returns the growths of a robot and group without noise and without feedback. `None` if they were not grown.
pub(super) fn open_set(
    experiments: &Experiments,
    robot: usize,
    group: usize,
    planner: Planner,
    slicing: SlicingRule,
) -> Option<&GrowthSet> {
    experiments.sets.iter().find(|set| {
        let condition = &set.condition;
        (set.robot, set.group, condition.planner, condition.slicing) == (robot, group, planner, slicing)
            && condition.noise == 0.0
            && !condition.feedback
    })
}

/// Returns the errors of all growths of these pairs of robot and group, one list for each pair. `None` if any of the
/// pairs was not grown.
fn values(
    experiments: &Experiments,
    members: impl IntoIterator<Item = (usize, usize)>,
    planner: Planner,
    slicing: impl Fn(usize) -> SlicingRule,
    quantity: ErrorQuantity,
) -> Option<Vec<Vec<f64>>> {
    members
        .into_iter()
        .map(|(robot, group)| {
            open_set(experiments, robot, group, planner, slicing(robot)).map(|set| set.values(quantity))
        })
        .collect()
}

impl Comparison {
    /// Compares the growths with the paper.
    pub fn of(experiments: &Experiments) -> Self {
        let (table2, quoted) = (table2::cells(experiments), quoted(experiments));
        let questions = questions(experiments);
        let differences = differences(&table2, &quoted, &questions);
        Self { table2, quoted, questions, exact: exact(experiments), differences }
    }
}

fn exact(experiments: &Experiments) -> Option<ExactErrors> {
    let growths = experiments.sets.iter().flat_map(|set| &set.growths).filter(|growth| {
        growth.condition.slicing == SlicingRule::Exact && growth.condition.noise == 0.0 && !growth.condition.feedback
    });
    growths.fold(None, |errors: Option<ExactErrors>, growth| {
        let ExactErrors { max_position, max_direction, growths } = errors.unwrap_or_default();
        let arrival = &growth.arrival;
        Some(ExactErrors {
            max_position: arrival.normalized_position_error.max(max_position),
            max_direction: arrival.direction_error_deg.to_radians().max(max_direction),
            growths: growths + 1,
        })
    })
}

/// Returns the label of a slicing rule for a robot.
fn label(experiments: &Experiments, robot: usize, slicing: SlicingRule) -> String {
    slicing.label(&experiments.robots[robot])
}

fn quoted(experiments: &Experiments) -> Vec<QuotedMean> {
    let mut quoted = Vec::new();
    // The paper's value seems to be a mean of the groups' means, because its standard deviation is small.
    let over_groups = |slicing: SlicingRule, quantity: ErrorQuantity| {
        let groups = (0..GROUPS.len()).map(|group| (paper::ROBOT_A, group));
        let values = values(experiments, groups, PAPERS_PLANNER, |_| slicing, quantity)?;
        let means: Vec<f64> = values.iter().map(|values| SampleSummary::of(values).mean).collect();
        let of_means = SampleSummary::of(&means);
        Some(OurMean { label: label(experiments, paper::ROBOT_A, slicing), mean: of_means.mean, sd: of_means.sd })
    };
    let long = |robot: usize, slicing: SlicingRule, planner: Planner| {
        let groups = LONG.map(|group| (robot, group));
        let values = values(experiments, groups, planner, |_| slicing, ErrorQuantity::Position)?;
        let all = SampleSummary::of(&values.concat());
        let path = if planner == PAPERS_PLANNER { "" } else { ", shortest path" };
        Some(OurMean { label: label(experiments, robot, slicing) + path, mean: all.mean, sd: all.sd })
    };
    let mut push = |what, paper, decimals, why, ours: Vec<Option<OurMean>>| {
        let ours: Vec<_> = ours.into_iter().flatten().collect();
        if !ours.is_empty() {
            quoted.push(QuotedMean { what, paper, decimals, ours, why });
        }
    };
    for (what, paper, quantity, why) in [
        (
            "pitch error of robot A, degrees, mean of the groups' means",
            paper::PITCH_ERROR_DEG,
            ErrorQuantity::Pitch,
            WHY_PITCH,
        ),
        (
            "heading error of robot A, degrees, mean of the groups' means",
            paper::HEADING_ERROR_DEG,
            ErrorQuantity::Heading,
            WHY_HEADING,
        ),
    ] {
        let rules = SlicingRule::of_robot(paper::ROBOT_A);
        push(what, paper, 2, why, rules.iter().map(|slicing| over_groups(*slicing, quantity)).collect());
    }
    for (what, paper, robot, why) in [
        ("position error of robot B over the path's length, groups from 8 R on", paper::LONG_PATHS_B, paper::B, WHY_B),
        ("position error of robot C over the path's length, groups from 8 R on", paper::LONG_PATHS_C, paper::C, WHY_C),
    ] {
        let rules = SlicingRule::of_robot(robot);
        let by_rule = rules.iter().map(|slicing| long(robot, *slicing, PAPERS_PLANNER));
        let shortest = long(robot, SlicingRule::Table, Planner::Shortest);
        push(what, paper, 4, why, by_rule.chain([shortest]).collect());
    }
    quoted
}

/// Slicing and planner of the paths in a significance test.
struct TestedPaths {
    slicing: String,
    planner: Planner,
}

/// Significance tests that have been made so far.
#[derive(Default)]
struct Questions(Vec<SignificanceTest>);

impl Questions {
    /// Tests whether these groups of values differ. `paper` is the paper's p-value. Does nothing without values.
    fn ask(&mut self, what: impl Into<String>, tested: TestedPaths, paper: Option<f64>, values: Option<Vec<Vec<f64>>>) {
        let Some(values) = values else { return };
        let groups: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        self.0.push(SignificanceTest {
            what: what.into(),
            slicing: tested.slicing,
            planner: tested.planner,
            groups: groups.len(),
            n: values.iter().map(Vec::len).sum(),
            paper,
            kruskal_wallis: kruskal_wallis(&groups),
            anova: anova(&groups),
        });
    }

    /// Tests whether errors differ between the groups of robot A.
    fn over_groups_of_a(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            for (what, quantity, paper) in [
                ("heading error over the groups of robot A", ErrorQuantity::Heading, Some(paper::P_HEADING_A)),
                ("pitch error over the groups of robot A", ErrorQuantity::Pitch, Some(paper::P_PITCH_A)),
                ("position error over the groups of robot A", ErrorQuantity::Position, None),
            ] {
                let tested = TestedPaths { slicing: label(experiments, paper::ROBOT_A, slicing), planner };
                let groups = (0..GROUPS.len()).map(|group| (paper::ROBOT_A, group));
                self.ask(what, tested, paper, values(experiments, groups, planner, |_| slicing, quantity));
            }
        }
    }

    /// Tests whether errors differ between all robots and groups.
    fn over_everything(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            let of = |robot| if SlicingRule::of_robot(robot).contains(&slicing) { slicing } else { SlicingRule::Table };
            for (what, quantity, paper) in [
                ("heading error over all robots and groups", ErrorQuantity::Heading, Some(paper::P_HEADING_ALL)),
                ("pitch error over all robots and groups", ErrorQuantity::Pitch, Some(paper::P_PITCH_ALL)),
            ] {
                let everywhere = (0..ROBOTS.len()).flat_map(|robot| (0..GROUPS.len()).map(move |group| (robot, group)));
                let label = format!("{}; B, C by Table 3", label(experiments, paper::ROBOT_A, slicing));
                let values = values(experiments, everywhere, planner, of, quantity);
                self.ask(what, TestedPaths { slicing: label, planner }, paper, values);
            }
        }
    }

    /// Tests whether position errors differ between the groups with long paths of robot B, and of robot C.
    fn over_long_paths(&mut self, experiments: &Experiments, planner: Planner) {
        for (what, robot, slicing, paper) in [
            ("position error over the groups from 8 R on, robot B", paper::B, SlicingRule::Table, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot B", paper::B, SlicingRule::Tenth, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot C", paper::C, SlicingRule::Table, paper::P_LONG_C),
            ("position error over the groups from 8 R on, robot C", paper::C, SlicingRule::Half, paper::P_LONG_C),
        ] {
            let tested = TestedPaths { slicing: label(experiments, robot, slicing), planner };
            let groups = LONG.map(|group| (robot, group));
            let values = values(experiments, groups, planner, |_| slicing, ErrorQuantity::Position);
            self.ask(what, tested, Some(paper), values);
        }
    }

    /// Tests in each group whether position errors differ between robots with the same `k`.
    fn over_robots_of_one_k(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            for robots in paper::CONSTANT_K {
                for (group, distance) in GROUPS.iter().enumerate() {
                    let names = robots.map(|robot| ROBOTS[robot].name).join(", ");
                    let what = format!("position error over robots of one k, {names}, {distance} R");
                    let tested = TestedPaths { slicing: label(experiments, robots[0], slicing), planner };
                    let members = robots.into_iter().map(|robot| (robot, group));
                    let values = values(experiments, members, planner, |_| slicing, ErrorQuantity::Position);
                    self.ask(what, tested, None, values);
                }
            }
        }
    }

    /// Tests in each group whether position errors of robot A differ between the levels of noise.
    fn over_noise(&mut self, experiments: &Experiments) {
        for (group, distance) in GROUPS.iter().enumerate() {
            for slicing in SlicingRule::of_robot(paper::ROBOT_A) {
                let levels = experiments.noise.iter().filter(|set| {
                    set.group == group
                        && set.condition.slicing == *slicing
                        && set.condition.noise > 0.0
                        && !set.condition.feedback
                });
                let values: Vec<_> = levels.map(|set| set.values(ErrorQuantity::Position)).collect();
                let what = format!("position error over the levels of noise, robot A, {distance} R");
                let tested =
                    TestedPaths { slicing: label(experiments, paper::ROBOT_A, *slicing), planner: PAPERS_PLANNER };
                self.ask(what, tested, None, (!values.is_empty()).then_some(values));
            }
        }
    }
}

/// Slicing rules with whole steps: of the height in the paper's text, and of the height in its table.
const WHOLE: [SlicingRule; 2] = [SlicingRule::Text, SlicingRule::Table];

fn questions(experiments: &Experiments) -> Vec<SignificanceTest> {
    let mut questions = Questions::default();
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        questions.over_groups_of_a(experiments, planner);
        questions.over_everything(experiments, planner);
        questions.over_long_paths(experiments, planner);
        questions.over_robots_of_one_k(experiments, planner);
    }
    questions.over_noise(experiments);
    let Questions(mut questions) = questions;
    // The tests are sorted so that the same test for several planners stands together.
    let order: Vec<String> = questions.iter().map(|question| question.what.clone()).collect();
    questions.sort_by_key(|question| order.iter().position(|what| *what == question.what));
    questions
}
