//! The firmware in the emulator grows a body with the same steps as the controller in a simulation on the desktop.

use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::ground_truth::grow_with_ground_truth;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_client::port::{Port, PortError};
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::path::{Segment, end, length};
use growbot_core::pose::{Pose, angle_between};
use growbot_core::robot::Robot;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_sim::port::sim::Sim;
use growbot_sim::simulated_tip::SimulatedTip;
use growbot_tests::firmware;

/// Grows a path and returns the result.
fn grow_on(opened: (Box<dyn Port>, Box<dyn SimulatedTip>), robot: &Robot, path: &[Segment]) -> GrowthReport {
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(path, &start.frame()));
    let job = Job::new(robot, &start, &goal, path);
    let (port, mut simulation) = opened;
    let mut client = Client::new(port, "a board under test");
    let grow = |on_event: &mut dyn FnMut(&JobEvent)| {
        grow_job(&mut client, &job, HostSilencePolicy::Pause, &CommandQueue::default(), on_event)
    };
    grow_with_ground_truth(Some(simulation.as_mut()), &job, &mut |_| (), grow).unwrap()
}

#[test]
fn the_emulated_board_lays_the_same_layers_as_the_simulation() {
    let robot = robot_file::load("growbot-a2".as_ref()).unwrap();
    // The path leads from one plane into another, with a straight line between. It is 103 mm long and includes a thin
    // layer.
    let path = [
        Segment::Arc { alpha: 1.0, bend: 0.5, length: 50.0 },
        Segment::Straight { length: 20.1 },
        Segment::Straight { length: 0.05 },
        Segment::Arc { alpha: 4.0, bend: 0.33, length: 33.0 },
    ];

    let mut emulator = Emulator::start(&robot, Some(&firmware("an386"))).unwrap();
    // A warm nozzle saves the heating time.
    emulator.simulated_tip(|tip| tip.preheat_instantly(190.0));
    let tip = emulator.tip_handle();
    let emulated = grow_on((Box::new(emulator), tip), &robot, &path);
    let sim = Sim::new(robot.clone());
    let tip = sim.tip_handle();
    let simulated = grow_on((Box::new(sim), tip), &robot, &path);

    assert_eq!(emulated.outcome, Outcome::Done);
    assert!(emulated.body.len() >= 100, "{} layers", emulated.body.len());
    // The steps of every sector of every layer are the same.
    assert_eq!(emulated.as_built, simulated.as_built);
    assert_eq!(emulated.filament_mm, simulated.filament_mm);
    assert_eq!(emulated.body.len(), simulated.body.len());
    // The end of the body is computed from the steps and their times. A busy machine sometimes delays the emulated
    // board's next layer by some ticks, and plastic of a step still flows in this time. No other difference is allowed.
    let (here, there) = (emulated.arrival.final_pose, simulated.arrival.final_pose);
    let apart = (here.position() - there.position()).norm();
    assert!(apart < 0.0005 * length(&path), "{apart} mm apart");
    assert!(angle_between(&here.direction(), &there.direction()) < 0.1_f64.to_radians());
    // The remaining error is the resolution of 200 head steps and 178 feed steps a layer.
    assert!(emulated.arrival.normalized_position_error < 0.001, "{:?}", emulated.arrival);
    println!("{} layers, {apart:.6} mm between emulator and simulation", emulated.body.len());
}

#[test]
fn a_port_reports_that_its_emulator_has_ended() {
    let robot = robot_file::load("growbot-a2".as_ref()).unwrap();
    let mut emulator = Emulator::start(&robot, Some(&firmware("an386"))).unwrap();
    emulator.board().qemu().kill();
    let error = loop {
        if let Err(error) = emulator.receive(&mut [0; 64], Duration::from_millis(100)) {
            break error;
        }
    };
    assert!(matches!(error, PortError::EmulatorEnded("qemu-system-arm", ..)), "{error}");
}
