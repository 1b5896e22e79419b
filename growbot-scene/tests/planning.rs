//! Paths through random scenes. A path is found if the scene was built around one, none is found if the goal is sealed,
//! and each found path is clear at every point.

use growbot_scene::centreline::{TipPose, angle_between};
use growbot_scene::clearance::RequiredClearance;
use growbot_scene::planner::{PlannerGoal, PlanningProblem, SearchBudget, SearchOutcome, search};
use growbot_scene::random_scenes::{FAMILIES, KnownPath, RandomScene, TubeLimits, brute_force_clearance, random_scene};
use growbot_scene::scene::Scene;
use nalgebra::Vector3;

/// Limits of the body of the robot growbot-a with a margin of 5 mm.
const BODY: TubeLimits = TubeLimits { radius: 100.0, clearance: 28.55 };

/// Returns the number of scenes of each family that are tested. GROWBOT_SCENES sets it for a long trial.
fn scenes() -> u64 {
    std::env::var("GROWBOT_SCENES").ok().and_then(|count| count.parse().ok()).unwrap_or(10)
}

fn plan(drawn: &RandomScene, goal: PlannerGoal, budget: &SearchBudget) -> SearchOutcome {
    let scene = drawn.scene();
    let problem = PlanningProblem {
        scene: &scene,
        start: drawn.start,
        goal,
        radius: BODY.radius,
        required_clearance: RequiredClearance { distance: BODY.clearance, tolerance: 1e-3 * BODY.clearance },
        max_length: 1e5,
        accept: &|_| true,
    };
    search(&problem, budget, &mut |_| ())
}

#[test]
fn constructed_paths_are_found_and_sealed_goals_are_infeasible() {
    for family in FAMILIES {
        for number in 0..scenes() {
            let drawn = random_scene(family, number, &BODY);
            let free = PlannerGoal::Position { at: drawn.goal.position, tolerance: 0.0 };
            // If nothing is known there may be no path, so a short search is enough.
            let work = if drawn.known == KnownPath::Unknown { 100_000 } else { 3_000_000 };
            let budget = SearchBudget { max_queries: work, deadline: None, stop_at_first: true };
            for goal in [free, PlannerGoal::Pose(drawn.goal)] {
                let outcome = plan(&drawn, goal, &budget);
                match (&drawn.known, &outcome) {
                    (KnownPath::Path(_), SearchOutcome::Found(_))
                    | (KnownPath::NoPath, SearchOutcome::Infeasible(_)) => {}
                    (KnownPath::Unknown, _) => {}
                    (known, outcome) => panic!("{family:?} {number}: {known:?}, {outcome:?}"),
                }
                if let SearchOutcome::Found(chain) = outcome {
                    let nearest = brute_force_clearance(&drawn, &chain.segments, 1.0);
                    assert!(nearest >= BODY.clearance, "{family:?} {number}: {nearest} mm");
                    assert_joined(&drawn, &chain.segments, goal);
                }
            }
        }
    }
}

/// Asserts that each segment begins at the end of the previous one, and that the last segment ends at the goal.
fn assert_joined(drawn: &RandomScene, stretches: &[growbot_scene::centreline::ArcSegment], goal: PlannerGoal) {
    let mut tip = drawn.start;
    for stretch in stretches {
        assert!(stretch.curvature <= (1.0 + 1e-9) / BODY.radius);
        assert_near(&stretch.from, &tip, 1e-6);
        tip = stretch.end();
    }
    let direction = if let PlannerGoal::Pose(goal) = goal { goal.direction } else { tip.direction };
    assert_near(&tip, &TipPose { position: goal.position(), direction }, 1e-6);
}

fn assert_near(a: &TipPose, b: &TipPose, within: f64) {
    assert!((a.position - b.position).norm() < within, "{a:?}, {b:?}");
    assert!(angle_between(&a.direction, &b.direction) < within, "{a:?}, {b:?}");
}

#[test]
fn results_are_the_same_in_every_run_and_thread() {
    let all = || {
        let budget = SearchBudget { max_queries: 100_000, deadline: None, stop_at_first: false };
        let drawn = FAMILIES.map(|family| random_scene(family, 1, &BODY));
        drawn.map(|drawn| plan(&drawn, PlannerGoal::Pose(drawn.goal), &budget))
    };
    let here = all();
    let threads: Vec<_> = (0..3).map(|_| std::thread::spawn(all)).collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), here);
    }
}

#[test]
fn more_effort_never_gives_a_longer_path() {
    for family in FAMILIES {
        let drawn = random_scene(family, 2, &BODY);
        let mut before = f64::INFINITY;
        for work in [30_000, 100_000, 300_000] {
            let budget = SearchBudget { max_queries: work, deadline: None, stop_at_first: false };
            let SearchOutcome::Found(chain) = plan(&drawn, PlannerGoal::Pose(drawn.goal), &budget) else { continue };
            // A position fewer on the path is worth a ten-thousandth of the distance.
            let price = 1e-4 * (drawn.goal.position - drawn.start.position).norm();
            let cost = chain.length + price * chain.via.len() as f64;
            assert!(cost <= before, "{family:?}: {cost} after {before}");
            before = cost;
        }
        assert!(before.is_finite(), "{family:?}");
    }
}

#[test]
fn an_empty_scene_has_the_shortest_path() {
    let drawn = random_scene(FAMILIES[0], 0, &BODY);
    let at = Vector3::new(0.0, 0.0, 500.0);
    let scene = Scene::default();
    let problem = PlanningProblem {
        scene: &scene,
        start: drawn.start,
        goal: PlannerGoal::Position { at, tolerance: 2.0 },
        radius: 100.0,
        required_clearance: RequiredClearance { distance: 20.0, tolerance: 0.02 },
        max_length: 1e4,
        accept: &|_| true,
    };
    let budget = SearchBudget { max_queries: 1000, deadline: None, stop_at_first: false };
    let SearchOutcome::Found(chain) = search(&problem, &budget, &mut |_| ()) else { panic!() };
    assert!((chain.length - 498.0).abs() < 1e-9);
}
