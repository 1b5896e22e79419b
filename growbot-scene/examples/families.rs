//! proto
use growbot_scene::{planner::*, families::*, clear::Need};
use std::time::{Instant, Duration};
fn main() {
    let per: u64 = std::env::args().nth(1).unwrap().parse().unwrap();
    let limit: f64 = std::env::args().nth(2).unwrap().parse().unwrap();
    let pose = std::env::args().nth(3).is_some();
    let verbose = std::env::args().nth(4).is_some();
    let body = Body { radius: 100.0, need: 28.55 };
    for family in FAMILIES {
        let (mut planted, mut found, mut quick, mut sealed, mut none, mut other, mut of) = (0,0,0,0,0,0,0);
        let mut times = vec![];
        for n in 0..per {
            let d = draw(family, n, &body);
            let scene = d.scene();
            let goal = if pose { Goal::Pose(d.goal) } else { Goal::Position { at: d.goal.position, tolerance: 0.0 } };
            let problem = Problem { scene: &scene, start: d.start, goal, radius: body.radius, need: Need { distance: body.need, slack: 0.001 * body.need }, length_max: 1e5, accept: &|_| true };
            let begin = Instant::now();
            let mut first = None;
            if let Known::Planted(way) = &d.known { let c = growbot_scene::clear::least(&scene, way, 1e-3); assert!(c.distance > body.need, "{c:?}"); }
            let out = search(&problem, &Budget { work: u64::MAX, deadline: Some(begin + Duration::from_secs_f64(limit)), first_only: true }, &mut |_| { if first.is_none() { first = Some(begin.elapsed()); } });
            let t = begin.elapsed();
            let f = matches!(out, Outcome::Found(_));
            match d.known {
                Known::Planted(_) => { planted += 1; found += u32::from(f); quick += u32::from(f && t.as_secs_f64() < 1.0); times.push(t); if !f && verbose { println!("missed {family:?} {n} {out:?}"); } }
                Known::Sealed => { sealed += 1; none += u32::from(matches!(out, Outcome::Impossible(_))); if verbose { println!("sealed {family:?} {n} {out:?} {t:?}"); } assert!(!f, "sealed {n}"); }
                Known::Nothing => { of += 1; other += u32::from(f); }
            }
        }
        times.sort();
        println!("{family:?}: planted {found}/{planted} within 1 s {quick} median {:?} worst {:?}; sealed none {none}/{sealed}; others {other}/{of}", times[times.len()/2], times.last().unwrap());
    }
}
