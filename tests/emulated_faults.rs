//! Faults of the tip with the firmware's own image in QEMU, which reacts as the robot's board would.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerEncoder;
use growbot_core::link::message::{
    AppendLayers, BeginJob, EnergizingRequest, Fault, HostSilencePolicy, PassiveRequest, Start, State,
};
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_sim::tip::TipFault;
use growbot_tests::firmware;
use growbot_tests::tip_memory::{BoardLimit, TipMemoryView, wait_until_outputs_off};

/// Returns robot A with faster homing and growth, so that the test does not take long.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a".as_ref()).unwrap().description().clone();
    description.layer.period_s = 6.0;
    description.head.homing_turns_per_s = 0.2;
    Robot::new(description).unwrap()
}

/// Time limit for a board to reach a state, s of its own clock. The time until it notices a fault has its own limit.
const LIMIT_S: u32 = 300;

/// Grows until the board is in the state `during`, injects the fault `broken` into the tip, and checks the board's
/// reaction. The board must report `expected`, or the emergency stop if that is `None`, within `within` s of its
/// clock.
fn run_case(broken: TipFault, during: State, expected: Option<Fault>, within: f64) {
    let what = format!("{} while {}", broken.name(), during.name());
    let robot = robot();
    let emulator = Rc::new(RefCell::new(Emulator::start(&robot, Some(&firmware("an386"))).unwrap()));
    let words = TipMemoryView::of(&mut emulator.borrow_mut());
    let mut client = Client::new(Box::new(Rc::clone(&emulator)), "the emulated board");
    client.open_session_for(&robot).unwrap();
    let plan_id = 1;
    client
        .request("to begin", &PassiveRequest::BeginJob(BeginJob { plan_id, layers: 8, robot_hash: robot.hash() }))
        .unwrap();
    // The nozzle is warmed only now, because the board erases its journal only with a cold nozzle.
    emulator.borrow_mut().simulated_tip(|tip| tip.set_nozzle_c(if during == State::Heating { 60.0 } else { 197.0 }));
    let mut encoder = LayerEncoder::default();
    let layers = (0..8).map(|_| encoder.encode(&Layer { alpha: 1.0, height: 0.7, tilt: 0.006 })).collect();
    client
        .request("to store layers", &PassiveRequest::AppendLayers(AppendLayers { plan_id, first: 0, layers }))
        .unwrap();
    client
        .energize(
            "to start",
            &EnergizingRequest::Start(Start {
                plan_id,
                on_host_silence: HostSilencePolicy::Continue,
                is_continuation: false,
            }),
            &Permit::standalone(),
        )
        .unwrap();

    let wait_for = |client: &mut Client, states: &[State]| {
        let mut limit = BoardLimit::new(&words, LIMIT_S);
        loop {
            let status = client.status().unwrap();
            if states.contains(&status.state) {
                return status;
            }
            limit.check(format_args!("{what}, still {}", status.state.name()));
            let _ = client.event(Duration::from_millis(50));
        }
    };
    let status = wait_for(&mut client, &[during, State::Fault]);
    assert_eq!((status.state, status.fault), (during, None), "{what}: too early");
    emulator.borrow_mut().inject(broken);
    let broken_ms = client.status().unwrap().uptime_ms;
    let status = wait_for(&mut client, &[State::Fault, State::EmergencyStop]);
    let noticed_ms = client.latest_fault().unwrap().expect("a record of it").uptime_ms;
    // The board may notice the fault before its time is requested.
    let after = noticed_ms.saturating_sub(broken_ms) as f64 / 1000.0;
    println!("{what}: {:?} after {after:.1} s", status.fault);
    assert_eq!(status.fault, expected, "{what}");
    assert!(after <= within, "{what}: noticed after {after} s, more than {within} s");
    assert_eq!(status.state, if expected.is_some() { State::Fault } else { State::EmergencyStop }, "{what}");
    // The tip switches off the next time it polls its board.
    wait_until_outputs_off(&mut emulator.borrow_mut(), &what);
}

#[test]
fn the_image_detects_faults_and_switches_outputs_off() {
    type Case = (TipFault, State, Option<Fault>, f64);
    let cases: [Case; 8] = [
        (TipFault::ThermistorOpen, State::Heating, Some(Fault::ThermistorOpen), 3.0),
        // The test of the switches before heating takes 21 s of this limit.
        (TipFault::HeaterOpen, State::Heating, Some(Fault::HeatingTooSlow), 45.0),
        (TipFault::IndexDead, State::Homing, Some(Fault::IndexNotFound), 30.0),
        (TipFault::ThermistorSilent, State::Growing, Some(Fault::ThermistorSilent), 3.0),
        (TipFault::IndexStuck, State::Growing, Some(Fault::IndexStuck), 20.0),
        (TipFault::FilamentJam, State::Growing, Some(Fault::FilamentJam), 10.0),
        (TipFault::SupplyLow { volts: 9.0 }, State::Growing, Some(Fault::SupplyLow), 3.0),
        (TipFault::EmergencyStop, State::Growing, None, 3.0),
    ];
    // Two boards run at a time, because each takes half of a core.
    for pair in cases.chunks(2) {
        std::thread::scope(|scope| {
            for &(broken, during, expected, within) in pair {
                scope.spawn(move || run_case(broken, during, expected, within));
            }
        });
    }
}
