//! Ours beside the paper's: what it quotes, the significance tests, and why we differ.

use growbot_core::plan::Planner;

use super::differences::{WHY_B, WHY_C, WHY_HEADING, WHY_PITCH, differences};
use super::experiments::{Experiments, Quantity, Set};
use super::paper::{self, GROUPS, MeanSd, ROBOTS};
use super::slicing_rule::SlicingRule;
use super::statistics::{Summary, Test, anova, kruskal_wallis};
use super::table2::{self, Cell};

/// The planner of the paper, by which we are compared with it.
pub(super) const PAPERS_PLANNER: Planner = Planner::TwoPlane;

/// The groups that the paper calls long paths: from 8 radii on, places in [`GROUPS`].
const LONG: std::ops::Range<usize> = 1..4;

/// A mean that the paper quotes.
#[derive(Debug, Clone, PartialEq)]
pub struct Quoted {
    /// What it is the mean of.
    pub what: &'static str,
    /// The paper's mean and standard deviation.
    pub paper: MeanSd,
    /// How many decimals tell something.
    pub decimals: usize,
    /// Ours, one for each way of slicing.
    pub ours: Vec<OurMean>,
    /// Why they differ.
    pub(super) why: &'static str,
}

/// A mean of ours, and its standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct OurMean {
    /// How the paths were sliced.
    pub label: String,
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
}

/// The largest errors that exact slicing gives without noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExactErrors {
    /// Max position error over the length of the path.
    pub max_position: f64,
    /// Max direction error, radians.
    pub max_direction: f64,
    /// How many growths there were.
    pub growths: usize,
}

/// A question whether groups differ, with the answers of both tests.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// What is compared with what.
    pub what: String,
    /// How the paths were sliced.
    pub slicing: String,
    /// The planner.
    pub planner: Planner,
    /// How many groups.
    pub groups: usize,
    /// How many values in all.
    pub n: usize,
    /// The paper's p.
    pub paper: Option<f64>,
    /// Kruskal and Wallis' test: of mean ranks.
    pub kruskal_wallis: Option<Test>,
    /// One-way analysis of variance: of means.
    pub anova: Option<Test>,
}

/// Something in which we differ from the paper, or from what it could have meant.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// What is compared.
    pub what: &'static str,
    /// By how much.
    pub by: String,
    /// Why, as far as we can tell.
    pub why: &'static str,
}

/// The whole comparison. Lists are empty where their growths were not asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Table 2.
    pub table2: Vec<Cell>,
    /// Means that the text quotes.
    pub quoted: Vec<Quoted>,
    /// Significance tests.
    pub questions: Vec<Question>,
    /// The errors of exact slicing without noise.
    pub exact: Option<ExactErrors>,
    /// Where we differ, and why.
    pub differences: Vec<Difference>,
}

/// Growths without noise and without feedback.
pub(super) fn open_set(
    experiments: &Experiments,
    robot: usize,
    group: usize,
    planner: Planner,
    slicing: SlicingRule,
) -> Option<&Set> {
    experiments.sets.iter().find(|set| {
        let condition = &set.condition;
        (set.robot, set.group, condition.planner, condition.slicing) == (robot, group, planner, slicing)
            && condition.noise == 0.0
            && !condition.feedback
    })
}

/// The values of these robots and groups, each a group of its own. None where any was not grown.
fn values(
    experiments: &Experiments,
    members: impl IntoIterator<Item = (usize, usize)>,
    planner: Planner,
    slicing: impl Fn(usize) -> SlicingRule,
    quantity: Quantity,
) -> Option<Vec<Vec<f64>>> {
    members
        .into_iter()
        .map(|(robot, group)| {
            open_set(experiments, robot, group, planner, slicing(robot)).map(|set| set.values(quantity))
        })
        .collect()
}

impl Comparison {
    /// Compares what was grown.
    #[must_use]
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

/// The label of a slicing rule for a robot.
fn label(experiments: &Experiments, robot: usize, slicing: SlicingRule) -> String {
    slicing.label(&experiments.robots[robot])
}

fn quoted(experiments: &Experiments) -> Vec<Quoted> {
    let mut quoted = Vec::new();
    // The paper's is a mean of the groups' means, as far as its small standard deviation tells.
    let over_groups = |slicing: SlicingRule, quantity: Quantity| {
        let groups = (0..GROUPS.len()).map(|group| (paper::A, group));
        let values = values(experiments, groups, PAPERS_PLANNER, |_| slicing, quantity)?;
        let means: Vec<f64> = values.iter().map(|values| Summary::of(values).mean).collect();
        let of_means = Summary::of(&means);
        Some(OurMean { label: label(experiments, paper::A, slicing), mean: of_means.mean, sd: of_means.sd })
    };
    let long = |robot: usize, slicing: SlicingRule, planner: Planner| {
        let groups = LONG.map(|group| (robot, group));
        let values = values(experiments, groups, planner, |_| slicing, Quantity::Position)?;
        let all = Summary::of(&values.concat());
        let path = if planner == PAPERS_PLANNER { "" } else { ", shortest path" };
        Some(OurMean { label: label(experiments, robot, slicing) + path, mean: all.mean, sd: all.sd })
    };
    let mut push = |what, paper, decimals, why, ours: Vec<Option<OurMean>>| {
        let ours: Vec<_> = ours.into_iter().flatten().collect();
        if !ours.is_empty() {
            quoted.push(Quoted { what, paper, decimals, ours, why });
        }
    };
    for (what, paper, quantity, why) in [
        (
            "pitch error of robot A, degrees, mean of the groups' means",
            paper::PITCH_ERROR_DEG,
            Quantity::Pitch,
            WHY_PITCH,
        ),
        (
            "heading error of robot A, degrees, mean of the groups' means",
            paper::HEADING_ERROR_DEG,
            Quantity::Heading,
            WHY_HEADING,
        ),
    ] {
        let rules = SlicingRule::of_robot(paper::A);
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

/// The planner and the slicing of the paths that a question is about.
struct Asked {
    slicing: String,
    planner: Planner,
}

/// The questions asked so far.
#[derive(Default)]
struct Questions(Vec<Question>);

impl Questions {
    /// Asks whether these groups of values differ; `paper` is the paper's p. Nothing is asked without values.
    fn ask(&mut self, what: impl Into<String>, asked: Asked, paper: Option<f64>, values: Option<Vec<Vec<f64>>>) {
        let Some(values) = values else { return };
        let groups: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        self.0.push(Question {
            what: what.into(),
            slicing: asked.slicing,
            planner: asked.planner,
            groups: groups.len(),
            n: values.iter().map(Vec::len).sum(),
            paper,
            kruskal_wallis: kruskal_wallis(&groups),
            anova: anova(&groups),
        });
    }

    /// Over the groups of robot A.
    fn over_groups_of_a(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            for (what, quantity, paper) in [
                ("heading error over the groups of robot A", Quantity::Heading, Some(paper::P_HEADING_A)),
                ("pitch error over the groups of robot A", Quantity::Pitch, Some(paper::P_PITCH_A)),
                ("position error over the groups of robot A", Quantity::Position, None),
            ] {
                let asked = Asked { slicing: label(experiments, paper::A, slicing), planner };
                let groups = (0..GROUPS.len()).map(|group| (paper::A, group));
                self.ask(what, asked, paper, values(experiments, groups, planner, |_| slicing, quantity));
            }
        }
    }

    /// Over all robots and groups.
    fn over_everything(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            let of = |robot| if SlicingRule::of_robot(robot).contains(&slicing) { slicing } else { SlicingRule::Table };
            for (what, quantity, paper) in [
                ("heading error over all robots and groups", Quantity::Heading, Some(paper::P_HEADING_ALL)),
                ("pitch error over all robots and groups", Quantity::Pitch, Some(paper::P_PITCH_ALL)),
            ] {
                let everywhere = (0..ROBOTS.len()).flat_map(|robot| (0..GROUPS.len()).map(move |group| (robot, group)));
                let label = format!("{}; B, C by Table 3", label(experiments, paper::A, slicing));
                let values = values(experiments, everywhere, planner, of, quantity);
                self.ask(what, Asked { slicing: label, planner }, paper, values);
            }
        }
    }

    /// Over the long paths of robots B and C.
    fn over_long_paths(&mut self, experiments: &Experiments, planner: Planner) {
        for (what, robot, slicing, paper) in [
            ("position error over the groups from 8 R on, robot B", paper::B, SlicingRule::Table, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot B", paper::B, SlicingRule::Tenth, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot C", paper::C, SlicingRule::Table, paper::P_LONG_C),
            ("position error over the groups from 8 R on, robot C", paper::C, SlicingRule::Half, paper::P_LONG_C),
        ] {
            let asked = Asked { slicing: label(experiments, robot, slicing), planner };
            let groups = LONG.map(|group| (robot, group));
            let values = values(experiments, groups, planner, |_| slicing, Quantity::Position);
            self.ask(what, asked, Some(paper), values);
        }
    }

    /// Over robots of one `k`, in each group.
    fn over_robots_of_one_k(&mut self, experiments: &Experiments, planner: Planner) {
        for slicing in WHOLE {
            for robots in paper::CONSTANT_K {
                for (group, distance) in GROUPS.iter().enumerate() {
                    let names = robots.map(|robot| ROBOTS[robot].name).join(", ");
                    let what = format!("position error over robots of one k, {names}, {distance} R");
                    let asked = Asked { slicing: label(experiments, robots[0], slicing), planner };
                    let members = robots.into_iter().map(|robot| (robot, group));
                    let values = values(experiments, members, planner, |_| slicing, Quantity::Position);
                    self.ask(what, asked, None, values);
                }
            }
        }
    }

    /// Over the levels of noise, in each group.
    fn over_noise(&mut self, experiments: &Experiments) {
        for (group, distance) in GROUPS.iter().enumerate() {
            for slicing in SlicingRule::of_robot(paper::A) {
                let levels = experiments.noise.iter().filter(|set| {
                    set.group == group
                        && set.condition.slicing == *slicing
                        && set.condition.noise > 0.0
                        && !set.condition.feedback
                });
                let values: Vec<_> = levels.map(|set| set.values(Quantity::Position)).collect();
                let what = format!("position error over the levels of noise, robot A, {distance} R");
                let asked = Asked { slicing: label(experiments, paper::A, *slicing), planner: PAPERS_PLANNER };
                self.ask(what, asked, None, (!values.is_empty()).then_some(values));
            }
        }
    }
}

/// Whole steps, of the text's height and of the table's.
const WHOLE: [SlicingRule; 2] = [SlicingRule::Text, SlicingRule::Table];

fn questions(experiments: &Experiments) -> Vec<Question> {
    let mut questions = Questions::default();
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        questions.over_groups_of_a(experiments, planner);
        questions.over_everything(experiments, planner);
        questions.over_long_paths(experiments, planner);
        questions.over_robots_of_one_k(experiments, planner);
    }
    questions.over_noise(experiments);
    let Questions(mut questions) = questions;
    // The same question for several planners stands together.
    let asked: Vec<String> = questions.iter().map(|question| question.what.clone()).collect();
    questions.sort_by_key(|question| asked.iter().position(|what| *what == question.what));
    questions
}

/// A p-value as it is read.
#[must_use]
pub fn p_text(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") }
}

/// With a capital letter.
#[must_use]
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
