//! Test of all short sequences of inputs from every state: requests, faults and their ends, resets.
//!
//! The bench checks its conditions at every tick, and [`check`] checks further ones after each input. If several
//! sequences lead to the same situation, only one of them is continued.

use std::collections::HashSet;
use std::format;
use std::string::String;
use std::vec::Vec;

use growbot_core::link::message::{Cancel, MaintenanceTask, Message, PlanRequest, PoseFields, ResetCause, State};
use growbot_core::plan::Planner;

use super::bench::Bench;
use super::requests::{
    PLAN, amend, batch_of, begin, bends, clear, feed, hello, maintain, pause, preheat, resume, start, stop, tune,
};
use super::tip::{DRIVER_FAULT, FILAMENT_PRESENCE, Wire};
use crate::safety::transitions::may_heat;
use crate::testing::number_from_environment;
use growbot_core::link::message::SCHEMA_HASH;

type Input = fn(Bench) -> Bench;

/// Sends a request and ignores the response.
fn send(mut bench: Bench, request: impl FnOnce(&mut Bench) -> Message) -> Bench {
    let request = request(&mut bench);
    bench.ask(&request);
    bench
}

fn with(bench: Bench, change: impl FnOnce(&Bench)) -> Bench {
    change(&bench);
    bench
}

fn after(mut bench: Bench, seconds: f64) -> Bench {
    bench.run(seconds);
    bench
}

fn pose(z: f64) -> PoseFields {
    PoseFields { position: [0.0, 0.0, z], heading: 0.0, pitch: core::f64::consts::FRAC_PI_2 }
}

const INPUTS: [(&str, Input); 37] = [
    ("begin", |bench| send(bench, |bench| begin(&bench.robot.clone(), PLAN, 40))),
    ("plan", |bench| {
        let plan = PlanRequest { start: pose(0.0), goal: pose(20.0), radius: 100.0, planner: Planner::TwoPlane };
        send(bench, |_| Message::Plan(plan))
    }),
    ("resume", |bench| send(bench, |bench| resume(bench.status().layers_laid))),
    ("resume after the interrupted layer", |bench| send(bench, |bench| resume(bench.status().layers_laid + 1))),
    ("layers", |bench| send(bench, |bench| batch_of(bench.status().next_layer as usize, &bends(4)))),
    ("amend", |bench| send(bench, |bench| amend(bench.status().next_layer, 50))),
    ("start", |bench| send(bench, |_| start())),
    ("pause", |bench| send(bench, |_| pause())),
    ("tune", |bench| send(bench, |_| tune(200.0))),
    ("preheat", |bench| send(bench, |_| preheat(200.0))),
    ("cool down", |bench| send(bench, |_| maintain(MaintenanceTask::CoolDown))),
    ("home", |bench| send(bench, |_| maintain(MaintenanceTask::Home))),
    ("rotate", |bench| send(bench, |_| maintain(MaintenanceTask::Rotate { centi_deg: 9000 }))),
    ("feed", |bench| send(bench, |_| feed(2.0))),
    ("feed back", |bench| send(bench, |_| feed(-2.0))),
    ("dry run", |bench| send(bench, |_| maintain(MaintenanceTask::DryRun))),
    ("stop", |bench| send(bench, |_| stop())),
    ("cancel", |bench| send(bench, |bench| Message::Cancel(Cancel { plan_id: bench.status().plan_id }))),
    ("clear", |bench| send(bench, |_| clear())),
    ("hello", |bench| send(bench, |_| hello(SCHEMA_HASH))),
    ("emergency stop over the link", |bench| with(bench, Bench::call_emergency_stop)),
    ("emergency stop pressed", |bench| with(bench, |bench| bench.press_emergency_stop(true))),
    ("emergency stop released", |bench| with(bench, |bench| bench.press_emergency_stop(false))),
    ("thermistor open", |bench| with(bench, |bench| bench.world.wire.set(Wire::Open))),
    ("thermistor silent", |bench| with(bench, |bench| bench.world.wire.set(Wire::Silent))),
    ("thermistor whole", |bench| with(bench, |bench| bench.world.wire.set(Wire::Whole))),
    ("supply low", |bench| with(bench, |bench| bench.world.supply_v.set(Some(9.0)))),
    ("supply whole", |bench| with(bench, |bench| bench.world.supply_v.set(Some(12.0)))),
    ("no filament", |bench| with(bench, |bench| bench.heater.pins.set(FILAMENT_PRESENCE, false))),
    ("filament", |bench| with(bench, |bench| bench.heater.pins.set(FILAMENT_PRESENCE, true))),
    ("driver fault", |bench| with(bench, |bench| bench.heater.pins.set(DRIVER_FAULT, true))),
    ("driver whole", |bench| with(bench, |bench| bench.heater.pins.set(DRIVER_FAULT, false))),
    ("index dead", |mut bench| {
        bench.motors.index_dead = true;
        bench
    }),
    ("a second", |bench| after(bench, 1.0)),
    ("twenty seconds", |bench| after(bench, 20.0)),
    ("watchdog", |bench| bench.reset(ResetCause::Watchdog)),
    ("power cycle", |bench| {
        bench.world.retained.set([0x5A; crate::safety::retained::RETAINED_BYTES]);
        bench.reset(ResetCause::PowerOn)
    }),
];

/// Describes everything about the board and its tip that decides their further behaviour, except temperatures and
/// times.
fn situation(bench: &mut Bench) -> String {
    let status = bench.status();
    format!(
        "{:?} {:?} {} {} {:?} {:?} {:?} {:?} {:?} {:?} {} {:?} {}",
        status.state,
        status.fault,
        status.plan_id,
        status.layers_laid == 0,
        status.interrupted.is_some(),
        status.pause_cause,
        status.target_centi_c,
        bench.world.wire.get(),
        bench.world.supply_v.get(),
        bench.heater.pins.level(FILAMENT_PRESENCE),
        bench.heater.pins.level(DRIVER_FAULT),
        bench.heater.pins.level(super::tip::EMERGENCY_STOP),
        bench.motors.index_dead,
    )
}

/// Asserts the conditions that must hold some time after an input. `before` is the board's state before the input, and
/// `what` lists all inputs for the message of a failure.
fn check(bench: &mut Bench, input: &str, before: State, what: &[&str]) {
    let status = bench.status();
    let state = status.state;
    let works = may_heat(state);
    let pins = &bench.heater.pins;
    // A dry run has no heat, and so needs no thermistor.
    let heats = status.target_centi_c.is_some();
    assert!(!heats || bench.world.wire.get() == Wire::Whole, "{state:?} without a thermistor: {what:?}");
    assert!(!works || bench.world.supply_v.get() == Some(12.0), "{state:?} with a low supply: {what:?}");
    assert!(!works || !pins.level(DRIVER_FAULT), "{state:?} with a driver's fault: {what:?}");
    let pressed = pins.level(super::tip::EMERGENCY_STOP);
    assert!(!pressed || matches!(state, State::EmergencyStop | State::Fault), "{state:?} while pressed: {what:?}");
    let is_latched = matches!(before, State::EmergencyStop | State::Fault);
    let may_leave = matches!(input, "clear" | "watchdog" | "power cycle");
    assert!(!is_latched || may_leave || state == before, "{before:?} was left for {state:?}: {what:?}");
    assert!(status.layers_laid <= status.layer_count, "{status:?}: {what:?}");
    let is_left = status.layers_laid < status.layer_count;
    assert!(status.interrupted.is_none() || is_left, "{status:?}: {what:?}");
    assert!(!status.interrupted.is_some_and(|layer| layer.min > layer.max || layer.max > 64), "{status:?}: {what:?}");
    if !works {
        assert!(bench.heater.off() && !bench.motors.enabled(), "{state:?} is not at rest: {what:?}");
    }
    let starts = matches!(input, "start" | "tune" | "preheat" | "dry run");
    let was_at_rest = !may_heat(before);
    assert!(
        !(was_at_rest && works) || starts || input == "resume",
        "{input} leads from {before:?} to {state:?}: {what:?}"
    );
}

/// Brings a board into a state, runs a sequence of inputs and checks the conditions after each of them.
fn run(state: State, inputs: &[usize]) -> Bench {
    let mut bench = Bench::in_state(state);
    let mut what = std::vec![state.name()];
    for input in inputs {
        let (name, act) = INPUTS[*input];
        what.push(name);
        let before = bench.status().state;
        bench = act(bench);
        // The self-test ends within this time, and every input counts.
        bench.run(1.3);
        check(&mut bench, name, before, &what);
    }
    bench
}

/// Runs all sequences of up to `length` inputs from a state. Returns the number of runs.
fn search(state: State, length: usize) -> u64 {
    let mut seen = HashSet::new();
    let mut runs = 0;
    let mut last: Vec<Vec<usize>> = std::vec![Vec::new()];
    for _ in 0..length {
        let mut next = Vec::new();
        for before in &last {
            for input in 0..INPUTS.len() {
                let inputs = [&before[..], &[input]].concat();
                let mut bench = run(state, &inputs);
                runs += 1;
                if seen.insert(situation(&mut bench)) {
                    next.push(inputs);
                }
            }
        }
        last = next;
    }
    runs
}

#[test]
fn no_sequence_of_inputs_breaks_a_condition() {
    let length = number_from_environment("GROWBOT_SEQUENCES", 2) as usize;
    let mut runs = 0;
    for state in State::ALL {
        let of_state = search(state, length);
        runs += of_state;
        std::println!("{}: {of_state} runs", state.name());
    }
    std::println!("{runs} sequences of up to {length} inputs");
    assert!(runs >= 13 * 37, "{runs}");
}
