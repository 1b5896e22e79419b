//! Every fault by its real cause, in every state in which it can occur. A `StepRate` does not occur, since no layer that asks
//! for it passes its check.

use growbot_core::link::message::{Fault, Message, Refusal, State, StateChanged};

use super::bench::{Bench, PLAN, STATES, WARM, batch_of, begin, bends, clear, start};
use super::tip::{FEED, HEAD, HEATER_ENABLE, Wire};
use crate::testing::fast_robot;

/// States in which the heater is on.
const HEATED: [State; 4] = [State::Heating, State::Homing, State::Growing, State::Hold];
/// Those in which the nozzle must be hot.
const HOT: [State; 3] = [State::Homing, State::Growing, State::Hold];

/// What shows where the nozzle cools although it is heated.
const COOLED: [Fault; 4] =
    [Fault::UnderTemperature, Fault::TemperatureDrop, Fault::ThermistorDetached, Fault::HeatingTooSlow];

/// Breaks something and waits for this fault; then nothing is warm or moves.
fn assert_fault(bench: &mut Bench, fault: Fault, within: f64) {
    assert_fault_of(bench, &[fault], within);
}

/// The same where what shows first depends on the moment.
fn assert_fault_of(bench: &mut Bench, faults: &[Fault], within: f64) {
    bench.run_to(State::Fault, within);
    let fault = bench.controller.fault().expect("a fault is latched");
    assert!(faults.contains(&fault), "{fault:?}, not one of {faults:?}");
    assert!(bench.heater.off());
    bench.run(0.1);
    assert!(!bench.motors.enabled());
    let told = Message::StateChanged(StateChanged { state: State::Fault, fault: Some(fault) });
    assert_eq!(bench.events.last(), Some(&told));
    assert_eq!(bench.refused(&start()), Refusal::WrongState { state: State::Fault });
    let moved = bench.motors.moved;
    bench.run(10.0);
    assert_eq!((bench.motors.moved, bench.controller.fault()), (moved, Some(fault)));
}

/// Clears a fault whose cause is gone, and grows.
fn assert_usable(bench: &mut Bench) {
    bench.accepted(&clear());
    assert_eq!((bench.controller.state(), bench.controller.fault()), (State::Idle, None));
    assert_eq!(bench.refused(&start()), Refusal::OtherPlan { board: 0 });
    bench.world.nozzle_c.set(WARM);
    bench.run(0.2);
    bench.grow(&bends(3));
    bench.run_to(State::Done, 120.0);
}

const WIRES: [(Wire, Fault, f64); 3] = [
    (Wire::Cut, Fault::ThermistorOpen, 0.22),
    (Wire::Shorted, Fault::ThermistorShort, 0.22),
    (Wire::Silent, Fault::ThermistorSilent, 0.62),
];

#[test]
fn a_broken_thermistor_is_a_fault_wherever_the_heater_is_on() {
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
fn a_broken_thermistor_matters_with_the_heater_off_only_once_it_is_to_go_on() {
    for (wire, fault, within) in WIRES {
        for state in [State::Idle, State::Done, State::Stopped] {
            let mut bench = Bench::in_state(state);
            bench.world.wire.set(wire);
            bench.run(2.0);
            assert_eq!(bench.controller.state(), state);
            assert_eq!(bench.status().temperature_centi_c, None);
            bench.grow(&bends(2));
            if state == State::Done {
                continue; // The same plan has been grown: nothing to do.
            }
            assert_fault(&mut bench, fault, within);
        }
    }
}

#[test]
fn too_hot_is_a_fault_in_every_state() {
    for state in STATES.into_iter().filter(|state| *state != State::Fault) {
        let mut bench = Bench::in_state(state);
        // A short in the heater's switches: it heats whatever it is told.
        bench.world.nozzle_c.set(320.0);
        let fault = Fault::OverTemperature;
        // In the midst of a period, the mean on its way there may show first.
        assert_fault_of(&mut bench, &[fault, Fault::HeaterStuckOn], 0.22);
        if bench.controller.fault() != Some(fault) {
            continue;
        }
        assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
        // Nor is it known to be gone without a reading.
        bench.world.wire.set(Wire::Cut);
        bench.world.nozzle_c.set(100.0);
        bench.run(0.2);
        assert_eq!(bench.refused(&clear()), Refusal::FaultRemains { fault });
        bench.world.wire.set(Wire::Whole);
        bench.run(0.2);
        assert_usable(&mut bench);
    }
}

#[test]
fn a_nozzle_that_cools_is_a_fault_wherever_it_must_be_hot() {
    for state in HOT {
        let mut bench = Bench::in_state(state);
        bench.world.draught.set(5.0);
        assert_fault_of(&mut bench, &COOLED, 20.0);
        bench.world.draught.set(1.0);
        assert_usable(&mut bench);
    }
}

#[test]
fn a_nozzle_that_does_not_get_hot_is_a_fault() {
    // Too much wind to reach the target, though the heater works.
    let mut bench = Bench::in_state(State::Heating);
    bench.world.draught.set(3.0);
    assert_fault(&mut bench, Fault::HeatingTooSlow, 301.0);
    bench.world.draught.set(1.0);
    assert_usable(&mut bench);

    // So is one whose thermistor fell off.
    let mut bench = Bench::in_state(State::Heating);
    bench.world.wire.set(Wire::Detached);
    assert_fault_of(&mut bench, &[Fault::ThermistorDetached, Fault::HeatingTooSlow, Fault::ThermistorFrozen], 20.0);
}

#[test]
fn passing_through_the_band_is_not_yet_hot() {
    let mut bench = Bench::in_state(State::Heating);
    // It passes its target, as one does that is heated by something else.
    bench.world.nozzle_c.set(201.0);
    bench.run(1.5);
    assert_eq!(bench.controller.state(), State::Heating);
    assert_eq!(bench.motors.moved.pulses, 0);
    bench.world.nozzle_c.set(150.0);
    bench.run_to(State::Fault, 2.0);
    assert_eq!(bench.controller.fault(), Some(Fault::ThermistorDetached));
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
fn homing_finds_the_same_zero_from_everywhere() {
    for head in (0..200).step_by(7).chain(178..186) {
        let mut bench = Bench::greeted(fast_robot(), WARM);
        bench.motors = super::tip::Motors::new(bench.motors.pins.clone(), &bench.robot, head);
        bench.grow(&bends(1));
        bench.run_to(State::Growing, 60.0);
        assert_eq!(bench.motors.moved.head % 200, 0, "from {head}");
    }
}

#[test]
fn a_pin_that_refuses_is_a_fault() {
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
fn the_first_fault_wins_and_stays() {
    let mut bench = Bench::in_state(State::Growing);
    bench.world.draught.set(20.0);
    bench.run_to(State::Fault, 20.0);
    let first = bench.controller.fault();
    assert!(first.is_some_and(|fault| COOLED.contains(&fault)), "{first:?}");
    for wire in [Wire::Cut, Wire::Shorted, Wire::Silent] {
        bench.world.wire.set(wire);
        bench.run(2.0);
        assert_eq!(bench.controller.fault(), first);
    }
    bench.world.wire.set(Wire::Whole);
    bench.world.draught.set(1.0);
    bench.world.nozzle_c.set(300.0);
    bench.run(2.0);
    assert_eq!(bench.controller.fault(), first);
    // Clearing it brings out what is still wrong.
    bench.accepted(&clear());
    bench.run(0.2);
    assert_eq!(bench.controller.fault(), Some(Fault::OverTemperature));
}

#[test]
fn a_fault_keeps_what_was_laid_in_sight_and_takes_no_job() {
    let mut bench = Bench::in_state(State::Fault);
    let status = bench.status();
    assert_eq!((status.plan_id, status.laid), (PLAN, bench.laid().len() as u32));
    let wrong = Refusal::WrongState { state: State::Fault };
    for plan_id in [PLAN, PLAN + 1] {
        let message = begin(&bench.robot.clone(), plan_id, 40);
        assert_eq!(bench.refused(&message), wrong);
    }
    assert_eq!(bench.refused(&batch_of(30, &bends(1))), wrong);
}
