//! Tests that the board refuses invalid requests, and that a refused request changes nothing.

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder};
use growbot_core::link::message::{
    AppendLayers, BeginJob, HostSilencePolicy, LayerBatch, MAX_LAYERS_PER_MESSAGE, Message, PlanRequest, PoseFields,
    ReadLayers, Refusal, RefusalResponse, SCHEMA_HASH, Start, State, StoredLayers,
};
use growbot_core::plan::Planner;
use growbot_core::robot::{FeedStrategy, Robot};

use super::bench::Bench;
use super::requests::{PLAN, batch_of, begin, bends, clear, hello, start};
use crate::layer_store::CAPACITY;
use crate::testing::{fast_robot, robot_a};

/// Creates a bench whose board is idle and has a job of 40 layers, of which 30 are stored.
fn idle() -> Bench {
    Bench::in_state(State::Idle)
}

fn layers_of(plan_id: u64, first: u32, layers: &[LayerBytes]) -> Message {
    Message::AppendLayers(AppendLayers { plan_id, first, layers: layers.iter().copied().collect() })
}

#[test]
fn undecodable_requests_are_not_understood() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        let before = bench.status();
        for (kind, body) in [
            (0x00, &[][..]),
            (0x0b, &[]),
            (0x3a, &[1, 2, 3]),
            (0xff, &[]),
            (0x05, &[]),
            (0x05, &[0xff; 100]),
            (0x04, &[1]),
        ] {
            let answer = bench.ask_raw(bench.session, kind, body);
            assert_eq!(
                answer,
                Message::Refused(RefusalResponse { kind, refusal: Refusal::UnknownRequest }),
                "{state:?}"
            );
        }
        // Only boards send these messages.
        assert_eq!(
            bench.refused(&Message::Accepted(growbot_core::link::message::Accepted {
                plan_id: 0,
                next: 0,
                free_layers: 0
            })),
            Refusal::UnknownRequest
        );
        assert_eq!(bench.status(), before);
    }
}

#[test]
fn a_schema_mismatch_opens_no_session() {
    let mut bench = Bench::new(fast_robot(), 25.0);
    bench.run_to(State::Idle, 1.0);
    assert_eq!(bench.refused(&hello(SCHEMA_HASH + 1)), Refusal::SchemaMismatch { board: SCHEMA_HASH });
    let message = begin(&bench.robot.clone(), PLAN, 1);
    assert_eq!(bench.refused(&message), Refusal::NoSession);
    // An open session stays open.
    bench.hello();
    assert_eq!(bench.refused(&hello(0)), Refusal::SchemaMismatch { board: SCHEMA_HASH });
    bench.accepted(&message);
}

#[test]
fn only_the_latest_session_may_change_state() {
    let mut bench = idle();
    let requests = [begin(&bench.robot.clone(), PLAN + 1, 2), batch_of(30, &bends(1)), start(), clear()];
    let other = bench.session + 1;
    for request in &requests {
        let before = bench.status();
        let answer = bench.ask_in(other, request);
        assert_eq!(answer, Message::Refused(RefusalResponse { kind: request.kind(), refusal: Refusal::NoSession }));
        assert_eq!(bench.status(), before);
    }
    bench.ask_in(other, &hello(SCHEMA_HASH));
    for request in &requests {
        assert_eq!(bench.refused(request), Refusal::NoSession);
    }
}

#[test]
fn a_job_for_another_robot_or_without_plan_id_is_refused() {
    let mut bench = idle();
    let board = bench.robot.hash();
    assert_eq!(bench.refused(&begin(&robot_a(), PLAN, 40)), Refusal::RobotMismatch { board });
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        let nameless = Message::BeginJob(BeginJob { plan_id: 0, layers: 1, robot_hash: board });
        assert_eq!(bench.refused(&nameless), Refusal::UnknownRequest, "{state:?}");
    }
    let mut fresh = Bench::greeted(fast_robot(), 25.0);
    assert_eq!(
        fresh.refused(&Message::BeginJob(BeginJob { plan_id: 0, layers: 1, robot_hash: board })),
        Refusal::UnknownRequest
    );
}

#[test]
fn a_plan_with_a_different_layer_count_is_a_different_job() {
    let mut bench = idle();
    let robot = bench.robot.clone();
    assert_eq!(bench.accepted(&begin(&robot, PLAN, 40)).next, 30);
    assert_eq!(bench.accepted(&begin(&robot, PLAN, 41)).next, 0);
    let mut bench = Bench::in_state(State::Growing);
    assert_eq!(bench.refused(&begin(&robot, PLAN, 41)), Refusal::WrongState { state: State::Growing });
}

#[test]
fn a_plan_mismatch_is_refused_in_every_state() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        let board = bench.status().plan_id;
        for plan_id in [0, PLAN + 1, u64::MAX] {
            let refusal = Refusal::PlanMismatch { board };
            assert_eq!(bench.refused(&layers_of(plan_id, 30, &bends(1))), refusal);
            assert_eq!(
                bench.refused(&Message::Start(Start {
                    plan_id,
                    on_host_silence: HostSilencePolicy::Pause,
                    is_continuation: false
                })),
                refusal
            );
        }
    }
    let mut fresh = Bench::greeted(fast_robot(), 25.0);
    assert_eq!(
        fresh.refused(&Message::Start(Start {
            plan_id: 0,
            on_host_silence: HostSilencePolicy::Pause,
            is_continuation: false
        })),
        Refusal::PlanMismatch { board: 0 }
    );
}

#[test]
fn layers_must_follow_the_stored_ones() {
    let mut bench = idle();
    let expected = Refusal::OutOfOrder { expected: 30 };
    assert_eq!(bench.refused(&batch_of(31, &bends(1))), expected);
    assert_eq!(bench.refused(&layers_of(PLAN, u32::MAX, &bends(16))), expected);
    // A repeated request overlaps with the stored layers.
    assert_eq!(bench.accepted(&batch_of(25, &bends(7))).next, 32);
    assert_eq!(bench.accepted(&batch_of(0, &bends(16))).next, 32);
    assert_eq!(bench.accepted(&batch_of(32, &[])).next, 32);
}

#[test]
fn one_invalid_layer_rejects_the_whole_batch() {
    let bad = |height: f64, tilt: f64| LayerEncoder::default().encode(&Layer { alpha: 1.0, height, tilt });
    for bad in [bad(1.0, 0.0), bad(0.7, 0.01), bad(0.1, 0.007), [0; 12], [0xff; 12], bad(0.0, 0.0)] {
        let mut bench = idle();
        let mut batch = bends(5);
        batch[3] = bad;
        assert_eq!(bench.refused(&batch_of(30, &batch)), Refusal::LayerOutOfLimits { index: 33 });
        assert_eq!(bench.refused(&batch_of(28, &batch)), Refusal::LayerOutOfLimits { index: 31 });
    }
    let mut bench = idle();
    assert_eq!(bench.refused(&batch_of(30, &bends(11))), Refusal::LayerOutOfLimits { index: 40 });
    assert_eq!(bench.accepted(&batch_of(30, &bends(10))).next, 40);
    assert_eq!(bench.refused(&batch_of(40, &bends(1))), Refusal::LayerOutOfLimits { index: 40 });
}

fn plan_to(position: [f64; 3], radius: f64) -> Message {
    let start = PoseFields { position: [0.0; 3], heading: 0.0, pitch: core::f64::consts::FRAC_PI_2 };
    let goal = PoseFields { position, heading: 0.0, pitch: 0.0 };
    Message::Plan(PlanRequest { start, goal, radius, planner: Planner::TwoPlane })
}

#[test]
fn invalid_poses_and_radii_give_no_plan() {
    let mut bench = idle();
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e8] {
        assert_eq!(bench.refused(&plan_to([x, 0.0, 0.0], 100.0)), Refusal::PlanningFailed);
    }
    for radius in [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, -100.0, 98.0, 1e300, f64::MIN_POSITIVE] {
        assert_eq!(bench.refused(&plan_to([100.0, 0.0, 300.0], radius)), Refusal::PlanningFailed);
    }
    let far = bench.refused(&plan_to([1e7, 0.0, 0.0], 100.0));
    assert!(
        matches!(far, Refusal::PlanTooLong { layers: 10_000_000.., capacity } if capacity as usize == CAPACITY),
        "{far:?}"
    );
}

#[test]
fn a_plan_beyond_the_motor_limits_is_refused_as_a_whole() {
    // With a steady feed the head is fastest on the inner side. On a tight bend it is too fast for these steps.
    let mut description = fast_robot().description().clone();
    description.motion.strategy = FeedStrategy::Speed;
    description.head.steps_per_turn = 256;
    description.planning_radius_mm = 1000.0;
    let mut bench = Bench::greeted(Robot::new(description).unwrap(), 25.0);
    bench.begin(40);
    bench.hand_over(0, &bends(1));
    let refusal = bench.refused(&plan_to([100.0, 0.0, 300.0], 100.0));
    assert!(matches!(refusal, Refusal::LayerOutOfLimits { .. }), "{refusal:?}");
}

#[test]
fn maximum_values_in_requests_are_handled() {
    let mut bench = idle();
    let robot = bench.robot.clone();
    let read = |first| Message::ReadLayers(ReadLayers { first });
    for first in [30, 4096, u32::MAX - 1, u32::MAX] {
        assert_eq!(bench.ask(&read(first)), Message::StoredLayers(StoredLayers { first, layers: LayerBatch::new() }));
    }
    let begin = |layers| Message::BeginJob(BeginJob { plan_id: u64::MAX, layers, robot_hash: robot.hash() });
    let too_long = bench.refused(&begin(u32::MAX));
    assert!(matches!(too_long, Refusal::PlanTooLong { layers: u32::MAX, capacity: 6000.. }), "{too_long:?}");
    bench.accepted(&begin(6000));
    for batch in 0..CAPACITY / MAX_LAYERS_PER_MESSAGE {
        let first = (batch * MAX_LAYERS_PER_MESSAGE) as u32;
        bench.accepted(&layers_of(u64::MAX, first, &bends(MAX_LAYERS_PER_MESSAGE)));
    }
    assert_eq!(bench.refused(&layers_of(u64::MAX, CAPACITY as u32, &bends(1))), Refusal::LayerStoreFull);
    bench.accepted(&Message::Start(Start {
        plan_id: u64::MAX,
        on_host_silence: HostSilencePolicy::Pause,
        is_continuation: false,
    }));
    assert_eq!(bench.controller.state(), State::Heating);
}
