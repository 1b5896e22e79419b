//! Tests of pauses, on request or for lack of layers: retraction of filament, standby, parking, and continuation.

use growbot_core::link::message::{PauseCause, Refusal, ResetCause, State};
use growbot_core::robot::{HeadRotation, Robot};

use super::bench::{Bench, WARM};
use super::requests::{bends, clear, continuation, feed_steps_of, pause, resume, start, stop};
use crate::testing::fast_robot;

/// Returns the fast robot with a retraction of 4 mm of filament in a pause, which are 10 steps.
fn retracting() -> Robot {
    let mut description = fast_robot().description().clone();
    description.feed.retract_mm = 4.0;
    description.feed.retract_mm_per_s = 40.0;
    Robot::new(description).unwrap()
}

#[test]
fn a_pause_finishes_the_layer_and_retracts_filament_until_continued() {
    let mut bench = Bench::greeted(retracting(), WARM);
    let layers = bends(40);
    bench.grow(&layers);
    bench.run_to(State::Growing, 60.0);
    bench.run(0.7);
    bench.accepted(&pause());
    bench.accepted(&pause());
    assert_eq!(bench.controller.state(), State::Growing, "the layer under way is finished");
    bench.run_to(State::Paused, 0.5);
    let fed = bench.fed();
    assert_eq!(bench.motors.moved.feed, i64::from(fed));
    bench.run(1.0);
    assert_eq!(bench.motors.moved.feed, i64::from(fed) - 10, "pulled back");
    assert!(bench.motors.enabled(), "the head keeps its place");
    bench.run(20.0);
    assert_eq!(bench.controller.state(), State::Paused, "though there are layers");
    bench.start();
    bench.run_to(State::Done, 60.0);
    let fed = bench.fed();
    assert_eq!((bench.laid().len(), bench.motors.moved.feed), (40, i64::from(fed)));
}

/// Returns a board that has pulled filament back in a pause before the first of 40 layers.
fn paused_before_first_layer() -> Bench {
    let mut bench = Bench::greeted(retracting(), WARM);
    bench.grow(&bends(40));
    bench.accepted(&pause());
    bench.run_to(State::Paused, 60.0);
    bench.run(1.0);
    bench
}

/// Resets the board, grows the body, and checks that the whole length that a pause pulls back was pushed before it.
fn check_pushed_in_full_after_reset(bench: Bench, cause: ResetCause) {
    let mut bench = bench.reset(cause);
    bench.accepted(&clear());
    bench.accepted(&resume(0));
    bench.hand_over(0, &bends(40));
    bench.start();
    bench.run_to(State::Done, 200.0);
    bench.run(0.1);
    assert_eq!(bench.motors.moved.feed, i64::from(bench.fed()) + 10);
}

/// Checks the one case in which only the retained memory distinguishes a pause from heating: before the first layer.
#[test]
fn filament_retracted_before_the_first_layer_is_pushed_forward_after_a_reset() {
    let bench = paused_before_first_layer();
    assert_eq!(bench.motors.moved.feed, -10);
    check_pushed_in_full_after_reset(bench, ResetCause::Watchdog);
}

#[test]
fn filament_that_a_reset_leaves_half_pushed_is_pushed_in_full() {
    let mut bench = paused_before_first_layer();
    bench.start();
    bench.run_until(60.0, |bench| bench.motors.moved.feed == -5);
    assert_eq!(bench.controller.state(), State::Growing);
    check_pushed_in_full_after_reset(bench, ResetCause::External);
}

#[test]
fn a_retraction_that_is_cut_off_counts_in_full() {
    let mut bench = Bench::greeted(retracting(), WARM);
    let layers = bends(40);
    bench.grow(&layers);
    bench.run_to(State::Growing, 60.0);
    bench.run(0.7);
    bench.accepted(&pause());
    bench.run_to(State::Paused, 0.5);
    let fed = i64::from(bench.fed());
    bench.run_until(1.0, |bench| bench.motors.moved.feed == fed - 5);
    bench.accepted(&stop());
    let laid = bench.status().layers_laid;
    // The board reports all layers again.
    bench.events.clear();
    bench.accepted(&resume(laid));
    bench.hand_over(laid as usize, &layers[laid as usize..]);
    bench.start();
    bench.run_to(State::Done, 200.0);
    assert_eq!(bench.motors.moved.feed, i64::from(bench.fed()) + 5);
}

#[test]
fn a_continuation_starts_only_what_waits_for_its_host() {
    let mut bench = Bench::greeted(retracting(), WARM);
    let settings = bench.robot.description().pause;
    let layers = bends(40);
    bench.begin(40);
    bench.hand_over(0, &layers[..10]);
    assert_eq!(bench.refused(&continuation()), Refusal::WrongState { state: State::Idle });
    assert!(bench.heater.off());
    bench.start();
    bench.run_to(State::Paused, 100.0);
    assert_eq!(bench.status().pause_cause, PauseCause::LayersExhausted);
    bench.accepted(&continuation());
    bench.hand_over(10, &layers[10..20]);
    bench.run_to(State::Growing, 60.0);
    bench.accepted(&pause());
    bench.run_to(State::Paused, 60.0);
    assert_eq!(bench.refused(&continuation()), Refusal::WrongState { state: State::Paused });
    assert_eq!(bench.status().pause_cause, PauseCause::Requested);
    // A start that was sent before the board parked arrives after it.
    bench.run_to(State::Parked, settings.off_after_s + 1.0);
    assert_eq!(bench.refused(&continuation()), Refusal::WrongState { state: State::Parked });
    bench.run(1.0);
    assert!(bench.heater.off());
    bench.start();
    bench.run_to(State::Heating, 10.0);
}

#[test]
fn a_long_pause_cools_to_standby_and_then_parks() {
    let mut bench = Bench::greeted(retracting(), WARM);
    let layers = bends(40);
    bench.begin(40);
    bench.hand_over(0, &layers[..10]);
    bench.start();
    bench.run_to(State::Paused, 100.0);
    let settings = bench.robot.description().pause;
    bench.run(settings.standby_after_s - 2.0);
    assert!(bench.world.nozzle_c.get() > 195.0);
    bench.run(120.0);
    assert!((bench.world.nozzle_c.get() - settings.standby_c).abs() < 3.0, "{} C", bench.world.nozzle_c.get());
    // From standby the nozzle heats up again before the growth continues.
    bench.hand_over(10, &layers[10..20]);
    bench.run(0.1);
    assert_eq!(bench.controller.state(), State::Paused, "not while it is cold");
    bench.run_to(State::Growing, 60.0);
    assert!(bench.world.nozzle_c.get() > 195.0);
    bench.run_to(State::Paused, 60.0);
    // If no layers arrive for long enough, the heater switches off, and the job is stored.
    bench.run_to(State::Parked, settings.off_after_s + 1.0);
    assert!(bench.heater.off());
    bench.run(1.0);
    assert!(!bench.motors.enabled());
    let laid = bench.status().layers_laid;
    assert_eq!(laid, 20);
    bench.hand_over(20, &layers[20..]);
    bench.run(30.0);
    assert_eq!(bench.controller.state(), State::Parked, "it does not heat by itself");
    // The pause waits for layers, and still only a person ends it.
    assert_eq!(bench.status().pause_cause, PauseCause::LayersExhausted);
    assert_eq!(bench.refused(&continuation()), Refusal::WrongState { state: State::Parked });
    bench.start();
    bench.run_to(State::Homing, 200.0);
    bench.run_to(State::Done, 100.0);
    let all = bench.laid();
    assert_eq!(all.iter().map(|laid| laid.index).collect::<std::vec::Vec<_>>(), (0..40).collect::<std::vec::Vec<_>>());
    let fed = bench.fed();
    assert_eq!(bench.motors.moved.feed, i64::from(fed), "what was pulled back is pushed forward again");
}

#[test]
fn a_pause_may_be_requested_before_the_first_layer() {
    let mut bench = Bench::greeted(retracting(), WARM);
    bench.grow(&bends(5));
    bench.accepted(&pause());
    bench.run_to(State::Paused, 60.0);
    assert!(bench.laid().is_empty());
    bench.start();
    bench.run_to(State::Done, 60.0);
}

#[test]
fn a_pause_is_refused_at_rest() {
    for state in [State::Idle, State::Done, State::Stopped, State::Fault, State::Tuning] {
        let mut bench = Bench::in_state(state);
        assert_eq!(bench.refused(&pause()), Refusal::WrongState { state });
    }
}

#[test]
fn an_alternating_head_builds_the_same_body() {
    let mut description = fast_robot().description().clone();
    description.motion.turning = HeadRotation::Alternate;
    let alternate = Robot::new(description).unwrap();
    let turn = i64::from(alternate.description().head.steps_per_turn);
    let built = [fast_robot(), alternate].map(|robot| {
        let alternates = robot.description().motion.turning == HeadRotation::Alternate;
        let mut bench = Bench::greeted(robot, WARM);
        bench.grow(&bends(31));
        bench.run_to(State::Growing, 60.0);
        let zero = bench.motors.moved.head;
        while bench.controller.state() != State::Done {
            bench.run(0.05);
            let from_zero = bench.motors.moved.head - zero;
            assert!(!alternates || (0..=turn).contains(&from_zero), "{from_zero} steps from zero");
        }
        bench.laid()
    });
    // Feed steps are placed by angle, so the layers differ only in the sector to which half a step is rounded.
    for (one, other) in built[0].iter().zip(&built[1]) {
        assert_eq!(one.index, other.index);
        let [one, other] = [one, other].map(|laid| feed_steps_of(laid, &fast_robot()));
        assert!(one.abs_diff(other) <= 1);
    }
}

#[test]
fn a_repeated_continue_has_no_effect() {
    let mut bench = Bench::greeted(retracting(), WARM);
    bench.stutters = true;
    bench.grow(&bends(8));
    bench.run_to(State::Growing, 60.0);
    bench.accepted(&pause());
    bench.run_to(State::Paused, 2.0);
    bench.accepted(&start());
    bench.run_to(State::Done, 60.0);
    assert_eq!(bench.laid().len(), 8);
}
