//! Tests of maintenance: heat and moves without a job, each within its limits.

use growbot_core::link::message::{Fault, MaintenanceTask, Refusal, State};

use super::bench::{Bench, WARM};
use super::requests::{feed, maintain, pause, preheat, start, stop};
use super::tip::{FILAMENT_PRESENCE, Wire};
use crate::controller::maintenance::UNATTENDED_US;
use crate::testing::fast_robot;

fn hot() -> Bench {
    Bench::in_state(State::Maintenance)
}

#[test]
fn preheating_holds_the_temperature_until_cool_down() {
    let mut bench = hot();
    assert!((bench.world.nozzle_c.get() - 200.0).abs() < 3.0);
    bench.accepted(&preheat(150.0));
    bench.run(90.0);
    assert!((bench.world.nozzle_c.get() - 150.0).abs() < 3.0, "{} C", bench.world.nozzle_c.get());
    bench.accepted(&maintain(MaintenanceTask::CoolDown));
    assert_eq!(bench.controller.state(), State::Idle);
    assert!(bench.heater.off());
    // A repeated request changes nothing, and the earlier job is still stored.
    bench.accepted(&maintain(MaintenanceTask::CoolDown));
    bench.start();
    bench.run_to(State::Growing, 200.0);
}

#[test]
fn temperatures_outside_the_limits_are_refused() {
    let mut bench = Bench::in_state(State::Idle);
    for celsius in [49.0, 235.1, 1e7, -1e7] {
        assert_eq!(
            bench.refused(&preheat(celsius)),
            Refusal::TemperatureOutOfRange { min: 5000, max: 23_500 },
            "{celsius}"
        );
    }
}

#[test]
fn moves_are_refused_with_a_cold_nozzle() {
    let mut bench = Bench::greeted(fast_robot(), 60.0);
    assert_eq!(bench.refused(&feed(1.0)), Refusal::WrongState { state: State::Idle });
    bench.accepted(&preheat(200.0));
    for request in
        [feed(1.0), feed(-1.0), maintain(MaintenanceTask::Home), maintain(MaintenanceTask::Rotate { centi_deg: 9000 })]
    {
        let Refusal::NozzleTooCold { now, min } = bench.refused(&request) else { panic!("{request:?}") };
        assert!((5900..6200).contains(&now) && min == 18_000, "{now} of {min}");
    }
    // A temperature of 150 C is not hot enough either. The refusal states the required temperature.
    bench.accepted(&preheat(150.0));
    bench.run(120.0);
    assert!(matches!(bench.refused(&feed(1.0)), Refusal::NozzleTooCold { now: 14_700..15_300, min: 18_000 }));
    assert_eq!(bench.motors.moved.pulses, 0);
}

#[test]
fn a_dry_run_moves_a_cold_robot_without_heating() {
    let mut bench = Bench::greeted(fast_robot(), 25.0);
    bench.accepted(&maintain(MaintenanceTask::DryRun));
    assert_eq!(bench.controller.state(), State::Maintenance);
    bench.accepted(&maintain(MaintenanceTask::Home));
    bench.run(20.0);
    let at = bench.motors.moved.feed;
    bench.accepted(&feed(5.0));
    bench.run(60.0);
    assert!(bench.motors.moved.feed > at && bench.heater.off());
    assert_eq!((bench.controller.fault(), bench.controller.state()), (None, State::Maintenance));
    // A repeated request changes nothing.
    bench.accepted(&maintain(MaintenanceTask::DryRun));
    // A preheat ends the dry run, and the nozzle is too cold then.
    bench.accepted(&preheat(200.0));
    assert!(matches!(bench.refused(&feed(1.0)), Refusal::NozzleTooCold { .. }));
    assert_eq!(bench.refused(&maintain(MaintenanceTask::DryRun)), Refusal::WrongState { state: State::Maintenance });
    bench.accepted(&maintain(MaintenanceTask::CoolDown));
    bench.accepted(&maintain(MaintenanceTask::DryRun));
    bench.run(UNATTENDED_US as f64 * 1e-6 + 1.0);
    assert_eq!(bench.controller.state(), State::Idle);
    assert!(!bench.motors.enabled());
}

#[test]
fn a_dry_run_is_refused_during_a_pause() {
    let mut bench = Bench::in_state(State::Paused);
    assert_eq!(bench.refused(&maintain(MaintenanceTask::DryRun)), Refusal::WrongState { state: State::Paused });
}

#[test]
fn filament_is_loaded_and_unloaded_by_the_requested_length() {
    let mut bench = hot();
    let steps_per_mm = bench.robot.description().feed.steps_per_mm;
    let at = bench.motors.moved.feed;
    for (mm, after_mm) in [(10.0, 10.0), (-25.0, -15.0)] {
        bench.accepted(&feed(mm));
        assert_eq!(bench.refused(&feed(1.0)), Refusal::StillMoving);
        bench.run(120.0);
        let moved = (bench.motors.moved.feed - at) as f64;
        assert!((moved - after_mm * steps_per_mm).abs() <= 1.0, "{moved} steps, {after_mm} mm");
        assert_eq!(bench.controller.fault(), None);
    }
    assert!(matches!(bench.refused(&feed(1e6)), Refusal::MoveTooLong { max } if max > 1000));
}

#[test]
fn the_head_homes_and_turns_by_the_requested_angle() {
    let mut bench = hot();
    bench.accepted(&maintain(MaintenanceTask::Home));
    bench.run(20.0);
    let (at, turn) = (bench.motors.moved.head, i64::from(bench.robot.description().head.steps_per_turn));
    bench.accepted(&maintain(MaintenanceTask::Rotate { centi_deg: 9000 }));
    bench.run(20.0);
    assert_eq!(bench.motors.moved.head - at, turn / 4);
    bench.accepted(&maintain(MaintenanceTask::Rotate { centi_deg: -18_000 }));
    bench.run(20.0);
    assert_eq!(bench.motors.moved.head - at, -turn / 4);
    for centi_deg in [36_001, i32::MIN, i32::MAX] {
        assert_eq!(
            bench.refused(&maintain(MaintenanceTask::Rotate { centi_deg })),
            Refusal::MoveTooLong { max: 36_000 }
        );
    }
}

#[test]
fn unattended_maintenance_times_out() {
    let mut bench = hot();
    let limit_s = UNATTENDED_US as f64 * 1e-6;
    bench.run(limit_s - 10.0);
    bench.accepted(&feed(1.0));
    bench.run(limit_s - 10.0);
    assert_eq!(bench.controller.state(), State::Maintenance, "a request begins the time anew");
    bench.run_to(State::Idle, 11.0);
    bench.run(0.1);
    assert!(bench.heater.off() && !bench.motors.enabled());
}

#[test]
fn maintenance_is_refused_during_growth_and_faults() {
    for state in [State::Heating, State::Homing, State::Growing, State::Tuning, State::Fault, State::EmergencyStop] {
        let mut bench = Bench::in_state(state);
        for request in [preheat(200.0), feed(1.0), maintain(MaintenanceTask::Home), maintain(MaintenanceTask::CoolDown)]
        {
            assert_eq!(bench.refused(&request), Refusal::WrongState { state }, "{request:?}");
        }
    }
    let mut bench = Bench::in_state(State::Paused);
    assert_eq!(bench.refused(&maintain(MaintenanceTask::Home)), Refusal::WrongState { state: State::Paused });
}

#[test]
fn alarms_stay_active_during_maintenance() {
    // A jam occurs while filament is pushed forward.
    let mut bench = hot();
    bench.motors.jammed = true;
    bench.accepted(&feed(30.0));
    bench.run_to(State::Fault, 60.0);
    assert_eq!(bench.controller.fault(), Some(Fault::FilamentJam));
    // The thermistor's wire breaks.
    let mut bench = hot();
    bench.world.wire.set(Wire::Open);
    bench.run_to(State::Fault, 1.0);
    assert!(bench.heater.off());
    // The host requests a stop.
    let mut bench = hot();
    bench.accepted(&feed(30.0));
    bench.accepted(&stop());
    let at = bench.motors.moved.feed;
    bench.run(5.0);
    assert_eq!((bench.controller.state(), bench.motors.moved.feed), (State::Stopped, at));
}

#[test]
fn loading_without_filament_is_refused() {
    let mut bench = hot();
    bench.heater.pins.set(FILAMENT_PRESENCE, false);
    bench.run(1.0);
    assert_eq!(bench.controller.state(), State::Maintenance, "it is no fault to have none");
    assert_eq!(bench.refused(&feed(5.0)), Refusal::NoFilament);
    bench.accepted(&feed(-5.0));
}

#[test]
fn growth_continues_its_layer_after_a_new_spool_is_loaded() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let layers = super::requests::bends(30);
    bench.grow(&layers);
    bench.run_to(State::Growing, 60.0);
    bench.run(2.0);
    bench.heater.pins.set(FILAMENT_PRESENCE, false);
    bench.run_to(State::Paused, 60.0);
    let status = bench.status();
    assert_eq!(status.pause_cause, growbot_core::link::message::PauseCause::FilamentOut);
    assert!(status.layers_laid > 0 && status.interrupted.is_none(), "the layer under way was finished");
    // The nozzle is at standby, for longer than any other pause may last.
    bench.run(2.0 * bench.robot.description().pause.off_after_s);
    assert_eq!(bench.controller.state(), State::Paused);
    assert!(bench.world.nozzle_c.get() < 160.0, "{} C", bench.world.nozzle_c.get());
    assert_eq!(bench.refused(&start()), Refusal::NoFilament);
    bench.accepted(&pause());
    assert_eq!(bench.refused(&start()), Refusal::NoFilament, "another pause does not hide it");
    // After a new spool the operator heats, loads, and continues.
    bench.heater.pins.set(FILAMENT_PRESENCE, true);
    bench.run(0.5);
    assert!(matches!(bench.refused(&feed(20.0)), Refusal::NozzleTooCold { .. }));
    bench.accepted(&preheat(200.0));
    bench.run_until_it_may_move();
    bench.accepted(&feed(20.0));
    assert_eq!(bench.refused(&start()), Refusal::StillMoving);
    bench.run(30.0);
    bench.start();
    bench.run_to(State::Done, 200.0);
    let laid = bench.laid();
    assert_eq!(laid.iter().map(|laid| laid.index).collect::<std::vec::Vec<_>>(), (0..30).collect::<std::vec::Vec<_>>());
}

#[test]
fn a_long_wait_for_filament_parks_the_robot() {
    let mut bench = Bench::in_state(State::Growing);
    bench.heater.pins.set(FILAMENT_PRESENCE, false);
    bench.run_to(State::Paused, 60.0);
    bench.run(3590.0);
    assert_eq!(bench.controller.state(), State::Paused);
    bench.run_to(State::Parked, 20.0);
    assert!(bench.heater.off());
}

#[test]
fn growth_continues_after_maintenance_only_on_command() {
    let mut bench = Bench::in_state(State::Growing);
    // The growth pauses because it has no layers, and would continue by itself with the next ones.
    let layers = super::requests::bends(60);
    bench.run_until(60.0, |bench| bench.controller.state() == State::Paused);
    bench.run_until_it_may_move();
    bench.accepted(&feed(10.0));
    bench.run(20.0);
    let at = bench.status().next_layer as usize;
    let left = layers.get(at..at + 10).unwrap();
    bench.hand_over(at, left);
    bench.run(60.0);
    assert_eq!(bench.controller.state(), State::Paused);
    bench.start();
    bench.run_to(State::Growing, 60.0);
}

/// Starts a job, pauses it, and moves filament by these lengths in the pause, mm.
fn moved_in_a_pause(bench: &mut Bench, moves: &[f64]) {
    bench.grow(&super::requests::bends(30));
    bench.run_to(State::Growing, 60.0);
    bench.run(2.0);
    bench.accepted(&pause());
    bench.run_to(State::Paused, 60.0);
    bench.run_until_it_may_move();
    for mm in moves {
        bench.accepted(&feed(*mm));
        bench.run(60.0);
        bench.accepted(&preheat(200.0));
        bench.run_until_it_may_move();
    }
}

#[test]
fn retracted_filament_is_pushed_to_the_nozzle_again() {
    let per_mm = fast_robot().description().feed.steps_per_mm;
    let steps = |moves: &[f64]| {
        let mut bench = Bench::greeted(fast_robot(), WARM);
        moved_in_a_pause(&mut bench, moves);
        bench.start();
        bench.run_to(State::Done, 200.0);
        bench.motors.moved.feed
    };
    let undisturbed = steps(&[]);
    assert_eq!(steps(&[-5.0, 5.0]), undisturbed);
    // If more filament is pushed than was missing, the excess goes through the nozzle.
    let more = steps(&[-5.0, 8.0]) - undisturbed;
    assert!((more as f64 - 3.0 * per_mm).abs() <= 1.0, "{more} steps");
}

#[test]
fn no_layer_is_laid_while_filament_is_far_from_the_nozzle() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    moved_in_a_pause(&mut bench, &[-20.0]);
    assert_eq!(bench.refused(&start()), Refusal::NoFilament);
    bench.accepted(&feed(12.0));
    bench.run(60.0);
    assert_eq!(bench.refused(&start()), Refusal::NoFilament, "8 mm are missing");
    bench.accepted(&preheat(200.0));
    bench.run_until_it_may_move();
    bench.accepted(&feed(8.0));
    bench.run(60.0);
    bench.start();
    bench.run_to(State::Done, 200.0);
}

#[test]
fn in_a_pause_only_the_growth_temperature_is_allowed() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    moved_in_a_pause(&mut bench, &[]);
    assert_eq!(bench.refused(&preheat(110.0)), Refusal::TemperatureOutOfRange { min: 20_000, max: 20_000 });
}

#[test]
fn temperature_changes_are_refused_during_a_move() {
    let mut bench = hot();
    bench.accepted(&maintain(MaintenanceTask::Rotate { centi_deg: 36_000 }));
    assert_eq!(bench.refused(&preheat(60.0)), Refusal::StillMoving);
}

#[test]
fn filament_running_out_during_a_load_is_a_fault() {
    let mut bench = hot();
    bench.accepted(&feed(60.0));
    bench.run(1.0);
    bench.heater.pins.set(FILAMENT_PRESENCE, false);
    bench.run_to(State::Fault, 2.0);
    assert_eq!(bench.controller.fault(), Some(Fault::FilamentOut));
}

#[test]
fn a_parked_robot_reports_missing_filament() {
    let mut bench = Bench::in_state(State::Growing);
    bench.heater.pins.set(FILAMENT_PRESENCE, false);
    bench.run_to(State::Parked, 4000.0);
    assert_eq!(bench.status().pause_cause, growbot_core::link::message::PauseCause::FilamentOut);
    assert_eq!(bench.refused(&start()), Refusal::NoFilament);
    // With a new spool the robot heats and homes, pauses before its layer, and is loaded while hot.
    bench.heater.pins.set(FILAMENT_PRESENCE, true);
    bench.run(0.5);
    bench.start();
    bench.accepted(&pause());
    bench.run_to(State::Paused, 200.0);
    bench.run_until_it_may_move();
    bench.accepted(&feed(20.0));
    bench.run(30.0);
    bench.start();
    bench.run_to(State::Growing, 60.0);
}
