//! The whole fault campaign: every fault, every onset, COPIES copies of the robot (50). Prints the table of SAFETY.md.
//!
//! ```text
//! cargo fault-campaign [COPIES]
//! ```

use growbot_tests::fault_campaign::cases::Case;
use growbot_tests::fault_campaign::{growth, run, table};

fn main() {
    let copies = std::env::args().nth(1).map_or(50, |text| text.parse().expect("COPIES is a whole number"));
    let robot = growth::robot();
    let rows = run(&Case::all(), 0..copies);
    println!("{}", table::markdown(&rows));
    let mut wrong = 0;
    for (case, seen) in &rows {
        for (seed, why) in seen.iter().enumerate().filter_map(|(seed, one)| Some((seed, one.wrong(case, &robot)?))) {
            eprintln!("{case:?}, seed {seed}: {why}");
            wrong += 1;
        }
    }
    let growths: usize = rows.iter().map(|(_, seen)| seen.len()).sum();
    eprintln!("{growths} growths, {wrong} not as they should be");
    assert_eq!(wrong, 0, "see above");
}
