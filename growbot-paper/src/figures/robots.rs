//! Figure 8: errors of robots A, B and C by distance of the goal, and the position error of all robots by k.

use growbot_core::plan::Planner;
use growbot_pictures::drawing::canvas::Canvas;
use growbot_pictures::drawing::chart::{Panel, Scale};

use super::super::comparison::open_set;
use super::super::experiments::ErrorQuantity;
use super::super::paper::{self, GROUPS, MeanSd, ROBOTS};
use super::super::reproduction::Reproduction;
use super::super::slicing_rule::SlicingRule;
use super::super::statistics::SampleSummary;
use super::chart::{CanvasExt, EXACT, Mark, PAPER, PanelExt, ROBOT, TABLE_STEP, TEXT_STEP, dashed, figure};
use super::errors::group_ticks;

const SIZE: (f64, f64) = (1000.0, 950.0);
/// Robots that the panels A to C show, as indexes into `ROBOTS`.
const SHOWN: [usize; 3] = [paper::ROBOT_A, paper::B, paper::C];

/// Returns Figure 8 as SVG.
pub fn svg(of: &Reproduction, title: &'static str) -> String {
    let notes = [
        format!(
            "Means of {} growths between random poses, along two-plane paths, whole steps, open loop, without noise.",
            of.request.repeat
        ),
        "Robot A grows by steps of 3.096 mm, B of 62.64 mm, C of 20 mm. The paper's numbers are from its text and its \
         Table 2."
            .to_owned(),
    ];
    let mut canvas = figure(SIZE.0, SIZE.1, title, &notes);
    canvas.legend(
        24.0,
        102.0,
        &[
            (Mark::Disc, ROBOT[0], "robot A".to_owned()),
            (Mark::Disc, ROBOT[1], "robot B".to_owned()),
            (Mark::Disc, ROBOT[2], "robot C".to_owned()),
            (Mark::Diamond, PAPER, "the paper's A, mean and SD".to_owned()),
            (Mark::Dash, PAPER, "the paper's mean: black, of all robots".to_owned()),
        ],
    );
    let panels = [
        (ErrorQuantity::Heading, "A. Heading error", "degrees"),
        (ErrorQuantity::Pitch, "B. Pitch error", "degrees"),
        (ErrorQuantity::Position, "C. Position error", "distance from the goal / path length"),
    ];
    for (index, (quantity, head, y_name)) in panels.into_iter().enumerate() {
        by_group(&mut canvas, of, area(index), quantity, head, y_name);
    }
    by_k(&mut canvas, of, area(3));
    canvas.finish()
}

fn area(index: usize) -> [f64; 4] {
    [94.0 + 490.0 * (index % 2) as f64, 148.0 + 412.0 * (index / 2) as f64, 400.0, 310.0]
}

fn by_group(canvas: &mut Canvas, of: &Reproduction, area: [f64; 4], quantity: ErrorQuantity, head: &str, y_name: &str) {
    let summary = |robot: usize, group: usize| {
        open_set(&of.experiments, robot, group, Planner::TwoPlane, SlicingRule::of_paper(robot))
            .map(|set| set.summary(quantity))
    };
    let everywhere = SHOWN.iter().flat_map(|robot| (0..GROUPS.len()).filter_map(|group| summary(*robot, group)));
    let quoted: Vec<f64> = match quantity {
        ErrorQuantity::Position => {
            let of_a = ROBOTS[paper::ROBOT_A].position_error.into_iter().flatten().map(|MeanSd { mean, sd }| mean - sd);
            of_a.chain([paper::LONG_PATHS_B.mean, paper::LONG_PATHS_C.mean]).collect()
        }
        _ => vec![paper::PITCH_ERROR_DEG.mean],
    };
    let y = Scale::log_around(everywhere.map(|summary| summary.mean).chain(quoted));
    let panel = Panel { area, x: Scale::Linear(-0.5, 3.5), y };
    panel.axes(canvas, head, "distance from start to goal", y_name, Some(&group_ticks()));
    // The paper's numbers are drawn first, so that ours are on top.
    let across = |canvas: &mut Canvas, mean: f64, from: f64, colour: &str| {
        canvas.line([panel.place(from, mean), panel.place(3.5, mean)], dashed(colour));
    };
    match quantity {
        ErrorQuantity::Position => {
            across(canvas, paper::LONG_PATHS_B.mean, 0.5, ROBOT[1]);
            across(canvas, paper::LONG_PATHS_C.mean, 0.5, ROBOT[2]);
            for (group, number) in ROBOTS[paper::ROBOT_A].position_error.into_iter().flatten().enumerate() {
                panel.whisker(canvas, group as f64 + 0.16, number, Mark::Diamond, PAPER);
            }
        }
        // The paper quotes about the same value for all robots.
        ErrorQuantity::Heading => across(canvas, paper::HEADING_ERROR_DEG.mean, -0.5, PAPER),
        _ => across(canvas, paper::PITCH_ERROR_DEG.mean, -0.5, PAPER),
    }
    for (robot, colour) in SHOWN.into_iter().zip(ROBOT) {
        let points: Vec<(f64, SampleSummary)> =
            (0..GROUPS.len()).filter_map(|group| Some((group as f64, summary(robot, group)?))).collect();
        let line = points.iter().map(|(x, summary)| panel.place(*x, summary.mean));
        canvas.line(line.collect::<Vec<_>>(), format_args!("stroke=\"{colour}\" stroke-width=\"1.8\""));
        for (x, summary) in points {
            Mark::Disc.draw(canvas, panel.place(x, summary.mean), colour);
        }
    }
}

/// Returns the label of the paper's number for a robot. Robots with the same `k` share one label: it is returned for
/// the first of them, and `None` for the others.
fn named(robot: usize) -> Option<&'static str> {
    match robot {
        0 => Some("A, A1, A2"),
        3 => Some("A3 - A5"),
        6 => Some("A6 - A8"),
        paper::B => Some("B"),
        paper::C => Some("C"),
        _ => None,
    }
}

/// Draws the mean position errors of all robots in the groups from 8 radii on, over the bend of one step (`k`,
/// radians).
fn by_k(canvas: &mut Canvas, of: &Reproduction, area: [f64; 4]) {
    let long = 1..GROUPS.len();
    let mean_of = |robot: usize, slicing: SlicingRule| {
        let means: Option<Vec<f64>> = long
            .clone()
            .map(|group| {
                open_set(&of.experiments, robot, group, Planner::TwoPlane, slicing)
                    .map(|set| set.summary(ErrorQuantity::Position).mean)
            })
            .collect();
        means.map(|means| SampleSummary::of(&means).mean)
    };
    let panel = Panel { area, x: Scale::Log(0.001, 1.0), y: Scale::Log(0.001, 1.0) };
    panel.axes(
        canvas,
        "D. Position error by k, groups from 8 R on",
        "k: bend of a step at R, radians",
        "distance from the goal / path length",
        None,
    );
    for (robot, paper) in ROBOTS.iter().enumerate() {
        let printed = match robot {
            paper::B => Some(paper::LONG_PATHS_B.mean),
            paper::C => Some(paper::LONG_PATHS_C.mean),
            _ => paper.position_error.map(|groups| groups[1..].iter().map(|group| group.mean).sum::<f64>() / 3.0),
        };
        if let Some(mean) = printed {
            let (x, y) = panel.place(paper.k, mean);
            Mark::Diamond.draw(canvas, (x, y), PAPER);
            if let Some(name) = named(robot) {
                canvas.text(x + 10.0, y + 4.5, "note", name);
            }
        }
        for slicing in SlicingRule::of_robot(robot) {
            let described = &of.experiments.robots[robot];
            let (Some(step), Some(mean)) = (slicing.step(described), mean_of(robot, *slicing)) else { continue };
            let k = step / described.description().planning_radius_mm;
            let (mark, colour) = match slicing {
                SlicingRule::Text => (Mark::Ring, TEXT_STEP),
                SlicingRule::Half | SlicingRule::Tenth => (Mark::Ring, EXACT),
                _ => (Mark::Ring, TABLE_STEP),
            };
            mark.draw(canvas, panel.place(k, mean), colour);
        }
    }
    let [left, top, ..] = area;
    for (line, (mark, colour, label)) in [
        (Mark::Diamond, PAPER, "the paper, at its k"),
        (Mark::Ring, TEXT_STEP, "A to A8, steps of 3.096 mm"),
        (Mark::Ring, TABLE_STEP, "A to A8, 0.774 mm; B; C"),
        (Mark::Ring, EXACT, "guesses: B, 6.264 mm; C, 10 mm"),
    ]
    .into_iter()
    .enumerate()
    {
        let y = top + 22.0 + 20.0 * line as f64;
        mark.draw(canvas, (left + 16.0, y - 4.5), colour);
        canvas.text(left + 30.0, y, "", label);
    }
}
