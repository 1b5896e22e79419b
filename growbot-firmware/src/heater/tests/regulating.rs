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
    for seed in 0..150 {
        let spread = Spread::of(&mut Random::new(seed), 0.1);
        let (farthest, over) = band_and_overshoot(&mut Rig::new(spread, seed));
        (band, overshoot) = (band.max(farthest), overshoot.max(over));
    }
    std::println!("within {band:.2} C of the target, overshoot {overshoot:.2} C");
    assert!(band < 1.5 && overshoot < 4.0, "band {band}, overshoot {overshoot}");
}
