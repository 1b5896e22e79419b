//! How well the temperature is kept.

use super::plant::{Random, Rig, Spread};

/// Overshoot after heating up, and the farthest from the target over layers, fan and flow.
fn band_and_overshoot(rig: &mut Rig) -> (f64, f64) {
    let target = 200.0;
    rig.on(target);
    rig.heat().unwrap();
    rig.run(60.0).unwrap();
    let overshoot = rig.peak_c - target;
    // Flow and fan begin.
    for _ in 0..4 {
        rig.layer(|_| {}).unwrap();
    }
    let mut band = 0.0_f64;
    for _ in 0..4 {
        rig.layer(|rig| band = band.max((rig.block_c - target).abs())).unwrap();
    }
    (band, overshoot)
}

#[test]
fn layers_are_laid_within_the_band() {
    let (mut band, mut overshoot) = (0.0_f64, 0.0_f64);
    for seed in 0..60 {
        let spread = Spread::of(&mut Random::new(seed), 0.1);
        let (farthest, over) = band_and_overshoot(&mut Rig::new(spread, seed));
        (band, overshoot) = (band.max(farthest), overshoot.max(over));
    }
    std::println!("within {band:.2} C of the target, overshoot {overshoot:.2} C");
    assert!(band < 1.5 && overshoot < 4.0, "band {band}, overshoot {overshoot}");
}

#[test]
fn gains_that_were_found_keep_the_band() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let spread = Spread::of(&mut random, 0.3);
        let mut rig = Rig::new(spread, seed);
        rig.heater.tune(200.0, rig.now);
        let tuned = loop {
            if let Err(fault) = rig.step() {
                std::println!("TUNE {seed} {fault:?} at {} s, {} C {spread:?}", rig.now as f64 * 1e-6, rig.block_c);
                break None;
            }
            if let Some(tuned) = rig.heater.take_tuned() {
                break Some(tuned);
            }
        };
        let Some(tuned) = tuned else { continue };
        let peak = rig.peak_c;
        let took = rig.now as f64 * 1e-6;
        let heater = &mut rig.robot.heater;
        (heater.kp, heater.ki, heater.kd) = (tuned.gains.kp, tuned.gains.ki, tuned.gains.kd);
        rig.heater.switch_off();
        rig.run(900.0).unwrap();
        rig.peak_c = 0.0;
        let r = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| band_and_overshoot(&mut rig)));
        std::println!("TUNE {seed} peak {peak:.1} took {took:.0} {tuned:?} band {r:.2?} {spread:?}");
    }
}
