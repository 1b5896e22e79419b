//! Tests of the board after a reset: nothing heats or moves, and the board reports the earlier activity and fault.

use growbot_core::link::message::{
    BootReport, Empty, Fault, FaultRecord, ImageCheck, InterruptedLayer, LatestFault, Message, Refusal, ResetCause,
    State,
};

use std::vec::Vec;

use super::bench::{Bench, WARM, at_rest};
use super::requests::{PLAN, bends, clear, pause, preheat, start, tune};
use super::tip::Wire;
use crate::safety::retained::tests::of_another_firmware;
use crate::safety::retained::{COPY_BYTES, RETAINED_BYTES, RetainedState, RetainedStore};

fn record(bench: &mut Bench) -> Option<FaultRecord> {
    match bench.ask(&Message::GetLatestFault(Empty {})) {
        Message::LatestFault(LatestFault { record }) => record,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_reset_during_work_is_a_fault_by_its_cause() {
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
            let laid = bench.status().layers_laid;
            let mut bench = bench.reset(cause);
            assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(fault)), "{state:?}");
            assert!(bench.heater.off() && bench.motors.moved.pulses == 0);
            let record = record(&mut bench).unwrap();
            assert_eq!((record.fault, record.state, record.laid), (Some(fault), state, laid));
            assert!(!record.cleared);
            if !matches!(state, State::Tuning | State::Maintenance) {
                assert_eq!(record.plan_id, PLAN);
            }
            assert!(matches!(bench.ask(&start()), Message::Refused(_)), "not before it is cleared");
            bench.accepted(&clear());
            assert_eq!(bench.controller.state(), State::Idle);
            // The job is known, but none of its layers is stored.
            let status = bench.status();
            assert_eq!(
                (status.plan_id, status.layer_count, status.layers_laid, status.next_layer),
                (PLAN, 40, laid, laid)
            );
        }
    }
}

#[test]
fn no_progress_is_invented_for_a_layer_not_active_at_the_reset() {
    let mut bench = Bench::in_state(State::Growing);
    bench.run(5.0);
    let mut bench = bench.reset(ResetCause::Watchdog);
    bench.accepted(&clear());
    assert!(bench.status().interrupted.is_some_and(|layer| layer.min > 1), "the layer was under way");
    // The activity at the next reset is maintenance, not the layer.
    bench.accepted(&preheat(200.0));
    bench.run_to(State::Maintenance, 60.0);
    let mut bench = bench.reset(ResetCause::Watchdog);
    bench.accepted(&clear());
    assert_eq!(bench.status().interrupted, Some(InterruptedLayer { min: 0, max: 64 }));
}

#[test]
fn a_reset_at_rest_is_not_a_fault() {
    for state in [State::Idle, State::Done, State::Stopped] {
        let bench = Bench::in_state(state).reset(ResetCause::External);
        assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Idle, None), "{state:?}");
    }
}

#[test]
fn a_fault_survives_resets_until_cleared_and_stays_readable() {
    let mut bench = Bench::in_state(State::Growing);
    bench.world.wire.set(Wire::Open);
    bench.run_to(State::Fault, 1.0);
    bench.world.wire.set(Wire::Whole);
    let first = record(&mut bench).unwrap();
    assert_eq!((first.fault, first.state), (Some(Fault::ThermistorOpen), State::Growing));
    assert!(first.temperature_centi_c.is_none(), "there was no reading when it came");
    assert!(first.duty > 0, "as it was when it came");
    assert!(first.target_centi_c.is_some() && first.laid > 0 && first.layers_begun > first.laid);
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
fn after_a_power_loss_the_state_comes_from_the_journal() {
    // A debug probe writes to RAM when it flashes the board.
    for cause in [ResetCause::PowerOn, ResetCause::BrownOut, ResetCause::External] {
        let mut bench = Bench::in_state(State::Growing);
        let laid = bench.status().layers_laid;
        assert!(laid > 0);
        bench.world.retained.set([0xA5; RETAINED_BYTES]);
        let mut bench = bench.reset(cause);
        assert_eq!((bench.controller.state(), record(&mut bench)), (State::Idle, None));
        let status = bench.status();
        assert_eq!(
            (status.plan_id, status.layers_laid, status.interrupted),
            (PLAN, laid, Some(InterruptedLayer { min: 0, max: 64 }))
        );
        assert!(matches!(bench.ask(&start()), Message::Refused(_)), "the interrupted layer is to be decided on");
        assert!(bench.heater.off());
    }
}

#[test]
fn a_corrupt_image_never_heats() {
    for before in [State::Idle, State::Growing, State::Fault, State::EmergencyStop] {
        let bench = Bench::in_state(before);
        let image = ImageCheck::Corrupt { sealed: 1, found: 2 };
        bench.world.image.set(image);
        let mut bench = bench.reset(ResetCause::External);
        let latched = (State::Fault, Some(Fault::ImageCorrupt));
        assert_eq!((bench.controller.state(), bench.controller.fault()), latched, "{before:?}");
        assert_eq!(
            bench.ask(&Message::GetBootReport(Empty {})),
            Message::BootReport(BootReport { image, crash: None })
        );
        assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault: Fault::ImageCorrupt });
        assert!(matches!(bench.refused(&start()), Refusal::WrongState { .. } | Refusal::PlanMismatch { .. }));
        assert_eq!(bench.refused(&tune(200.0)), Refusal::WrongState { state: State::Fault });
        bench.run(5.0);
        assert_eq!((bench.controller.state(), bench.controller.fault()), latched);
        // The board is flashed again.
        bench.world.image.set(ImageCheck::Valid { crc: 1 });
        let mut bench = bench.reset(ResetCause::External);
        assert_eq!((bench.controller.state(), bench.controller.fault()), latched, "it is latched");
        bench.accepted(&clear());
        assert_eq!(bench.controller.state(), State::Idle);
    }
}

#[test]
fn retained_state_lost_in_a_powered_reset_is_a_fault() {
    for (cause, fault) in [
        (ResetCause::Watchdog, Some(Fault::WatchdogReset)),
        (ResetCause::ProcessorFault, Some(Fault::ProcessorFault)),
        (ResetCause::StackOverflow, Some(Fault::StackOverflow)),
        (ResetCause::ClockFailed, Some(Fault::ClockFailed)),
        // The memory may have been without power.
        (ResetCause::BrownOut, None),
        (ResetCause::PowerOn, None),
        (ResetCause::External, None),
    ] {
        let bench = Bench::in_state(State::Growing);
        bench.world.retained.set([0xA5; RETAINED_BYTES]);
        assert_eq!(bench.reset(cause).controller.fault(), fault, "{cause:?}");
    }
}

#[test]
fn retained_state_of_another_firmware_is_always_a_fault() {
    for (cause, fault) in [
        (ResetCause::PowerOn, Fault::PowerLost),
        (ResetCause::External, Fault::PowerLost),
        (ResetCause::BrownOut, Fault::BrownOut),
        (ResetCause::Watchdog, Fault::WatchdogReset),
    ] {
        for before in [State::Idle, State::Growing, State::EmergencyStop] {
            let bench = Bench::in_state(before);
            let mut memory = [0; RETAINED_BYTES];
            memory.as_chunks_mut::<COPY_BYTES>().0.copy_from_slice(&[of_another_firmware(1), of_another_firmware(2)]);
            bench.world.retained.set(memory);
            let mut bench = bench.reset(cause);
            assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, Some(fault)), "{before:?}");
            assert!(matches!(bench.ask(&start()), Message::Refused(_)), "not before it is cleared");
            // The fault is stored in the format of this firmware, and stays cleared after it is cleared once.
            bench = bench.reset(ResetCause::External);
            assert_eq!(bench.controller.fault(), Some(fault));
            bench.accepted(&clear());
            assert_eq!(bench.reset(ResetCause::External).controller.state(), State::Idle);
        }
    }
}

/// Returns the distinct states that a start would find if a reset had torn one of these writes at any byte. Each state
/// comes with the content of its memory. The byte at which the reset occurs is noise.
fn found_after_tears(
    mut memory: [u8; RETAINED_BYTES],
    writes: &[(usize, [u8; COPY_BYTES])],
) -> Vec<([u8; RETAINED_BYTES], RetainedState)> {
    let mut found: Vec<([u8; RETAINED_BYTES], RetainedState)> = Vec::new();
    for (copy, bytes) in writes {
        let before = memory;
        memory.as_chunks_mut::<COPY_BYTES>().0[*copy] = *bytes;
        let torn = (0..COPY_BYTES).flat_map(|written| {
            [0, bytes[written], !bytes[written]].map(|noise| {
                let mut torn = before;
                let into = &mut torn.as_chunks_mut::<COPY_BYTES>().0[*copy];
                into[..written].copy_from_slice(&bytes[..written]);
                into[written] = noise;
                torn
            })
        });
        for torn in [before, memory].into_iter().chain(torn) {
            let retained = RetainedStore::find(&mut Fixed(torn)).1.expect("one of the copies is whole");
            if found.iter().all(|(_, other)| *other != retained) {
                found.push((torn, retained));
            }
        }
    }
    found
}

/// Retained memory that ignores writes.
struct Fixed([u8; RETAINED_BYTES]);

impl crate::hal::RetainedMemory for Fixed {
    fn read(&mut self) -> [u8; RETAINED_BYTES] {
        self.0
    }

    fn write(&mut self, _: usize, _: &[u8; COPY_BYTES]) {}
}

#[test]
fn a_torn_retained_write_during_work_leads_to_a_fault() {
    type End = fn(&mut Bench);
    let ends: [(End, State); 2] = [
        (|bench| bench.world.wire.set(Wire::Open), State::Fault),
        (|bench| bench.press_emergency_stop(true), State::EmergencyStop),
    ];
    for (end, state) in ends {
        // A cleared fault comes first, so that an old copy may contain that one.
        let mut bench = Bench::in_state(State::Fault);
        bench.accepted(&clear());
        bench.world.nozzle_c.set(WARM);
        bench.run(0.3);
        bench.grow(&bends(40));
        // From here on the heater is on.
        bench.run_until(60.0, |bench| !bench.heater.off());
        let memory = bench.world.retained.get();
        bench.world.retained_writes.borrow_mut().clear();
        bench.run_to(State::Growing, 60.0);
        bench.run(2.5);
        bench.accepted(&pause());
        bench.run_to(State::Paused, 4.0);
        bench.start();
        bench.run_to(State::Growing, 60.0);
        bench.run(0.5);
        end(&mut bench);
        bench.run_to(state, 1.0);
        bench.run(0.3);

        let writes = bench.world.retained_writes.borrow().clone();
        let found = found_after_tears(memory, &writes);
        std::println!("{} writes, {} states of what is retained", writes.len(), found.len());
        assert!(writes.len() > 30 && found.len() > 20);
        for (memory, retained) in found {
            bench.world.retained.set(memory);
            bench = bench.reset(ResetCause::External);
            let state = bench.controller.state();
            assert!(matches!(state, State::Fault | State::EmergencyStop), "{state:?} after {retained:?}");
        }
    }
}

#[test]
fn a_crystal_failure_at_rest_is_a_fault() {
    let mut bench = Bench::in_state(State::Idle).reset(ResetCause::ClockFailed);
    assert_eq!(bench.controller.fault(), Some(Fault::ClockFailed));
    // The first fault stays latched if another one occurs.
    bench = Bench::in_state(State::Fault);
    let latched = bench.controller.fault();
    assert!(latched.is_some() && latched != Some(Fault::ClockFailed));
    assert_eq!(bench.reset(ResetCause::ClockFailed).controller.fault(), latched);
}
