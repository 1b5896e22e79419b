//! Tests of tuning the heater's gains on request of a host.

use growbot_core::link::message::{Message, Refusal, State, Tuned};

use super::bench::{Bench, WARM};
use super::requests::{clear, stop, tune};
use super::tip::Wire;
use crate::testing::fast_robot;

#[test]
fn tuning_reports_gains_without_applying_them() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.accepted(&tune(200.0));
    bench.run_to(State::Idle, 900.0);
    bench.run(0.1);
    let reported = bench.events.iter().rev().find_map(|event| match event {
        Message::Tuned(Tuned { gains, .. }) => Some(*gains),
        _ => None,
    });
    let gains = reported.expect("the gains are reported");
    assert!(gains.kp > 0.0 && gains.ki > 0.0 && gains.kd >= 0.0, "{gains:?}");
    assert!(bench.heater.off());
    assert_eq!(bench.motors.moved.pulses, 0);
}

#[test]
fn tuning_targets_outside_the_limits_are_refused() {
    let mut bench = Bench::in_state(State::Idle);
    let refusal = Refusal::TemperatureOutOfRange { min: 5000, max: 22_000 };
    for celsius in [49.0, 221.0, 240.0, 1e7, -1e7, 0.0] {
        assert_eq!(bench.refused(&tune(celsius)), refusal);
    }
}

#[test]
fn tuning_ends_on_a_stop_or_fault() {
    let mut bench = Bench::in_state(State::Tuning);
    bench.accepted(&stop());
    assert_eq!(bench.controller.state(), State::Stopped);
    let mut bench = Bench::in_state(State::Tuning);
    bench.world.wire.set(Wire::Open);
    bench.run_to(State::Fault, 0.3);
    bench.world.wire.set(Wire::Whole);
    bench.run(0.2);
    bench.accepted(&clear());
    assert_eq!(bench.controller.state(), State::Idle);
}
