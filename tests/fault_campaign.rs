//! Every fault at every time of a growth is noticed with the right code, before the nozzle gets too hot.
//!
//! This test runs a part of the campaign. `cargo fault-campaign` runs all of it for docs/safety-evidence.md.

use growbot_tests::fault_campaign::cases::Case;
use growbot_tests::fault_campaign::growth::Plant;
use growbot_tests::fault_campaign::{mismatches, run, table};

/// Seeds of the robot's variations for each case and plant.
const SEEDS: std::ops::Range<u64> = 0..2;

#[test]
fn every_fault_is_detected_in_time_with_the_right_code() {
    let [lump, cartridge] = Plant::ALL.map(|plant| run(plant, &Case::all(), SEEDS));
    println!("{}", table::markdown(&lump, &cartridge));
    let wrong = [mismatches(Plant::Lump, &lump), mismatches(Plant::Cartridge, &cartridge)].concat();
    assert!(wrong.is_empty(), "{} growths went wrong:\n{}", wrong.len(), wrong.join("\n"));
}
