//! Benchmark of the planners: time for a plan, by planner and family of goals. Run it with `cargo bench -p
//! growbot-core`.

use std::f64::consts::{PI, TAU};
use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use growbot_core::dubins2::{self, PathType, PlanarPath, PlanarPose};
use growbot_core::plan::{PlannedPath, Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

/// Min radius of the paths, mm: close to the min radius of the robot.
const RADIUS: f64 = 100.0;
/// Number of goals in each family, large enough that the branch predictor of a processor cannot learn them.
const GOALS: u32 = 8192;

/// Measures each pair of planner and family of goals. To add a pair, add a line.
fn planners(criterion: &mut Criterion) {
    let file = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml"));
    let robot = Robot::new(toml::from_str(file).unwrap()).unwrap();

    bench(criterion, "planar", "0 to 40 R", |n| planar_goal(n, 40.0), dubins2::shortest);
    bench(criterion, "planar", "0 to 5 R", |n| planar_goal(n, 5.0), dubins2::shortest);
    for (family, goal) in FAMILIES {
        bench(criterion, "planar", family, goal, dubins2::shortest);
    }
    bench(criterion, "two-plane", "from 4 R", |n| goal(n, 4.0, 12.0), |goal| to(&robot, goal, Planner::TwoPlane));
    bench(criterion, "two-plane", "0 to 4 R", |n| goal(n, 0.0, 4.0), |goal| to(&robot, goal, Planner::TwoPlane));
    bench(criterion, "shortest", "from 4 R", |n| goal(n, 4.0, 12.0), |goal| to(&robot, goal, Planner::Shortest));
    bench(criterion, "shortest", "0 to 4 R", |n| goal(n, 0.0, 4.0), |goal| to(&robot, goal, Planner::Shortest));
}

fn bench<G, P>(criterion: &mut Criterion, planner: &str, goals: &str, goal: impl Fn(u32) -> G, plan: impl Fn(&G) -> P) {
    let all: Vec<G> = (0..GOALS).map(goal).collect();
    let mut next = 0;
    criterion.benchmark_group(planner).bench_function(goals, |bencher| {
        bencher.iter(|| {
            next = (next + 1) % all.len();
            plan(black_box(&all[next]))
        });
    });
}

/// Plans a path to `goal` from the origin, where the tip points straight up.
fn to(robot: &Robot, goal: &Pose, planner: Planner) -> PlannedPath {
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    plan(robot, &start, goal, RADIUS, planner).unwrap()
}

/// Returns a number in [0, 1) for each `n`, from Weyl's sequence, whose numbers are evenly spread.
fn spread(n: u32, factor: f64) -> f64 {
    let value = f64::from(n + 1) * factor;
    value - value.floor()
}

/// Returns goal `n` of a series that is evenly spread over distance, direction and heading.
fn planar_goal(n: u32, farthest: f64) -> PlanarPose {
    let distance = farthest * spread(n, 0.754_877_666_246_692_7);
    let (y, x) = libm::sincos(TAU * spread(n, 0.569_840_290_998_053_2));
    PlanarPose { x: distance * x, y: distance * y, heading: TAU * spread(n, 0.618_033_988_749_894_9) }
}

/// The name of a family of goals, and a function that returns the goal for each `n`.
type GoalFamily = (&'static str, fn(u32) -> PlanarPose);

/// Families of goals for which path types degenerate: each goal is the end of a path that is a part of a path type.
const FAMILIES: [GoalFamily; 7] = [
    ("arc below pi", |n| laid(PathType::Lsl, [0.5 * angle(n), 0.0, 0.0])),
    ("arc above pi", |n| laid(PathType::Lsl, [PI + 0.5 * angle(n), 0.0, 0.0])),
    ("tangent arcs", |n| laid(PathType::Lsr, [angle(n), 0.0, other_angle(n)])),
    ("arc, line", |n| laid(PathType::Lsl, [angle(n), line(n), 0.0])),
    ("line, arc", |n| laid(PathType::Lsl, [0.0, line(n), angle(n)])),
    ("line", |n| laid(PathType::Lsl, [0.0, line(n), 0.0])),
    ("start is goal", |_| laid(PathType::Lsl, [0.0; 3])),
];

fn laid(path_type: PathType, lengths: [f64; 3]) -> PlanarPose {
    PlanarPath { path_type, lengths }.end()
}

fn angle(n: u32) -> f64 {
    TAU * spread(n, 0.754_877_666_246_692_7)
}

fn other_angle(n: u32) -> f64 {
    TAU * spread(n, 0.569_840_290_998_053_2)
}

fn line(n: u32) -> f64 {
    40.0 * spread(n, 0.618_033_988_749_894_9)
}

/// Returns goal `n` of a series that is evenly spread over distance (radii), direction, heading and pitch.
fn goal(n: u32, nearest: f64, farthest: f64) -> Pose {
    let distance = RADIUS * (nearest + (farthest - nearest) * spread(n, 0.754_877_666_246_692_7));
    let (y, x) = libm::sincos(TAU * spread(n, 0.569_840_290_998_053_2));
    let z = 2.0 * spread(n, 0.430_159_709_001_946_7) - 1.0;
    let across = (1.0 - z * z).sqrt();
    let position = [across * x, across * y, z].map(|part| distance * part);
    let heading = TAU * spread(n, 0.618_033_988_749_894_9) - PI;
    let pitch = PI * (spread(n, 0.819_172_513_396_164_4) - 0.5);
    Pose::new(position.into(), heading, pitch).unwrap()
}

criterion_group! {
    name = all;
    config = Criterion::default().warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    targets = planners
}
criterion_main!(all);
