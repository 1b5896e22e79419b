//! Tests of a job's result: the laid layers, and the states and reports on the way.

use std::vec::Vec;

use growbot_core::angle::radians;
use growbot_core::job::{job_layers, summarize};
use growbot_core::layer_bytes::{HEIGHT_UNITS_PER_MM, LayerBytes, RawLayer, decode};
use growbot_core::link::message::{
    MAX_LAYERS_PER_MESSAGE, Message, PlanRequest, Planned, PoseFields, ReadLayers, Refusal, State, StoredLayers,
};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::{FeedStrategy, Robot};
use nalgebra::Vector2;

use super::bench::{Bench, WARM};
use super::requests::{PLAN, batch_of, begin, bends, start, stop};
use crate::layer_store::CAPACITY;
use crate::safety::transitions::{Event, next_state};
use crate::testing::{fast_robot, robot_a, robot_a_by};

/// Returns the number of feed steps that these layers need.
fn feed_steps(layers: &[LayerBytes], robot: &Robot) -> i64 {
    let units: u64 = layers.iter().map(|bytes| u64::from(RawLayer::from_bytes(bytes).height)).sum();
    libm::rint(units as f64 / HEIGHT_UNITS_PER_MM * robot.feed_steps_per_length()) as i64
}

/// Asserts that a job is done and that every report and every step count match its layers.
fn assert_laid(bench: &mut Bench, layers: &[LayerBytes]) {
    assert_eq!(bench.controller.state(), State::Done);
    bench.run(0.01);
    assert!(bench.heater.off() && !bench.motors.enabled());
    let status = bench.status();
    assert_eq!(
        (status.layers_laid, status.next_layer, status.plan_id),
        (layers.len() as u32, layers.len() as u32, PLAN)
    );
    assert_eq!((status.target_centi_c, status.duty), (None, 0));

    let laid = bench.laid();
    assert_eq!(laid.len(), layers.len());
    let (radius, step) = (bench.robot.tip_radius(), 1.0 / bench.robot.feed_steps_per_length());
    let turn = bench.robot.description().head.steps_per_turn;
    let lean = |bytes: &LayerBytes| {
        let layer = decode(bytes);
        let (sin, cos) = libm::sincos(layer.alpha);
        Vector2::new(cos, sin) * layer.tilt * radius
    };
    let mut owed = Vector2::zeros();
    for (index, (laid, asked)) in laid.iter().zip(layers).enumerate() {
        assert_eq!((laid.plan_id, laid.index), (PLAN, index as u32));
        let as_built = laid.as_built.unwrap();
        assert!((decode(&as_built).height - decode(asked).height).abs() <= step, "height of layer {index}");
        // Every sector begins and ends within half a step of its planned position. In the first harmonic the error is 2
        // pi steps at most. The next layer corrects the error of a layer, so that errors never add up.
        owed += lean(asked) - lean(&as_built);
        assert!(owed.norm() <= std::f64::consts::TAU * step, "lean after layer {index}");
    }
    assert_eq!(i64::from(bench.fed()), bench.motors.moved.feed);
    assert_eq!(bench.motors.moved.feed, feed_steps(layers, &bench.robot));
    // Every layer is a whole turn from the tip's x axis.
    assert_eq!(bench.motors.moved.head % i64::from(turn), 0);
    let states = [State::Idle, State::Heating, State::Homing, State::Growing, State::Done];
    assert!(states.ends_with(&bench.states()), "{:?}", bench.states());
}

#[test]
fn a_job_is_laid_with_exact_step_counts() {
    for (robot, count) in
        [(fast_robot(), 100), (robot_a_by(FeedStrategy::Feed), 6), (robot_a_by(FeedStrategy::Speed), 6)]
    {
        let mut bench = Bench::greeted(robot, 25.0);
        let layers = bends(count);
        bench.grow(&layers);
        bench.run_to(State::Done, 600.0);
        assert_laid(&mut bench, &layers);
        assert!(*bench.fed.0.borrow() > 100, "the watchdog is fed");
    }
}

#[test]
fn both_feed_strategies_build_the_same_body() {
    let built = [FeedStrategy::Feed, FeedStrategy::Speed].map(|strategy| {
        let mut bench = Bench::greeted(robot_a_by(strategy), WARM);
        bench.grow(&bends(5));
        bench.run_to(State::Done, 300.0);
        bench.laid()
    });
    // As-built layers are computed from the feed steps of each sector.
    assert_eq!(built[0].len(), 5);
    assert_eq!(built[0], built[1]);
}

#[test]
fn repeated_requests_change_nothing() {
    let layers = bends(60);
    let bodies = [false, true].map(|stutters| {
        let mut bench = Bench::greeted(fast_robot(), WARM);
        bench.stutters = stutters;
        bench.grow(&layers);
        bench.run_to(State::Growing, 60.0);
        // These requests are late repetitions.
        bench.grow(&layers);
        bench.run_to(State::Done, 60.0);
        bench.start();
        assert_laid(&mut bench, &layers);
        bench.laid()
    });
    assert_eq!(bodies[0], bodies[1]);
}

#[test]
fn a_job_larger_than_the_layer_store_is_streamed() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let layers = bends(CAPACITY + 600);
    bench.begin(layers.len());
    let (stored, rest) = layers.split_at(CAPACITY);
    bench.hand_over(0, stored);
    assert_eq!(bench.refused(&batch_of(CAPACITY, &rest[..1])), Refusal::LayerStoreFull);
    bench.start();
    for (batch, bytes) in rest.chunks(MAX_LAYERS_PER_MESSAGE).enumerate() {
        let laid = batch * MAX_LAYERS_PER_MESSAGE + bytes.len();
        if batch == 0 {
            bench.run_until(200.0, |bench| bench.laid().len() >= laid - 1);
            assert_eq!(
                bench.refused(&batch_of(CAPACITY, bytes)),
                Refusal::LayerStoreFull,
                "nothing of a batch that does not fit"
            );
        }
        bench.run_until(60.0, |bench| bench.events.len() > laid + 3);
        bench.hand_over(CAPACITY + batch * MAX_LAYERS_PER_MESSAGE, bytes);
    }
    bench.run_to(State::Done, 1000.0);
    assert_laid(&mut bench, &layers);
}

#[test]
fn growth_pauses_without_layers_and_continues_with_new_ones() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let layers = bends(20);
    bench.begin(20);
    bench.start();
    bench.run_to(State::Paused, 60.0);
    for at in [0, 5, 10] {
        bench.hand_over(at, &layers[at..at + 5]);
        bench.run_to(State::Growing, 0.1);
        bench.run_to(State::Paused, 2.0);
        let (moved, temperature) = (bench.motors.moved, bench.world.nozzle_c.get());
        bench.run(20.0);
        assert_eq!(bench.motors.moved, moved, "it only pauses");
        assert!(temperature > 180.0 && bench.world.nozzle_c.get() > 195.0, "hot");
        assert!(bench.motors.enabled(), "the head keeps its place");
    }
    bench.hand_over(15, &layers[15..]);
    bench.run_to(State::Done, 10.0);
    assert_eq!(bench.laid().len(), 20);
    assert_eq!(bench.motors.moved.feed, feed_steps(&layers, &bench.robot));
    assert_eq!(bench.motors.moved.head % 200, 0);
}

#[test]
fn a_stop_switches_all_outputs_off_in_every_state() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        bench.accepted(&stop());
        // The heater is off before anything else, and the motors with the next tick (the bench checks after each).
        assert!(bench.heater.off(), "{state:?}");
        let expected = next_state(state, Event::Stop).unwrap();
        assert_eq!(bench.controller.state(), expected);
        bench.run(1.0 / 4000.0);
        assert!(!bench.motors.enabled(), "{state:?}");
        let (moved, laid) = (bench.motors.moved, bench.status().layers_laid);
        bench.run(30.0);
        assert_eq!((bench.motors.moved, bench.status().layers_laid), (moved, laid));
        let later = if expected == State::SelfTest { State::Idle } else { expected };
        assert_eq!(bench.controller.state(), later);
    }
}

#[test]
fn a_stop_is_accepted_in_any_session() {
    let mut bench = Bench::in_state(State::Growing);
    assert!(matches!(bench.ask_in(99, &stop()), Message::Accepted(_)));
    assert_eq!(bench.controller.state(), State::Stopped);
}

#[test]
fn a_job_after_a_stop_is_new() {
    let mut bench = Bench::in_state(State::Growing);
    let before = bench.laid().len();
    assert!(before > 0);
    bench.accepted(&stop());
    assert_eq!(bench.refused(&start()), Refusal::WrongState { state: State::Stopped });
    // The stop takes effect at once, before the next tick and poll.
    let layers = bends(12);
    bench.grow(&layers);
    assert_eq!(bench.status().layers_laid, 0);
    let fed = bench.motors.moved.feed;
    bench.run_to(State::Done, 200.0);
    let laid = bench.laid().split_off(before);
    assert_eq!(laid.iter().map(|laid| laid.index).collect::<Vec<_>>(), (0..12).collect::<Vec<_>>());
    assert_eq!(bench.motors.moved.feed - fed, feed_steps(&layers, &bench.robot));
}

#[test]
fn no_heat_or_motion_without_a_start() {
    let mut bench = Bench::new(fast_robot(), 200.0);
    bench.run(5.0);
    bench.hello();
    bench.begin(20);
    bench.hand_over(0, &bends(20));
    bench.run(20.0);
    // The bench has checked every tick, and no step was made.
    assert_eq!((bench.motors.moved.pulses, bench.controller.state()), (0, State::Idle));
    assert!(bench.world.nozzle_c.get() < 175.0, "the nozzle cools");
}

#[test]
fn an_empty_job_is_done_at_once() {
    let mut bench = Bench::greeted(fast_robot(), 25.0);
    bench.stutters = true;
    bench.begin(0);
    bench.start();
    assert_eq!(bench.controller.state(), State::Done);
    bench.run(5.0);
    assert_eq!(bench.motors.moved.pulses, 0);
}

#[test]
fn unread_layer_reports_are_delivered_later() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let layers = bends(300);
    bench.grow(&layers);
    bench.reads = false;
    bench.run_to(State::Done, 120.0);
    bench.run(0.1);
    bench.reads = true;
    bench.run(20.0);
    let laid = bench.laid();
    assert_eq!(laid.iter().map(|laid| laid.index).collect::<Vec<_>>(), (0..300).collect::<Vec<_>>());
    assert!(laid.iter().all(|laid| laid.as_built.is_some()));
    assert_eq!(bench.states().last(), Some(&State::Done));
    assert_eq!(bench.status().layers_laid, 300);
}

#[test]
fn a_host_that_stops_reading_gets_responses_when_it_reads_again() {
    let mut bench = Bench::in_state(State::Growing);
    bench.reads = false;
    let mut buffer = [0; growbot_core::link::frame::MAX_BODY_LEN];
    let status = Message::GetStatus(growbot_core::link::message::Empty {});
    let body = status.encode(&mut buffer).unwrap();
    let header = growbot_core::link::frame::FrameHeader { kind: status.kind(), session: 1, seq: 1, ack: 0 };
    let request = growbot_core::link::frame::encode(&header, body).unwrap();
    for _ in 0..1000 {
        bench.send(&request);
    }
    bench.run(1.0);
    // Only whole frames are sent, and then the link is free again.
    let (_, answers) = bench.read(Some(1));
    assert!((5..100).contains(&answers.len()), "{} answers", answers.len());
    bench.reads = true;
    assert_eq!(bench.status().state, State::Growing);
}

#[test]
fn the_board_plans_like_the_desktop() {
    let robot = robot_a();
    let mut bench = Bench::greeted(robot.clone(), WARM);
    let pose = |position: [f64; 3], heading: f64, pitch: f64| PoseFields {
        position,
        heading: radians(heading),
        pitch: radians(pitch),
    };
    let start = pose([0.0; 3], 0.0, 90.0);
    for goal in [pose([300.0, 120.0, 400.0], 40.0, -20.0), pose([-50.0, 900.0, 10.0], 200.0, 5.0), start] {
        let request = PlanRequest { start, goal, radius: 100.0, planner: Planner::TwoPlane };
        let Message::Planned(planned) = bench.ask(&Message::Plan(request)) else { panic!() };
        let [from, to] = [start, goal].map(|fields| Pose::try_from(fields).unwrap());
        let path = plan(&robot, &from, &to, 100.0, Planner::TwoPlane).unwrap().path;
        let summary = summarize(&path, &robot);
        assert_eq!(
            planned,
            Planned {
                plan_id: summary.plan_id,
                exact_hash: summary.exact_hash,
                layers: summary.layers,
                length: growbot_core::path::length(&path),
            }
        );
        let mut stored = Vec::new();
        loop {
            let first = stored.len() as u32;
            let Message::StoredLayers(StoredLayers { layers, .. }) =
                bench.ask(&Message::ReadLayers(ReadLayers { first }))
            else {
                panic!()
            };
            stored.extend_from_slice(&layers);
            if layers.len() < MAX_LAYERS_PER_MESSAGE {
                break;
            }
        }
        assert_eq!(stored, job_layers(&path, &robot).collect::<Vec<_>>());
    }
}

#[test]
fn a_job_may_begin_exactly_in_the_states_at_rest() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        let other = begin(&bench.robot.clone(), PLAN + 1, 3);
        if matches!(state, State::Idle | State::Done | State::Stopped) {
            assert_eq!(bench.accepted(&other).next, 0);
            assert_eq!(bench.status().layers_laid, 0);
        } else {
            assert_eq!(bench.refused(&other), Refusal::WrongState { state });
        }
    }
}
