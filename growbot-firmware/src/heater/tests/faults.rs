//! Every fault in every phase.

use std::collections::BTreeMap;
use std::string::{String, ToString};
use std::vec::Vec;

use growbot_core::link::message::Fault;

use super::plant::{Random, Rig, Spread, Wrong};

/// When it breaks.
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
}

const PHASES: [Phase; 8] = [
    Phase::Before,
    Phase::Heating,
    Phase::Settling,
    Phase::Growing,
    Phase::Holding,
    Phase::LettingDown,
    Phase::Standby,
    Phase::Returning,
];

/// Brings a nozzle somewhere into a phase.
fn bring(rig: &mut Rig, phase: Phase) {
    let (target, standby) = (rig.robot.heater.target_c, rig.robot.hold.standby_c);
    if phase == Phase::Before {
        rig.run(1.0).unwrap();
        return;
    }
    rig.on(target);
    if phase == Phase::Heating {
        let until = rig.random.between(30.0, 198.0);
        while rig.heater.temperature(rig.now).is_none_or(|celsius| celsius < until) {
            rig.step().unwrap();
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

/// Goes on from a phase until the fault shows: which, after how long, or none.
fn go_on(rig: &mut Rig, phase: Phase) -> Option<(Fault, f64)> {
    let begin = rig.now;
    if phase == Phase::Before {
        rig.on(rig.robot.heater.target_c);
    }
    let mut fault = None;
    while fault.is_none() && rig.now - begin < 400_000_000 {
        fault = if phase == Phase::Growing { rig.layer(|_| {}).err() } else { rig.step().err() };
    }
    let after = (rig.now - begin) as f64 * 1e-6;
    rig.heater.switch_off();
    for _ in 0..100 {
        let _ = rig.step();
    }
    fault.map(|fault| (fault, after))
}

#[test]
fn scan() {
    type Draw = fn(&mut Random) -> Wrong;
    let wrongs: [(&str, Draw); 10] = [
        ("stuck", |_| Wrong::Stuck),
        ("open", |_| Wrong::Open),
        ("short", |_| Wrong::Short),
        ("silent", |_| Wrong::Silent),
        ("frozen", |_| Wrong::Frozen),
        ("detached", |random| Wrong::Detached(random.between(2.0, 20.0), random.between(0.1, 0.4))),
        ("heater open", |_| Wrong::HeaterOpen),
        ("stuck on", |_| Wrong::StuckOn(1.0)),
        ("stuck partly", |random| Wrong::StuckOn(random.between(0.3, 1.0))),
        ("draught", |_| Wrong::Draught(4.0)),
    ];
    for measured in [true] {
    for (name, draw) in wrongs {
        for phase in PHASES {
            let (mut codes, mut times, mut peak) = (BTreeMap::<String, u32>::new(), Vec::new(), 0.0_f64);
            let mut worst = None;
            for seed in 0..if measured { 100 } else { 30 } {
                let mut random = Random::new(seed);
                let mut spread = Spread::of(&mut random, 0.1);
                spread.measured = measured;
                if phase == Phase::Before { spread.noise = 1.0; }
                let mut rig = Rig::new(spread, seed);
                let r = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| bring(&mut rig, phase)));
                if r.is_err() { std::println!("after bring target {phase:?} {:?} {spread:?}", rig.heater.temperature(rig.now)); continue; }
                let wrong = draw(&mut random);
                rig.breaks(wrong);
                let found = go_on(&mut rig, phase);
                *codes.entry(found.map_or("NONE", |(fault, _)| fault.code()).to_string()).or_default() += 1;
                times.push(found.map_or(999.0, |(_, after)| after));
                if rig.peak_c > peak { peak = rig.peak_c; worst = Some((found, wrong, spread)); }
            }
            times.sort_by(f64::total_cmp);
            let bad = if peak > 245.0 { std::format!("BAD {worst:?}") } else { String::new() };
            std::println!("{} {name:12} {phase:12?} median {:5.1} worst {:5.1} peak {peak:5.1} {codes:?} {bad}", if measured {"M"} else {"U"}, times[times.len() / 2], times[times.len() - 1]);
        }
    }
    }
}
