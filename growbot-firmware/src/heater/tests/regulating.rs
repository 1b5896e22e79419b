//! Tests of the precision of the temperature control.

use growbot_core::link::message::{Fault, Tuned};

use super::plant::{Random, Rig, Spread, Wrong};

/// Returns the largest distance from the target while layers are laid, with fan and flow, and the overshoot after
/// heating up, degrees.
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
fn temperature_stays_in_the_band_while_laying_layers() {
    let (mut band, mut overshoot) = (0.0_f64, 0.0_f64);
    for seed in 0..60 {
        let spread = Spread::of(&mut Random::new(seed), 0.1);
        let (farthest, over) = band_and_overshoot(&mut Rig::new(spread, seed));
        (band, overshoot) = (band.max(farthest), overshoot.max(over));
    }
    std::println!("within {band:.2} C of the target, overshoot {overshoot:.2} C");
    assert!(band < 1.5 && overshoot < 4.0, "band {band}, overshoot {overshoot}");
}

/// Tunes a nozzle at 200 C. Returns the result, or the fault that ends the tuning.
fn tune(rig: &mut Rig) -> Result<Tuned, Fault> {
    rig.heater.tune(200.0, rig.now);
    loop {
        rig.step()?;
        if let Some(tuned) = rig.heater.take_tuning_result() {
            assert_eq!((rig.heater.target(), rig.heater.duty()), (None, 0.0), "it is off when it is done");
            // A nozzle with lag swings like this about a hysteresis of 0.4 C or more.
            assert!((0.4..5.0).contains(&tuned.amplitude_c), "{tuned:?}");
            return Ok(tuned);
        }
        assert!(rig.peak_c < 215.0 && rig.now < 600_000_000);
    }
}

#[test]
fn tuned_gains_keep_the_temperature_in_the_band() {
    let (mut found, mut band, mut overshoot) = (0, 0.0_f64, 0.0_f64);
    for seed in 0..40 {
        let spread = Spread::of(&mut Random::new(seed), 0.3);
        let mut rig = Rig::new(spread, seed);
        let tuned = match tune(&mut rig) {
            Ok(tuned) => tuned,
            Err(fault) => {
                // The nozzle differs so much from its description that the supervision cannot distinguish it from a
                // fault.
                let strength = spread.power / spread.capacity;
                let strange = match fault {
                    Fault::HeaterStuckOn => strength > 1.3,
                    Fault::HeatingTooSlow => strength < 0.75 || spread.loss / spread.power > 1.5,
                    _ => false,
                };
                assert!(strange, "{fault:?} with {spread:?}");
                continue;
            }
        };
        let mut rig = Rig::new(Spread::of(&mut Random::new(seed), 0.3), seed + 1000);
        let heater = &mut rig.robot.heater;
        (heater.kp, heater.ki, heater.kd) = (tuned.gains.kp, tuned.gains.ki, tuned.gains.kd);
        // As for any robot, the model must be right within 10 %.
        heater.power_w *= spread.power;
        heater.heat_capacity_j_per_k *= spread.capacity;
        heater.loss_w_per_k *= spread.loss;
        (rig.spread.power, rig.spread.capacity, rig.spread.loss) = (1.0, 1.0, 1.0);
        let (farthest, over) = band_and_overshoot(&mut rig);
        (found, band, overshoot) = (found + 1, band.max(farthest), overshoot.max(over));
    }
    std::println!("{found} tuned: within {band:.2} C of the target, overshoot {overshoot:.2} C");
    assert!(found > 25 && band < 1.5 && overshoot < 4.0, "{found} found: band {band}, overshoot {overshoot}");
}

#[test]
fn a_sensor_failure_ends_the_tuning() {
    for seed in 0..20 {
        for wrong in [Wrong::Frozen, Wrong::Stuck, Wrong::Open, Wrong::Detached(5.0, 0.3), Wrong::HeaterOpen] {
            let mut rig = Rig::new(Spread::of(&mut Random::new(seed), 0.1), seed);
            rig.heater.tune(200.0, rig.now);
            let whole = rig.random.between(5.0, 60.0);
            rig.run(whole).unwrap();
            rig.wrong = wrong;
            let fault = tune_to_fault(&mut rig);
            assert!(fault.is_some() && rig.peak_c < 245.0, "{wrong:?}, seed {seed}: {fault:?}, {}", rig.peak_c);
        }
    }
}

#[test]
fn a_reading_without_a_swing_for_90_s_ends_the_tuning() {
    // The power that holds 60 degrees is so low that supervision expects no change in the time that it compares.
    let mut rig = Rig::new(Spread { noise: 1.0, ..Spread::of(&mut Random::new(1), 0.0) }, 1);
    rig.heater.tune(60.0, rig.now);
    while rig.heater.tuning.is_some_and(|relay| relay.swing_s().is_none()) {
        rig.step().unwrap();
    }
    rig.wrong = Wrong::Stuck;
    let begin = rig.now;
    assert_eq!(tune_to_fault(&mut rig), Some(Fault::ThermistorFrozen));
    let seconds = (rig.now - begin) as f64 * 1e-6;
    assert!((89.0..=91.0).contains(&seconds), "after {seconds} s");
}

/// Continues the tuning until a fault is raised. Returns the fault, or `None` if there is none within 3000 periods.
fn tune_to_fault(rig: &mut Rig) -> Option<Fault> {
    (0..3000).find_map(|_| rig.step().err())
}
