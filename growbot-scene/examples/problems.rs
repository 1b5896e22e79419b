//! proto
use growbot_scene::{planner::*, read, scene::*, clear::Need, motion::Tip};
use nalgebra::Vector3;
use std::{fs::File, path::Path, time::{Instant, Duration}};
fn v(j: &serde_json::Value) -> Vector3<f64> { Vector3::from_fn(|i, _| j[i].as_f64().unwrap()) }
fn main() {
    for dir in std::env::args().skip(2) {
        let limit: f64 = std::env::args().nth(1).unwrap().parse().unwrap();
        let dir = Path::new(&dir);
        let g = read::geometry(&dir.join("scene.ply")).unwrap().geometry;
        let p: serde_json::Value = serde_json::from_reader(File::open(dir.join("problems.json")).unwrap()).unwrap();
        let r = p["point_radius_mm"].as_f64().unwrap();
        let tube = p["tube_diameter_mm"].as_f64().unwrap() / 2.0 - std::env::var("LESS").map_or(0.0, |t| t.parse().unwrap());
        for (name, q) in p["problems"].as_object().unwrap() {
            let sp = v(&q["start_mm"]); let scene = Scene::new(vec![], vec![], vec![Cloud::new(g.points.iter().copied().filter(|p| (p-sp).norm() >= 3.0).collect(), r)], vec![]);
            let problem = Problem { scene: &scene, start: Tip { position: v(&q["start_mm"]), direction: v(&q["start_direction"]).normalize() }, goal: Goal::Position { at: v(&q["goal_mm"]), tolerance: p["goal_tolerance_mm"].as_f64().unwrap() }, radius: p["radius_mm"].as_f64().unwrap(), need: Need { distance: tube, slack: 0.001 * tube }, length_max: p["length_max_mm"].as_f64().unwrap(), accept: &|_| true };
            let begin = Instant::now();
            let mut log = vec![];
            let out = search(&problem, &Budget { work: u64::MAX, deadline: Some(begin + Duration::from_secs_f64(limit)), first_only: false }, &mut |c| log.push((begin.elapsed(), c.length)));
            let total = begin.elapsed();
            print!("{} {name}: ", dir.file_name().unwrap().display());
            match out {
                Outcome::Found(c) => println!("found first {:?} {:.4}, last {:.4} in {total:?} via {}", log[0].0, log[0].1, c.length, c.via.len()),
                Outcome::NoneAt(r) => println!("none {r:?} {total:?}"),
                Outcome::Impossible(r) => println!("impossible {r:?} {total:?}"),
                Outcome::NotFound => println!("not found {total:?}"),
            }
        }
    }
}
