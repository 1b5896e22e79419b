//! The firmware of the Pico runs pin by pin in an emulator. It grows a body with the same steps as the controller in a
//! simulation on the desktop, and as another processor in QEMU.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::Client;
use growbot_client::ground_truth::grow_with_ground_truth;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_client::port::Port;
use growbot_core::job::summarize;
use growbot_core::link::message::{HostSilencePolicy, Message, PassiveRequest, PlanRequest, Planned};
use growbot_core::path::{Segment, end, length};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::{BoardDescription, BoardKind, DriverSettings, PinOverrides, Robot};
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_sim::port::rp2040::{HostLink, Rp2040Emulator};
use growbot_sim::port::sim::Sim;
use growbot_sim::simulated_tip::SimulatedTip;
use growbot_sim::tip::Variation;
use growbot_tests::{firmware, pico_firmware};

/// Returns robot A2, which lays a layer in 0.18 s.
fn robot() -> Robot {
    robot_file::load("growbot-a2".as_ref()).unwrap()
}

/// Temperature of a nozzle that is warm at once, which saves the heating time, degrees Celsius.
const WARM_C: f64 = 190.0;

/// Returns robot A2 on an SKR Pico, which has its signals on other pins than a Pico.
fn on_skr_pico() -> Robot {
    let mut description = robot().description().clone();
    description.board = Some(BoardDescription { kind: BoardKind::SkrPico, pins: PinOverrides::default() });
    // An SKR Pico does not measure its supply.
    description.sensors.supply = false;
    (description.head.driver, description.feed.driver) =
        (Some(DriverSettings::with_current(0.8)), Some(DriverSettings::with_current(0.6)));
    Robot::new(description).unwrap()
}

/// Grows a path with robot A2.
fn grow_on(port: Box<dyn Port>, simulation: Box<dyn SimulatedTip>, path: &[Segment]) -> GrowthReport {
    grow_as(&robot(), port, simulation, path)
}

/// Grows a path with a robot.
fn grow_as(
    robot: &Robot,
    port: Box<dyn Port>,
    mut simulation: Box<dyn SimulatedTip>,
    path: &[Segment],
) -> GrowthReport {
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(path, &start.frame()));
    let job = Job::new(robot, &start, &goal, path);
    let mut client = Client::new(port, "a board under test");
    let grow = |on_event: &mut dyn FnMut(&JobEvent)| {
        grow_job(&mut client, &job, HostSilencePolicy::Pause, &CommandQueue::default(), on_event)
    };
    grow_with_ground_truth(Some(simulation.as_mut()), &job, &mut |_| (), grow).unwrap()
}

/// Grows a path on the simulated board. Also returns the time on the board's clock at the end.
fn simulated(path: &[Segment]) -> (GrowthReport, Duration) {
    let sim = Rc::new(RefCell::new(Sim::new(robot())));
    sim.borrow_mut().simulated_tip().preheat_instantly(WARM_C);
    let tip = sim.borrow().tip_handle();
    let grown = grow_on(Box::new(Rc::clone(&sim)), tip, path);
    let time = sim.now();
    (grown, time)
}

/// Grows a path on the emulated M4.
fn on_an386(path: &[Segment]) -> GrowthReport {
    let mut emulator = Emulator::start(&robot(), Some(&firmware("an386"))).unwrap();
    emulator.simulated_tip(|tip| tip.preheat_instantly(WARM_C));
    let tip = emulator.tip_handle();
    grow_on(Box::new(emulator), tip, path)
}

/// Clock of the processor, Hz.
const CLOCK_HZ: u64 = 125_000_000;
/// Steps per second that both axes must be able to make at the same time. Each step has its own tick, because no two
/// coincide, and the ticks may take half of the processor's time.
const STEPS_PER_S: u64 = 10_000;
/// Size of the stack, bytes. Half of it must stay unused.
const STACK: u64 = 64 * 1024;

/// Returns a board for robot A2 that measures its step interrupt and its stack, and the file of the measurements.
fn measured(name: &str) -> (Rp2040Emulator, PathBuf) {
    let figures = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_file(&figures);
    (Rp2040Emulator::start_measured(&robot(), &pico_firmware("growbot-a2"), &figures).unwrap(), figures)
}

/// Checks the measurements in a file.
fn check_figures(file: &Path) {
    let text = std::fs::read_to_string(file).unwrap();
    println!("{text}");
    let figures: serde_json::Value = serde_json::from_str(&text).unwrap();
    let [longest, stack] = ["longest", "stack"].map(|name| figures[name].as_u64().unwrap());
    assert!(longest > 0 && 2 * (2 * STEPS_PER_S) * longest <= CLOCK_HZ, "a step interrupt of {longest} cycles");
    assert!(stack > 0 && 2 * stack <= STACK, "{stack} B of the stack were used");
}

#[test]
fn the_pico_lays_the_same_layers_as_simulation_and_cortex_m4() {
    // The path leads from one plane into another, with a straight line between, and includes a thin layer.
    let path = [
        Segment::Arc { alpha: 1.0, bend: 1.0, length: 100.0 },
        Segment::Straight { length: 20.1 },
        Segment::Straight { length: 0.05 },
        Segment::Arc { alpha: 4.0, bend: 1.1, length: 114.0 },
    ];
    let other = thread::spawn(move || on_an386(&path));
    let began = Instant::now();
    let (board, figures) = measured("growing.json");
    let board = Rc::new(RefCell::new(board));
    board.borrow_mut().simulated_tip().preheat_instantly(WARM_C);
    let tip = board.borrow().tip_handle();
    let pico = grow_on(Box::new(Rc::clone(&board)), tip, &path);
    let took = began.elapsed();
    let (simulated, time) = simulated(&path);
    let an386 = other.join().unwrap();

    for grown in [&pico, &an386] {
        assert_eq!(grown.outcome, Outcome::Done);
        assert!(grown.body.len() >= 300, "{} layers", grown.body.len());
        // The steps of every sector of every layer are the same.
        assert_eq!(grown.as_built, simulated.as_built);
        assert_eq!(grown.filament_mm, simulated.filament_mm);
    }
    // Times of steps differ at most by the tick in which an interrupt occurs.
    let (here, there) = (pico.arrival.final_pose, simulated.arrival.final_pose);
    let apart = (here.position() - there.position()).norm();
    assert!(apart < 0.001, "{apart} mm");
    let board = board.borrow();
    // Each layer is in the journal. It takes 32 bytes, for which a page of 256 bytes is programmed.
    assert!(board.flash_changed() as usize >= 256 * pico.body.len(), "{} bytes", board.flash_changed());
    assert_eq!(board.resets(), 0);
    // The Pico is as fast as the simulation, so its computations between two layers do not delay it.
    assert!(board.now().as_secs_f64() < 1.02 * time.as_secs_f64(), "{:?}, simulated {time:?}", board.now());
    println!("{} layers, {apart:.6} mm apart, {:.1?} of the chip in {took:.1?}", pico.body.len(), board.now());
    check_figures(&figures);
}

/// An image that was built for no robot is configured over its serial line, and then drives the configured robot at
/// that robot's pins.
#[test]
fn a_board_configured_as_skr_pico_uses_its_pins() {
    let path = [Segment::Arc { alpha: 1.0, bend: 0.2, length: 20.0 }];
    let robot = on_skr_pico();
    let board = Rc::new(RefCell::new(Rp2040Emulator::start(&robot, Some(&pico_firmware("none"))).unwrap()));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "a board under test");
    client.open_session().unwrap();
    let hello = client.configure(&robot).unwrap();
    drop(client);
    assert_eq!((hello.robot_name.as_str(), hello.robot_hash), (robot.name(), robot.hash()));
    board.borrow_mut().simulated_tip().preheat_instantly(WARM_C);
    let tip = board.borrow().tip_handle();
    let grown = grow_as(&robot, Box::new(Rc::clone(&board)), tip, &path);
    assert_eq!(grown.outcome, Outcome::Done);
    assert_eq!(grown.as_built, simulated(&path).0.as_built);
    // One reset, to start as that robot.
    assert_eq!(board.borrow().resets(), 1);
}

#[test]
fn over_usb_the_pico_lays_the_same_layers() {
    let path = [Segment::Straight { length: 4.0 }, Segment::Arc { alpha: 1.0, bend: 0.1, length: 10.0 }];
    let image = pico_firmware("growbot-a2");
    let board = Rp2040Emulator::start_on_link(HostLink::Usb, &robot(), Some(&image), Variation::default()).unwrap();
    let board = Rc::new(RefCell::new(board));
    board.borrow_mut().simulated_tip().preheat_instantly(WARM_C);
    let tip = board.borrow().tip_handle();
    let grown = grow_on(Box::new(Rc::clone(&board)), tip, &path);
    let (simulated, _) = simulated(&path);
    assert_eq!(grown.outcome, Outcome::Done);
    assert!(grown.body.len() >= 10, "{} layers", grown.body.len());
    assert_eq!(grown.as_built, simulated.as_built);
    assert_eq!(board.borrow().resets(), 0);
}

/// Goals with a path of arcs and lines, far and near. The shortest path to the near goal takes the Pico minutes.
const GOALS: [([f64; 5], Planner); 5] = [
    ([300.0, 200.0, 250.0, -45.0, -30.0], Planner::TwoPlane),
    ([300.0, 200.0, 250.0, -45.0, -30.0], Planner::Shortest),
    ([0.0, 0.0, -300.0, 0.0, 90.0], Planner::TwoPlane),
    ([0.0, 0.0, -300.0, 0.0, 90.0], Planner::Shortest),
    ([60.0, 0.0, 100.0, 90.0, 45.0], Planner::TwoPlane),
];

#[test]
fn the_pico_and_the_desktop_plan_identical_layers() {
    let robot = robot();
    let (board, figures) = measured("planning.json");
    let board = Rc::new(RefCell::new(board));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "the board under test");
    client.open_session_for(&robot).unwrap();
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    for (goal, planner) in GOALS {
        let goal = Pose::from_degrees(goal).unwrap();
        let path = plan(&robot, &start, &goal, 100.0, planner).unwrap().path;
        let expected = summarize(&path, &robot);
        let request = PlanRequest { start: (&start).into(), goal: (&goal).into(), radius: 100.0, planner };
        let began = board.now();
        let Message::Planned(planned) = client.request("to plan", &PassiveRequest::Plan(request)).unwrap() else {
            panic!("no plan for {goal:?}");
        };
        let expected = Planned {
            plan_id: expected.plan_id,
            exact_hash: expected.exact_hash,
            layers: expected.layers,
            length: length(&path),
        };
        assert_eq!(planned, expected, "{goal:?}, {planner:?}");
        println!("{planner:?}, {} layers: {:.2?} of the chip", planned.layers, board.now() - began);
    }
    check_figures(&figures);
}
