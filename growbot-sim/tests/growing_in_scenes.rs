//! Noisy growths through random scenes, with and without feedback. The tests count the growths that touch an obstacle
//! and those that pause.
//!
//! CI runs 5 growths in each of 4 scenes. This command runs all thousand:
//!
//! ```sh
//! GROWBOT_SCENES=20 GROWBOT_GROWTHS=50 cargo test --release -p growbot-sim --test it growing_in_scenes:: -- --nocapture
//! ```
//!
//! The heights of layers have random errors of up to 10 %. A second set adds a bias of +10 % (in every second scene) or
//! -10 % to all layers of a growth. The sensors are those that feedback assumes: odometry to 1 % of a layer, gravity's
//! direction to 0.5 degrees. The scenes are generated around a path that is free for robot A with a margin of 5 mm.

use growbot_core::plan::Planner;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::simulation::{DirectionSensor, SimulatedSensors};
use growbot_core::slicing::Slicing;
use growbot_plan::feedback::DEFAULT_SENSOR_NOISE;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::robot_file;
use growbot_plan::scene_planning::{self, MAX_LENGTH_MM, SceneOptions};
use growbot_scene::centreline::{TipPose, any_perpendicular};
use growbot_scene::random_scenes::{self, FAMILIES, TubeLimits};
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::simulation::Simulation;
use growbot_sim::simulation::campaign::{Campaign, ObstacleStatistics};
use nalgebra::{Matrix3, Rotation3, Translation3};

const MARGIN: f64 = 5.0;
const RADIUS: f64 = 100.0;
const EFFORT: u64 = 5;

/// Returns the number in an environment variable, or `default` if the variable is not set.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name} is {text}, no number")))
}

#[test]
fn no_closed_loop_growth_touches_an_obstacle() {
    let (scenes, growths) = (number("GROWBOT_SCENES", 4), number("GROWBOT_GROWTHS", 3));
    let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    println!("simulated growths of robot A: how many touch, pause, take a detour; min clearance in mm");
    let noise = table(&robot, scenes, growths, false);
    assert_eq!(noise.closed.contacts, 0);
    let bias = table(&robot, scenes, growths, true);
    assert_eq!(bias.closed.contacts, 0);
    // Without contacts, the scenes would test nothing.
    assert!(bias.open.contacts > 0);
    // A growth that always pauses would touch nothing either.
    assert!(20 * (noise.closed.pauses + bias.closed.pauses) <= 2 * scenes * growths);
}

/// Results of the growths in all scenes, in closed loop and in open loop.
struct Both {
    closed: ObstacleStatistics,
    open: ObstacleStatistics,
}

/// Grows in each scene and prints a row of results. Returns the sum over all scenes.
fn table(robot: &Robot, scenes: u64, growths: u64, biased: bool) -> Both {
    println!("{}", if biased { "\nnoise of 10 %, bias of +10 or -10 %" } else { "\nnoise of 10 %" });
    println!("scene           length  clear   closed: contact  pause  detour  min clear   open: contact  min clear");
    let none =
        ObstacleStatistics { contacts: 0, first_contact: None, clearance: f64::INFINITY, with_detours: 0, pauses: 0 };
    let mut sum = Both { closed: none, open: none };
    for index in 0..scenes {
        let (name, loaded, plan) = scene(robot, index);
        let mut simulation = Simulation::new(&plan, robot, Slicing::Exact);
        simulation.disturbance.growth_noise = 0.1;
        if biased {
            simulation.disturbance.growth_bias = if index % 2 == 0 { 0.1 } else { -0.1 };
        }
        simulation.scene = Some(&loaded);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let open = among(&simulation, growths, threads);
        simulation.sensors = Some(SimulatedSensors {
            noise: DEFAULT_SENSOR_NOISE,
            odometry_scale: 0.0,
            direction: DirectionSensor::Gravity,
        });
        let closed = among(&simulation, growths, threads);
        let clear = plan.scene.as_ref().map_or(0.0, |scene| scene.clearance);
        println!(
            "{name:<12}{:>10.1}{clear:>7.2}{:>17}{:>7}{:>8}{:>11.2}{:>16}{:>11.2}",
            plan.requirements.length,
            closed.contacts,
            closed.pauses,
            closed.with_detours,
            closed.clearance,
            open.contacts,
            open.clearance
        );
        for (sum, found) in [(&mut sum.closed, closed), (&mut sum.open, open)] {
            sum.contacts += found.contacts;
            sum.pauses += found.pauses;
            sum.with_detours += found.with_detours;
        }
    }
    let Both { closed: ObstacleStatistics { contacts, pauses, with_detours, .. }, open } = &sum;
    let all = scenes * growths;
    println!("{all} in closed loop: {contacts} touch, {pauses} pause, {with_detours} take a detour");
    println!("{all} in open loop: {} touch", open.contacts);
    sum
}

fn among(simulation: &Simulation, growths: u64, threads: usize) -> ObstacleStatistics {
    Campaign::run(simulation, 1, growths, threads, |_| ()).among.unwrap()
}

/// Returns the scene with this number, with a plan through it.
fn scene(robot: &Robot, index: u64) -> (String, LoadedScene, Plan) {
    let count = FAMILIES.len() as u64;
    let (family, number) = (FAMILIES[(index % count) as usize], index / count);
    // The first five of every ten numbers are generated around a free path.
    let number = number / 5 * 10 + number % 5;
    let body = TubeLimits { radius: RADIUS, clearance: 0.5 * robot.outer_diameter() + MARGIN + 0.1 };
    let drawn = random_scenes::random_scene(family, number, &body);
    let loaded = LoadedScene { scene: drawn.scene(), margin: Some(MARGIN), hash: 0 };
    let (start, goal) = (pose(&drawn.start), pose(&drawn.goal));
    let search = PlanOptions { radius: RADIUS, planner: Planner::Shortest, avoid_self_collision: true, existing: None };
    let through = SceneOptions {
        file: "scene",
        loaded: &loaded,
        margin: MARGIN,
        effort: EFFORT,
        deadline: None,
        first_only: false,
        max_length: MAX_LENGTH_MM,
    };
    let name = format!("{family:?} {number}");
    let plan = scene_planning::plan(robot, &start, &[Goal::Pose(goal)], &search, &through)
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    (name, loaded, plan)
}

fn pose(tip: &TipPose) -> Pose {
    let x = any_perpendicular(&tip.direction);
    let axes = Matrix3::from_columns(&[x, tip.direction.cross(&x), tip.direction]);
    Pose::from_frame(&Frame::from_parts(Translation3::from(tip.position), Rotation3::from_matrix_unchecked(axes)))
}
