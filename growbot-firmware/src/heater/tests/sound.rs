//! No false alarms.

use super::plant::{Random, Rig, Spread};

#[test]
fn a_sound_nozzle_raises_no_alarm() {
    let mut bad = 0;
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let spread = Spread { measured: random.of(&[true, true, false]), ..Spread::of(&mut random, 0.1) };
        let mut rig = Rig::new(spread, seed);
        if seed % 5 == 0 {
            rig.spread.noise = rig.spread.noise.max(0.5);
            rig.breaks(super::plant::Wrong::NoFlow);
        }
        if let Err(fault) = rig.live(1.0) {
            bad += 1;
            std::println!("{:?} {fault:?} after {:.1} s, target {:?} reading {:?} block {:.1} flow {:.1} duty {:.2} {spread:?}", rig.wrong, rig.now as f64 * 1e-6, rig.heater.target(), rig.heater.temperature(rig.now), rig.block_c, rig.flow, rig.heater.duty());
        }
    }
    assert_eq!(bad, 0);
}
