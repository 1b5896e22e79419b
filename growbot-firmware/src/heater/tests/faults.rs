//! Tests that every fault of the heater is detected in every phase of its operation.

use std::collections::BTreeMap;
use std::vec::Vec;

use growbot_core::link::message::Fault;

use super::plant::{Random, Rig, Spread, Wrong};
use crate::testing::number_from_environment;

/// Phase of the heater's operation in which a defect appears.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Before,
    Heating,
    Settling,
    Growing,
    Holding,
    LettingDown,
    Standby,
    Returning,
    /// The heater was off after a growth, and is switched on again while the nozzle is still hot.
    Again,
}

const PHASES: [Phase; 9] = [
    Phase::Before,
    Phase::Heating,
    Phase::Settling,
    Phase::Growing,
    Phase::Holding,
    Phase::LettingDown,
    Phase::Standby,
    Phase::Returning,
    Phase::Again,
];

/// Brings a nozzle to a random moment of a phase.
fn bring(rig: &mut Rig, phase: Phase) {
    let (target, standby) = (rig.robot.heater.target_c, rig.robot.pause.standby_c);
    if phase == Phase::Before {
        rig.run(1.0).unwrap();
        return;
    }
    rig.on(target);
    rig.prove().unwrap();
    if phase == Phase::Heating {
        let until = rig.random.between(30.0, 198.0);
        let begin = rig.now;
        while rig.heater.temperature(rig.now).is_none_or(|celsius| celsius < until) {
            rig.step().unwrap();
            assert!(rig.now - begin < 1_000_000_000, "not at {until} C");
        }
        return;
    }
    rig.heat().unwrap();
    if phase == Phase::Settling {
        let time = rig.random.between(0.0, 20.0);
        return rig.run(time).unwrap();
    }
    for _ in 0..rig.random.of(&[0, 2, 4]) {
        rig.layer(|_| {}).unwrap();
    }
    let some = rig.random.between(0.0, 60.0);
    if phase == Phase::Again {
        rig.off();
        (rig.flow, rig.fan) = (0.0, 0.0);
        return rig.run(0.5 * some).unwrap();
    }
    match phase {
        Phase::Growing | Phase::Holding => return rig.run(some).unwrap(),
        _ => rig.run(60.0).unwrap(),
    }
    rig.target(standby);
    match phase {
        Phase::LettingDown => return rig.run(some * 0.5).unwrap(),
        _ => rig.run(60.0 + 3.0 * some).unwrap(),
    }
    if phase == Phase::Returning {
        rig.target(target);
        let time = rig.random.between(0.0, 15.0);
        rig.run(time).unwrap();
    }
}

/// Continues from a phase until a fault is found. Returns the fault and the time until it was found, s. The time counts
/// from the appearance of the defect, or from the end of the proof test if the test did not find the defect. `None` if
/// no fault is found.
fn run_to_fault(rig: &mut Rig, phase: Phase) -> Option<(Fault, f64)> {
    let mut fault = None;
    if matches!(phase, Phase::Before | Phase::Again) {
        rig.on(rig.robot.heater.target_c);
        let begin = rig.now;
        fault = rig.prove().err();
        if let Some(fault) = fault {
            return Some((fault, cool_down(rig, begin)));
        }
    }
    let begin = rig.now;
    while fault.is_none() && rig.now - begin < 200_000_000 {
        fault = if phase == Phase::Growing { rig.layer(|_| {}).err() } else { rig.step().err() };
    }
    let after = cool_down(rig, begin);
    fault.map(|fault| (fault, after))
}

/// Switches the heater off and waits until the nozzle has reached its highest temperature. Returns the time from
/// `begin` to the switching off, s.
fn cool_down(rig: &mut Rig, begin: u64) -> f64 {
    let after = (rig.now - begin) as f64 * 1e-6;
    rig.off();
    for _ in 0..100 {
        let _ = rig.step();
    }
    after
}

/// Function that draws the random details of a defect.
type Draw = fn(&mut Random) -> Wrong;

/// All defects: their names, and the functions that draw their details.
const WRONGS: [(&str, Draw); 11] = [
    ("open", |_| Wrong::Open),
    ("short", |_| Wrong::Short),
    ("silent", |_| Wrong::Silent),
    ("frozen", |_| Wrong::Frozen),
    ("stuck", |_| Wrong::Stuck),
    ("detached", |random| Wrong::Detached(random.between(2.0, 20.0), random.between(0.1, 0.4))),
    ("heater open", |_| Wrong::HeaterOpen),
    ("stuck on", |_| Wrong::StuckOn(1.0)),
    ("partly on", |random| Wrong::StuckOn(random.between(0.3, 0.99))),
    ("welded", |_| Wrong::Welded),
    ("draught", |_| Wrong::Draught(4.0)),
];

/// Returns the faults that are right for a defect in a phase, and the time within which one of them must be found, s.
/// If the heater gets full power while it heats up, a reading that stays too low is reported as heating too slow.
fn expected(wrong: Wrong, phase: Phase) -> (&'static [Fault], f64) {
    use Fault::{
        HeaterEnergy, HeaterStuckOn, HeaterSwitchWelded, HeatingTooSlow, TemperatureDrop, ThermistorDetached,
        ThermistorFrozen, ThermistorOpen, ThermistorShort, ThermistorSilent,
    };
    let switched_on = matches!(phase, Phase::Before | Phase::Again);
    let rising = switched_on || matches!(phase, Phase::Heating | Phase::Returning);
    // At the end, the way up is already within the target's band.
    let near = matches!(phase, Phase::Heating | Phase::Returning | Phase::Again);
    match wrong {
        Wrong::Nothing | Wrong::NoFlow => (&[], f64::INFINITY),
        Wrong::Open => (&[ThermistorOpen], 0.2),
        Wrong::Short => (&[ThermistorShort], 0.2),
        Wrong::Silent => (&[ThermistorSilent], 0.6),
        Wrong::Frozen if rising => (&[HeatingTooSlow, ThermistorFrozen], if near { 60.0 } else { 15.0 }),
        Wrong::Frozen => (&[ThermistorFrozen], 60.0),
        // A constant voltage with noise on it looks like a nozzle that does not cool.
        Wrong::Stuck if phase == Phase::Again => {
            (&[HeaterStuckOn, ThermistorFrozen, HeatingTooSlow, HeaterEnergy], 45.0)
        }
        Wrong::Stuck if rising => (&[HeatingTooSlow, ThermistorFrozen, HeaterEnergy], if near { 120.0 } else { 15.0 }),
        // Without power it looks like a nozzle that does not cool.
        Wrong::Stuck => (&[ThermistorFrozen, HeaterEnergy, HeaterStuckOn], 120.0),
        Wrong::Detached(..) if phase == Phase::Before => (&[HeatingTooSlow], 10.0),
        Wrong::Detached(..) if near => {
            (&[HeatingTooSlow, ThermistorDetached, ThermistorFrozen, TemperatureDrop, HeaterEnergy], 15.0)
        }
        Wrong::Detached(..) => (&[ThermistorDetached, TemperatureDrop, HeaterEnergy], 10.0),
        Wrong::HeaterOpen if phase == Phase::Before => (&[HeatingTooSlow], 20.0),
        Wrong::HeaterOpen if near => (&[HeatingTooSlow, TemperatureDrop, HeaterEnergy], 30.0),
        Wrong::HeaterOpen if phase == Phase::LettingDown => (&[TemperatureDrop], 75.0),
        Wrong::HeaterOpen => (&[TemperatureDrop, HeaterEnergy], 20.0),
        // The proof test finds both defects. It waits until a hot nozzle cools evenly.
        Wrong::StuckOn(duty) if duty >= 1.0 && switched_on => (&[HeaterStuckOn], 45.0),
        Wrong::Welded if switched_on => (&[HeaterSwitchWelded], 45.0),
        Wrong::Welded => (&[], f64::INFINITY),
        // The defect is hidden while full power is requested.
        Wrong::StuckOn(duty) if duty >= 1.0 => (&[HeaterStuckOn, ThermistorFrozen], if rising { 150.0 } else { 60.0 }),
        // The nozzle may need more than this duty. Then no fault is found, and nothing gets too hot.
        Wrong::StuckOn(_) => (&[HeaterStuckOn, ThermistorFrozen, HeaterEnergy], f64::INFINITY),
        Wrong::Draught(_) if phase == Phase::Before => (&[HeatingTooSlow], 60.0),
        Wrong::Draught(_) => (&[TemperatureDrop, ThermistorDetached, HeatingTooSlow, HeaterEnergy], 60.0),
    }
}

/// Tests every defect in every phase, on one random nozzle for each seed.
fn break_everything(seeds: core::ops::Range<u64>) {
    for (name, draw) in WRONGS {
        for phase in PHASES {
            let (mut codes, mut times, mut peak) = (BTreeMap::new(), Vec::new(), 0.0_f64);
            for seed in seeds.clone() {
                let mut random = Random::new(seed);
                let mut rig = Rig::new(Spread::of(&mut random, 0.1), seed);
                bring(&mut rig, phase);
                let wrong = draw(&mut random);
                rig.wrong = wrong;
                let found = run_to_fault(&mut rig, phase);
                let (right, within) = expected(wrong, phase);
                let what = std::format!("{wrong:?} in {phase:?}, seed {seed}: {found:?}, peak {}", rig.peak_c);
                match found {
                    Some((fault, after)) => {
                        assert!(right.contains(&fault) && after <= within, "{what}");
                        *codes.entry(fault.code()).or_insert(0) += 1;
                        times.push(after);
                    }
                    None => assert!(within.is_infinite(), "{what}"),
                }
                assert!(rig.peak_c < rig.robot.heater.max_c + 5.0, "{what}");
                peak = peak.max(rig.peak_c);
            }
            times.sort_by(f64::total_cmp);
            let (median, max) = (times.get(times.len() / 2), times.last());
            std::println!("{name:12} {phase:12?} {median:.1?} {max:.1?} s, to {peak:.1} C, {codes:?}");
        }
    }
}

/// Tests on GROWBOT_NOZZLES nozzles, from the number GROWBOT_FIRST_NOZZLE on, by default the first 6. 200 nozzles take
/// minutes.
#[test]
fn every_fault_is_detected_in_time_in_every_phase() {
    let first = number_from_environment("GROWBOT_FIRST_NOZZLE", 0);
    break_everything(first..first + number_from_environment("GROWBOT_NOZZLES", 6));
}

/// Checks that the models, which are in single precision, do not lose small additions to sums over hours.
#[test]
fn supervision_still_detects_faults_after_hours_at_the_target() {
    for (wrong, right, within) in [
        (Wrong::HeaterOpen, [Fault::TemperatureDrop, Fault::HeaterEnergy], 20.0),
        (Wrong::Detached(5.0, 0.2), [Fault::TemperatureDrop, Fault::ThermistorDetached], 10.0),
        (Wrong::StuckOn(1.0), [Fault::HeaterStuckOn, Fault::ThermistorFrozen], 60.0),
    ] {
        let mut rig = Rig::new(Spread::of(&mut Random::new(1), 0.1), 1);
        bring(&mut rig, Phase::Holding);
        rig.run(20.0 * 3600.0).unwrap();
        rig.wrong = wrong;
        let found = run_to_fault(&mut rig, Phase::Holding);
        assert!(found.is_some_and(|(fault, after)| right.contains(&fault) && after <= within), "{wrong:?}: {found:?}");
    }
}
