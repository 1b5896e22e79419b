//! Tests of every fault by its real cause, in every state in which the fault can occur. The fault `StepRate` does not
//! occur, because no layer that needs too high a step rate passes its check.

use growbot_core::link::message::{Empty, Fault, LatestFault, Message, Refusal, State, StateChanged};

use super::bench::{Bench, WARM, at_rest};
use super::requests::{PLAN, batch_of, begin, bends, clear, start};
use super::tip::{DRIVER_FAULT, FEED, FILAMENT_PRESENCE, HEAD, HEATER_ENABLE, Wire};
use crate::testing::fast_robot;

/// States in which the heater is on.
const HEATED: [State; 5] = [State::Heating, State::Homing, State::Growing, State::Paused, State::Tuning];
/// States in which the nozzle must be hot.
const HOT: [State; 3] = [State::Homing, State::Growing, State::Paused];

/// Waits at most `within` seconds for this fault, and asserts that nothing is warm or moves afterwards.
fn assert_fault(bench: &mut Bench, fault: Fault, within: f64) {
    bench.run_to(State::Fault, within);
    assert_eq!(bench.controller.fault(), Some(fault));
    assert!(bench.heater.off());
    bench.run(0.1);
    assert!(!bench.motors.enabled());
    let told = Message::StateChanged(StateChanged { state: State::Fault, fault: Some(fault) });
    // The report of a layer that was laid at the same moment may follow.
    let latest = bench.events.iter().rfind(|event| matches!(event, Message::StateChanged(_)));
    assert_eq!(latest, Some(&told));
    assert!(matches!(bench.refused(&start()), Refusal::WrongState { .. } | Refusal::PlanMismatch { .. }));
    let moved = bench.motors.moved;
    bench.run(10.0);
    assert_eq!((bench.motors.moved, bench.controller.fault()), (moved, Some(fault)));
}

/// Clears a fault whose cause is gone, and asserts that a job can be laid afterwards.
fn assert_usable(bench: &mut Bench) {
    bench.accepted(&clear());
    assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Idle, None));
    bench.run(0.3);
    assert_eq!(bench.controller.state(), State::Idle, "clearing starts nothing");
    bench.world.nozzle_c.set(WARM);
    bench.run(0.2);
    bench.grow(&bends(3));
    bench.run_to(State::Done, 120.0);
}

const WIRES: [(Wire, Fault, f64); 3] = [
    (Wire::Open, Fault::ThermistorOpen, 0.22),
    (Wire::Shorted, Fault::ThermistorShort, 0.22),
    (Wire::Silent, Fault::ThermistorSilent, 0.72),
];

#[test]
fn a_broken_thermistor_is_a_fault_in_every_heated_state() {
    for (wire, fault, within) in WIRES {
        for state in HEATED {
            let mut bench = Bench::in_state(state);
            bench.world.wire.set(wire);
            assert_fault(&mut bench, fault, within);
            assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
            bench.world.wire.set(Wire::Whole);
            bench.run(0.2);
            assert_usable(&mut bench);
        }
    }
}

#[test]
fn with_the_heater_off_a_broken_thermistor_is_a_fault_at_the_next_start() {
    for (wire, fault, within) in WIRES {
        for state in [State::Idle, State::Done, State::Stopped] {
            let mut bench = Bench::in_state(state);
            bench.world.wire.set(wire);
            bench.run(2.0);
            assert_eq!(bench.controller.state(), state);
            assert_eq!(bench.status().temperature_centi_c, None);
            bench.grow(&bends(2));
            if state == State::Done {
                continue; // The same plan is finished already, so there is nothing to grow.
            }
            assert_fault(&mut bench, fault, within);
        }
    }
}

#[test]
fn over_temperature_is_a_fault_in_every_state() {
    for state in State::ALL.into_iter().filter(|state| !matches!(state, State::Fault | State::EmergencyStop)) {
        let mut bench = Bench::in_state(state);
        // Both switches of the heater are shorted, so that it heats at any duty.
        bench.world.nozzle_c.set(320.0);
        bench.run_to(State::Fault, 0.22);
        let fault = bench.controller.fault().unwrap();
        // On the way up, supervision may first detect that this cannot be the heater's power.
        let hot = !at_rest(state) && fault == Fault::HeaterStuckOn;
        assert!(fault == Fault::OverTemperature || hot, "{state:?}: {fault:?}");
        assert!(bench.heater.off());
        if fault != Fault::OverTemperature {
            continue;
        }
        assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
        // Without a reading, the fault also counts as remaining.
        bench.world.wire.set(Wire::Open);
        bench.world.nozzle_c.set(100.0);
        bench.run(0.2);
        assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
        bench.world.wire.set(Wire::Whole);
        bench.run(0.2);
        assert_usable(&mut bench);
    }
}

#[test]
fn a_cooling_nozzle_is_a_fault_in_states_that_need_heat() {
    for state in HOT {
        let mut bench = Bench::in_state(state);
        bench.world.draught.set(3.0);
        assert_fault(&mut bench, Fault::TemperatureDrop, 60.0);
        bench.world.draught.set(1.0);
        assert_usable(&mut bench);
    }
}

#[test]
fn a_nozzle_that_does_not_heat_up_is_a_fault() {
    // The draught is too strong to reach the target, though the heater works.
    let mut bench = Bench::in_state(State::Heating);
    bench.world.draught.set(4.0);
    assert_fault(&mut bench, Fault::HeatingTooSlow, 301.0);
    bench.world.draught.set(1.0);
    assert_usable(&mut bench);
}

#[test]
fn dangerous_inputs_are_faults_while_the_robot_is_active() {
    type Break = fn(&Bench, bool);
    let working = [State::Heating, State::Homing, State::Growing, State::Paused];
    // While growing, the robot waits for filament: see `pausing.rs`.
    let before_growing = &working[..2];
    let inputs: [(Fault, Break); 5] = [
        (Fault::DriverFault, |bench, broken| bench.heater.pins.set(DRIVER_FAULT, broken)),
        (Fault::FilamentOut, |bench, broken| bench.heater.pins.set(FILAMENT_PRESENCE, !broken)),
        (Fault::SupplyLow, |bench, broken| bench.world.supply_v.set(Some(if broken { 10.0 } else { 12.0 }))),
        (Fault::SupplyHigh, |bench, broken| bench.world.supply_v.set(Some(if broken { 14.5 } else { 12.0 }))),
        (Fault::SupplyLow, |bench, broken| bench.world.supply_v.set((!broken).then_some(12.0))),
    ];
    for (fault, set) in inputs {
        let states = if fault == Fault::FilamentOut { before_growing } else { &working };
        for &state in states {
            let mut bench = Bench::in_state(state);
            set(&bench, true);
            assert_fault(&mut bench, fault, 1.3);
            assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
            set(&bench, false);
            bench.run(0.3);
            assert_usable(&mut bench);
        }
        // At rest it is reported, and has no other effect.
        let mut bench = Bench::in_state(State::Idle);
        set(&bench, true);
        bench.run(5.0);
        assert_eq!(bench.controller.state(), State::Idle);
    }
}

#[test]
fn sensor_readings_are_reported() {
    let mut bench = Bench::in_state(State::Growing);
    let Message::SensorReadings(readings) = bench.ask(&Message::GetSensorReadings(Empty {})) else { panic!() };
    assert!(readings.supply_mv.is_some_and(|millivolts| millivolts.abs_diff(12_000) < 10));
    assert_eq!((readings.filament_present, readings.driver_fault), (Some(true), Some(false)));
    assert_eq!((readings.emergency_stop, readings.gravity_milli_g), (Some(false), Some([0, 0, 1000])));
    let before = readings.filament_pulses.unwrap();
    bench.run(1.0);
    let Message::SensorReadings(readings) = bench.ask(&Message::GetSensorReadings(Empty {})) else { panic!() };
    assert!(readings.filament_pulses.unwrap() > before);
}

#[test]
fn filament_that_does_not_move_when_fed_is_a_fault() {
    let mut bench = Bench::in_state(State::Growing);
    bench.motors.jammed = true;
    let before = bench.motors.moved.feed;
    assert_fault(&mut bench, Fault::FilamentJam, 1.0);
    let description = bench.robot.description();
    let jam_mm = description.sensors.filament_motion.unwrap().jam_mm;
    let fed_mm = (bench.motors.moved.feed - before) as f64 / description.feed.steps_per_mm;
    assert!(fed_mm <= jam_mm + 1.0, "{fed_mm} mm were fed");
    bench.motors.jammed = false;
    assert_usable(&mut bench);
}

#[test]
fn lost_head_steps_are_a_fault_within_one_turn() {
    for lost in [-12, 12] {
        let mut bench = Bench::in_state(State::Growing);
        bench.motors.moved.head += lost;
        assert_fault(&mut bench, Fault::HeadStepsLost, 0.5);
    }
    // With so large a loss the mark comes in another turn, and is missing in this one.
    let mut bench = Bench::in_state(State::Growing);
    bench.motors.moved.head -= 60;
    assert_fault(&mut bench, Fault::IndexMissing, 0.5);
    let mut bench = Bench::in_state(State::Growing);
    bench.motors.index_dead = true;
    assert_fault(&mut bench, Fault::IndexMissing, 0.5);
}

#[test]
fn a_stopped_step_interrupt_is_a_fault_and_starves_the_watchdog() {
    for state in [State::Heating, State::Homing, State::Growing, State::Paused] {
        let mut bench = Bench::in_state(state);
        bench.interrupt_runs = false;
        bench.run_to(State::Fault, 0.5);
        assert_eq!(bench.controller.fault(), Some(Fault::StepsStalled), "{state:?}");
        assert!(bench.heater.off());
        let fed = *bench.fed.0.borrow();
        bench.run(3.0);
        assert_eq!(*bench.fed.0.borrow(), fed, "only a reset can let go of the motors");
    }
    // If the interrupt never ran, the self-test detects it.
    let mut bench = Bench::new(fast_robot(), 25.0);
    bench.interrupt_runs = false;
    bench.run_to(State::Fault, 0.6);
    assert_eq!(bench.controller.fault(), Some(Fault::StepsStalled));
}

#[test]
fn the_self_test_reports_faults_before_any_request() {
    for (wire, fault) in [
        (Wire::Open, Fault::ThermistorOpen),
        (Wire::Shorted, Fault::ThermistorShort),
        (Wire::Silent, Fault::ThermistorSilent),
    ] {
        let mut bench = Bench::new(fast_robot(), 25.0);
        bench.world.wire.set(wire);
        bench.run_to(State::Fault, 2.3);
        assert_eq!(bench.controller.fault(), Some(fault));
    }
    let mut bench = Bench::new(fast_robot(), 25.0);
    bench.world.supply_v.set(Some(9.0));
    bench.run_to(State::Fault, 2.3);
    assert_eq!(bench.controller.fault(), Some(Fault::SupplyLow));
}

#[test]
fn a_lost_index_mark_is_a_fault_while_homing() {
    let mut bench = Bench::in_state(State::Homing);
    bench.motors.index_dead = true;
    let before = bench.motors.moved.head;
    assert_fault(&mut bench, Fault::IndexNotFound, 16.0);
    assert!(bench.motors.moved.head - before <= 300, "a turn and a half");
    assert_eq!(bench.motors.moved.feed, 0);
    bench.motors.index_dead = false;
    assert_usable(&mut bench);
}

#[test]
fn homing_finds_the_same_zero_from_any_position() {
    for head in (0..200).step_by(7).chain(178..186) {
        let mut bench = Bench::greeted(fast_robot(), WARM);
        bench.motors = super::tip::Motors::new(bench.motors.pins.clone(), &bench.robot, head);
        bench.grow(&bends(1));
        bench.run_to(State::Growing, 60.0);
        assert_eq!(bench.motors.moved.head % 200, 0, "from {head}");
    }
}

#[test]
fn a_pin_error_is_a_fault() {
    for (pin, states) in
        [(HEATER_ENABLE, &HEATED[..]), (HEAD, &[State::Homing, State::Growing]), (FEED, &[State::Growing])]
    {
        for state in states {
            let mut bench = Bench::in_state(*state);
            bench.heater.pins.fail(pin);
            bench.run_until(1.0, |bench| bench.controller.state() == State::Fault);
            assert_eq!(bench.controller.fault(), Some(Fault::Hardware), "pin {pin} in {state:?}");
        }
    }
}

#[test]
fn the_first_fault_is_kept() {
    let mut bench = Bench::in_state(State::Growing);
    bench.world.draught.set(3.0);
    bench.run_to(State::Fault, 60.0);
    let first = bench.controller.fault();
    assert_eq!(first, Some(Fault::TemperatureDrop));
    for wire in [Wire::Open, Wire::Shorted, Wire::Silent] {
        bench.world.wire.set(wire);
        bench.run(2.0);
        assert_eq!(bench.controller.fault(), first);
    }
    bench.press_emergency_stop(true);
    bench.run(1.0);
    bench.press_emergency_stop(false);
    bench.world.wire.set(Wire::Whole);
    bench.world.draught.set(1.0);
    bench.world.nozzle_c.set(300.0);
    bench.run(2.0);
    assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Fault, first));
    // After the fault is cleared, the remaining cause raises it again.
    bench.accepted(&clear());
    bench.run(0.2);
    assert_eq!(bench.controller.fault(), Some(Fault::OverTemperature));
}

#[test]
fn emergency_stop_is_immediate_and_clears_only_after_release() {
    for state in State::ALL.into_iter().filter(|state| !matches!(state, State::Fault | State::EmergencyStop)) {
        let mut bench = Bench::in_state(state);
        bench.press_emergency_stop(true);
        bench.run(0.02);
        assert_eq!(bench.controller.state(), State::EmergencyStop, "{state:?}");
        assert!(bench.heater.off() && !bench.motors.enabled());
        let moved = bench.motors.moved;
        assert_eq!(bench.refused(&clear()), Refusal::EmergencyStop);
        bench.run(5.0);
        assert_eq!(bench.motors.moved, moved);
        bench.press_emergency_stop(false);
        bench.run(0.1);
        assert_eq!(bench.controller.state(), State::EmergencyStop, "it is latched");
        let Message::LatestFault(LatestFault { record: Some(record) }) = bench.ask(&Message::GetLatestFault(Empty {}))
        else {
            panic!()
        };
        assert_eq!((record.fault, record.cleared, record.state), (None, false, state));
        assert_usable(&mut bench);
    }
}

#[test]
fn button_switches_the_heater_off_while_the_main_loop_hangs() {
    for state in HEATED {
        let mut bench = Bench::in_state(state);
        bench.run_until(60.0, |bench| bench.heater.share() > 0.0);
        bench.main_loop_runs = false;
        bench.run(0.1);
        assert!(bench.heater.share() > 0.0, "{state:?}: nothing else switches it off");
        bench.press_emergency_stop(true);
        // This is one tick of the step interrupt.
        bench.run(1.1 / f64::from(bench.robot.description().motion.tick_hz));
        assert!(bench.heater.off() && bench.fan.share() == 0.0 && !bench.motors.enabled(), "{state:?}");
        // Even a short press is latched.
        bench.press_emergency_stop(false);
        bench.run(0.2);
        assert!(bench.heater.off() && bench.fan.share() == 0.0 && !bench.motors.enabled(), "{state:?}");
        bench.main_loop_runs = true;
        bench.run(0.1);
        assert_eq!(bench.controller.state(), State::EmergencyStop, "{state:?}");
        assert!(bench.heater.off());
    }
}

#[test]
fn step_interrupt_alarm_switches_heater_off_while_the_main_loop_hangs() {
    let mut bench = Bench::in_state(State::Homing);
    bench.run_until(60.0, |bench| bench.heater.share() > 0.0);
    bench.motors.index_dead = true;
    bench.main_loop_runs = false;
    bench.run(20.0);
    assert!(bench.heater.off() && !bench.motors.enabled());
    // When the main loop runs again, it first misses the temperatures that it has not read.
    bench.main_loop_runs = true;
    bench.run(0.1);
    assert_eq!((bench.controller.state(), bench.heater.off()), (State::Fault, true));
}

#[test]
fn in_a_fault_progress_is_still_reported_and_jobs_are_refused() {
    let mut bench = Bench::in_state(State::Fault);
    let status = bench.status();
    assert_eq!((status.plan_id, status.layers_laid), (PLAN, bench.laid().len() as u32));
    let wrong = Refusal::WrongState { state: State::Fault };
    for plan_id in [PLAN, PLAN + 1] {
        let message = begin(&bench.robot.clone(), plan_id, 40);
        assert_eq!(bench.refused(&message), wrong);
    }
    assert_eq!(bench.refused(&batch_of(30, &bends(1))), wrong);
}
