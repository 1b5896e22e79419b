//! What a reset of the board leaves: nothing heats or moves, and what was under way and what was wrong are told.

use growbot_core::link::message::{Cut, Empty, Fault, FaultRecord, LatestFault, Message, ResetCause, State};

use super::bench::{Bench, PLAN, at_rest, clear, start};
use super::tip::Wire;

fn record(bench: &mut Bench) -> Option<FaultRecord> {
    match bench.ask(&Message::AskFault(Empty {})) {
        Message::LatestFault(LatestFault { record }) => record,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_reset_in_the_midst_of_work_is_a_fault_by_its_cause() {
    for (cause, fault) in [
        (ResetCause::BrownOut, Fault::BrownOut),
        (ResetCause::Watchdog, Fault::WatchdogReset),
        (ResetCause::ProcessorFault, Fault::ProcessorFault),
        (ResetCause::StackOverflow, Fault::StackOverflow),
        (ResetCause::External, Fault::PowerLost),
        (ResetCause::ClockFailed, Fault::ClockFailed),
    ] {
        for state in State::ALL.into_iter().filter(|state| !at_rest(*state) || *state == State::Parked) {
            let mut bench = Bench::in_state(state);
            let laid = bench.status().laid;
            let mut bench = bench.reset(cause);
            assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(fault)), "{state:?}");
            assert!(bench.heater.off() && bench.motors.moved.pulses == 0);
            let record = record(&mut bench).unwrap();
            assert_eq!((record.fault, record.state, record.laid), (Some(fault), state, laid));
            assert!(!record.cleared);
            if state != State::Tuning {
                assert_eq!(record.plan_id, PLAN);
            }
            assert!(matches!(bench.ask(&start()), Message::Refused(_)), "not before it is cleared");
            bench.accepted(&clear());
            assert_eq!(bench.controller.state(), State::Idle);
            // The job is known, and nothing of it is held.
            let status = bench.status();
            assert_eq!((status.plan_id, status.layers, status.laid, status.next), (PLAN, 40, laid, laid));
        }
    }
}

#[test]
fn a_reset_at_rest_is_none() {
    for state in [State::Idle, State::Done, State::Stopped] {
        let bench = Bench::in_state(state).reset(ResetCause::External);
        assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Idle, None), "{state:?}");
    }
}

#[test]
fn a_fault_survives_resets_until_it_is_cleared_and_can_be_read_after_that() {
    let mut bench = Bench::in_state(State::Growing);
    bench.world.wire.set(Wire::Cut);
    bench.run_to(State::Fault, 1.0);
    bench.world.wire.set(Wire::Whole);
    let first = record(&mut bench).unwrap();
    assert_eq!((first.fault, first.state), (Some(Fault::ThermistorOpen), State::Growing));
    assert!(first.temperature_centi_c.is_none(), "there was no reading when it came");
    assert!(first.target_centi_c.is_some() && first.laid > 0 && first.begun > first.laid);
    for cause in [ResetCause::External, ResetCause::Watchdog, ResetCause::BrownOut] {
        bench = bench.reset(cause);
        assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(Fault::ThermistorOpen)));
        assert_eq!(record(&mut bench), Some(first));
    }
    bench.accepted(&clear());
    let bench = &mut bench.reset(ResetCause::External);
    assert_eq!(bench.controller.state(), State::Idle);
    assert_eq!(record(bench), Some(FaultRecord { cleared: true, ..first }));
}

#[test]
fn an_emergency_stop_survives_a_reset() {
    let mut bench = Bench::in_state(State::EmergencyStop).reset(ResetCause::External);
    assert_eq!(bench.controller.state(), State::EmergencyStop);
    bench.accepted(&clear());
    assert_eq!(bench.controller.state(), State::Idle);
}

#[test]
fn without_power_the_journal_is_what_is_known() {
    let mut bench = Bench::in_state(State::Growing);
    let laid = bench.status().laid;
    assert!(laid > 0);
    bench.world.kept.set([0xA5; crate::safety::kept::KEPT_BYTES]);
    let mut bench = bench.reset(ResetCause::PowerOn);
    assert_eq!((bench.controller.state(), record(&mut bench)), (State::Idle, None));
    let status = bench.status();
    assert_eq!((status.plan_id, status.laid, status.cut), (PLAN, laid, Some(Cut { least: 0, most: 64 })));
}
