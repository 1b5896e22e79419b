//! Cost of planning on a Pico, in its emulator. The goals are those of `cargo plan-cost`, and each plan must have the
//! desktop's bits.
//!
//! The test plans a few goals. `GROWBOT_PLANS=all cargo test -p growbot-tests --test it emulated_rp2040_planning:: --
//! --nocapture` plans all of them, which takes half an hour. It prints instructions, the step interrupt's included, and
//! seconds of the chip.

#[path = "../growbot-firmware/benches/plan/goals.rs"]
mod goals;

use std::cell::RefCell;
use std::rc::Rc;
use std::thread;
use std::time::Duration;

use goals::{RADIUS, goal};
use growbot_client::client::Client;
use growbot_client::port::Port;
use growbot_core::job::summarize;
use growbot_core::link::message::{Message, PassiveRequest, PlanRequest};
use growbot_core::path::length;
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_plan::robot_file;
use growbot_sim::port::rp2040::Rp2040Emulator;
use growbot_tests::pico_firmware;

/// A kind of goals: their distance in radii, their number, the number planned by default, and the time limit of a plan
/// on the Pico, s.
struct Kind {
    planner: Planner,
    goals: &'static str,
    radii: [f64; 2],
    all: u32,
    few: u32,
    limit_s: f64,
}

const KINDS: [Kind; 4] = [
    Kind { planner: Planner::TwoPlane, goals: "from 4 R", radii: [4.0, 12.0], all: 64, few: 1, limit_s: 3.0 },
    Kind { planner: Planner::TwoPlane, goals: "0 to 4 R", radii: [0.0, 4.0], all: 64, few: 0, limit_s: 3.0 },
    Kind { planner: Planner::Shortest, goals: "from 4 R", radii: [4.0, 12.0], all: 64, few: 1, limit_s: 5.0 },
    Kind { planner: Planner::Shortest, goals: "0 to 4 R", radii: [0.0, 4.0], all: 5, few: 0, limit_s: 600.0 },
];

/// Instructions and seconds of a plan.
type Cost = (u64, f64);

fn measure(kind: &Kind, count: u32) -> Vec<Cost> {
    let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let board = Rc::new(RefCell::new(Rp2040Emulator::start(&robot, Some(&pico_firmware("growbot-a"))).unwrap()));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "the board under test");
    client.open_session_for(&robot).unwrap();
    // The tests at the board's start take a while.
    client.wait(Duration::from_secs(3)).unwrap();
    let [nearest, farthest] = kind.radii;
    let mut costs = Vec::new();
    for number in 0..count {
        let goal = goal(number, nearest, farthest).unwrap();
        let Ok(expected) = plan(&robot, &start, &goal, RADIUS, kind.planner) else { continue };
        let layers = summarize(&expected.path, &robot);
        let request =
            PlanRequest { start: (&start).into(), goal: (&goal).into(), radius: RADIUS, planner: kind.planner };
        let began = board.now();
        let before = board.borrow().instructions();
        let answer = client.request("to plan", &PassiveRequest::Plan(request));
        let Ok(Message::Planned(planned)) = answer else { panic!("{:?}, goal {number}: {answer:?}", kind.planner) };
        let same = (layers.exact_hash, layers.layers, length(&expected.path));
        assert_eq!((planned.exact_hash, planned.layers, planned.length), same, "{:?}, goal {number}", kind.planner);
        let cost = (board.borrow().instructions() - before, (board.now() - began).as_secs_f64());
        println!("{:?}, {}, goal {number}: {} instructions, {:.2} s", kind.planner, kind.goals, cost.0, cost.1);
        costs.push(cost);
    }
    assert_eq!(board.borrow().resets(), 0);
    costs
}

fn check(kind: &Kind, count: u32) {
    let mut costs = measure(kind, count);
    costs.sort_by(|a, b| a.1.total_cmp(&b.1));
    let [median, worst] = [costs.get(costs.len() / 2), costs.last()].map(|cost| cost.copied().unwrap());
    println!(
        "| {:?} | {} | {} | {} | {} | {:.2} | {:.2} |",
        kind.planner,
        kind.goals,
        costs.len(),
        median.0,
        worst.0,
        median.1,
        worst.1
    );
    assert!(worst.1 <= kind.limit_s, "{:?}, {}: {:.2} s, over {} s", kind.planner, kind.goals, worst.1, kind.limit_s);
}

#[test]
fn the_pico_plans_far_goals_within_seconds() {
    let all = std::env::var("GROWBOT_PLANS").is_ok_and(|plans| plans == "all");
    let count = |kind: &Kind| if all { kind.all } else { kind.few };
    thread::scope(|scope| {
        for kind in KINDS.iter().filter(|kind| count(kind) > 0) {
            scope.spawn(move || check(kind, count(kind)));
        }
    });
}
