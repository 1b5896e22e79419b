//! A growth without faults raises no alarm, and its nozzle keeps its temperature. `GROWBOT_HOURS` is the simulated time
//! with each plant, hours, by default 12:
//! `GROWBOT_HOURS=1000 cargo test --release -p growbot-tests --test it no_false_alarms:: -- --nocapture`.

use growbot_tests::fault_campaign::growth::Plant;
use growbot_tests::normal_growth;

fn grow(plant: Plant) {
    let hours = std::env::var("GROWBOT_HOURS").ok().and_then(|text| text.parse().ok()).unwrap_or(12.0);
    let seen = normal_growth::run(plant, hours);
    println!(
        "{plant:?}: {:.0} h, {} layers, {} false alarms; while growing within {:.2} C of the target, overshoot {:.2} C; furthest: {:?}",
        seen.seconds / 3600.0,
        seen.layers,
        seen.false_alarms.len(),
        seen.furthest.above_c.abs(),
        seen.overshoot_c,
        seen.furthest
    );
    assert!(seen.false_alarms.is_empty(), "seeds and faults: {:?}", seen.false_alarms);
    assert!(seen.furthest.above_c.abs() <= 1.5, "too far from the target while growing: {:?}", seen.furthest);
    assert!(seen.overshoot_c < 4.0, "{} C above the target", seen.overshoot_c);
}

#[test]
fn hours_of_growth_with_a_lumped_nozzle_raise_no_alarm() {
    grow(Plant::Lump);
}

#[test]
fn hours_of_growth_with_a_cartridge_raise_no_alarm() {
    grow(Plant::Cartridge);
}
