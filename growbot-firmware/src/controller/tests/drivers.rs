//! Tests of stepper drivers that report a problem over their serial line, or are not configured.

use growbot_core::link::message::{
    DriverProblem, DriverReport, Empty, Fault, LatestFault, MaintenanceTask, Message, Motor, Refusal, ResetCause, State,
};

use super::bench::{Bench, WARM};
use super::requests::{bends, clear, maintain, start};
use crate::safety::transitions::may_heat;
use crate::testing::fast_robot;

fn trouble(problem: DriverProblem) -> DriverReport {
    DriverReport { motor: Motor::Feed, problem }
}

#[test]
fn a_driver_problem_during_work_is_a_fault_with_details() {
    for state in State::ALL.into_iter().filter(|state| may_heat(*state)) {
        for problem in DriverProblem::ALL {
            let mut bench = Bench::in_state(state);
            bench.world.driver_problem.set(Some(trouble(problem)));
            bench.run_to(State::Fault, 0.25);
            assert_eq!(bench.controller.fault(), Some(Fault::DriverFault));
            let answer = bench.ask(&Message::GetLatestFault(Empty {}));
            let Message::LatestFault(LatestFault { record: Some(record) }) = answer else { panic!("{answer:?}") };
            assert_eq!(record.sensors.driver_problem, Some(trouble(problem)));
            assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault: Fault::DriverFault });
            bench.world.driver_problem.set(None);
            bench.run(0.2);
            bench.accepted(&clear());
        }
    }
}

#[test]
fn a_driver_problem_at_rest_becomes_a_fault_when_motors_start() {
    let mut bench = Bench::in_state(State::Idle);
    bench.world.driver_problem.set(Some(trouble(DriverProblem::Silent)));
    bench.run(1.0);
    assert_eq!(bench.controller.state(), State::Idle);
    let Message::SensorReadings(readings) = bench.ask(&Message::GetSensorReadings(Empty {})) else { panic!() };
    assert_eq!(readings.driver_fault, Some(true));
    assert_eq!(readings.driver_problem, Some(trouble(DriverProblem::Silent)));
    bench.accepted(&start());
    bench.run_to(State::Fault, 0.25);
    assert_eq!(bench.controller.fault(), Some(Fault::DriverFault));
}

#[test]
fn a_start_without_motor_supply_is_not_a_broken_driver() {
    for problem in DriverProblem::ALL {
        let bench = Bench::in_state(State::Idle);
        bench.world.driver_problem.set(Some(trouble(problem)));
        let bench = bench.reset(ResetCause::PowerOn);
        let passes = matches!(problem, DriverProblem::Silent | DriverProblem::NotConfigured);
        let expected = if passes { None } else { Some(Fault::DriverFault) };
        assert_eq!(bench.controller.fault(), expected, "{problem:?}");
    }
}

#[test]
fn no_motor_is_energised_before_the_drivers_are_configured() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.world.drivers_unconfigured.set(true);
    bench.grow(&bends(2));
    bench.run(60.0);
    assert_eq!(bench.controller.state(), State::Heating);
    assert!(!bench.motors.enabled());
    bench.world.drivers_unconfigured.set(false);
    bench.run_to(State::Done, 120.0);

    let mut bench = Bench::in_state(State::Maintenance);
    bench.world.drivers_unconfigured.set(true);
    for task in [MaintenanceTask::Home, MaintenanceTask::Rotate { centi_deg: 100 }, MaintenanceTask::Feed { um: 100 }] {
        assert_eq!(bench.refused(&maintain(task)), Refusal::FaultRemains { fault: Fault::DriverFault });
    }
    bench.world.drivers_unconfigured.set(false);
    bench.accepted(&maintain(MaintenanceTask::Home));
}

#[test]
fn drivers_are_informed_whether_motors_are_in_use() {
    for state in State::ALL {
        let bench = Bench::in_state(state);
        // The drivers have the new value after the next poll at the latest.
        let mut bench = bench;
        bench.run(0.02);
        assert_eq!(bench.world.motors_in_use.get(), may_heat(bench.controller.state()), "{state:?}");
    }
}
