//! Tests of faults of the board itself (a debug probe that may halt it, a crystal that does not start), and of clearing
//! every fault.

use growbot_core::link::message::{Fault, Refusal, ResetCause, State};
use growbot_core::robot::{Robot, Sensors};

use super::bench::{Bench, WARM};
use super::requests::{bends, clear, start, tune};
use crate::safety::transitions::may_heat;
use crate::testing::fast_robot;

fn bench_robot() -> Robot {
    let mut description = fast_robot().description().clone();
    description.test_bench = true;
    Robot::new(description).unwrap()
}

#[test]
fn heating_is_refused_while_a_debug_probe_is_attached() {
    let mut bench = Bench::in_state(State::Idle);
    bench.world.debugging.set(true);
    for request in [start(), tune(200.0)] {
        assert_eq!(bench.refused(&request), Refusal::DebugProbe);
    }
    bench.run(1.0);
    assert_eq!(bench.controller.state(), State::Idle, "it is no fault while nothing heats");
    bench.world.debugging.set(false);
    bench.accepted(&start());
    assert_eq!(bench.controller.state(), State::Heating);
}

#[test]
fn attaching_a_debug_probe_while_heating_is_a_fault() {
    for state in State::ALL.into_iter().filter(|state| may_heat(*state)) {
        let mut bench = Bench::in_state(state);
        bench.world.debugging.set(true);
        bench.run_to(State::Fault, 0.11);
        assert_eq!(bench.controller.fault(), Some(Fault::DebugProbe), "{state:?}");
        assert!(bench.heater.off());
        // Debugging stays enabled after the probe is unplugged, until the next power cycle.
        let refusal = Refusal::FaultRemains { fault: Fault::DebugProbe };
        assert_eq!(bench.refused(&clear()), refusal);
        bench.world.debugging.set(false);
        bench.accepted(&clear());
        assert_eq!(bench.controller.state(), State::Idle);
    }
}

#[test]
fn a_parked_robot_cannot_continue_under_a_debug_probe() {
    let mut bench = Bench::in_state(State::Parked);
    bench.world.debugging.set(true);
    bench.run(1.0);
    assert_eq!(bench.controller.state(), State::Parked);
    assert_eq!(bench.refused(&start()), Refusal::DebugProbe);
}

#[test]
fn a_test_bench_may_heat_under_a_debug_probe() {
    let mut bench = Bench::greeted(bench_robot(), WARM);
    bench.world.debugging.set(true);
    bench.grow(&bends(2));
    bench.run_to(State::Done, 120.0);
    bench.accepted(&tune(200.0));
    bench.run(1.0);
    assert_eq!(bench.controller.state(), State::Tuning);
}

#[test]
fn without_its_crystal_the_board_reports_a_fault_and_never_heats() {
    let bench = Bench::in_state(State::Idle);
    bench.world.without_crystal.set(true);
    let mut bench = bench.reset(ResetCause::External);
    assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(Fault::ClockFailed)));
    assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault: Fault::ClockFailed });
    assert_eq!(bench.refused(&start()), Refusal::WrongState { state: State::Fault });
    bench.world.without_crystal.set(false);
    let mut bench = bench.reset(ResetCause::External);
    bench.accepted(&clear());
    assert_eq!(bench.controller.state(), State::Idle);
}

#[test]
fn a_failed_crystal_is_reported_after_another_fault_is_cleared() {
    for state in [State::Fault, State::EmergencyStop] {
        let bench = Bench::in_state(state);
        bench.world.without_crystal.set(true);
        let mut bench = bench.reset(ResetCause::External);
        assert_eq!(bench.controller.state(), state);
        assert_ne!(bench.controller.fault(), Some(Fault::ClockFailed), "the first one wins");
        bench.accepted(&clear());
        // The host requests a start before the next check of the board.
        let _ = bench.ask(&start());
        bench.run_until(0.2, |bench| bench.controller.fault() == Some(Fault::ClockFailed));
        assert!(bench.heater.off());
    }
}

/// Checks that every latched fault can be cleared after the board was configured for a robot without sensors.
#[test]
fn every_fault_can_be_cleared_on_a_robot_without_sensors() {
    let mut description = fast_robot().description().clone();
    description.sensors = Sensors::default();
    let without = Robot::new(description).unwrap();
    for fault in Fault::ALL {
        let mut bench = Bench::in_state(State::Idle);
        bench.fail(fault);
        assert_eq!(bench.controller.fault(), Some(fault));
        let mut bench = Bench::boot(without.clone(), bench.world, ResetCause::External);
        bench.run(0.7);
        bench.hello();
        assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(fault)));
        bench.accepted(&clear());
        bench.run(1.0);
        assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Idle, None), "{fault:?}");
    }
}
