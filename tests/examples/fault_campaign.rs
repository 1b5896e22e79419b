//! Runs the whole fault campaign: every fault, every onset, and COPIES variations of the robot with each plant, by
//! default 50. Prints the table of docs/safety-evidence.md.
//!
//! ```text
//! cargo fault-campaign [COPIES]
//! ```

use growbot_tests::fault_campaign::cases::Case;
use growbot_tests::fault_campaign::growth::Plant;
use growbot_tests::fault_campaign::{mismatches, run, table};

fn main() {
    let copies = std::env::args().nth(1).map_or(50, |text| text.parse().expect("COPIES is a whole number"));
    let [lump, cartridge] = Plant::ALL.map(|plant| run(plant, &Case::all(), 0..copies));
    println!("{}", table::markdown(&lump, &cartridge));
    let wrong = [mismatches(Plant::Lump, &lump), mismatches(Plant::Cartridge, &cartridge)].concat();
    for why in &wrong {
        eprintln!("{why}");
    }
    let growths: usize = lump.iter().chain(&cartridge).map(|(_, seen)| seen.len()).sum();
    eprintln!("{growths} growths, {} not as they should be", wrong.len());
    assert!(wrong.is_empty(), "see above");
}
