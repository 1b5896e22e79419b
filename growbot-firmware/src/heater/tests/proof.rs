//! The proof test of both switches: its stages, and each of its limits just within it and just beyond. Robot A.

use std::vec::Vec;

use growbot_core::link::message::Fault;

use super::plant::{Random, Rig, Spread, Wrong};
use crate::heater::model::Nozzle;
use crate::heater::proof_test::{ProofTest, Rest};
use crate::heater::{Demand, Output};
use crate::testing::robot_a;

const DT: f32 = 0.1;
const TIMEOUT_S: f32 = 300.0;

/// What the switches do and since when, s, up to the end; and the fault, if any.
fn prove(reading_c: impl Fn(f32) -> f32) -> (Vec<(f32, Output)>, f32, Option<Fault>) {
    let robot = robot_a();
    let demand = Demand { supply_v: Some(12.0), ..Demand::default() };
    let nozzle = Nozzle::new(&demand, robot.description());
    let (mut proof, mut rest) = (ProofTest::default(), Rest::default());
    let mut outputs: Vec<(f32, Output)> = Vec::new();
    for look in 1..10_000 {
        let time = look as f32 * DT;
        match proof.look(&mut rest, reading_c(time), DT, TIMEOUT_S, &nozzle) {
            Ok(Some(output)) if outputs.last().is_none_or(|(_, before)| *before != output) => {
                outputs.push((time, output));
            }
            Ok(Some(_)) => {}
            Ok(None) => return (outputs, time, None),
            Err(fault) => return (outputs, time, Some(fault)),
        }
    }
    panic!("the proof test does not end");
}

fn fault(reading_c: impl Fn(f32) -> f32) -> Option<Fault> {
    prove(reading_c).2
}

#[test]
fn each_switch_is_closed_alone_for_seven_seconds() {
    let (outputs, end, fault) = prove(|_| 25.0);
    let second_switch = Output { duty: 0.0, closed: true };
    let power_stage = Output { duty: 1.0, closed: false };
    let expected = [(0.1, Output::OFF), (7.0, second_switch), (14.0, power_stage)];
    assert_eq!(outputs.len(), expected.len(), "{outputs:?}");
    for ((at, output), (when, what)) in outputs.iter().zip(expected) {
        assert!(*output == what && (at - when).abs() < 0.05, "{outputs:?}");
    }
    assert!((end - 21.0).abs() < 0.05 && fault.is_none(), "{end} {fault:?}");
}

#[test]
fn a_rise_above_the_course_names_the_switch_that_conducts() {
    let step = |at: f32, rise: f32| fault(move |t| if t < at { 25.0 } else { 25.0 + rise });
    assert_eq!((step(8.05, 3.4), step(8.05, 3.6)), (None, Some(Fault::HeaterStuckOn)));
    // A rise that goes on, as heat does.
    let ramp = |at: f32, rate: f32| fault(move |t| 25.0 + rate * (t - at).clamp(0.0, 6.5));
    // The last mean is that of 6 to 7 s: 0.525 C/s come to 3.4 C.
    assert_eq!((ramp(7.0, 0.525), ramp(7.0, 0.56)), (None, Some(Fault::HeaterStuckOn)));
    assert_eq!(ramp(14.0, 0.56), Some(Fault::HeaterSwitchWelded));
    let late = |rate: f32| fault(move |t| 25.0 + rate * (t - 14.0).max(0.0));
    assert_eq!((late(0.525), late(0.56)), (None, Some(Fault::HeaterSwitchWelded)));
}

#[test]
fn a_nozzle_that_is_hot_is_let_cool_below_the_limit_less_what_a_switch_may_heat() {
    let falls = |from: f32| prove(move |t| from - 0.5 * t);
    let begins = |from: f32| falls(from).0.get(1).map(|(at, _)| *at);
    assert!(begins(206.0).is_some_and(|at| (at - 7.0).abs() < 0.05));
    // 205 degrees is reached after 20 s.
    assert!(begins(215.0).is_some_and(|at| (20.0..22.5).contains(&at)));
    assert_eq!(falls(215.0).2, None);
    let (_, end, fault) = prove(|t| 206.0 + if t % 0.2 < 0.1 { 0.0 } else { 0.01 });
    assert!(fault == Some(Fault::HeaterStuckOn) && (end - TIMEOUT_S).abs() < 1.2, "{end} {fault:?}");
}

#[test]
fn a_nozzle_that_goes_on_rising_with_both_open_is_heated() {
    assert_eq!(fault(|t| 25.0 + 0.29 * t.min(7.5)), None);
    let (outputs, end, fault) = prove(|t| 25.0 + 0.32 * t);
    assert_eq!((outputs.len(), fault), (1, Some(Fault::HeaterStuckOn)));
    assert!((30.0..32.0).contains(&end), "{end}");
    // One that was heated a moment ago rises on for a while, and is waited for.
    let (outputs, _, fault) = prove(|t| 180.0 - 12.0 * libm::expf(-t / 4.0));
    assert!(fault.is_none() && outputs[1].0 > 8.0, "{outputs:?} {fault:?}");
}

#[test]
fn the_course_must_be_straight_and_no_draughts() {
    let begins = |reading_c: fn(f32) -> f32| prove(reading_c).0.get(1).map_or(f32::INFINITY, |(at, _)| *at);
    let early = |at: f32| (at - 7.0).abs() < 0.05;
    // The fourth of seven means lies off the line of the others.
    assert!(early(begins(|t| if (3.05..4.05).contains(&t) { 25.38 } else { 25.0 })));
    assert!(!early(begins(|t| if (3.05..4.05).contains(&t) { 25.42 } else { 25.0 })));
    // 1.6 times what no power does, and 0.3 C/s: 2.8 C/s about 180 degrees.
    assert!(early(begins(|t| 200.0 - 2.7 * t)));
    assert!(!early(begins(|t| 200.0 - 2.95 * t)));
}

#[test]
fn a_reading_that_stands_where_it_should_fall_is_frozen() {
    assert_eq!(fault(|t| 190.0 - 1.5 * t.min(7.0)), Some(Fault::ThermistorFrozen));
    // A fall that levels off as a cooling nozzle's does is none.
    assert_eq!(fault(|t| 25.0 + 165.0 * libm::expf(-t / 100.0)), None);
}

/// Switches on from anything that a nozzle may have done before, after any pause.
fn again(seed: u64, wrong: Wrong) -> (Rig, Option<Fault>, f64) {
    let mut random = Random::new(seed);
    let mut rig = Rig::new(Spread::of(&mut random, 0.1), seed);
    rig.on(rig.robot.heater.target_c);
    rig.prove().unwrap();
    let heated = rig.random.between(0.0, 90.0);
    rig.run(heated).unwrap();
    rig.off();
    let paused = rig.random.between(0.0, 30.0);
    rig.run(paused).unwrap();
    rig.wrong = wrong;
    let begin = rig.now;
    rig.on(rig.robot.heater.target_c);
    let fault = rig.prove().err();
    let seconds = (rig.now - begin) as f64 * 1e-6;
    (rig, fault, seconds)
}

#[test]
fn the_duty_is_that_of_the_power_stage_from_the_first_stage_to_a_fault() {
    for (wrong, duty, fault) in [
        (Wrong::StuckOn(1.0), 0.0, Some(Fault::HeaterStuckOn)),
        (Wrong::Welded, 1.0, Some(Fault::HeaterSwitchWelded)),
        (Wrong::Nothing, 1.0, None),
    ] {
        let mut rig = Rig::new(Spread::of(&mut Random::new(1), 0.0), 1);
        rig.wrong = wrong;
        rig.on(rig.robot.heater.target_c);
        let mut greatest = 0.0_f64;
        let ended = loop {
            if let Err(fault) = rig.step() {
                break Some(fault);
            }
            if rig.heater.proof.is_none() {
                break None;
            }
            assert_eq!(rig.heater.duty().to_bits(), rig.output.duty.to_bits());
            greatest = greatest.max(rig.heater.duty());
        };
        assert_eq!((ended, greatest), (fault, duty), "{wrong:?}");
        if fault.is_some() {
            assert_eq!(rig.heater.duty(), duty, "what it was when the fault came");
        }
    }
}

#[test]
fn both_switches_are_proven_whenever_it_is_switched_on() {
    let mut longest = [0.0_f64; 3];
    for seed in 0..300 {
        let cases = [
            (Wrong::Nothing, None),
            (Wrong::StuckOn(1.0), Some(Fault::HeaterStuckOn)),
            (Wrong::Welded, Some(Fault::HeaterSwitchWelded)),
        ];
        for ((wrong, right), longest) in cases.into_iter().zip(&mut longest) {
            let (mut rig, fault, seconds) = again(seed, wrong);
            rig.off();
            rig.run(30.0).unwrap();
            assert_eq!(fault, right, "{wrong:?}, seed {seed} after {seconds} s: {:?}", rig.spread);
            assert!(rig.peak_c < rig.robot.heater.max_c, "{wrong:?}, seed {seed}: {}", rig.peak_c);
            *longest = longest.max(seconds);
        }
    }
    std::println!(
        "longest: sound {:.1} s, power stage {:.1} s, second switch {:.1} s",
        longest[0],
        longest[1],
        longest[2]
    );
    assert!(longest[0] < 40.0, "{longest:?}");
}
