//! The figures, each as a separate SVG.

mod chart;
mod errors;
mod noise;
mod paths;
mod robots;

use super::reproduction::Reproduction;

/// A figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// Number in the paper.
    pub number: u8,
    /// Title, one line.
    pub title: &'static str,
    /// The drawing as SVG.
    pub svg: String,
}

/// Function that draws a figure under a title.
type Draw = fn(&Reproduction, &'static str) -> String;

/// Returns the requested figures.
pub fn all(of: &Reproduction) -> Vec<Figure> {
    let draw: [(u8, &'static str, Draw); 5] = [
        (4, "Figure 4: errors of robot A by distance of the goal", errors::svg),
        (5, "Figure 5: representative paths of robot A, planned and grown", paths::of_robot_a),
        (6, "Figure 6: position error of robot A by noise of its growth", noise::svg),
        (7, "Figure 7: paths of robots B and C, planned and grown", paths::of_robots_b_and_c),
        (8, "Figure 8: errors by robot, and position error by k", robots::svg),
    ];
    draw.into_iter()
        .filter(|(number, ..)| of.request.has_figure(*number))
        .map(|(number, title, draw)| Figure { number, title, svg: draw(of, title) })
        .collect()
}
