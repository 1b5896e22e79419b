//! Figure 4: errors in position, heading and pitch by distance of the goal, and lengths of the paths.

use growbot_core::plan::Planner;
use growbot_pictures::drawing::canvas::Canvas;
use growbot_pictures::drawing::chart::{Panel, Scale};

use super::super::comparison::open_set;
use super::super::experiments::ErrorQuantity;
use super::super::paper::{self, GROUPS, MeanSd, ROBOTS};
use super::super::reproduction::Reproduction;
use super::super::slicing_rule::SlicingRule;
use super::chart::{CanvasExt, Mark, PAPER, PanelExt, TABLE_STEP, TEXT_STEP, figure};

const SIZE: (f64, f64) = (1000.0, 920.0);

/// Returns Figure 4 as SVG.
pub fn svg(of: &Reproduction, title: &'static str) -> String {
    let notes = [
        format!(
            "{} growths in each group, between random poses, along two-plane paths, open loop, without noise.",
            of.request.repeat
        ),
        "Whole steps, rounded up: the paper's text says 3.096 mm, its Table 1 0.774 mm.".to_owned(),
    ];
    let mut canvas = figure(SIZE.0, SIZE.1, title, &notes);
    let next = canvas.legend(
        24.0,
        102.0,
        &[
            (Mark::Dot, TEXT_STEP, "a growth, steps of 3.096 mm".to_owned()),
            (Mark::Dot, TABLE_STEP, "0.774 mm".to_owned()),
            (Mark::Square, "#4a5565", "median".to_owned()),
            (Mark::Dash, "#4a5565", "means".to_owned()),
        ],
    );
    canvas.legend(next, 102.0, &[(Mark::Diamond, PAPER, "the paper's mean and SD".to_owned())]);
    let panels = [
        (ErrorQuantity::Position, "A. Position error", "distance from the goal / path length"),
        (ErrorQuantity::Heading, "B. Heading error", "degrees"),
        (ErrorQuantity::Pitch, "C. Pitch error", "degrees"),
        (ErrorQuantity::Length, "D. Length of the path", "path length / R"),
    ];
    for (index, (quantity, head, y_name)) in panels.into_iter().enumerate() {
        let area = [94.0 + 490.0 * (index % 2) as f64, 148.0 + 400.0 * (index / 2) as f64, 400.0, 310.0];
        panel(&mut canvas, of, area, quantity, head, y_name);
    }
    canvas.finish()
}

/// Returns the positions of the groups on the x axis, with their labels.
pub fn group_ticks() -> Vec<(f64, String)> {
    GROUPS.iter().enumerate().map(|(place, group)| (place as f64, format!("{group} R"))).collect()
}

fn panel(canvas: &mut Canvas, of: &Reproduction, area: [f64; 4], quantity: ErrorQuantity, head: &str, y_name: &str) {
    let clouds: &[(SlicingRule, f64, &str)] = match quantity {
        // The path is the same for every slicing rule.
        ErrorQuantity::Length => &[(SlicingRule::Text, 0.0, TEXT_STEP)],
        _ => &[(SlicingRule::Text, -0.24, TEXT_STEP), (SlicingRule::Table, 0.0, TABLE_STEP)],
    };
    let values = |slicing: SlicingRule, group: usize| {
        open_set(&of.experiments, paper::ROBOT_A, group, Planner::TwoPlane, slicing)
            .map(|set| set.values(quantity))
            .unwrap_or_default()
    };
    let groups = 0..GROUPS.len();
    let all: Vec<f64> =
        clouds.iter().flat_map(|(slicing, ..)| groups.clone().flat_map(|group| values(*slicing, group))).collect();
    let (y, limit) = scale(quantity, &all);
    let panel = Panel { area, x: Scale::Linear(-0.5, 3.5), y };
    panel.axes(canvas, head, "distance from start to goal", y_name, Some(&group_ticks()));
    for (slicing, offset, colour) in clouds {
        let mut means = Vec::new();
        for group in groups.clone() {
            let (x, values) = (group as f64 + offset, values(*slicing, group));
            let shown: Vec<f64> =
                values.iter().copied().filter(|value| limit.is_none_or(|max| *value <= max)).collect();
            panel.cloud(canvas, x, &shown, colour);
            means.push((x, super::super::statistics::SampleSummary::of(&values).mean));
        }
        panel.means(canvas, &means, colour);
    }
    match quantity {
        ErrorQuantity::Position => {
            for (group, number) in ROBOTS[paper::ROBOT_A].position_error.into_iter().flatten().enumerate() {
                panel.whisker(canvas, group as f64 + 0.24, number, Mark::Diamond, PAPER);
            }
        }
        ErrorQuantity::Heading => over_groups(canvas, &panel, paper::HEADING_ERROR_DEG),
        ErrorQuantity::Pitch => over_groups(canvas, &panel, paper::PITCH_ERROR_DEG),
        ErrorQuantity::Length => {
            let straight: Vec<(f64, f64)> =
                GROUPS.iter().enumerate().map(|(place, group)| (place as f64, f64::from(*group))).collect();
            panel.means(canvas, &straight, PAPER);
            let (x, y) = panel.place(2.2, 12.0);
            canvas.text(x, y, "note", "straight to the goal");
        }
        ErrorQuantity::Direction => {}
    }
    if let Some(max) = limit {
        let beyond = all.iter().filter(|value| **value > max).count();
        if beyond > 0 {
            let [left, top, width, _] = area;
            let note = format!("{beyond} of {} lie above, at steep pitch", all.len());
            canvas.text(left + width - 6.0, top + 18.0, "note end", note);
        }
    }
}

/// Draws the mean and the standard deviation that the paper quotes for all groups together.
fn over_groups(canvas: &mut Canvas, panel: &Panel, number: MeanSd) {
    const AT: f64 = 3.36;
    panel.whisker(canvas, AT, number, Mark::Diamond, PAPER);
    let (x, y) = panel.place(AT, number.mean + number.sd);
    canvas.text(x + 8.0, y - 8.0, "note end", "paper, all groups");
}

/// Returns the scale of a quantity, and the limit above which values are cut off. Single heading errors at steep pitch
/// would otherwise hide all others.
fn scale(quantity: ErrorQuantity, values: &[f64]) -> (Scale, Option<f64>) {
    if quantity != ErrorQuantity::Heading {
        return (Scale::from_zero(values.iter().copied()), None);
    }
    let max = 2.0 * super::super::statistics::SampleSummary::of(values).p95;
    let scale = Scale::from_zero(values.iter().copied().filter(|value| *value <= max));
    let Scale::Linear(_, top) = scale else { return (scale, None) };
    (scale, Some(top))
}
