//! Figure 6: position error by noise of the growth, along the representative path of each group.

use growbot_pictures::drawing::chart::{Panel, Scale};

use super::super::experiments::{ErrorQuantity, GrowthSet};
use super::super::paper::{GROUPS, NOISE};
use super::super::reproduction::Reproduction;
use super::super::slicing_rule::SlicingRule;
use super::chart::{CLOSED, CanvasExt, EXACT, Mark, PanelExt, TABLE_STEP, TEXT_STEP, figure};

const SIZE: (f64, f64) = (1000.0, 936.0);
/// Limit below which an error is rounding and is not drawn.
const ROUNDING: f64 = 1e-9;

/// Returns the colour of a set of growths, its offset from the tick on the x axis, and its name. `None` if the figure
/// does not show the set.
fn series(set: &GrowthSet) -> Option<(&'static str, f64, &'static str)> {
    Some(match (set.condition.slicing, set.condition.feedback) {
        (_, true) => (CLOSED, 0.36, "closed loop"),
        (SlicingRule::Text, false) => (TEXT_STEP, -0.36, "steps of 3.096 mm"),
        (SlicingRule::Table, false) => (TABLE_STEP, -0.12, "steps of 0.774 mm"),
        (SlicingRule::Exact, false) => (EXACT, 0.12, "exact slicing"),
        (SlicingRule::Half | SlicingRule::Tenth, false) => return None,
    })
}

/// Returns the legend: each series once, then the median and the means.
fn legend(sets: &[GrowthSet]) -> Vec<(Mark, &'static str, String)> {
    let mut legend: Vec<(Mark, &str, String)> = Vec::new();
    for (colour, _, name) in sets.iter().filter_map(series) {
        if legend.iter().all(|(_, other, _)| *other != colour) {
            legend.push((Mark::Dot, colour, name.to_owned()));
        }
    }
    legend.push((Mark::Square, "#4a5565", "median".to_owned()));
    legend.push((Mark::Dash, "#4a5565", "means".to_owned()));
    legend
}

/// Returns Figure 6 as SVG.
pub fn svg(of: &Reproduction, title: &'static str) -> String {
    let notes = [
        format!(
            "{} growths at each level, along the path of each group whose error is nearest to the median (Figure 5).",
            of.request.repeat_noise
        ),
        "The noise is uniform, up to that percentage of each layer's growth. Without noise and in open loop all \
         growths are the same;"
            .to_owned(),
        "exact slicing then has an error below 1e-9, outside the scale. The sensors of the closed loop always have \
         noise: 1 % of a layer, 0.5 degrees."
            .to_owned(),
    ];
    let mut canvas = figure(SIZE.0, SIZE.1, title, &notes);
    let sets = &of.experiments.noise;
    canvas.legend(24.0, 118.0, &legend(sets));
    let shown = |set: &GrowthSet| {
        let mut values = set.values(ErrorQuantity::Position);
        values.retain(|value| *value > ROUNDING);
        values
    };
    let y = Scale::log_around(sets.iter().filter(|set| series(set).is_some()).flat_map(shown));
    for (group, distance) in GROUPS.iter().enumerate() {
        let panel = Panel {
            area: [94.0 + 490.0 * (group % 2) as f64, 164.0 + 400.0 * (group / 2) as f64, 400.0, 310.0],
            x: Scale::Linear(-0.6, 4.6),
            y,
        };
        let levels: Vec<f64> = [0.0].into_iter().chain(NOISE).collect();
        let ticks: Vec<(f64, String)> =
            levels.iter().enumerate().map(|(place, level)| (place as f64, format!("{} %", 100.0 * level))).collect();
        let head = format!("{}. Goals at {distance} R", ["A", "B", "C", "D"][group]);
        panel.axes(&mut canvas, &head, "noise of the growth, +-", "position error / path length", Some(&ticks));
        let here = sets.iter().filter(|set| set.group == group);
        let mut lines: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
        for set in here {
            let Some((colour, offset, _)) = series(set) else { continue };
            let Some(place) = levels.iter().position(|level| *level == set.condition.noise) else { continue };
            let (x, values) = (place as f64 + offset, shown(set));
            panel.cloud(&mut canvas, x, &values, colour);
            if values.is_empty() {
                continue;
            }
            let mean = (x, set.summary(ErrorQuantity::Position).mean);
            match lines.iter_mut().find(|(other, _)| *other == colour) {
                Some((_, line)) => line.push(mean),
                None => lines.push((colour, vec![mean])),
            }
        }
        for (colour, line) in lines {
            panel.means(&mut canvas, &line, colour);
        }
    }
    canvas.finish()
}
