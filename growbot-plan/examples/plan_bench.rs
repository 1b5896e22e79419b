//! Benchmark of planning from Rust. Plans to the goals in a file with lines `x,y,z,heading,pitch`. For each batch of
//! goals, prints a line with the shortest time of several rounds, s.
//!
//!     plan_bench GOALS.csv BATCH ROUNDS
//!
//! A batch takes about a millisecond, so that on a busy machine it runs without interruption in some of the rounds.

use std::hint::black_box;
use std::time::Instant;

use growbot_core::plan::Planner;
use growbot_plan::plan::Plan;
use growbot_plan::plan::{Goal, PlanOptions};
use growbot_plan::pose_text::{parse_goal, parse_pose};
use growbot_plan::robot_file;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, file, batch, rounds] = arguments.as_slice() else {
        return Err("give a file of goals, how many are a batch, and how many rounds".into());
    };
    let robot = robot_file::load(robot_file::DEFAULT.as_ref())?;
    let start = parse_pose("0,0,0,0,90")?;
    let text = std::fs::read_to_string(file)?;
    let goals = text
        .lines()
        .map(|line| Ok(parse_goal(line)?.goal))
        .collect::<Result<Vec<Goal>, Box<dyn std::error::Error>>>()?;
    let search = PlanOptions {
        radius: robot.description().planning_radius_mm,
        planner: Planner::Shortest,
        avoid_self_collision: false,
        existing: None,
    };
    let batches: Vec<&[Goal]> = goals.chunks(batch.parse()?).collect();
    let mut fastest = vec![f64::INFINITY; batches.len()];
    for _ in 0..rounds.parse::<u32>()? {
        for (batch, fastest) in batches.iter().zip(&mut fastest) {
            let begun = Instant::now();
            let plans: Vec<Plan> = batch
                .iter()
                .map(|goal| Plan::through_waypoints(&robot, &start, &[], goal, &search))
                .collect::<Result<_, _>>()?;
            drop(black_box(plans));
            *fastest = fastest.min(begun.elapsed().as_secs_f64());
        }
    }
    for seconds in fastest {
        println!("{seconds}");
    }
    Ok(())
}
