//! Plans every problem in directories of the format that is converted from Med-RAD (UNC Robotics). `scene.ply` contains
//! the centres of balls. `problems.json` contains the tube's diameter and radius, starts, and goals without a
//! direction.
//!
//! ```sh
//! cargo run --release -p growbot-scene --example med_rad -- [--seconds S] [--start-free MM] DIRECTORY...
//! ```
//!
//! `--start-free` leaves out the points whose centres lie this near to the start. The published planners of that data
//! do so within 3 mm, because bodies start in the wall of an airway there. Without it such a start is refused. If
//! `published-planners.csv` lies beside the directories, the length of RCS* is printed too. The program uses one
//! thread, and does not count the time of loading.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use growbot_scene::centreline::{TipPose, angle_between};
use growbot_scene::clearance::{RequiredClearance, min_clearance};
use growbot_scene::planner::{PlannerGoal, PlanningProblem, SearchBudget, SearchOutcome, ViaPath, search};
use growbot_scene::read;
use growbot_scene::scene::{Cloud, Scene};
use nalgebra::Vector3;
use serde::Deserialize;

#[derive(Deserialize)]
struct ProblemSetJson {
    point_radius_mm: f64,
    tube_diameter_mm: f64,
    radius_mm: f64,
    length_max_mm: f64,
    #[serde(default)]
    goal_tolerance_mm: f64,
    #[serde(default = "half_turn")]
    turn_max_deg: f64,
    problems: BTreeMap<String, QueryJson>,
}

#[derive(Deserialize)]
struct QueryJson {
    start_mm: [f64; 3],
    start_direction: [f64; 3],
    goal_mm: [f64; 3],
}

fn half_turn() -> f64 {
    180.0
}

struct Options {
    seconds: f64,
    start_free: f64,
    directories: Vec<PathBuf>,
}

fn options() -> Result<Options, Box<dyn Error>> {
    let mut options = Options { seconds: 1.0, start_free: 0.0, directories: Vec::new() };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--seconds" => options.seconds = arguments.next().ok_or("--seconds needs a number")?.parse()?,
            "--start-free" => options.start_free = arguments.next().ok_or("--start-free needs a number")?.parse()?,
            directory => options.directories.push(directory.into()),
        }
    }
    Ok(options)
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = options()?;
    let (mut solved, mut decided, mut of) = (0, 0, 0);
    let mut firsts = Vec::new();
    for directory in &options.directories {
        let written: ProblemSetJson = serde_json::from_slice(&fs::read(directory.join("problems.json"))?)?;
        let points = read::geometry(&directory.join("scene.ply"))?.geometry.points;
        for (name, query) in &written.problems {
            let answer = answer(&written, query, &points, &options);
            let place = directory.file_name().unwrap_or_default().to_string_lossy();
            let rival =
                published_length(directory, &place, name).map_or(String::new(), |length| format!("; RCS* {length}"));
            println!("{place} {name}: {}{rival}", answer.text);
            of += 1;
            solved += u32::from(answer.first.is_some());
            decided += u32::from(answer.decided);
            firsts.extend(answer.first);
        }
    }
    firsts.sort();
    let median = firsts.get(firsts.len() / 2).copied().unwrap_or_default();
    println!("{solved} of {of} solved, {decided} decided within {} s; first path: median {median:?}", options.seconds);
    Ok(())
}

/// Result of the search for one problem.
struct Answer {
    text: String,
    first: Option<Duration>,
    decided: bool,
}

fn answer(written: &ProblemSetJson, query: &QueryJson, points: &[Vector3<f64>], options: &Options) -> Answer {
    let start = Vector3::from(query.start_mm);
    let kept = points.iter().copied().filter(|point| (point - start).norm() >= options.start_free).collect();
    let scene = Scene::new(vec![], vec![], vec![Cloud::new(kept, written.point_radius_mm)], vec![]);
    let tube = 0.5 * written.tube_diameter_mm;
    let problem = PlanningProblem {
        scene: &scene,
        start: TipPose { position: start, direction: Vector3::from(query.start_direction).normalize() },
        goal: PlannerGoal::Position { at: query.goal_mm.into(), tolerance: written.goal_tolerance_mm },
        radius: written.radius_mm,
        required_clearance: RequiredClearance { distance: tube, tolerance: 1e-3 * tube },
        max_length: written.length_max_mm,
        accept: &|_| true,
    };
    let begin = Instant::now();
    let deadline = Some(begin + Duration::from_secs_f64(options.seconds));
    let mut first = None;
    let mut note = |chain: &ViaPath| first = first.or(Some((begin.elapsed(), chain.length)));
    let outcome = search(&problem, &SearchBudget { max_queries: u64::MAX, deadline, stop_at_first: false }, &mut note);
    let decided = outcome != SearchOutcome::BudgetExhausted;
    let text = match (&outcome, first) {
        (SearchOutcome::Found(chain), Some((time, length))) => {
            let clearance = min_clearance(&scene, &chain.segments, 1e-4).distance - tube;
            let turns = chain.segments.iter().flat_map(|stretch| [stretch.from, stretch.end()]);
            let turn = turns
                .map(|tip| angle_between(&tip.direction, &problem.start.direction).to_degrees())
                .fold(0.0, f64::max);
            let beyond = if turn > written.turn_max_deg { ", beyond the max turn" } else { "" };
            format!(
                "first {length:.4} mm after {time:?}, then {:.4} mm, {clearance:.4} mm clear, turns {turn:.0} deg{beyond}",
                chain.length
            )
        }
        (other, _) => format!("{other:?} after {:?}", begin.elapsed()),
    };
    Answer { text, first: first.map(|(time, _)| time), decided }
}

/// Returns the length of the last path that the published planner RCS* found for this problem.
fn published_length(directory: &Path, place: &str, name: &str) -> Option<String> {
    let table = fs::read_to_string(directory.parent()?.join("published-planners.csv")).ok()?;
    let row = table.lines().find(|row| row.starts_with(&format!("{place},{name},rcs_star,")))?;
    row.rsplit(',').next().filter(|length| !length.is_empty()).map(ToOwned::to_owned)
}
