//! Noisy growths through scenes drawn at random, in closed and in open loop: how many touch an obstacle, how many pause.
//!
//! ```sh
//! cargo run --release -p growbot-sim --example growing_in_scenes            # 20 scenes, 50 growths in each
//! cargo run --release -p growbot-sim --example growing_in_scenes -- 4 5     # 4 scenes, 5 growths in each
//! ```
//!
//! Layers come out up to 10 % too high or low, and the sensors are those that feedback assumes: odometry to 1 % of a
//! layer, a direction to 0.5 degrees. A scene is a third of each family that has a planted path, for robot A with a
//! margin of 5 mm.

use std::process::ExitCode;

use growbot_client::feedback::ASSUMED;
use growbot_client::plan::{Goal, Plan, Search};
use growbot_client::robot_file;
use growbot_client::through_scene::{self, Through};
use growbot_core::plan::Planner;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::simulation::{DirectionSensor, Sensors};
use growbot_core::slicing::Slicing;
use growbot_scene::families::{self, Body, FAMILIES};
use growbot_scene::file::LoadedScene;
use growbot_scene::motion::{Tip, any_across};
use growbot_sim::simulation::Simulation;
use growbot_sim::simulation::campaign::{Campaign, ManyAmong};
use nalgebra::{Matrix3, Rotation3, Translation3};

const MARGIN: f64 = 5.0;
const RADIUS: f64 = 100.0;
const EFFORT: u64 = 5;

fn main() -> ExitCode {
    let mut numbers = std::env::args().skip(1).map(|argument| argument.parse::<u64>());
    let (scenes, growths) = match (numbers.next(), numbers.next()) {
        (None, None) => (20, 50),
        (Some(Ok(scenes)), Some(Ok(growths))) => (scenes, growths),
        _ => {
            eprintln!("give the number of scenes and of growths in each, or neither");
            return ExitCode::from(2);
        }
    };
    match run(scenes, growths) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(contacts) => {
            eprintln!("{contacts} growths in closed loop touch an obstacle, and none may");
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Prints a row for each scene; gives the contacts in closed loop.
fn run(scenes: u64, growths: u64) -> Result<u64, String> {
    let robot = robot_file::load("growbot-a".as_ref()).map_err(|error| error.to_string())?;
    println!("scene           length  clear   closed: contact  pause  detour  min clear   open: contact  min clear");
    let mut sums = [0; 5];
    for index in 0..scenes {
        let (name, loaded, plan) = scene(&robot, index)?;
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        simulation.disturbance.growth_noise = 0.1;
        simulation.scene = Some(&loaded);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let open = among(&simulation, growths, threads)?;
        simulation.sensors =
            Some(Sensors { noise: ASSUMED, odometry_scale: 0.0, direction: DirectionSensor::Gravity });
        let closed = among(&simulation, growths, threads)?;
        let clear = plan.scene.as_ref().map_or(0.0, |scene| scene.clearance);
        println!(
            "{name:<12}{:>10.1}{clear:>7.2}{:>17}{:>7}{:>8}{:>11.2}{:>16}{:>11.2}",
            plan.needs.length,
            closed.contacts,
            closed.pauses,
            closed.with_detours,
            closed.clearance,
            open.contacts,
            open.clearance
        );
        let row = [growths, closed.contacts, closed.pauses, closed.with_detours, open.contacts];
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
    let [growths, contacts, pauses, detours, open] = sums;
    println!("{growths} simulated growths in closed loop: {contacts} touch, {pauses} pause, {detours} take a detour");
    println!("{growths} simulated growths in open loop: {open} touch");
    Ok(contacts)
}

fn among(simulation: &Simulation, growths: u64, threads: usize) -> Result<ManyAmong, String> {
    let campaign = Campaign::run(simulation, 1, growths, threads, |_| ());
    campaign.among.ok_or_else(|| "no scene".to_owned())
}

/// The scene of this number, with a plan through it.
fn scene(robot: &Robot, index: u64) -> Result<(String, LoadedScene, Plan), String> {
    let count = FAMILIES.len() as u64;
    let (family, number) = (FAMILIES[(index % count) as usize], index / count);
    // Of ten numbers, the first five have a planted path.
    let number = number / 5 * 10 + number % 5;
    let body = Body { radius: RADIUS, need: 0.5 * robot.outer_diameter() + MARGIN + 0.1 };
    let drawn = families::draw(family, number, &body);
    let loaded = LoadedScene { scene: drawn.scene(), margin: MARGIN, hash: 0 };
    let (start, goal) = (pose(&drawn.start), pose(&drawn.goal));
    let search = Search { radius: RADIUS, planner: Planner::Shortest, clear_of_self: true };
    let through =
        Through { file: "scene", loaded: &loaded, margin: MARGIN, grown: None, effort: EFFORT, deadline: None };
    let name = format!("{family:?} {number}");
    let plan = through_scene::plan(robot, &start, &[Goal::Pose(goal)], &search, &through)
        .map_err(|error| format!("{name}: {error}"))?;
    Ok((name, loaded, plan))
}

fn pose(tip: &Tip) -> Pose {
    let x = any_across(&tip.direction);
    let axes = Matrix3::from_columns(&[x, tip.direction.cross(&x), tip.direction]);
    Pose::from_frame(&Frame::from_parts(Translation3::from(tip.position), Rotation3::from_matrix_unchecked(axes)))
}
