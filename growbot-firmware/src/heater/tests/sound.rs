//! Tests that a healthy nozzle raises no false alarm.

use super::plant::{Random, Rig, Spread, Wrong};
use crate::testing::number_from_environment;

/// Runs a healthy nozzle for an hour for each seed. For a third of the nozzles the supply is not measured. For a sixth
/// of them filament and fan take no heat, as in a jam.
fn live(seeds: core::ops::Range<u64>) {
    for seed in seeds {
        let mut random = Random::new(seed);
        let spread = Spread { measured: random.of(&[true, true, false]), ..Spread::of(&mut random, 0.1) };
        let mut rig = Rig::new(spread, seed);
        if seed % 6 == 5 {
            rig.spread.noise = rig.spread.noise.max(0.5);
            rig.wrong = Wrong::NoFlow;
        }
        let lived = rig.live(1.0);
        let (at, celsius) = (rig.now as f64 * 1e-6, rig.block_c);
        assert_eq!(lived, Ok(()), "seed {seed} after {at} s at {celsius} C, flow {}: {:?}", rig.flow, rig.spread);
        assert!(rig.peak_c < rig.robot.heater.max_c - 20.0, "seed {seed}: {}", rig.peak_c);
    }
}

/// Tests for GROWBOT_HOURS hours, by default 40. A thousand hours take minutes.
#[test]
fn a_healthy_nozzle_raises_no_alarm() {
    live(0..number_from_environment("GROWBOT_HOURS", 40));
}
