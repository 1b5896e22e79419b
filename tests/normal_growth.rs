//! Where nothing is wrong there is no alarm, and the nozzle keeps its temperature. GROWBOT_HOURS of simulated growth, 20 unless
//! it says otherwise: `GROWBOT_HOURS=1000 cargo test --release -p growbot-tests --test normal_growth -- --nocapture`.

use growbot_tests::normal_growth;

#[test]
fn hours_of_growth_raise_no_alarm_and_keep_their_temperature() {
    let hours = std::env::var("GROWBOT_HOURS").ok().and_then(|text| text.parse().ok()).unwrap_or(20.0);
    let seen = normal_growth::run(hours);
    println!(
        "{:.0} h, {} layers, {} false alarms; while growing within {:.2} C of the target, overshoot {:.2} C",
        seen.seconds / 3600.0,
        seen.layers,
        seen.false_alarms.len(),
        seen.furthest_c,
        seen.overshoot_c
    );
    assert!(seen.false_alarms.is_empty(), "seeds and faults: {:?}", seen.false_alarms);
    assert!(seen.furthest_c <= 1.5, "{} C from the target while growing", seen.furthest_c);
    assert!(seen.overshoot_c < 4.0, "{} C above the target", seen.overshoot_c);
}
