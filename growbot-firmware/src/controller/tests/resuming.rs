//! Tests of a job that is interrupted and resumed. Every layer is laid once, and the layers after the interruption are
//! the same as without an interruption.

use std::vec::Vec;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{Cancel, InterruptedLayer, Message, Refusal, ResetCause, State};

use super::bench::{Bench, WARM};
use super::requests::{AMENDED, PLAN, amend, bends, clear, pause, resume, start, stop};
use crate::testing::fast_robot;

/// Returns the layers as built that were reported to the host, each once and in order. An element is `None` if the
/// layer was skipped.
fn body(bench: &Bench) -> Vec<Option<LayerBytes>> {
    let laid = bench.laid();
    // A layer is reported again after each resumption, and the reports must be equal.
    let mut body: Vec<Option<LayerBytes>> = Vec::new();
    for laid in laid {
        match body.get(laid.index as usize) {
            Some(before) => assert_eq!(*before, laid.as_built, "layer {}", laid.index),
            None => {
                assert_eq!(laid.index as usize, body.len());
                body.push(laid.as_built);
            }
        }
    }
    body
}

fn uninterrupted() -> Vec<Option<LayerBytes>> {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.grow(&bends(40));
    bench.run_to(State::Done, 100.0);
    bench.run(0.1);
    body(&bench)
}

/// Resumes the job at a layer and grows to the end.
fn resume_to_end(bench: &mut Bench, from: u32) {
    let accepted = bench.accepted(&resume(from));
    bench.hand_over(accepted.next as usize, &bends(40)[accepted.next as usize..]);
    bench.start();
    bench.run_to(State::Done, 200.0);
    bench.run(1.0);
}

#[test]
fn remaining_layers_are_laid_unchanged_after_stop_fault_or_reset() {
    let whole = uninterrupted();
    assert_eq!(whole.len(), 40);
    type Interruption = fn(Bench) -> Bench;
    let interruptions: [Interruption; 5] = [
        |mut bench| {
            bench.accepted(&stop());
            bench
        },
        |mut bench| {
            bench.press_emergency_stop(true);
            bench.run_to(State::EmergencyStop, 0.1);
            bench.press_emergency_stop(false);
            bench.run(0.1);
            bench.accepted(&clear());
            bench
        },
        |bench| {
            let mut bench = bench.reset(ResetCause::Watchdog);
            bench.accepted(&clear());
            bench
        },
        |bench| {
            bench.world.retained.set([0x5A; crate::safety::retained::RETAINED_BYTES]);
            bench.reset(ResetCause::PowerOn)
        },
        |mut bench| {
            // The reset is between two layers.
            bench.accepted(&pause());
            bench.run_to(State::Paused, 2.0);
            bench.world.retained.set([0x5A; crate::safety::retained::RETAINED_BYTES]);
            bench.reset(ResetCause::PowerOn)
        },
    ];
    for (which, interrupt) in interruptions.into_iter().enumerate() {
        // The heater gets power 42 ms before the first layer.
        for seconds in [0.06, 0.25, 1.3, 4.0] {
            let mut bench = Bench::greeted(fast_robot(), WARM);
            bench.grow(&bends(40));
            bench.run_to(State::Growing, 60.0);
            bench.run(seconds);
            let mut bench = interrupt(bench);
            let status = bench.status();
            assert_eq!(status.plan_id, PLAN);
            assert_eq!(status.interrupted.is_some(), which != 4, "{status:?}");
            resume_to_end(&mut bench, status.layers_laid);
            assert_eq!(bench.status().layers_laid, 40);
            let all = body(&bench);
            assert_eq!(all, whole, "interruption {which} after {seconds} s");
        }
    }
}

#[test]
fn layer_progress_is_exact_after_a_stop_and_bounded_after_a_reset() {
    // A layer takes 0.5 s, and a sector 8 ms.
    let interrupted = |bench: &mut Bench| bench.status().interrupted.unwrap();
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.grow(&bends(40));
    bench.run_until(60.0, |bench| bench.laid().len() == 3);
    let period = bench.robot.description().layer.period_s;
    bench.run(0.4 * period);
    bench.accepted(&stop());
    let InterruptedLayer { min, max } = interrupted(&mut bench);
    assert_eq!(max, min + 1);
    assert!((22..30).contains(&min), "{min}");

    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.grow(&bends(40));
    bench.run_until(60.0, |bench| bench.laid().len() == 3);
    bench.run(0.7 * period);
    let mut bench = bench.reset(ResetCause::External);
    let InterruptedLayer { min, max } = interrupted(&mut bench);
    assert!(min <= 45 && max >= 45 && max - min < 40, "{min} to {max}");
}

#[test]
fn an_interrupted_layer_can_count_as_laid() {
    let mut bench = Bench::in_state(State::Growing);
    bench.accepted(&stop());
    let laid = bench.status().layers_laid;
    resume_to_end(&mut bench, laid + 1);
    let body = body(&bench);
    assert_eq!(body.len(), 40);
    assert_eq!(body[laid as usize], None, "nothing is claimed of it");
    assert_eq!(body.iter().filter(|layer| layer.is_none()).count(), 1);
}

#[test]
fn only_the_next_layer_can_be_resumed() {
    let mut bench = Bench::in_state(State::Growing);
    bench.accepted(&pause());
    bench.run_to(State::Paused, 2.0);
    bench.accepted(&stop());
    let laid = bench.status().layers_laid;
    for from in [0, laid - 1, laid + 1, laid + 2, u32::MAX] {
        assert_eq!(bench.refused(&resume(from)), Refusal::OutOfOrder { expected: laid });
    }
    assert_eq!(bench.refused(&Message::Cancel(Cancel { plan_id: PLAN + 1 })), Refusal::PlanMismatch { board: PLAN });
    resume_to_end(&mut bench, laid);
}

#[test]
fn a_cancelled_job_is_forgotten() {
    for state in [State::Growing, State::Stopped, State::Paused, State::Parked] {
        let mut bench = Bench::in_state(state);
        bench.accepted(&Message::Cancel(Cancel { plan_id: PLAN }));
        bench.accepted(&Message::Cancel(Cancel { plan_id: PLAN }));
        assert_eq!((bench.controller.state(), bench.status().plan_id), (State::Idle, 0), "{state:?}");
        let mut bench = bench.reset(ResetCause::PowerOn);
        assert_eq!(bench.status().plan_id, 0);
        assert_eq!(bench.refused(&resume(0)), Refusal::PlanMismatch { board: 0 });
    }
}

#[test]
fn a_done_job_is_reported_after_a_reset_and_not_repeated() {
    let whole = uninterrupted();
    let mut bench = Bench::in_state(State::Done).reset(ResetCause::PowerOn);
    bench.events.clear();
    let status = bench.status();
    assert_eq!((status.plan_id, status.layers_laid, status.layer_count, status.interrupted), (PLAN, 40, 40, None));
    bench.accepted(&resume(40));
    bench.start();
    assert_eq!(bench.controller.state(), State::Done);
    bench.run(5.0);
    assert_eq!(body(&bench), whole);
    assert_eq!(bench.motors.moved.pulses, 0);
}

#[test]
fn future_layers_are_replaced_during_growth() {
    let mut bench = Bench::in_state(State::Growing);
    let (given, next) = (bench.status().layers_laid + 2, bench.status().next_layer);
    assert_eq!(bench.refused(&amend(given - 2, 50)), Refusal::LayerAlreadyBegun { first: given });
    assert_eq!(bench.refused(&amend(next + 1, 50)), Refusal::OutOfOrder { expected: next });
    assert_eq!(bench.refused(&amend(given + 4, given + 6)), Refusal::LayerOutOfLimits { index: given + 6 });
    let accepted = bench.accepted(&amend(given + 4, given + 7));
    assert_eq!((accepted.plan_id, accepted.next), (AMENDED, given + 7));
    // Requests for the plan before the amendment are refused.
    assert_eq!(bench.refused(&start()), Refusal::PlanMismatch { board: AMENDED });
    bench.run_to(State::Done, 60.0);
    bench.run(0.1);
    let laid = bench.laid();
    assert_eq!(laid.len() as u32, given + 7);
    assert_eq!(laid.last().unwrap().plan_id, AMENDED);
}

#[test]
fn an_amended_job_keeps_its_new_plan_id_after_a_power_loss() {
    let mut bench = Bench::in_state(State::Growing);
    let given = bench.status().layers_laid + 2;
    bench.accepted(&amend(given + 4, 50));
    bench.world.retained.set([0; crate::safety::retained::RETAINED_BYTES]);
    let mut bench = bench.reset(ResetCause::PowerOn);
    let status = bench.status();
    assert_eq!((status.plan_id, status.layer_count), (AMENDED, 50));
}

#[test]
fn layer_reports_include_measurements_while_stored() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.grow(&bends(40));
    bench.run_to(State::Done, 100.0);
    bench.run(1.0);
    let measured: Vec<_> = bench.laid().iter().map(|laid| laid.readings.unwrap()).collect();
    assert_eq!(measured.len(), 40);
    assert!(measured.iter().all(|measured| measured.gravity_milli_g == Some([0, 0, 1000])));
    let pulses: Vec<u32> = measured.iter().map(|measured| measured.filament_pulses.unwrap()).collect();
    assert!(pulses.is_sorted() && pulses[39] > pulses[0] + 40, "{pulses:?}");

    // Only the latest measurements are still stored, and none of them survives a reset.
    bench.events.clear();
    bench.accepted(&resume(0));
    bench.run(1.0);
    let again: Vec<_> = bench.laid().iter().map(|laid| laid.readings).collect();
    assert_eq!(again.len(), 40);
    assert!(again[..24].iter().all(Option::is_none), "{again:?}");
    assert!(again[24..].iter().copied().eq(measured[24..].iter().copied().map(Some)));
    let mut bench = bench.reset(ResetCause::External);
    bench.events.clear();
    bench.accepted(&resume(40));
    bench.run(1.0);
    assert!(bench.laid().len() == 40 && bench.laid().iter().all(|laid| laid.readings.is_none()));
}
