//! The firmware in the emulator grows a body, step for step as the same controller does in a simulation on the desktop.

use std::sync::atomic::AtomicBool;

use growbot_core::path::{Path, Segment};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::client::Client;
use growbot_host::growth::{Grown, Job, Outcome, grow_job};
use growbot_host::port::Port;
use growbot_host::port::emulator::Emulator;
use growbot_host::port::sim::Sim;
use growbot_host::robot_file;
use growbot_tests::firmware;

fn grow_on(port: Box<dyn Port>, robot: &Robot, path: &Path) -> Grown {
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&path.end(&start.frame()));
    let job = Job { robot, start: &start, goal: &goal, path };
    let mut client = Client::new(port, "a board under test");
    grow_job(&mut client, &job, &AtomicBool::new(false), &mut |news| println!("{news:?}")).unwrap()
}

#[test]
fn the_emulated_board_lays_the_layers_that_the_simulation_lays() {
    let robot = robot_file::load("growbot-a2".as_ref()).unwrap();
    // Out of one plane into another, with a straight line between: 103 mm, one thin layer included.
    let mut path = Path::new();
    for segment in [
        Segment::Arc { alpha: 1.0, bend: 0.5, length: 50.0 },
        Segment::Straight { length: 20.1 },
        Segment::Straight { length: 0.05 },
        Segment::Arc { alpha: 4.0, bend: 0.33, length: 33.0 },
    ] {
        path.push(segment).unwrap();
    }

    let emulated = grow_on(Box::new(Emulator::start(&robot, Some(&firmware("an386"))).unwrap()), &robot, &path);
    let simulated = grow_on(Box::new(Sim::new(robot.clone())), &robot, &path);

    assert_eq!(emulated.outcome, Outcome::Done);
    assert!(emulated.body.len() >= 100, "{} layers", emulated.body.len());
    assert_eq!(emulated.body, simulated.body);
    assert_eq!(emulated.arrival, simulated.arrival);
    assert_eq!(emulated.filament_mm, simulated.filament_mm);
    // What is left is what 200 head steps and 178 feed steps a layer cannot say.
    assert!(emulated.arrival.normalized_position_error < 0.001, "{:?}", emulated.arrival);
}
