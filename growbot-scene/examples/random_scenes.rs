//! Plans through the random scenes of `growbot_scene::random_scenes`. Checks the results at points 0.5 mm apart, with
//! every distance from every obstacle computed one by one.
//!
//! ```sh
//! cargo run --release -p growbot-scene --example random_scenes -- [SCENES OF EACH FAMILY [SECONDS [DIRECTORY [best]]]]
//! ```
//!
//! With a directory, each scene and its result are written there as JSON, for `tests/scenes/check.py`, which does not
//! use growbot's geometry. With `best`, all the time is used to shorten the first path.

use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use growbot_scene::clearance::RequiredClearance;
use growbot_scene::planner::{PlannerGoal, PlanningProblem, SearchBudget, SearchOutcome, search};
use growbot_scene::random_scenes::{
    FAMILIES, KnownPath, POINT_RADIUS, RandomScene, SceneFamily, TubeLimits, brute_force_clearance, random_scene,
};
use growbot_scene::shapes::Shape;
use nalgebra::Vector3;
use serde_json::{Value, json};

/// Limits of the body of the robot growbot-a with a margin of 5 mm.
const BODY: TubeLimits = TubeLimits { radius: 100.0, clearance: 28.55 };

#[derive(Default)]
struct Counts {
    planted: usize,
    found: usize,
    within_1_s: usize,
    sealed: usize,
    refused: usize,
    others: usize,
    others_found: usize,
    contacts: usize,
    times: Vec<Duration>,
}

fn main() {
    let number =
        |index: usize, default: u64| std::env::args().nth(index).and_then(|text| text.parse().ok()).unwrap_or(default);
    let (count, seconds) = (number(1, 100), number(2, 10));
    let directory = std::env::args().nth(3).map(PathBuf::from);
    println!("family   planted found  1 s  median     worst  sealed refused  others found  contacts");
    for family in FAMILIES {
        let mut counts = Counts::default();
        for number in 0..count {
            let written = one(family, number, seconds, &mut counts);
            if let Some(directory) = &directory {
                let file = directory.join(format!("{family:?}-{number}.json").to_lowercase());
                fs::write(&file, written.to_string()).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            }
        }
        let Counts { planted, found, within_1_s, sealed, refused, others, others_found, contacts, mut times } = counts;
        times.sort();
        let milliseconds = |time: Option<&Duration>| time.map_or(0.0, |time| 1e3 * time.as_secs_f64());
        let (median, worst) = (milliseconds(times.get(times.len() / 2)), milliseconds(times.last()));
        println!(
            "{:<8} {planted:>7} {found:>5} {within_1_s:>4} {median:>7.1} ms {worst:>6.0} ms {sealed:>7} {refused:>7} \
             {others:>7} {others_found:>5} {contacts:>9}",
            format!("{family:?}")
        );
    }
}

fn one(family: SceneFamily, number: u64, seconds: u64, counts: &mut Counts) -> Value {
    let drawn = random_scene(family, number, &BODY);
    // If nothing is known there may be no path, so a second is enough.
    let seconds = if drawn.known == KnownPath::Unknown { 1 } else { seconds };
    let (outcome, time) = plan(&drawn, number, seconds);
    let is_found = matches!(outcome, SearchOutcome::Found(_));
    match drawn.known {
        KnownPath::Path(_) => {
            counts.planted += 1;
            counts.found += usize::from(is_found);
            counts.within_1_s += usize::from(is_found && time.as_secs_f64() <= 1.0);
            counts.times.push(time);
        }
        KnownPath::NoPath => {
            counts.sealed += 1;
            counts.refused += usize::from(matches!(outcome, SearchOutcome::Infeasible(_)));
        }
        KnownPath::Unknown => {
            counts.others += 1;
            counts.others_found += usize::from(is_found);
        }
    }
    if let SearchOutcome::Found(chain) = &outcome {
        counts.contacts += usize::from(brute_force_clearance(&drawn, &chain.segments, 0.5) < BODY.clearance);
    }
    written(&drawn, number, &outcome, time)
}

/// Returns the JSON of a scene and its result: arcs and lines, lengths in mm.
fn written(drawn: &RandomScene, number: u64, outcome: &SearchOutcome, time: Duration) -> Value {
    let path = match outcome {
        SearchOutcome::Found(chain) => chain.segments.iter().map(|stretch| {
            json!({
                "position": stretch.from.position.as_slice(), "direction": stretch.from.direction.as_slice(),
                "towards": stretch.towards.as_slice(), "curvature": stretch.curvature, "length": stretch.length,
            })
        }),
        _ => return header(drawn, number, time),
    };
    let mut written = header(drawn, number, time);
    written["path"] = path.collect();
    written
}

/// Returns the JSON of a scene without a path.
fn header(drawn: &RandomScene, number: u64, time: Duration) -> Value {
    let shapes = drawn.shapes.iter().map(|shape| match shape {
        Shape::Box { centre, half_extents: half, rotation } => json!({
            "kind": "box", "centre": centre.as_slice(), "half": half.as_slice(),
            "rotation_by_columns": rotation.matrix().as_slice(),
        }),
        Shape::Ball { centre, radius } => json!({ "kind": "ball", "centre": centre.as_slice(), "radius": radius }),
        Shape::Capsule { from, to, radius } => {
            json!({ "kind": "capsule", "from": from.as_slice(), "to": to.as_slice(), "radius": radius })
        }
    });
    let faces = drawn.triangles.iter().map(|triangle| triangle.0.map(<[f64; 3]>::from));
    json!({
        "family": format!("{:?}", drawn.family),
        "known": match drawn.known {
            KnownPath::Path(_) => "planted",
            KnownPath::NoPath => "sealed",
            KnownPath::Unknown => "nothing",
        },
        "seconds": time.as_secs_f64(),
        "need": BODY.clearance,
        "radius": BODY.radius,
        "start": [drawn.start.position.as_slice(), drawn.start.direction.as_slice()],
        "goal": [drawn.goal.position.as_slice(), drawn.goal.direction.as_slice()],
        "goal_has_direction": !number.is_multiple_of(2),
        "shapes": shapes.collect::<Vec<_>>(),
        "faces": faces.collect::<Vec<_>>(),
        "points": drawn.points.iter().map(Vector3::as_slice).collect::<Vec<_>>(),
        "point_radius": POINT_RADIUS,
        "path": Value::Null,
    })
}

/// Returns the first path and the time that it took. Every other goal has a direction.
fn plan(drawn: &RandomScene, number: u64, seconds: u64) -> (SearchOutcome, Duration) {
    let scene = drawn.scene();
    let free = PlannerGoal::Position { at: drawn.goal.position, tolerance: 0.0 };
    let problem = PlanningProblem {
        scene: &scene,
        start: drawn.start,
        goal: if number.is_multiple_of(2) { free } else { PlannerGoal::Pose(drawn.goal) },
        radius: BODY.radius,
        required_clearance: RequiredClearance { distance: BODY.clearance, tolerance: 1e-3 * BODY.clearance },
        max_length: 1e5,
        accept: &|_| true,
    };
    let begin = Instant::now();
    let deadline = Some(begin + Duration::from_secs(seconds));
    let first_only = std::env::args().nth(4).is_none_or(|argument| argument != "best");
    let outcome =
        search(&problem, &SearchBudget { max_queries: u64::MAX, deadline, stop_at_first: first_only }, &mut |_| ());
    (outcome, begin.elapsed())
}
