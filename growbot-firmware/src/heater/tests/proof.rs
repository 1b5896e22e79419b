//! Tests of the proof test of the heater's two switches on simulated nozzles.

use growbot_core::link::message::Fault;

use super::plant::{Random, Rig, Spread, Wrong};

/// Heats a nozzle for a random time, pauses for a random time, and runs the proof test again, with this defect. Returns
/// the nozzle, the fault that the test finds, and the duration of the test, s.
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
fn duty_is_reported_from_the_first_proof_stage_until_a_fault() {
    for (wrong, duty, fault) in [
        (Wrong::StuckOn(1.0), 0.0, Some(Fault::HeaterStuckOn)),
        (Wrong::Welded, 1.0, Some(Fault::HeaterSwitchWelded)),
        (Wrong::Nothing, 1.0, None),
    ] {
        let mut rig = Rig::new(Spread::of(&mut Random::new(1), 0.0), 1);
        rig.wrong = wrong;
        rig.on(rig.robot.heater.target_c);
        let mut max_duty = 0.0_f64;
        let ended = loop {
            if let Err(fault) = rig.step() {
                break Some(fault);
            }
            if rig.heater.proof.is_none() {
                break None;
            }
            assert_eq!(rig.heater.duty().to_bits(), rig.output.duty.to_bits());
            max_duty = max_duty.max(rig.heater.duty());
        };
        assert_eq!((ended, max_duty), (fault, duty), "{wrong:?}");
        if fault.is_some() {
            assert_eq!(rig.heater.duty(), duty, "what it was when the fault came");
        }
    }
}

#[test]
fn both_switches_are_proven_at_each_switch_on() {
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
