//! Faults of the tip behind the firmware's own image: what the robot's board would do, in QEMU, in real time.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::Encoder;
use growbot_core::link::message::{Begin, Fault, Layers, Message, Silence, Start, State};
use growbot_core::robot::Robot;
use growbot_host::client::Client;
use growbot_host::port::emulator::Emulator;
use growbot_host::robot_file;
use growbot_host::tip::{Motor, TipFault};
use growbot_tests::firmware;

/// Robot A, homing and growing faster, so that the test does not take long.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a".as_ref()).unwrap().description().clone();
    description.layer.period_s = 6.0;
    description.head.homing_turns_per_s = 0.2;
    Robot::new(description).unwrap()
}

/// Grows until this state, breaks something, and waits for the fault (the emergency stop is none).
fn meet(broken: TipFault, during: State, expected: Option<Fault>, within: Duration) {
    let what = format!("{} while {}", broken.name(), during.name());
    let robot = robot();
    let emulator = Rc::new(RefCell::new(Emulator::start(&robot, Some(&firmware("an386"))).unwrap()));
    let mut client = Client::new(Box::new(Rc::clone(&emulator)), "the emulated board");
    client.hello_robot(&robot).unwrap();
    let plan_id = 1;
    client.request("to begin", &Message::Begin(Begin { plan_id, layers: 8, robot: robot.hash() })).unwrap();
    // Warm only now: the board makes room in its journal with a cold nozzle only.
    emulator.borrow_mut().simulated_tip(|tip| tip.set_nozzle_c(if during == State::Heating { 60.0 } else { 197.0 }));
    let mut encoder = Encoder::default();
    let layers = (0..8).map(|_| encoder.encode(&Layer { alpha: 1.0, height: 0.7, tilt: 0.006 })).collect();
    client.request("to hold layers", &Message::Layers(Layers { plan_id, first: 0, layers })).unwrap();
    client.request("to start", &Message::Start(Start { plan_id, silence: Silence::GoOn })).unwrap();

    let mut wait_for = |states: &[State], patience: Duration| {
        let began = Instant::now();
        loop {
            let status = client.status().unwrap();
            if states.contains(&status.state) {
                return (status, began.elapsed());
            }
            assert!(began.elapsed() < patience, "{what}: still {} after {patience:?}", status.state.name());
            let _ = client.event(Duration::from_millis(50));
        }
    };
    let (status, _) = wait_for(&[during, State::Fault], Duration::from_secs(120));
    assert_eq!((status.state, status.fault), (during, None), "{what}: too early");
    emulator.borrow_mut().inject(broken);
    let (status, after) = wait_for(&[State::Fault, State::EmergencyStop], within);
    println!("{what}: {:?} after {:.1} s", status.fault, after.as_secs_f64());
    assert_eq!(status.fault, expected, "{what}");
    assert_eq!(status.state, if expected.is_some() { State::Fault } else { State::EmergencyStop }, "{what}");
    // Two looks of the tip at its board later.
    std::thread::sleep(Duration::from_millis(100));
    emulator.borrow_mut().simulated_tip(|tip| {
        assert!(!tip.heater_is_on(), "{what}: the heater is on");
        assert!(!tip.is_enabled(Motor::Head) && !tip.is_enabled(Motor::Feed), "{what}: motors are held");
    });
}

#[test]
fn the_image_notices_faults_and_switches_everything_off() {
    type Case = (TipFault, State, Option<Fault>, u64);
    let cases: [Case; 8] = [
        (TipFault::ThermistorOpen, State::Heating, Some(Fault::ThermistorOpen), 3),
        (TipFault::HeaterOpen, State::Heating, Some(Fault::HeatingTooSlow), 30),
        (TipFault::IndexDead, State::Homing, Some(Fault::IndexNotFound), 30),
        (TipFault::ThermistorSilent, State::Growing, Some(Fault::ThermistorSilent), 3),
        (TipFault::IndexStuck, State::Growing, Some(Fault::IndexStuck), 20),
        (TipFault::FilamentJam, State::Growing, Some(Fault::FilamentJam), 10),
        (TipFault::SupplyLow { volts: 9.0 }, State::Growing, Some(Fault::SupplyLow), 3),
        (TipFault::EmergencyStop, State::Growing, None, 3),
    ];
    // Two boards at a time: each takes half of a core.
    for pair in cases.chunks(2) {
        std::thread::scope(|scope| {
            for &(broken, during, expected, within) in pair {
                scope.spawn(move || meet(broken, during, expected, Duration::from_secs(within)));
            }
        });
    }
}
