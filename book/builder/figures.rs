//! Figures that are drawn while the book is built: by growbot, or here from the layers that growbot exports.

use std::ffi::OsStr;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::growbot::Growbot;

/// Arguments of the growbot commands that are run for their drawings.
const COMMANDS: [&[&str]; 2] = [
    &["workspace", "--length", "1000", "-o", "reach.svg"],
    // Five growths for each group are enough for the figures. The whole command takes half a minute.
    &["reproduce", "--repeat", "5", "-o", "."],
];
/// Drawings of the paths of both planners to one goal: file name, and goal.
const PATHS: [(&str, &str); 2] = [("both-planners.svg", "0,0,-300,0,90"), ("helicoid.svg", "60,40,80,200,-20")];
/// Planners and the colours of their paths in the drawings. Later ones are drawn in front.
const PLANNERS: [(&str, &str); 2] = [("two-plane", "#d9822b"), ("shortest", "#3b82c4")];
/// Projection of the axes x, y and z to a drawing: distances to the right and down for 1 mm along the axis.
const AXES: [[f64; 2]; 3] = [[0.87, 0.25], [0.5, -0.4], [0.0, -1.0]];
/// Width and height of a drawing, pixels. `MARGIN` is its margin, pixels.
const SIZE: [f64; 2] = [640.0, 460.0];
const MARGIN: f64 = 40.0;

/// Draws all figures and writes them to a directory.
///
/// # Errors
/// Fails if a command fails.
pub fn draw(growbot: &Growbot, directory: &Path) -> Result<()> {
    fs::create_dir_all(directory)?;
    let scratch = tempfile::tempdir()?;
    for command in COMMANDS {
        growbot.says(command, scratch.path())?;
    }
    for entry in fs::read_dir(scratch.path())? {
        let path = entry?.path();
        if let (Some("svg"), Some(name)) = (path.extension().and_then(OsStr::to_str), path.file_name()) {
            fs::copy(&path, directory.join(name))?;
        }
    }
    for (file, goal) in PATHS {
        let mut lines = Vec::new();
        for (planner, colour) in PLANNERS {
            growbot.says(&["plan", "--to", goal, "--planner", planner, "-o", "plan.json"], scratch.path())?;
            growbot.says(&["export", "plan.json", "-o", "body.csv"], scratch.path())?;
            lines.push((centreline(&fs::read_to_string(scratch.path().join("body.csv"))?)?, colour));
        }
        fs::write(directory.join(file), drawing(&lines))?;
    }
    Ok(())
}

/// Parses the points of the centreline, mm, from a CSV export of growbot.
fn centreline(csv: &str) -> Result<Vec<[f64; 3]>> {
    let mut rows = csv.lines();
    let header: Vec<_> = rows.next().unwrap_or_default().split(',').collect();
    ensure!(header[1..4] == ["x_mm", "y_mm", "z_mm"], "the export has other columns than are drawn here");
    let point = |row: &str| {
        let numbers: Vec<f64> = row.split(',').skip(1).take(3).map(str::parse).collect::<Result<_, _>>()?;
        numbers.try_into().ok().context("a row of the export has no point")
    };
    rows.map(point).collect()
}

/// Returns an SVG drawing of centrelines, each with its colour, in an oblique view from above. It also shows their
/// shadows at the height of the start, and a scale bar of 100 mm.
fn drawing(lines: &[(Vec<[f64; 3]>, &str)]) -> String {
    let flat = |p: &[f64; 3]| [0, 1].map(|side| (0..3).map(|axis| AXES[axis][side] * p[axis]).sum::<f64>());
    let shadow = |p: &[f64; 3]| flat(&[p[0], p[1], 0.0]);
    let all: Vec<[f64; 2]> =
        lines.iter().flat_map(|(line, _)| line.iter().flat_map(|p| [flat(p), shadow(p)])).collect();
    let [low, high] =
        [f64::min, f64::max].map(|pick| [0, 1].map(|side| all.iter().map(|p| p[side]).reduce(pick).unwrap_or(0.0)));
    let scale =
        [0, 1].map(|side| (SIZE[side] - 2.0 * MARGIN) / (high[side] - low[side])).into_iter().fold(2.0, f64::min);
    let place = |p: [f64; 2]| [0, 1].map(|side| MARGIN + (p[side] - low[side]) * scale);
    let points = |line: &[[f64; 3]], of: &dyn Fn(&[f64; 3]) -> [f64; 2]| {
        let mut text = String::new();
        for p in line {
            let [x, y] = place(of(p));
            // Writing to a String cannot fail.
            let _ = write!(text, "{x:.1},{y:.1} ");
        }
        text
    };
    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" fill=\"none\" \
         stroke-linecap=\"round\" font-family=\"sans-serif\" font-size=\"14\">\n"
    );
    for (line, colour) in lines {
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" stroke=\"#bbb\" stroke-width=\"1.5\" stroke-dasharray=\"2 4\"/>",
            points(line, &shadow)
        );
        let _ = writeln!(svg, "<polyline points=\"{}\" stroke=\"{colour}\" stroke-width=\"4\"/>", points(line, &flat));
        for (end, name) in [(line.first(), "start"), (line.last(), "goal")] {
            let [x, y] = end.map_or([0.0; 2], |p| place(flat(p)));
            let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#222\"/>");
            let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#222\">{name}</text>", x + 9.0, y + 5.0);
        }
    }
    let (left, bottom) = (14.0, height - MARGIN);
    let top = bottom - 100.0 * scale;
    let _ = writeln!(svg, "<path d=\"M{left} {bottom}V{top:.1}\" stroke=\"#222\" stroke-width=\"2\"/>");
    let _ = writeln!(svg, "<text x=\"{left}\" y=\"{:.1}\" fill=\"#222\">100 mm</text>", bottom + 18.0);
    svg + "</svg>\n"
}
