//! Ours beside the paper's: what it quotes, the significance tests, and why we differ.

use growbot_core::plan::Planner;

use super::experiments::{Cutting, Experiments, Quantity, Set};
use super::paper::{self, GROUPS, ROBOTS};
use super::statistics::{Summary, Test, anova, kruskal_wallis};

/// The planner of the paper, by which we are compared with it.
const PAPERS_PLANNER: Planner = Planner::TwoPlane;

/// The groups that the paper calls long paths: from 8 radii on, places in [`GROUPS`].
const LONG: std::ops::Range<usize> = 1..4;

/// A mean that the paper quotes.
#[derive(Debug, Clone, PartialEq)]
pub struct Quoted {
    /// What it is the mean of.
    pub what: &'static str,
    /// The paper's mean and standard deviation.
    pub paper: (f64, f64),
    /// How many decimals tell something.
    pub decimals: usize,
    /// How the paths were cut, and our mean and standard deviation.
    pub ours: Vec<(String, f64, f64)>,
    /// Why they differ.
    why: &'static str,
}

/// A question whether groups differ, with the answers of both tests.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    /// What is compared with what.
    pub what: String,
    /// How the paths were cut.
    pub cutting: String,
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

/// Position errors of a robot in a group, beside those of Table 2.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Place in [`ROBOTS`].
    pub robot: usize,
    /// Place in [`GROUPS`].
    pub group: usize,
    /// The planner.
    pub planner: Planner,
    /// How the paths were cut.
    pub cutting: Cutting,
    /// Ours.
    pub ours: Summary,
    /// The paper's mean and standard deviation.
    pub paper: (f64, f64),
}

impl Cell {
    /// Whether our mean lies within the paper's mean and its standard deviation.
    #[must_use]
    pub fn is_within(&self) -> bool {
        (self.ours.mean - self.paper.0).abs() <= self.paper.1
    }
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
    /// The worst that exact slicing without noise gives: position error over the length, direction error in radians, and growths.
    pub exact: Option<(f64, f64, usize)>,
    /// Where we differ, and why.
    pub differences: Vec<Difference>,
}

/// Growths without noise and without feedback.
pub(super) fn open_set(
    experiments: &Experiments,
    robot: usize,
    group: usize,
    planner: Planner,
    cutting: Cutting,
) -> Option<&Set> {
    experiments.sets.iter().find(|set| {
        let condition = &set.condition;
        (set.robot, set.group, condition.planner, condition.cutting) == (robot, group, planner, cutting)
            && condition.noise == 0.0
            && !condition.feedback
    })
}

/// The values of these robots and groups, each a group of its own. None where any was not grown.
fn values(
    experiments: &Experiments,
    members: impl IntoIterator<Item = (usize, usize)>,
    planner: Planner,
    cutting: impl Fn(usize) -> Cutting,
    quantity: Quantity,
) -> Option<Vec<Vec<f64>>> {
    members
        .into_iter()
        .map(|(robot, group)| {
            open_set(experiments, robot, group, planner, cutting(robot)).map(|set| set.values(quantity))
        })
        .collect()
}

impl Comparison {
    /// Compares what was grown.
    #[must_use]
    pub fn of(experiments: &Experiments) -> Self {
        let (table2, quoted) = (table2(experiments), quoted(experiments));
        let questions = questions(experiments);
        let differences = differences(&table2, &quoted, &questions);
        Self { table2, quoted, questions, exact: exact(experiments), differences }
    }
}

fn table2(experiments: &Experiments) -> Vec<Cell> {
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
                cutting: condition.cutting,
                ours: set.summary(Quantity::Position),
                paper: paper[set.group],
            });
        }
    }
    cells
}

fn exact(experiments: &Experiments) -> Option<(f64, f64, usize)> {
    let growths = experiments.sets.iter().flat_map(|set| &set.growths).filter(|growth| {
        growth.condition.cutting == Cutting::Exact && growth.condition.noise == 0.0 && !growth.condition.feedback
    });
    growths.fold(None, |worst, growth| {
        let (position, direction, count) = worst.unwrap_or((0.0, 0.0, 0));
        let arrival = &growth.arrival;
        Some((
            arrival.normalized_position_error.max(position),
            arrival.direction_error_deg.to_radians().max(direction),
            count + 1,
        ))
    })
}

/// Labels the cutting of a robot.
fn label(experiments: &Experiments, robot: usize, cutting: Cutting) -> String {
    cutting.label(&experiments.robots[robot])
}

fn quoted(experiments: &Experiments) -> Vec<Quoted> {
    let mut quoted = Vec::new();
    // The paper's is a mean of the groups' means, as far as its small standard deviation tells.
    let over_groups = |cutting: Cutting, quantity: Quantity| {
        let groups = (0..GROUPS.len()).map(|group| (paper::A, group));
        let values = values(experiments, groups, PAPERS_PLANNER, |_| cutting, quantity)?;
        let means: Vec<f64> = values.iter().map(|values| Summary::of(values).mean).collect();
        let of_means = Summary::of(&means);
        Some((label(experiments, paper::A, cutting), of_means.mean, of_means.sd))
    };
    let long = |robot: usize, cutting: Cutting, planner: Planner| {
        let groups = LONG.map(|group| (robot, group));
        let values = values(experiments, groups, planner, |_| cutting, Quantity::Position)?;
        let all = Summary::of(&values.concat());
        let path = if planner == PAPERS_PLANNER { "" } else { ", shortest path" };
        Some((label(experiments, robot, cutting) + path, all.mean, all.sd))
    };
    let mut push = |what, paper, decimals, why, ours: Vec<Option<(String, f64, f64)>>| {
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
        let cuttings = Cutting::of_robot(paper::A);
        push(what, paper, 2, why, cuttings.iter().map(|cutting| over_groups(*cutting, quantity)).collect());
    }
    for (what, paper, robot, why) in [
        ("position error of robot B over the path's length, groups from 8 R on", paper::LONG_PATHS_B, paper::B, WHY_B),
        ("position error of robot C over the path's length, groups from 8 R on", paper::LONG_PATHS_C, paper::C, WHY_C),
    ] {
        let cuttings = Cutting::of_robot(robot);
        let by_cutting = cuttings.iter().map(|cutting| long(robot, *cutting, PAPERS_PLANNER));
        let shortest = long(robot, Cutting::Table, Planner::Shortest);
        push(what, paper, 4, why, by_cutting.chain([shortest]).collect());
    }
    quoted
}

fn questions(experiments: &Experiments) -> Vec<Question> {
    let mut questions = Vec::new();
    let mut ask =
        |what: String, cutting: String, planner: Planner, paper: Option<f64>, values: Option<Vec<Vec<f64>>>| {
            let Some(values) = values else { return };
            let groups: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
            questions.push(Question {
                what,
                cutting,
                planner,
                groups: groups.len(),
                n: values.iter().map(Vec::len).sum(),
                paper,
                kruskal_wallis: kruskal_wallis(&groups),
                anova: anova(&groups),
            });
        };
    let whole = [Cutting::Text, Cutting::Table];
    for planner in [Planner::TwoPlane, Planner::Shortest] {
        for cutting in whole {
            let of_a = || (0..GROUPS.len()).map(|group| (paper::A, group));
            for (what, quantity, paper) in [
                ("heading error over the groups of robot A", Quantity::Heading, Some(paper::P_HEADING_A)),
                ("pitch error over the groups of robot A", Quantity::Pitch, Some(paper::P_PITCH_A)),
                ("position error over the groups of robot A", Quantity::Position, None),
            ] {
                let label = label(experiments, paper::A, cutting);
                ask(
                    what.to_owned(),
                    label,
                    planner,
                    paper,
                    values(experiments, of_a(), planner, |_| cutting, quantity),
                );
            }
        }
        for cutting in whole {
            let of = |robot| if Cutting::of_robot(robot).contains(&cutting) { cutting } else { Cutting::Table };
            for (what, quantity, paper) in [
                ("heading error over all robots and groups", Quantity::Heading, Some(paper::P_HEADING_ALL)),
                ("pitch error over all robots and groups", Quantity::Pitch, Some(paper::P_PITCH_ALL)),
            ] {
                let everywhere = (0..ROBOTS.len()).flat_map(|robot| (0..GROUPS.len()).map(move |group| (robot, group)));
                let label = format!("{}; B, C by Table 3", label(experiments, paper::A, cutting));
                ask(what.to_owned(), label, planner, paper, values(experiments, everywhere, planner, of, quantity));
            }
        }
        for (what, robot, cutting, paper) in [
            ("position error over the groups from 8 R on, robot B", paper::B, Cutting::Table, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot B", paper::B, Cutting::Tenth, paper::P_LONG_B),
            ("position error over the groups from 8 R on, robot C", paper::C, Cutting::Table, paper::P_LONG_C),
            ("position error over the groups from 8 R on, robot C", paper::C, Cutting::Half, paper::P_LONG_C),
        ] {
            let groups = LONG.map(|group| (robot, group));
            let label = label(experiments, robot, cutting);
            let values = values(experiments, groups, planner, |_| cutting, Quantity::Position);
            ask(what.to_owned(), label, planner, Some(paper), values);
        }
        for (cutting, robots, group) in whole.into_iter().flat_map(|cutting| {
            paper::CONSTANT_K
                .into_iter()
                .flat_map(move |robots| (0..GROUPS.len()).map(move |group| (cutting, robots, group)))
        }) {
            let names = robots.map(|robot| ROBOTS[robot].name).join(", ");
            let what = format!("position error over robots of one k, {names}, {} R", GROUPS[group]);
            let label = label(experiments, robots[0], cutting);
            let members = robots.into_iter().map(|robot| (robot, group));
            ask(what, label, planner, None, values(experiments, members, planner, |_| cutting, Quantity::Position));
        }
    }
    for (group, distance) in GROUPS.iter().enumerate() {
        for cutting in Cutting::of_robot(paper::A) {
            let levels = experiments.noise.iter().filter(|set| {
                set.group == group
                    && set.condition.cutting == *cutting
                    && set.condition.noise > 0.0
                    && !set.condition.feedback
            });
            let values: Vec<_> = levels.map(|set| set.values(Quantity::Position)).collect();
            let what = format!("position error over the levels of noise, robot A, {distance} R");
            let label = label(experiments, paper::A, *cutting);
            ask(what, label, PAPERS_PLANNER, None, (!values.is_empty()).then_some(values));
        }
    }
    // What asks the same stands together.
    let asked: Vec<String> = questions.iter().map(|question| question.what.clone()).collect();
    questions.sort_by_key(|question| asked.iter().position(|what| *what == question.what));
    questions
}

fn differences(table2: &[Cell], quoted: &[Quoted], questions: &[Question]) -> Vec<Difference> {
    let mut differences = Vec::new();
    let by = |cutting: Cutting| {
        let cells: Vec<&Cell> =
            table2.iter().filter(|cell| cell.cutting == cutting && cell.planner == PAPERS_PLANNER).collect();
        let within = cells.iter().filter(|cell| cell.is_within()).count();
        let ratios: Vec<f64> = cells.iter().map(|cell| cell.ours.mean / cell.paper.0).collect();
        let (least, greatest) =
            ratios.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), ratio| (a.min(*ratio), b.max(*ratio)));
        (within, cells.len(), Summary::of(&ratios).median, least, greatest)
    };
    if !table2.is_empty() {
        let (text, table) = (by(Cutting::Text), by(Cutting::Table));
        differences.push(Difference {
            what: "Table 2: position errors of robots A to A8",
            by: format!(
                "With steps of 3.096 mm, {} of {} means lie within the paper's mean and its SD; ours over the paper's is {:.2} at \
                 the median, {:.2} to {:.2}. With steps of 0.774 mm, {} of {} do; {:.2} at the median.",
                text.0, text.1, text.2, text.3, text.4, table.0, table.1, table.2
            ),
            why: "The text says that g t is 0.3096 (cm) throughout, Table 1 gives 0.0774 cm in every row. Whole steps, rounded up, pass \
                  the end of each segment by half a step on average, so the errors are in proportion to the step: Table 2 goes with the \
                  text's value, not with Table 1's. What is left is chance, and how the paper drew its poses, which it does not say.",
        });
    }
    for quoted in quoted {
        let Some((label, mean, sd)) = quoted.ours.first() else { continue };
        let digits = quoted.decimals;
        let others: Vec<String> =
            quoted.ours.iter().skip(1).map(|(label, mean, _)| format!("{mean:.digits$} with {label}")).collect();
        let (paper, paper_sd) = quoted.paper;
        differences.push(Difference {
            what: quoted.what,
            by: format!(
                "{mean:.digits$} +- {sd:.digits$} with {label}, {paper:.digits$} +- {paper_sd:.digits$} in the paper: {:.2} times as much; {}.",
                mean / paper,
                others.join(", ")
            ),
            why: quoted.why,
        });
    }
    let ps: Vec<String> = [paper::P_HEADING_ALL, paper::P_PITCH_ALL]
        .into_iter()
        .filter_map(|p| {
            let question = questions.iter().find(|question| question.paper == Some(p))?;
            Some(format!("{}: p {} (paper: {p:.4})", question.what, p_text(question.kruskal_wallis?.p)))
        })
        .collect();
    if !ps.is_empty() {
        differences.push(Difference {
            what: "heading and pitch errors over all robots: the paper finds no difference",
            by: capital(&format!("{}. Ours depend on the robot.", ps.join("; "))),
            why: "A whole step bends by k: 1.8 degrees for robot A (3.096 mm at a radius of 100 mm), 0.6 for A3, 5.3 for A6 and B, 30 for C. \
                  Steps that are rounded up turn too far by half of that in each arc on average, so direction errors grow with k as \
                  position errors do. Errors of direction that are the same for all robots cannot come out of whole steps, while the position \
                  errors of Table 2, which grow with k, do. The paper does not say how the last step of an arc is bent.",
        });
    }
    differences
}

/// Why heading errors differ.
const WHY_HEADING: &str = "As for the pitch, and heading errors depend on how poses are drawn besides: near straight up or down a small angle is a large heading. \
    With directions uniform on the sphere heading errors are pi/2 times the pitch errors on average; the paper's are hardly larger than its \
    pitch errors. The angle between the directions, in the files, does not depend on it.";
/// Why pitch errors differ.
const WHY_PITCH: &str = "The paper's 1.77 degrees are the bend of one whole step of 3.096 mm at R = 100 mm: the most that rounding up turns too far in one arc. On \
    average it turns too far by half of that, and only a part of it goes up or down. So the paper's simulation turned further than rounding \
    up does, or measured otherwise; it does not say. Its position errors leave no room for it, except at the very end of the path.";
/// Why robot B's errors differ.
const WHY_B: &str = "By k = 0.0921, robot B's steps are three times as long, for its radius, as robot A's of 3.096 mm, so with whole steps its errors must \
    be larger than robot A's; the paper's are three times smaller. They go with a step a tenth as long (6.264 mm, k = 0.0092), as if \
    a centimetre had been taken for a millimetre. That is a guess.";
/// Why robot C's errors differ.
const WHY_C: &str = "At k = 0.5263 a step bends by 30 degrees and an arc is a handful of steps. The paper's mean goes with a step of about half of Table 3's: 10 mm, the \
    distance of its latches. That is a guess, and a weaker one than for robot B: ours grow with the distance for either step, the paper's do not. By \
    the shortest path, of three segments instead of five or six, ours come nearer with Table 3's step, and hardly depend on the distance.";

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
